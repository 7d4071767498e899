"""What every filter promises, whichever it is: the protocol test that all of `FILTERS` pass."""

from typing import Any

import numpy as np
import pytest

from tests.mechanics.models import CHAIN_VALUES, Reads, chain, chain_sensors, duffing, symbols
from windsysid.filters import FILTERS, Filter, Info
from windsysid.mechanics import RotorModel
from windsysid.mechanics.equations import Equations
from windsysid.simulation.integrate import integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.process import LoadBlock
from windsysid.turbine.file import load_turbine


def rotor_with_everything() -> StateSpace:
    """The joint formulation: loads, biases and ten coefficients beside the motion."""
    turbine = load_turbine("verne555")
    sensors = tuple(s.model_copy(update={"bias": 0.2 * (i % 2)}) for i, s in enumerate(turbine.sensors))
    return compose(
        turbine.model,
        rate=100.0,
        values=turbine.values,
        parameters=[
            Parameter(name, value, 0.3) if name[0] == "k" else Parameter(name, value, 0.3 * value, False, 300.0)
            for name, value in turbine.coefficients.items()
        ],
        loads=turbine.loads,
        sensors=sensors,
        cov=np.diag([1e-3] * 5 + [1e-1] * 5) ** 2,
        walk={"k_x": 1e-3},
    )


def loads_that_turn() -> StateSpace:
    """Blade forces that shake the hub: a correlated second-order block whose output turns with the rotor."""
    turbine = load_turbine("verne555")
    swing = np.array([[0.0, 1.0], [-9.0, -2.0]])
    rows = np.array([[[1.0, 0.0]], [[0.0, 0.3]], [[0.4, 0.0]]]).reshape(3, 2)
    block = LoadBlock(("gust", "gust_rate"), swing, np.diag([4.0, 36.0]), {"load_x": rows, "load_beta_1": rows[:1]})
    return compose(
        turbine.model, rate=100.0, values=turbine.values, loads=[*turbine.loads, block], sensors=turbine.sensors,
        cov=np.diag([1e-3] * 5 + [1e-1] * 5) ** 2,
    )  # fmt: skip


def chain_with(**blocks: Any) -> StateSpace:
    """The chain of masses with the given blocks and no others."""
    given: dict[str, Any] = {"rate": 50.0, "values": CHAIN_VALUES, "sensors": chain_sensors()}
    return compose(chain(), **(given | blocks))


LOADS = (GaussMarkov("load_1", 5.0, 0.5), GaussMarkov("load_3", 2.0, 1.5))


def without_mechanics() -> StateSpace:
    """No motion at all: a straight line a + b t is fitted, t being an input."""
    a, b, t = symbols("a b t")
    model = Equations("line", (), (t,), (a, b), (), ())
    return compose(
        model,
        rate=10.0,
        values={},
        parameters=[Parameter("a", 1.0, 1.0, False), Parameter("b", 1.0, 1.0, False)],
        sensors=(Reads("line", a + b * t, 0.1),),
    )


def nothing_but_a_load() -> StateSpace:
    """No states of its own, no parameters: a load that is read directly."""
    (w,) = symbols("w")
    model = Equations("load_cell", (), (), (), (w,), ())
    return compose(
        model, rate=10.0, values={}, loads=[GaussMarkov("w", 2.0, 1.0)], sensors=(Reads("cell", 3 * w, 0.1, 0.5),)
    )


MODELS = {
    "rotor_with_everything": rotor_with_everything,
    "chain_without_loads_parameters_biases": chain_with,
    "chain_with_loads": lambda: chain_with(loads=LOADS),
    "chain_with_a_bias": lambda: chain_with(sensors=chain_sensors(bias=0.3)),
    "chain_with_parameters": lambda: chain_with(parameters=[Parameter("k_2", 330.0, 0.2)]),
    "chain_sampled_unequally": lambda: chain_with(loads=LOADS, rate=None, intervals=[0.02, 0.005, 0.033]),
    "loads_that_turn": loads_that_turn,
    "chain_with_a_gate": lambda: chain_with(loads=LOADS, gate=2.0),
    "chain_without_sensors": lambda: chain_with(sensors=(), loads=LOADS),
    "blades_locked": lambda: compose(
        RotorModel(3, lag="locked"),
        rate=100.0,
        values=load_turbine("verne555").values,
        sensors=load_turbine("verne555").sensors[:2],
    ),
    "duffing": lambda: compose(
        duffing(),
        rate=50.0,
        values={"a": 4.0, "b": 30.0, "c": 0.3},
        parameters=[Parameter("b", 20.0, 0.5)],
        sensors=(Reads("q", symbols("q")[0], 0.01),),
        cov=np.diag([0.1, 0.1]),
    ),
    "without_mechanics": without_mechanics,
    "nothing_but_a_load": nothing_but_a_load,
}

every_filter = pytest.mark.parametrize("filter_", FILTERS, ids=lambda f: f.name.replace(" ", "_"))
every_model = pytest.mark.parametrize("name", MODELS)


def record(model: StateSpace, samples: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and readings of a plausible size, some of them missing; what they are does not matter here."""
    rng = np.random.default_rng(21)
    inputs = 0.1 * rng.standard_normal((samples, len(model.inputs)))
    if model.inputs[:1] == ("rotor_azimuth",):
        inputs[:, :3] = [[7.0 * k * model.blocks.step[0], 7.0, 0.0] for k in range(samples)]
    if model.inputs[-1:] == ("interval",):
        inputs[:, -1] = rng.integers(model.blocks.step.size, size=samples)
    readings = np.sqrt(model.blocks.noise) * 3.0 * rng.standard_normal((samples, len(model.readings)))
    readings[rng.random(readings.shape) < 0.1] = np.nan
    readings[17] = np.nan
    return inputs, readings


def assert_same(one: Any, other: Any) -> None:
    """Bit for bit."""
    for name, a, b in zip(one._fields, one, other, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)


@every_filter
@every_model
def test_whatever_is_composed_runs_and_stays_finite(filter_: Filter, name: str):
    model = MODELS[name]()
    inputs, readings = record(model)
    belief, info = filter_.run(model, filter_.init(model), inputs, readings)
    assert belief.samples == 40
    assert belief.mean.shape == (len(model.states),)
    assert info.mean.shape == info.std.shape == (40, len(model.states))
    assert info.innovation.shape == info.innovation_std.shape == info.whitened.shape == readings.shape
    assert info.log_likelihood.shape == (40,)
    for array in (belief.mean, belief.cov, info.mean, info.std, info.log_likelihood):
        assert np.isfinite(array).all()
    for array in (info.innovation, info.innovation_std):
        np.testing.assert_array_equal(np.isnan(array), np.isnan(readings))
    for array in (info.whitened, info.whitening_std):
        np.testing.assert_array_equal(np.isnan(array), np.isnan(readings) | info.gated)
    assert info.gated.any() == (name == "chain_with_a_gate")
    np.testing.assert_array_equal(belief.cov, belief.cov.T)
    np.testing.assert_array_equal(info.mean[-1], belief.mean)
    np.testing.assert_allclose(info.std[-1] ** 2, np.diag(belief.cov), rtol=1e-14)
    if len(model.states):
        scale = np.sqrt(np.diag(belief.cov))
        assert np.linalg.eigvalsh(belief.cov / np.outer(scale, scale)).min() > -1e-12


@every_filter
@every_model
def test_step_is_run_with_one_sample(filter_: Filter, name: str):
    model = MODELS[name]()
    inputs, readings = record(model)
    whole, info = filter_.run(model, filter_.init(model), inputs, readings)
    belief, infos = filter_.init(model), []
    for u, y in zip(inputs, readings, strict=True):
        belief, one = filter_.step(model, belief, u, y)
        infos.append(one)
    assert_same(belief, whole)
    assert_same(Info(*(np.concatenate(parts) for parts in zip(*infos, strict=True))), info)


@every_filter
@every_model
@pytest.mark.parametrize("cut", [0, 1, 17, 40])
def test_a_run_can_stop_and_go_on_from_its_belief(filter_: Filter, name: str, cut: int):
    model = MODELS[name]()
    inputs, readings = record(model)
    whole, info = filter_.run(model, filter_.init(model), inputs, readings)
    belief, first = filter_.run(model, filter_.init(model), inputs[:cut], readings[:cut])
    belief, second = filter_.run(model, belief, inputs[cut:], readings[cut:])
    assert_same(belief, whole)
    assert_same(Info(*(np.concatenate(parts) for parts in zip(first, second, strict=True))), info)


@every_filter
@every_model
def test_predict_then_update_is_step(filter_: Filter, name: str):
    model = MODELS[name]()
    inputs, readings = record(model)
    belief = filter_.init(model)
    for u, y in zip(inputs[:20], readings[:20], strict=True):
        stepped, step_info = filter_.step(model, belief, u, y)
        predicted = filter_.predict(model, belief, u)
        assert predicted.samples == belief.samples + 1
        belief, update_info = filter_.update(model, predicted, y)
        assert_same(belief, stepped)
        assert_same(update_info, step_info)


@every_filter
def test_the_first_prediction_stays_at_the_prior(filter_: Filter):
    model = rotor_with_everything()
    belief = filter_.predict(model, filter_.init(model), record(model)[0][0])
    np.testing.assert_array_equal(belief.mean, model.mean)
    np.testing.assert_array_equal(belief.cov, model.cov)


@every_filter
@every_model
def test_nothing_handed_in_is_changed(filter_: Filter, name: str):
    model = MODELS[name]()
    inputs, readings = record(model)
    start, _ = filter_.run(model, filter_.init(model), inputs[:5], readings[:5])
    given = (start.mean, start.cov, start.inputs, inputs, readings, model.mean, model.cov, *model.blocks)
    before = [array.copy() for array in given]
    inputs.flags.writeable = readings.flags.writeable = False  # as a file mapped into memory is
    filter_.run(model, start, inputs, readings)
    filter_.step(model, start, inputs[0], readings[0])
    filter_.update(model, filter_.predict(model, start, inputs[0]), readings[0])
    filter_.init(model).mean[:] = 7.0
    filter_.init(model).cov[:] = 7.0
    for array, copy in zip(given, before, strict=True):
        np.testing.assert_array_equal(array, copy)


@every_filter
def test_a_belief_does_not_share_memory_with_the_record(filter_: Filter):
    model = chain_with(loads=LOADS)
    inputs, readings = record(model)
    belief, _ = filter_.run(model, filter_.init(model), inputs, readings)
    kept = belief.inputs.copy()
    inputs[:] = 99.0
    np.testing.assert_array_equal(belief.inputs, kept)


@every_filter
def test_a_channel_of_nan_is_a_model_without_that_channel(filter_: Filter):
    everything = rotor_with_everything()
    turbine = load_turbine("verne555")
    inputs, readings = record(everything)
    readings[:, 2] = np.nan
    kept = [0, 1, 3, 4]
    sensors = tuple(turbine.sensors[i].model_copy(update={"bias": 0.2 * (i % 2)}) for i in kept)
    fewer = compose(
        turbine.model,
        rate=100.0,
        values=turbine.values,
        parameters=everything.parameters,
        loads=turbine.loads,
        sensors=sensors,
        cov=np.diag([1e-3] * 5 + [1e-1] * 5) ** 2,
        walk={"k_x": 1e-3},
    )
    assert fewer.states == everything.states
    belief, info = filter_.run(everything, filter_.init(everything), inputs, readings)
    other, other_info = filter_.run(fewer, filter_.init(fewer), inputs, readings[:, kept])
    scale = np.sqrt(np.diag(belief.cov))
    np.testing.assert_allclose(belief.mean / scale, other.mean / scale, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(belief.cov / np.outer(scale, scale), other.cov / np.outer(scale, scale), atol=1e-12)
    np.testing.assert_allclose(info.log_likelihood, other_info.log_likelihood, rtol=1e-12, atol=1e-12)


@every_filter
@every_model
def test_a_sample_without_readings_is_a_prediction(filter_: Filter, name: str):
    model = MODELS[name]()
    assert_a_sample_without_readings_is_a_prediction(filter_, model, *record(model))


def assert_a_sample_without_readings_is_a_prediction(
    filter_: Any, model: StateSpace, inputs: np.ndarray, readings: np.ndarray
) -> None:
    belief, _ = filter_.run(model, filter_.init(model), inputs[:10], readings[:10])
    predicted = filter_.predict(model, belief, inputs[10])
    stepped, info = filter_.step(model, belief, inputs[10], np.full(len(model.readings), np.nan))
    assert_same(stepped, predicted)
    assert info.log_likelihood[0] == 0.0
    assert np.isnan(info.innovation).all()


@every_filter
def test_more_readings_never_make_a_linear_model_less_certain(filter_: Filter):
    model = chain_with(loads=LOADS)
    inputs, readings = record(model)
    readings = np.nan_to_num(readings)
    _, full = filter_.run(model, filter_.init(model), inputs, readings)
    readings[:, 1] = np.nan
    _, fewer = filter_.run(model, filter_.init(model), inputs, readings)
    assert np.all(full.std <= fewer.std * (1 + 1e-12))
    assert np.any(full.std < 0.9 * fewer.std)


@every_filter
def test_a_line_is_fitted_as_by_least_squares(filter_: Filter):
    # Without mechanics the filter is recursive least squares with a prior: known in closed form.
    model = without_mechanics()
    rng = np.random.default_rng(22)
    t = np.linspace(0.0, 2.0, 30)
    y = 0.5 + 2.0 * t + 0.1 * rng.standard_normal(30)
    belief, _ = filter_.run(model, filter_.init(model), t[:, None], y[:, None])
    X = np.column_stack([np.ones(30), t])
    information = np.eye(2) + X.T @ X / 0.1**2
    np.testing.assert_allclose(belief.mean, np.linalg.solve(information, np.ones(2) + X.T @ y / 0.1**2), rtol=1e-9)
    np.testing.assert_allclose(belief.cov, np.linalg.inv(information), rtol=1e-9)


@every_filter
def test_a_parameter_that_walks_grows_less_certain_by_its_walk(filter_: Filter):
    still = chain_with(parameters=[Parameter("k_2", 330.0, 0.2)])
    walking = chain_with(parameters=[Parameter("k_2", 330.0, 0.2)], walk={"k_2": 0.05})
    inputs = np.zeros((101, 3))
    nothing = np.full((101, 3), np.nan)
    variance = [
        f[1].std[-1, -1] ** 2 for f in (filter_.run(m, filter_.init(m), inputs, nothing) for m in (still, walking))
    ]
    assert variance[0] == pytest.approx(0.2**2, rel=1e-12)
    assert variance[1] == pytest.approx(0.2**2 + 0.05**2 * 2.0, rel=1e-12)  # 100 steps of 1/50 s


@every_filter
@pytest.mark.parametrize(("inputs", "readings"), [((5, 2), (5, 3)), ((5, 3), (5, 2)), ((5, 3), (4, 3))])
def test_shapes_that_do_not_fit_are_named(filter_: Filter, inputs: tuple[int, int], readings: tuple[int, int]):
    model = chain_with()
    with pytest.raises(ValueError, match=r"expected inputs \(T, 3\) and readings \(T, 3\), got"):
        filter_.run(model, filter_.init(model), np.zeros(inputs), np.zeros(readings))


@every_filter
def test_a_wrong_model_is_less_likely_than_the_right_one(filter_: Filter):
    # So that the likelihood can be used to choose: a stiffness 30 % off loses against the true one.
    right = chain_with(loads=LOADS)
    rng = np.random.default_rng(23)
    loads = draw_loads(LOADS, right.compiled.loads, 500, 50.0, rng)
    clean = integrate(right.compiled, right.blocks.p, loads, rate=50.0, start=np.zeros(6), substeps=8).readings
    readings = clean + np.sqrt(right.blocks.noise) * rng.standard_normal(clean.shape)
    wrong = chain_with(loads=LOADS, values=CHAIN_VALUES | {"k_1": 1.3 * CHAIN_VALUES["k_1"]})
    inputs = np.zeros((500, 3))
    likely, unlikely = (
        filter_.run(m, filter_.init(m), inputs, readings)[1].log_likelihood.sum() for m in (right, wrong)
    )
    assert likely > unlikely + 10.0


def test_every_filter_has_its_own_name():
    assert len({f.name for f in FILTERS}) == len(FILTERS)
    assert all(isinstance(f, Filter) for f in FILTERS)


def test_the_models_above_cover_every_empty_block():
    sizes = np.array([model().blocks.sizes[:4] for model in MODELS.values()])
    assert np.all(sizes.min(axis=0) == 0)
    assert np.all(sizes.max(axis=0) > 0)

"""The front door for one's own equations: equal to SciPy's least squares, noise and loads learned, bad input refused in
one line."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import scipy.signal
import sympy as sp

from tests.findings import only, reasons
from windsysid import ConfigurationError, Record, RecordError
from windsysid.mechanics.compile import compile_model
from windsysid.models import Equations, Fit, GaussMarkov, Parameter, Reading, fit
from windsysid.signals import resample
from windsysid.simulation.integrate import integrate
from windsysid.simulation.random_loads import draw_loads, draw_within_steps
from windsysid.statespace.process import load_on, second_order

RATE = 100.0
TRUTH = {"m": 2.0, "c": 0.8, "k": 50.0}
NOISE = {"position": 0.004, "acceleration": 0.05}

q, v, force = sp.symbols("q v force", real=True)
m, c, k = sp.symbols("m c k", positive=True)
ACCELERATION = (force - c * v - k * q) / m
SPRING = Equations("spring", (q, v), (), (m, c, k), (force,), (v, ACCELERATION))
PARAMETERS = (Parameter("c", 0.4, 1.0, logarithmic=False, scale=20.0), Parameter("k", 20.0, 1.5))
AT_REST = 1e-12 * np.eye(2)


def sensors(factor: float = 1.0) -> tuple[Reading, ...]:
    expressions = {"position": q, "acceleration": ACCELERATION}
    return tuple(Reading(name, expressions[name], factor * noise) for name, noise in NOISE.items())


def shaken(
    samples: int = 1500, seed: int = 0, force: np.ndarray | None = None, within: np.ndarray | None = None
) -> Record:
    """A spring from rest under a force, with two noisy sensors; between samples the force is `within` (T, 1) beside a
    straight line."""
    rng = np.random.default_rng(seed)
    if force is None:
        force = scipy.signal.lfilter([1.0], [1.0, -0.95], rng.standard_normal(samples))
    model = compile_model(SPRING, sensors())
    p = [TRUTH[name] for name in model.parameters]
    exact = integrate(model, p, force[:, None], rate=RATE, start=np.zeros(2), substeps=4, within=within)
    noisy = exact.readings + rng.standard_normal(exact.readings.shape) * list(NOISE.values())
    units = ("N", "m", "m/s^2")
    return Record(np.arange(samples) / RATE, np.column_stack([force, noisy]), ("force", *NOISE), units, name="shaken")


def fitted(record: Record | list[Record], **changes: object) -> Fit:
    options = {"parameters": PARAMETERS, "sensors": sensors(), "cov": AT_REST, "values": {"m": TRUTH["m"]}}
    return fit(SPRING, record, **(options | changes))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def record() -> Record:
    return shaken()


def test_a_fit_is_the_least_squares_solution_of_scipy(record: Record):
    # Without process noise and from a known state the likelihood is that of a regression. SciPy answers by its own
    # simulation, exact for a force that runs linearly, and by its own Gauss–Newton, the priors being two more
    # residuals.
    found = fitted(record, learn_levels=False)

    def residuals(theta: np.ndarray) -> np.ndarray:
        damping, stiffness = 20.0 * theta[0], 20.0 * np.exp(theta[1])
        A = np.array([[0.0, 1.0], [-stiffness / 2.0, -damping / 2.0]])
        system = (A, [[0.0], [0.5]], [[1.0, 0.0], A[1]], [[0.0], [0.5]])
        _, y, _ = scipy.signal.lsim(system, record["force"], record.time)
        off = [(y[:, i] - record[name]) / noise for i, (name, noise) in enumerate(NOISE.items())]
        return np.concatenate([*off, [(theta[0] - 0.02) / 0.05, theta[1] / 1.5]])

    solution = scipy.optimize.least_squares(residuals, [0.04, np.log(2.5)], x_scale=[1e-3, 1e-3])
    J = np.asarray(solution.jac)
    cov = np.linalg.inv(J.T @ J)
    theta = np.array([q.coordinate(found[q.name].estimate) for q in PARAMETERS])
    # a step of RK4 errs by (ωh)⁴/120 in the frequency: 5e-8 here, a standard deviation being 4e-5
    np.testing.assert_allclose((theta - solution.x) / np.sqrt(np.diag(cov)), 0.0, atol=0.01)
    wider = np.sqrt(np.diag(found.cov) / np.diag(cov))  # as parts of the record contradict each other by chance
    assert np.all((wider > 0.99) & (wider < 1.05))
    np.testing.assert_allclose(found.cov, cov * np.outer(wider, wider), rtol=0.01)
    for estimate in found.estimates:
        assert estimate.low < TRUTH[estimate.name] < estimate.high
    noise = list(NOISE.values())
    gauss = -0.5 * np.sum(solution.fun[:-2] ** 2) - np.sum(np.log(noise)) * record.samples
    assert found.log_likelihood == pytest.approx(gauss - np.log(2.0 * np.pi) * record.samples, abs=0.1)


@pytest.mark.parametrize("factor", [0.02, 50.0])
def test_noise_is_learned_whatever_was_guessed(record: Record, factor: float):
    told, guessed = fitted(record), fitted(record, sensors=sensors(factor))
    for name in ("c", "k"):
        assert guessed[name].estimate == pytest.approx(told[name].estimate, abs=0.1 * told[name].std)
        assert guessed[name].std == pytest.approx(told[name].std, rel=0.02)
    for statistic, noise in zip(guessed.statistics, NOISE.values(), strict=True):
        assert statistic.given == pytest.approx(factor * noise)
        # relative standard error of an rms of T samples: 1/√(2T) = 1.8 %
        assert statistic.estimate == pytest.approx(noise, rel=0.06)
        assert statistic.low < statistic.estimate < statistic.high
    assert [s.unit for s in guessed.statistics] == ["m", "m/s^2"]


def test_the_level_of_a_load_that_nobody_measured_is_learned():
    load = GaussMarkov("force", 3.0, 0.5)
    drawn = draw_loads([load], ("force",), 6000, RATE, np.random.default_rng(5))
    within = draw_within_steps([load], ("force",), 6000, RATE, np.random.default_rng(8))
    record = shaken(6000, 5, drawn[:, 0], within).select(list(NOISE))
    found = fitted(record, loads=[GaussMarkov("force", 3.0 / 5.0, 0.5)])
    rms = found.statistics[-1]
    assert rms.name == "rms_force"
    assert rms.given == pytest.approx(0.6)
    assert rms.low < 3.0 < rms.high
    assert rms.high < 1.5 * rms.low
    assert found["k"].low < TRUTH["k"] < found["k"].high
    assert found["c"].low < TRUTH["c"] < found["c"].high
    seen = found.state_mean[500:, found.states.index("force")]
    assert np.corrcoef(seen, drawn[500:, 0])[0, 1] > 0.9


def test_a_load_scaled_by_hand_is_the_load_that_was_learned():
    # The level must act on the load's noise and on its first covariance alike.
    load = GaussMarkov("force", 3.0, 0.5)
    drawn = draw_loads([load], ("force",), 1500, RATE, np.random.default_rng(6))
    record = shaken(1500, 6, drawn[:, 0]).select(list(NOISE))
    learned = fitted(record, loads=[GaussMarkov("force", 1.0, 0.5)])
    by_hand = [GaussMarkov("force", learned.statistics[-1].estimate, 0.5)]
    noise = [s.estimate for s in learned.statistics[:2]]
    exact = [Reading(s.channel, s.expression, n) for s, n in zip(sensors(), noise, strict=True)]
    again = fitted(record, loads=by_hand, sensors=exact, learn_levels=False)
    assert again.log_likelihood == pytest.approx(learned.log_likelihood, abs=0.05)
    assert again["k"].estimate == pytest.approx(learned["k"].estimate, abs=0.1 * learned["k"].std)


def test_missing_readings_are_left_out(record: Record):
    holes = np.random.default_rng(3).random(record.samples) < 0.4
    holes[: record.samples // 10] = True  # nothing of it in all that the first estimate on line knows
    values = np.where(holes, np.nan, record["position"])
    found = fitted(record.with_channels({"position": (values, "m")}))
    assert found["k"].low < TRUTH["k"] < found["k"].high
    assert found["k"].std > fitted(record)["k"].std


def test_inputs_are_found_by_name_or_where_they_are_said_to_be(record: Record):
    renamed = Record(record.time, record.values, ("load_cell", *NOISE), record.units)
    found = fitted(renamed, channels={"force": "load_cell"})
    assert found["k"].estimate == fitted(record)["k"].estimate
    unforced = fitted(
        renamed, values={"m": TRUTH["m"], "force": 0.0}
    )  # said to be zero; the record says that it was not
    assert unforced.diagnosis is not None
    assert not unforced.diagnosis.trusted


def test_a_load_of_which_nothing_is_said_is_refused_and_not_taken_for_zero(record: Record):
    mistyped = Record(record.time, record.values, ("Force", *NOISE), record.units)
    with pytest.raises(ConfigurationError, match=r"load 'force' is not defined.*the record has Force, position, "):
        fitted(mistyped)


def test_a_constant_load_is_a_record_of_that_value(record: Record):
    steady = shaken(force=np.full(1500, 3.0))
    told = fitted(steady.select(list(NOISE)), values={"m": TRUTH["m"], "force": 3.0})
    assert told["k"].estimate == fitted(steady)["k"].estimate


def test_a_record_that_went_through_a_low_pass_has_loads_that_did(record: Record):
    # As if the user had said so of the load, which `identify` does by itself.
    drawn = draw_loads([GaussMarkov("force", 3.0, 0.5)], ("force",), 3000, RATE, np.random.default_rng(7))
    slow = resample(shaken(3000, 7, drawn[:, 0]).select(list(NOISE)), 25.0)
    by_itself = fitted(slow, loads=[GaussMarkov("force", 3.0, 0.5)])
    plain = replace(slow, attributes={})
    told = fitted(plain, loads=[GaussMarkov("force", 3.0, 0.5, low_pass=12.5)])
    assert by_itself["c"].estimate == told["c"].estimate
    assert by_itself.statistics[-1].given == pytest.approx(3.0)
    assert by_itself.states == ("q", "v", "force", "force_rate", "force_acceleration")
    other = fitted(slow, loads=[load_on("force", second_order(3.0, 0.2, 0.7))])
    assert only(other.findings, "low_pass_unknown_to_loads").data["loads"] == ["force_0"]


@pytest.mark.parametrize(("rate", "trusted"), [(8.0, False), (40.0, True)])
def test_steps_too_long_for_a_vibration_are_a_reason_not_to_trust(rate: float, trusted: bool):
    # RK4 damps a motion at ω by (ωh)⁵/144 of the critical: at 1 Hz and 8 samples a period by 0.2 %, nearly all of 0.25
    # %. A free decay in closed form.
    omega, ratio = 2.0 * np.pi, 0.0025
    time = np.arange(0.0, 60.0, 1.0 / rate)
    exact = np.exp(-ratio * omega * time) * np.cos(omega * time)
    noisy = exact + 0.001 * np.random.default_rng(8).standard_normal(len(time))
    found = fit(
        Equations("decay", (q, v), (), (c, k), (), (v, -c * v - k * q)),
        Record(time, noisy[:, None], ("position",), ("m",), name="decay"),
        parameters=(Parameter("c", 0.01 * omega, 0.02, False, omega), Parameter("k", omega**2, 0.3)),
        sensors=(Reading("position", q, 0.001),), cov=np.eye(2), mean=[1.0, 0.0],
    )  # fmt: skip
    lacking = 0.0 if trusted else (omega / rate) ** 5 / 144.0
    assert found["c"].estimate / (2.0 * omega) == pytest.approx(ratio - lacking, abs=2e-4)
    assert found.diagnosis is not None
    told = [reason for reason in reasons(found) if reason.code == "steps_too_long"]
    assert bool(told) != trusted
    if told:
        assert told[0].data["frequency"] == pytest.approx(1.0, rel=0.005)
        assert told[0].data["damping"] == pytest.approx(0.0019, abs=5e-5)


@pytest.mark.slow
def test_damping_is_right_from_records_resampled_to_five_hertz():
    # A tower at 0.35 Hz, damped by 0.25 %, under a broadband load: six records of half an hour, simulated exactly by
    # SciPy's matrix exponential. Without the low-pass in the load's model, as `fit` had it once, damping comes out
    # lower.
    omega, ratio, tau, fine, samples = 2.0 * np.pi * 0.35, 0.0025, 1.0, 50.0, 90_000
    A = np.array([[0.0, 1.0, 0.0], [-(omega**2), -2.0 * ratio * omega, 1.0], [0.0, 0.0, -1.0 / tau]])
    step = scipy.linalg.expm(A / fine)
    stationary = scipy.linalg.solve_continuous_lyapunov(A, -np.diag([0.0, 0.0, 2.0 / tau]))
    sizes, vectors = np.linalg.eigh(stationary - step @ stationary @ step.T)
    root, noise = vectors * np.sqrt(sizes.clip(0.0)), 0.05 * np.sqrt(A[1] @ stationary @ A[1])
    equations = Equations("tower", (q, v), (), (c, k), (force,), (v, force - c * v - k * q))
    found = []
    for seed in range(100, 106):
        rng = np.random.default_rng(seed)
        z, pushes = np.linalg.cholesky(stationary) @ rng.standard_normal(3), rng.standard_normal((samples, 3)) @ root.T
        readings = noise * rng.standard_normal(samples)
        for i, push in enumerate(pushes):
            readings[i] += A[1] @ z
            z = step @ z + push
        record = Record(np.arange(samples) / fine, readings[:, None], ("acceleration",), ("m/s^2",), name=str(seed))
        slow = resample(record, 5.0)
        parameters = (Parameter("c", 0.01 * omega, 0.02, False, omega), Parameter("k", omega**2, 0.3))
        sensors = (Reading("acceleration", force - c * v - k * q, noise),)
        cov, loads = stationary[:2, :2] * np.eye(2), [GaussMarkov("force", 1.0, tau)]
        both = [
            fit(equations, r, parameters=parameters, sensors=sensors, cov=cov, loads=loads)["c"]
            for r in (slow, replace(slow, attributes={}))
        ]
        found.append([(e.estimate / (2.0 * omega), e.std / (2.0 * omega)) for e in both])
    values, sigma = np.moveaxis(np.array(found), 2, 0)
    print("damping ratio [%], with the low-pass and without:", 100.0 * values.mean(axis=0), "truth 0.25")
    assert abs(values[:, 0].mean() - ratio) < 2.5 * np.sqrt(np.mean(sigma[:, 0] ** 2) / len(values))
    assert np.all(np.abs(values[:, 0] - ratio) < 3.5 * sigma[:, 0])
    assert values[:, 1].mean() < 0.9 * values[:, 0].mean()


def test_what_was_known_on_line_ends_at_the_result(record: Record):
    found = fitted(record)
    assert found.mean.shape == found.std.shape == (record.samples, 2)
    low, high = found["k"].low, found["k"].high
    assert low < found.history("k")[0][-1] < high
    assert found.history("k")[0][0] == pytest.approx(20.0)  # the prior's centre, before the first estimate
    widths = found.std[[-1, record.samples // 2, record.samples // 8], 1]
    assert np.all(np.diff(widths) > 0.0)


def test_a_fit_prints_saves_and_draws_like_any_identification(record: Record, tmp_path: Path):
    found = fitted(record)
    text = str(found)
    assert "spring, shaken: fit" in text
    assert "noise_position" in text
    assert "trust: yes" in text
    found.save(tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["parameters"]["k"]["estimate"] == found["k"].estimate
    found.plot().savefig(tmp_path / "histories.png")
    assert found.states == ("q", "v")
    assert found.state_mean.shape == (record.samples, 2)


def test_wrong_equations_are_not_trusted(record: Record):
    hard = Equations("hard", (q, v), (), (m, c, k), (force,), (v, ACCELERATION - 30.0 * q**3 * k))
    reads = (Reading("position", q, 0.004), Reading("acceleration", ACCELERATION - 30.0 * q**3 * k, 0.05))
    found = fit(hard, record, parameters=PARAMETERS, sensors=reads, cov=AT_REST, values={"m": 2.0})
    assert found.diagnosis is not None
    assert not found.diagnosis.trusted
    assert "trust: NO" in str(found)


def test_bad_input_is_refused_in_one_line(record: Record):
    gap = record["force"]
    gap[10:20] = np.nan
    silent = np.full(record.samples, np.nan)
    driven = Equations("driven", (q, v), (force,), (m, c, k), (), SPRING.rates)
    cases = [
        (RecordError, "lacks 10 of 1500 samples", lambda: fitted(record.with_channels({"force": (gap, "N")}))),
        (RecordError, "holds no numbers", lambda: fitted(record.with_channels({"position": (silent, "m")}))),
        (RecordError, "no channel 'position'", lambda: fitted(record.select(["force", "acceleration"]))),
        (ConfigurationError, "'fources' is no input or load", lambda: fitted(record, channels={"fources": "force"})),
        (ConfigurationError, "expected at least one reading", lambda: fitted(record, sensors=())),
        (ConfigurationError, "expected at least one to identify", lambda: fitted(record, parameters=())),
        (ConfigurationError, "parameter 'm': expected a finite value", lambda: fitted(record, values={})),
        (
            RecordError, "no channel 'force'",
            lambda: fit(driven, record.select(list(NOISE)), parameters=PARAMETERS, sensors=sensors(), cov=AT_REST,
            values={"m": 2.0}),
        ),
    ]  # fmt: skip
    for kind, message, call in cases:
        with pytest.raises(kind, match=message) as error:
            call()
        assert "\n" not in str(error.value)


def test_pieces_of_a_record_give_what_the_whole_gives(record: Record):
    whole = fitted(record)
    edges = (0, 400, 401, 900, 1500)
    pieces = [
        replace(record, time=record.time[a:b], values=record.values[a:b]) for a, b in pairwise(edges) if b - a > 1
    ]
    pieces[1] = replace(record, time=record.time[400:900], values=record.values[400:900])
    found = fitted(pieces)
    for e in found.estimates:
        assert abs(e.estimate - whole[e.name].estimate) < 1e-6 * e.std
    np.testing.assert_allclose(found.cov, whole.cov, rtol=1e-9)
    np.testing.assert_allclose(found.time, whole.time, atol=1e-9)
    np.testing.assert_allclose(found.innovation, whole.innovation, atol=1e-9)
    assert found.samples == whole.samples
    with pytest.raises(RecordError, match="begins after the one before"):
        fitted([pieces[0], pieces[0]])


def test_spikes_are_left_out_of_ones_own_equations_too(record: Record):
    clean = fitted(record)
    values = record.values.copy()
    values[[300, 700, 1100], record.channels.index("position")] += 60.0 * NOISE["position"]
    found = fitted(replace(record, values=values))
    outliers = only(found.findings, "outliers")
    assert (outliers.channels, outliers.data["count"], outliers.data["read"]) == (("position",), 3, 1500)
    for e in found.estimates:
        assert abs(e.estimate - clean[e.name].estimate) < 0.3 * e.std, e.name

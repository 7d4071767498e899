"""Equations of one's own from spectra: transfer against SciPy's, slopes against differences, Fisher's information
against the mean curvature, and the front door against the filters and against the truth."""

import numpy as np
import pytest
import scipy.signal

from tests.findings import codes, reasons
from tests.identification.test_own_equations import AT_REST, NOISE, PARAMETERS, RATE, SPRING, TRUTH, sensors, shaken
from windsysid import ConfigurationError, Record, RecordError
from windsysid.mechanics.compile import compile_model
from windsysid.models import Fit, GaussMarkov, Parameter, fit
from windsysid.simulation.random_loads import draw_loads
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.rotor.load_filters import LoadShape, load_shapes
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.cross_spectra import transform_block
from windsysid.statespace.process import load_on, rational, second_order

LOAD = GaussMarkov("force", 3.0, 0.5)
AT = np.array([0.05, 0.8, 0.1, -0.1, 0.2])


def driven(seed: int, samples: int = 24_000) -> Record:
    """Readings of the spring under a random force that nobody measured."""
    force = draw_loads([LOAD], ("force",), samples, RATE, np.random.default_rng(1000 + seed))
    return shaken(samples, seed, force[:, 0]).select(list(NOISE))


def by_spectra(record: Record | list[Record], **changes: object) -> Fit:
    options = {"parameters": PARAMETERS, "sensors": sensors(), "values": {"m": TRUTH["m"]}, "loads": [LOAD]}
    return fit(SPRING, record, formulation="spectral", **(options | changes))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def model() -> LinearModel:
    compiled = compile_model(SPRING, sensors())
    given = np.array([{"m": 2.0, "c": 0.4, "k": 20.0}[name] for name in compiled.parameters])
    noise, shapes = 2.0 * np.array(list(NOISE.values())) ** 2 / RATE, load_shapes([LOAD], ("force",))
    return LinearModel(
        compiled, given, np.zeros(0), np.zeros(1), np.zeros(2), PARAMETERS, noise, np.zeros(2), shapes, np.full(3, 1.5)
    )


@pytest.fixture(scope="module")
def record() -> Record:
    return driven(1)


def test_the_spectrum_is_that_of_scipys_transfer_function(model: LinearModel):
    m, c, k = 2.0, 20.0 * AT[0], 20.0 * np.exp(AT[1])
    f = np.array([0.1, 0.7, 0.9, 3.0])
    _, position = scipy.signal.freqs([1.0], [m, c, k], 2.0 * np.pi * f)
    T = np.column_stack([position, -((2.0 * np.pi * f) ** 2) * position])
    density = np.exp(2.0 * AT[4]) * 4.0 * 3.0**2 * 0.5 / (1.0 + (2.0 * np.pi * f * 0.5) ** 2)  # one-sided
    expected = density[:, None, None] * T[:, :, None] * T[:, None, :].conj()
    expected += np.diag(2.0 * np.array(list(NOISE.values())) ** 2 / RATE * np.exp(2.0 * AT[2:4]))
    np.testing.assert_allclose(model.spectrum(f, AT), expected, rtol=1e-9, atol=1e-18)


def test_gradient_and_information_are_those_of_differences(model: LinearModel, record: Record):
    spectra = BlockSums.of(transform_block(record.values, RATE, (0.0, 5.0)))
    rows = model.rows(spectra, AT)
    smear = model.smear(spectra, rows, AT)
    h = 1e-5 * np.eye(5)
    g = model.likelihood(rows, spectra.last.overlap, AT, smear)[1]
    moved = [
        [model.likelihood(rows, spectra.last.overlap, AT + sign * step, smear)[0] for sign in (1, -1)] for step in h
    ]  # fmt: skip
    np.testing.assert_allclose(g, [(up - down) / 2e-5 for up, down in moved], rtol=1e-5, atol=1e-4)
    expected = rows._replace(power=model.spectrum(rows.frequency, AT))  # there the curvature is its mean
    F = model.likelihood(expected, spectra.last.overlap, AT)[2]
    up, down = ([model.likelihood(expected, spectra.last.overlap, AT + s * step)[1] for step in h] for s in (1, -1))
    np.testing.assert_allclose(F, (np.array(up) - np.array(down)) / 2e-5, atol=1e-5 * np.abs(F).max())


@pytest.mark.parametrize(
    "load",
    [
        GaussMarkov("force", 3.0, 0.5),
        GaussMarkov("force", 3.0, 40.0, low_pass=2.0),
        load_on("force", second_order(2.0, 0.8, 0.02)),
        load_on("force", rational(2.0, [-0.01, -5.0, -300.0], [-1.0])),
    ],
)
def test_any_load_model_has_its_spectrum(load):
    f = np.array([0.003, 0.1, 0.75, 4.0])
    found = LoadShape(load, ("other", "force"))(2j * np.pi * f)
    assert not found[:, 0].any()
    process = load._passed if isinstance(load, GaussMarkov) else load.process
    first_order = 2.0 * 3.0**2 * 0.5 / (1.0 + (2.0 * np.pi * f * 0.5) ** 2)
    expected = first_order if process is None else process.spectrum(f)
    np.testing.assert_allclose(np.sum(np.abs(found[:, 1]) ** 2, axis=1), expected, rtol=1e-5)


def test_smeared_spectra_are_the_mean_of_what_records_show(model: LinearModel):
    # A resonance of 8 bins under white noise: the mean of many short blocks against S̄, and S itself is off by more.
    truth = np.array([TRUTH["c"] / 20.0, np.log(TRUTH["k"] / 20.0), 0.0, 0.0, 0.0])
    long = driven(5, 60 * 1600).values
    blocks = [transform_block(block, RATE, (0.0, 3.0)) for block in np.split(long, 60)]
    total = BlockSums.of(blocks[0])
    for block in blocks[1:]:
        total = total.plus(block)
    rows = model.rows(total, truth)
    sharp = model.spectrum(rows.frequency, truth)[:, 0, 0].real
    smooth = sharp + model.smear(total, rows, truth)[:, 0, 0].real
    near = np.abs(rows.frequency / 0.796 - 1.0) < 0.05
    shown = rows.power[:, 0, 0].real
    assert abs(np.sum(rows.counts[near] * (shown / smooth - 1.0)[near])) < 3.0 * np.sqrt(1.1 * rows.counts[near].sum())


@pytest.mark.slow
def test_spectra_say_what_the_filters_say(record: Record):
    found, joint = by_spectra(record), fit(
        SPRING, record, parameters=PARAMETERS, sensors=sensors(), values={"m": TRUTH["m"]}, loads=[LOAD], cov=AT_REST
    )  # fmt: skip
    assert found.diagnosis is not None
    assert found.diagnosis.trusted, found.diagnosis.reasons
    for name in ("c", "k"):
        assert found[name].estimate == pytest.approx(joint[name].estimate, abs=0.5 * joint[name].std)
        assert 0.95 < found[name].std / joint[name].std < 1.2  # filters read more than twice the natural frequency
        assert found[name].low < TRUTH[name] < found[name].high
    assert found.statistics[-1].low < 3.0 < found.statistics[-1].high


def test_noise_and_load_are_learned_whatever_was_guessed(record: Record):
    told = by_spectra(record)
    guessed = by_spectra(record, sensors=sensors(20.0), loads=[GaussMarkov("force", 0.3, 0.5)])
    for name in ("c", "k"):
        assert guessed[name].estimate == pytest.approx(told[name].estimate, abs=0.1 * told[name].std)
        assert guessed[name].std == pytest.approx(told[name].std, rel=0.03)


def test_a_prior_that_is_unstable_at_its_centre_is_no_obstacle(record: Record):
    told = by_spectra(record)
    odd = (Parameter("c", -0.4, 1.0, logarithmic=False, scale=20.0), PARAMETERS[1])
    found = by_spectra(record, parameters=odd)
    # a prior of σ = 1 whose centre lies 0.8 lower moves an estimate of σ = 0.12 by 0.8 · 0.12² = 0.1 σ
    assert found["c"].estimate == pytest.approx(told["c"].estimate, abs=0.2 * told["c"].std)
    assert found["k"].estimate == pytest.approx(told["k"].estimate, abs=0.1 * told["k"].std)


def test_pieces_say_what_the_whole_says(record: Record):
    samples = 2
    whole = driven(3, samples * 24_000)
    parts = [whole.section(k * 240.0, (k + 1) * 240.0 - 0.005) for k in range(samples)]
    one, many = by_spectra(whole), by_spectra(parts)
    assert many.samples == whole.samples
    for name in ("c", "k"):
        assert many[name].estimate == pytest.approx(one[name].estimate, abs=0.7 * one[name].std)
        assert many[name].std == pytest.approx(one[name].std, rel=0.05)


def test_a_record_that_grows_louder_is_not_trusted(record: Record):
    louder = np.where(np.arange(record.samples) < record.samples // 2, 1.0, 3.0)[:, None] * record.values
    found = by_spectra(Record(record.time, louder, record.channels, record.units, name="growing"))
    assert found.diagnosis is not None
    assert "nonstationary" in codes(reasons(found))


def test_a_load_of_another_shape_is_not_trusted(record: Record):
    found = by_spectra(record, loads=[load_on("force", second_order(3.0, 0.05, 0.7))])
    assert found.diagnosis is not None
    assert "unexplained_power" in codes(reasons(found))


def test_bad_input_is_refused_in_one_line(record: Record):
    force = record.with_channels({"force": (np.sin(record.time), "N")})
    refused: list[tuple[type[Exception], str, Record, dict[str, object]]] = [
        (ConfigurationError, "force.*varies", force, {"loads": []}),
        (ConfigurationError, "loads: expected models", record, {"loads": [], "values": {"m": 2.0, "force": 0.0}}),
        (ConfigurationError, "without a value.*m", record, {"values": {}}),
        (ConfigurationError, "mean: expected 2 states", record, {"mean": np.zeros(3)}),
        (ConfigurationError, "turn with a rotor", record, {"loads": [GaussMarkov("force", 1.0, 1.0, harmonic=1)]}),
        (RecordError, "expected .* s or more", record.section(0.0, 5.0), {}),
    ]
    for kind, words, given, changes in refused:
        with pytest.raises(kind, match=words):
            by_spectra(given, **changes)
    with pytest.raises(ConfigurationError, match="joint or spectral"):
        fit(SPRING, record, parameters=PARAMETERS, sensors=sensors(), formulation="fast")  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="cov: expected"):
        fit(SPRING, record, parameters=PARAMETERS, sensors=sensors(), values={"m": 2.0}, loads=[LOAD])

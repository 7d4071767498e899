"""The diagnosis against noise of known law (white, coloured, spiked), and against results right and wrong."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy import signal, stats
from validation.trust import FAULTS, faulty_record, identify_broadband

from tests.findings import codes, only, reasons, remarks
from windsysid.checks.verdict import Diagnosis, FittedParameters, TurningRotor, diagnose
from windsysid.checks.whiteness import Whiteness, examine
from windsysid.identification import identify as front
from windsysid.identification.model.prior import Prior
from windsysid.results.finding import Finding
from windsysid.simulation.record import simulate_record
from windsysid.statespace.parameter import Parameter

identify = partial(front.identify, formulation="joint")
"""Filters: what is tested here."""


RATE = 50.0
NATURAL = (1.0, 2.0)


def examined(z: np.ndarray, **more) -> Whiteness:
    z = np.atleast_2d(z.T).T
    return examine(z, names=[f"channel_{i}" for i in range(z.shape[1])], rate=RATE, frequencies=NATURAL, **more)


def diagnosed(z: np.ndarray, *, is_white: bool = True, damping: Any = (), findings: Any = (), **more) -> Diagnosis:
    z = np.atleast_2d(z.T).T
    gated = more.pop("gated", np.zeros(z.shape, dtype=bool))
    whiteness = examined(np.where(gated, np.nan, z), gated=gated) if is_white else None
    known: dict[str, Any] = {
        "parameters": (Parameter("k_x", 100.0, 0.3),),
        "theta": np.array([0.1]),
        "cov": np.array([[1e-4]]),
    }
    fitted = FittedParameters(**(known | more), damping=damping)
    rotor = TurningRotor(2 * math.pi * 0.5, 3)
    return diagnose(whiteness, fitted, frequencies=NATURAL, rotor=rotor, findings=findings)


def white(samples: int = 5000, m: int = 2, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((samples, m))


def test_white_noise_is_trusted_and_nothing_is_remarked():
    found = diagnosed(white())
    assert found.trusted
    assert found.remarks == ()
    assert str(found) == "trust: yes"


@pytest.mark.slow
def test_white_noise_passes_at_the_stated_rate():
    # Normalised innovation squared: 95.45 % by the χ² law. Peaks and colour: one record in 1000 each, so that 300
    # records hold more than three false alarms with a chance of 1e-3. The bound of the autocorrelation holds 95.45 %
    # (at short lags, where no pairs are lost).
    runs = 300
    w = [examined(white(800, 2, seed)) for seed in range(runs)]
    inside = sum(one.nis_low < one.nis < one.nis_high for one in w)
    assert stats.binomtest(inside, runs, 0.9545).pvalue > 1e-3
    assert sum((one.spectrum > one.spectrum_bound).any() for one in w) <= 3
    assert sum(max(c.colour for c in one.channels) > one.colour_bound for one in w) <= 3
    assert sum(max(c.line for c in one.channels) > one.line_bound for one in w) <= 3
    held = np.mean([np.abs(one.autocorrelation[:10]) < one.autocorrelation_bound for one in w])
    assert held == pytest.approx(0.9545, abs=0.005)


@pytest.mark.slow
def test_peaks_of_white_noise_in_gusts_are_chance():
    """Gusts three times as strong, an eighth of the time: few segments make the spectrum, and its peaks are higher."""
    swell = np.where(np.arange(4000) // 250 % 8, 1.0, 3.0)[:, None]
    w = [examined(swell * white(4000, 2, 500 + seed)) for seed in range(100)]
    assert sum((one.spectrum > one.spectrum_bound).any() for one in w) <= 2


def test_autocorrelation_and_colour_are_those_of_a_first_order_process():
    # r_k = ρ^k, and their squares add up to ρ² / (1 − ρ²).
    rho, samples = 0.4, 200_000
    z = signal.lfilter([math.sqrt(1 - rho**2)], [1.0, -rho], white(samples, 1)[:, 0])
    w = examined(z)
    np.testing.assert_allclose(w.autocorrelation[:6, 0], rho ** np.arange(1, 7), atol=5.0 / math.sqrt(samples))
    np.testing.assert_allclose(w.lags[:3], np.array([1, 2, 3]) / RATE)
    assert w.channels[0].colour == pytest.approx(rho**2 / (1 - rho**2), abs=0.01)


def test_the_spectrum_is_scipys():
    z = white(8000, 1, seed=3)
    w = examined(z)
    frequency, power = signal.welch(z[:, 0] - z.mean(), RATE, "hann", 500, 250, detrend=False)
    np.testing.assert_allclose(w.frequency, frequency[2:-1])
    np.testing.assert_allclose(w.spectrum[:, 0], power[2:-1] * RATE / 2.0 / z.var(), rtol=1e-9)
    assert w.spectrum.mean() == pytest.approx(1.0, abs=0.03)


def test_a_peak_is_found_named_and_condemned():
    time = np.arange(5000) / RATE
    z = white()
    z[:, 1] += 0.3 * np.sin(2 * math.pi * 1.5 * time)
    found = diagnosed(z)
    assert not found.trusted
    (reason,) = reasons(found)
    assert (reason.code, reason.channels) == ("unexplained_peak", ("channel_1",))
    assert reason.data["frequency"] == pytest.approx(1.5, abs=0.015)
    assert "Hz = 3.0P" in str(reason)
    assert found.whiteness is not None
    assert found.whiteness.channels[1].peak_hz == pytest.approx(1.5, abs=0.05)


def test_a_line_beside_a_natural_frequency_is_condemned_and_a_faint_or_far_one_is_not():
    # An amplitude a stands (2/3) (a/2)² T above white noise of T samples under Hann's window: 24 and 3 times.
    t = np.arange(5000) / RATE
    for frequency, amplitude, expected in ((1.08, 0.17, False), (1.08, 0.06, True), (1.5, 0.17, True)):
        z = white(seed=1)
        z[:, 1] += amplitude * np.sin(2.0 * np.pi * frequency * t)
        found = diagnosed(z)
        assert found.trusted == expected
        if not expected:
            (reason,) = reasons(found)
            assert (reason.code, reason.channels) == ("spectral_line", ("channel_1",))
            assert reason.data["frequency"] == pytest.approx(1.08, abs=0.005)


def test_a_peak_that_nothing_answers_to_is_a_remark():
    z = white()
    z[:, 0] += 0.5 * np.sin(2 * math.pi * 18.0 * np.arange(5000) / RATE)
    found = diagnosed(z)
    assert found.trusted
    remark = only(found.findings, "far_peak")
    assert (remark.severity, remark.channels) == ("remark", ("channel_0",))
    assert remark.data["frequency"] == pytest.approx(18.0, abs=0.1)


def test_colour_is_half_the_mean_square_departure_of_the_spectrum_from_one():
    # Parseval: for a first-order process the spectrum is known, (1 − ρ²) / |1 − ρ e^{−iω}|².
    rho, omega = 0.6, np.linspace(0.0, math.pi, 20001)
    spectrum = (1 - rho**2) / np.abs(1 - rho * np.exp(-1j * omega)) ** 2
    expected = 0.5 * float(np.trapezoid((spectrum - 1.0) ** 2, omega)) / math.pi
    assert expected == pytest.approx(rho**2 / (1 - rho**2), rel=1e-6)


def test_colour_far_from_every_natural_frequency_is_a_remark():
    z = signal.lfilter([math.sqrt(1 - 0.3**2)], [1.0, 0.3], white(), axis=0)  # high frequencies: nothing answers there
    found = diagnosed(z)
    assert found.trusted
    remark = only(found.findings, "coloured_innovations")
    assert remark.severity == "remark"
    assert 0.095 < remark.data["colour"] < 0.2


def test_colour_around_a_natural_frequency_is_condemned():
    # ρ = 0.5: at 1 and 2 Hz of 50 the spectrum is 3 / |2 − e^{−iω}|² = 2.9 and 2.7, broad and without a peak.
    z = signal.lfilter([math.sqrt(1 - 0.5**2)], [1.0, -0.5], white(20_000), axis=0)
    found = diagnosed(z)
    assert found.whiteness is not None
    for c in found.whiteness.channels:
        level = 3.0 / abs(2.0 - np.exp(-2j * math.pi * c.near_hz / RATE)) ** 2
        assert c.near == pytest.approx(level, rel=0.1)
    assert not found.trusted


@pytest.mark.parametrize(("factor", "words"), [(1.3, "too narrow"), (0.7, "too wide")])
def test_innovations_of_another_size_are_condemned(factor, words):
    (reason,) = reasons(diagnosed(factor * white()))
    assert reason.code == "innovation_level"
    assert reason.data["ratio"] == pytest.approx(factor, rel=0.04)
    assert str(reason).endswith(f"all intervals are {words}")


def test_one_channel_of_another_size_is_named():
    z = white(5000, 8)
    z[:, 3] *= 1.6
    (reason,) = reasons(diagnosed(z))
    assert (reason.code, reason.channels) == ("channel_level", ("channel_3",))
    assert reason.data["ratio"] == pytest.approx(1.61, abs=0.005)


def test_spikes_are_counted():
    z = white()
    z[[100, 2000, 3333], 0] = (9.0, -12.0, 7.0)
    found = diagnosed(z)
    assert found.whiteness is not None
    assert [c.outliers for c in found.whiteness.channels] == [3, 0]
    assert found.whiteness.channels[0].outlying == pytest.approx((81 + 144 + 49) / np.sum(z[:, 0] ** 2), rel=0.01)
    assert stats.kurtosis(z[:, 0]) == pytest.approx(found.whiteness.channels[0].kurtosis, rel=1e-6)
    (remark,) = remarks(found)
    assert (remark.code, remark.channels) == ("outlying_innovations", ("channel_0",))
    assert (remark.data["count"], remark.data["sigmas"]) == (3, 5.0)
    z[500, 0] = 40.0
    reason = reasons(diagnosed(z))[-1]
    assert reason.code == "outlying_innovations"
    assert 0.2 < reason.data["share"] < 0.3


def test_what_was_left_out_is_said_and_too_much_of_it_condemned():
    z, rng = white(), np.random.default_rng(1)
    few = np.zeros(z.shape, dtype=bool)
    few[rng.choice(5000, 50, replace=False), 1] = True
    found = diagnosed(z, gated=few)
    assert found.trusted
    assert remarks(found) == [Finding("gated_readings", "remark", {"channel": "channel_1", "share": 0.01})]
    assert reasons(diagnosed(z, gated=rng.random(z.shape) < 0.2))[0].code == "too_many_outliers"


def test_gaps_do_not_look_like_colour():
    # Half of the samples missing at random, and a hole of ten seconds.
    rng = np.random.default_rng(2)
    for seed in range(20):
        z = white(6000, 2, seed)
        z[rng.random(z.shape) < 0.4] = np.nan
        z[1000:1500] = np.nan
        found = diagnosed(z)
        assert found.trusted, found.reasons
        assert found.whiteness is not None
        assert found.whiteness.channels[0].missing == pytest.approx(0.45, abs=0.02)
        assert found.whiteness.used == np.isfinite(z).sum()
        assert found.whiteness.spectrum.mean() == pytest.approx(1.0, abs=0.1)


def test_a_short_record_is_not_condemned_by_chance():
    # Mean squares of 20 samples leave 1/1.25 … 1.25 in half of all records, and by more than chance in one of 1000.
    assert sum(not diagnosed(white(20, 1, seed)).trusted for seed in range(200)) <= 2


def test_a_record_too_short_for_a_spectrum_is_judged_by_the_rest():
    found = diagnosed(white(100))
    assert found.trusted
    assert found.whiteness is not None
    assert len(found.whiteness.frequency) == 0
    assert not diagnosed(3.0 * white(100)).trusted


def test_an_estimate_far_from_its_prior_is_a_contradiction():
    # The prior is 0.3 wide: five of these away is condemned, three are not.
    assert diagnosed(white(), theta=np.array([0.9])).trusted
    (reason,) = reasons(diagnosed(white(), theta=np.array([-1.5])))
    assert (reason.code, reason.quantities) == ("prior_conflict", ("k_x",))
    assert reason.data["sigmas"] == pytest.approx(-5.0, abs=0.01)


@pytest.mark.parametrize(("y", "at"), [(-1.5, 0), (0.1, -1)])
def test_a_file_of_another_machine_is_named_first(y: float, at: int):
    """A crack, a loose bolt and friction came first, where every stiffness contradicted the turbine file."""
    springs = tuple(Parameter(name, 100.0, 0.3, kind="stiffness") for name in ("k_x", "k_y"))
    found = diagnosed(3.0 * white(), parameters=springs, theta=np.array([-1.5, y]), cov=1e-4 * np.eye(2))
    assert [one.code for one in reasons(found)].count("innovation_level") == 1
    assert reasons(found)[at].code == "prior_conflict"


@pytest.mark.slow
def test_the_shift_is_measured_in_what_was_to_be_expected():
    # A prior draws θ, a measurement of variance r sees it: estimate − centre has the variance σ₀² − σ² (closed form).
    rng = np.random.default_rng(5)
    spread, r = 0.3, 0.2
    variance = 1.0 / (1.0 / spread**2 + 1.0 / r**2)
    shifts = []
    for _ in range(2000):
        theta = spread * rng.standard_normal()
        estimate = variance / r**2 * (theta + r * rng.standard_normal())
        found = diagnosed(white(40), theta=np.array([estimate]), cov=np.array([[variance]]))
        shifts.append(found.coefficients[0].shift)
    assert np.std(shifts) == pytest.approx(1.0, abs=0.06)


def test_what_the_prior_decided_is_remarked():
    c = Parameter("c_x", 2.0, 1.0, False, 10.0, "damping")
    found = diagnosed(white(), parameters=(c,), theta=np.array([0.2]), cov=np.array([[0.09**2]]))
    (remark,) = remarks(found)
    assert (remark.code, remark.quantities) == ("prior_dominates", ("c_x",))
    assert remark.data["share"] == pytest.approx(1.0 - 0.9**2)
    assert found.trusted


def test_negative_damping_is_a_reason_not_to_trust():
    c = Parameter("c_x", 2.0, 1.0, False, 10.0, "damping")
    for theta, surely in ((-0.1, True), (-0.01, False)):
        (reason,) = reasons(diagnosed(white(), parameters=(c,), theta=np.array([theta]), cov=np.array([[0.03**2]])))
        assert (reason.code, reason.quantities) == ("damping_not_positive", ("c_x",))
        assert reason.data["coefficients"] == [["c_x", pytest.approx(10.0 * theta), surely, ""]]
        assert reason.data["modes"] == []
    (reason,) = reasons(
        diagnosed(white(), damping=[("tower x", (0.01, 0.008, 0.012)), ("lag forward", (-0.002, -0.005, 0.001))])
    )
    assert (reason.data["coefficients"], reason.data["modes"]) == ([], [["lag forward", -0.002, False]])


def test_damping_that_may_be_negative_within_its_band_is_remarked():
    c = Parameter("c_x", 2.0, 1.0, False, 10.0, "damping")
    found = diagnosed(
        white(),
        parameters=(c,),
        theta=np.array([0.05]),
        cov=np.array([[0.03**2]]),
        damping=[("tower x", (0.01, -0.002, 0.022))],
    )
    assert found.trusted
    assert remarks(found) == [Finding("damping_may_be_negative", "remark", {"names": ["c_x", "tower x"]}, ("c_x",))]


def test_what_cannot_be_negative_or_may_be_is_not_called_negative_damping():
    # A damper whose logarithm is identified is positive, below its prior's median or not; a coupling is centred on
    # zero.
    logarithmic, coupling = (
        Parameter("c_1", 0.25, 0.5, kind="damping"),
        Parameter("c_hub_blade", 0.0, 1.0, False, 10.0, "damping"),
    )
    found = diagnosed(
        white(), parameters=(logarithmic, coupling), theta=np.array([-0.2, -0.05]), cov=np.diag([0.02**2, 0.01**2])
    )
    assert float(logarithmic.physical(-0.2)) == pytest.approx(0.2047, rel=1e-3)
    assert found.trusted
    assert "damping_may_be_negative" not in codes(found.findings)


def test_a_channel_that_is_read_rarely_is_judged_on_its_own_samples():
    # 50 Hz, and one channel read every 25th sample: 2 Hz. Its line at 0.5 Hz has mirror images at 1.5, 2.5 Hz …, where
    # natural frequencies are.
    z = white(20_000)
    slow = np.full(20_000, np.nan)
    slow[7::25] = z[7::25, 1] + 1.5 * np.sin(2 * math.pi * 0.5 * np.arange(20_000) / RATE)[7::25]
    slow /= np.nanstd(slow)
    both, alone = (
        examined(np.column_stack([z[:, 0], slow])),
        examine(slow[7::25, None], names=["channel_1"], rate=RATE / 25, frequencies=NATURAL),
    )
    c = both.channels[1]
    assert c == alone.channels[0]
    assert c.peak_hz == pytest.approx(0.5, abs=0.02)
    assert c.missing == 0.0
    assert c.used == 800
    assert np.isnan(both.spectrum[both.frequency > 1.0, 1]).all()
    lag = np.searchsorted(both.lags, 0.5 - 1e-9)  # one sample of its own
    x = slow[7::25] - slow[7::25].mean()
    assert both.autocorrelation[lag, 1] == pytest.approx(np.mean(x[1:] * x[:-1]) / np.mean(x**2), rel=1e-6)
    assert both.channels[0] == examined(z[:, :1]).channels[0]
    reason = reasons(diagnosed(np.column_stack([z[:, 0], slow])))[0]
    assert (reason.code, reason.channels) == ("unexplained_peak", ("channel_1",))
    assert reason.data["frequency"] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("gaps", [(2, 3), (3, 5, 4)])
def test_no_frequency_above_half_the_rate_at_which_a_channel_is_read_is_named(gaps: tuple[int, ...]):
    # On no coarser grid, and yet never often enough for what is higher.
    at = np.cumsum(np.tile(gaps, 2000))
    z = np.full((20_000, 1), np.nan)
    at = at[at < 20_000]
    z[at, 0] = white(len(at), 1)[:, 0] + np.sin(2 * math.pi * 2.0 * at / RATE)
    c = examined(z).channels[0]
    highest = 0.5 * RATE / np.median(gaps)
    assert c.peak_hz == pytest.approx(2.0, abs=0.05)
    assert c.far_hz < highest


def test_doubts_condemn_and_what_is_not_white_is_not_asked_to_be():
    doubt, note = Finding("one_block", "reason"), Finding("damping_is_total", "note")
    found = diagnosed(np.cumsum(white(), axis=0), is_white=False, findings=(doubt, note))
    assert found.whiteness is None
    assert (found.findings, found.trusted) == ((doubt, note), False)
    assert str(found) == f"trust: NO, because {doubt}"


def test_a_constant_that_the_model_does_not_have_asks_for_a_bias():
    z = white()
    z[:, 0] += 0.5
    found = diagnosed(z)
    assert only(found.findings, "constant_offset").channels == ("channel_0",)


def test_the_summary_holds_plain_values():
    summary = diagnosed(white()).summary()
    assert summary["trusted"] is True
    assert summary["innovations"]["channels"]["channel_0"]["used"] == 5000
    assert set(summary["prior_against_data"]["k_x"]) == {"name", "informed_by_data", "shift"}


# Whole results


@pytest.fixture(scope="module")
def record(verne555):
    return simulate_record(verne555, duration=40.0, rate=50.0, seed=2)


@pytest.fixture(scope="module")
def right(verne555, record):
    return identify(record.section(0.0, 20.0), verne555, prior=Prior(1.3, 1.3), loads="broadband")


def test_a_result_that_is_right_is_trusted(right):
    assert right.diagnosis.trusted, right.diagnosis.reasons
    assert "trust: yes" in str(right)
    assert right.summary()["diagnosis"]["trusted"] is True
    assert {c.name for c in right.diagnosis.whiteness.channels} == set(right.readings)


@pytest.mark.slow
def test_a_result_under_loads_that_no_model_holds_is_not_trusted(verne555):
    harmonic, _ = FAULTS["3P on the hub, amplitude × rms"]
    found = identify_broadband(faulty_record(harmonic, 0.5, seed=1, duration=60.0, rate=50.0), verne555, Prior())
    worst = max(abs(e.estimate - e.reference) / e.std for e in found.estimates if e.reference is not None)
    assert worst > 4.0  # it is wrong, and says so
    assert not found.diagnosis.trusted
    assert any(
        reason.data["frequency"] == pytest.approx(3.0 * reason.data["rotor_frequency"], rel=0.02)
        for reason in reasons(found)
        if "frequency" in reason.data
    )
    assert "trust: NO" in " ".join(str(found).split())


def test_a_balance_without_its_loads_is_not_trusted(verne555, record):
    found = identify(record, verne555, formulation="force-balance")
    assert codes(reasons(found)) == ["loads_missing", "damping_not_positive"]


@pytest.mark.slow
def test_records_of_the_reference_scenario_raise_no_false_alarm(verne555):
    # Two quick ones, none of them wrong; `python -m validation.trust` counts properly.
    for seed in range(2):
        found = identify(simulate_record(verne555, duration=40.0, rate=50.0, seed=seed), verne555)
        assert found.diagnosis.trusted, found.diagnosis.reasons

"""A real machine's rotor in bands around its modes: what it is made of, and that it finds the truth."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise, product

import numpy as np
import pytest
from validation.auto import KINDS

import windsysid as ws
from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification.model.tolerances import in_numbers, tolerances_of
from windsysid.mechanics.compile import compile_model
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.spectral.rotor.problem import RotorQuestion
from windsysid.spectral.rotor_bands.build import PosedBands, belongs_in_bands, pose_bands, search_bands
from windsysid.spectral.rotor_bands.channels import bins_between, combine
from windsysid.spectral.rotor_bands.limits import MIN_PEAK_LOG_ODDS
from windsysid.spectral.rotor_bands.mode_locations import ModeLocation, find_places
from windsysid.spectral.rotor_bands.model import BandModel
from windsysid.spectral.rotor_bands.peak_search import best_of, trace
from windsysid.spectral.rotor_bands.rotational_sampling import hump_terms, line_terms, wind_of
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.rotating_frame import (
    MAX_GROUPS,
    TurnedBlock,
    combine_groups,
    turned_block,
    turned_spectra,
)
from windsysid.statespace.compose import compose
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine

HZ = 12.1 / 60.0
TURBINE = load_turbine("nrel5mw_full")
pytestmark = pytest.mark.usefixtures("without_effects")

TIPS = tuple(f"blade_{i}_tip_lag_acceleration" for i in (1, 2, 3))


@lru_cache(maxsize=1)
def record() -> Record:
    return simulate_record(TURBINE, duration=360.0, rate=25.0, seed=201, loads="wind-feedback")


def question(of: Record, *, sensors: tuple[str, ...] = ()) -> RotorQuestion:
    chosen = tuple(s for s in TURBINE.sensors if s.channel in of and (not sensors or s.channel in sensors))
    parameters = DrawnPrior(seed=1).parameters(TURBINE, list(TURBINE.model.coefficients), linear=False)
    parameters = tuple(q for q in parameters if q.name not in ("k_y", "c_y"))
    model = compose(TURBINE.model, rate=of.rate, values=TURBINE.values, parameters=parameters, sensors=chosen)
    inputs = np.zeros((of.samples, 3))
    inputs[:, 0], inputs[:, 1] = np.unwrap(of["rotor_azimuth"]), TURBINE.rotor_speed
    readings = np.column_stack([of[s.channel] for s in chosen])
    return RotorQuestion(TURBINE, chosen, readings, of.rate, inputs, model.compiled, parameters, TURBINE.loads)


def turning(hz: float, samples: int, rate: float) -> Array:
    """Azimuths of a steady rotor."""
    return np.asarray(2.0 * np.pi * hz * np.arange(samples) / rate, dtype=np.float64)


@lru_cache(maxsize=2)
def posed(*, sensors: tuple[str, ...] = ()) -> PosedBands:
    found = search_bands(question(record(), sensors=sensors))
    assert found is not None
    return found


def test_whirls_are_told_apart_by_the_sign_of_their_class() -> None:
    """What whirls backward at F is p = 1 at F + Ω in the blades' frame, and nowhere else; forward p = −1 at F − Ω."""
    time = np.arange(6000) / 10.0
    psi = 0.4 + 2.0 * np.pi * HZ * time
    angle = psi[:, None] + 2.0 * np.pi * np.arange(3) / 3.0
    for way, F, p in ((-1.0, 0.89, 1), (1.0, 1.30, -1)):
        whirl = np.exp(1j * way * 2.0 * np.pi * F * time)[:, None]
        readings = np.real(whirl * np.exp(-1j * angle))  # z = (2/3) Σ y e^{iψ} turns at ± F
        spectra = turned_spectra(readings, psi, 10.0, 0)
        found = {c.shape: spectra.combined(c.weights)[:, 0] for c in combine(TURBINE.sensors[1:], 3)}
        where = {shape: np.argmax(np.abs(row[:3000])) / spectra.duration for shape, row in found.items()}
        size = {shape: np.abs(row[:3000]).max() for shape, row in found.items()}
        assert where[p] == pytest.approx(F + p * HZ, abs=0.002)
        assert size[p] > 100.0 * max(value for shape, value in size.items() if shape != p)


def test_support_is_read_where_the_blades_shake_it() -> None:
    """A line at F of a reading that stands is at F + Ω in the frame of the blades, at k = −1."""
    time = np.arange(6000) / 10.0
    psi = 0.4 + 2.0 * np.pi * HZ * time
    spectra = turned_spectra(np.cos(2.0 * np.pi * 0.89 * time)[:, None], psi, 10.0, 1)
    assert np.argmax(np.abs(spectra.data[-1][:3000, 0, 0])) / spectra.duration == pytest.approx(0.89 + HZ, abs=0.002)


def test_a_missing_sensor_leaves_the_others_as_they_are() -> None:
    found = combine(TURBINE.sensors[:3], 3)
    assert [c.blade for c in found] == [0, 1, 2]
    assert all(np.array_equal(c.weights, np.eye(3)[i]) for i, c in enumerate(found))


def test_harmonics_of_the_rotor_are_not_used() -> None:
    spectra = turned_spectra(np.zeros((6000, 1)), turning(HZ, 6000, 10.0), 10.0, 0)
    f = bins_between(spectra, 0.3, 1.3) / spectra.duration
    assert np.abs(f - HZ * np.round(f / HZ)).min() * spectra.duration >= 1.4
    assert len(f) > 0.97 * 600


def test_humps_stand_at_their_harmonics() -> None:
    f = np.linspace(0.9, 1.35, 400)
    wind = wind_of(12.4, 26.5, HZ)
    level, below, above = hump_terms(wind, f, 0.95, 1.3, HZ, 1, 3)  # n = 4 and 7
    assert np.all(level == 1.0)
    assert np.all(np.diff(below) < 0.0)
    assert np.all(np.diff(above) > 0.0)
    inside = (f > 0.95) & (f < 1.3)
    assert np.median(below[inside]) == pytest.approx(1.0, rel=0.05)
    assert np.sum(line_terms(f, 0.9, 1.35), axis=0) == pytest.approx(1.0)


def test_flanks_are_those_of_the_simulated_wind() -> None:
    """The class p = 0 of the moments that simulated turbulence makes, between two humps."""
    from windsysid.simulation.wind.field import WindConditions, rotating_turbulence

    wind = WindConditions(speed=12.0, hub_height=90.0, turbulence_intensity=0.167)
    rate, samples = 8.0, 40_000
    psi = turning(HZ, samples, rate)
    radii = (12.0, 24.0, 36.0, 48.0)
    _, blades = rotating_turbulence(wind, psi, radii, blades=3, rate=rate, seed=np.random.default_rng(4), harmonics=14)
    weights = np.array([r * (r - 12.0) + 1.0 for r in radii])
    together = (blades @ weights).sum(axis=1)
    power = np.abs(np.fft.rfft(together * np.hanning(samples))) ** 2
    f = np.fft.rfftfreq(samples, 1.0 / rate)
    shape = wind_of(12.4, 26.5, HZ)
    ratio = []
    for low, high in ((0.63, 0.66), (0.66, 0.70), (0.70, 0.76)):
        inside = (f > low) & (f < high)
        ratio.append(power[inside].mean() / shape.flank(np.asarray(f[inside] - 3.0 * HZ, dtype=np.float64), 3).mean())
    assert max(ratio) < 1.6 * min(ratio)  # the power itself falls 4 times


def test_a_resonance_is_found_beside_a_hump() -> None:
    rng = np.random.default_rng(5)
    spectra = turned_spectra(np.zeros((8000, 1)), turning(0.15, 8000, 10.0), 10.0, 0)
    f = np.arange(8000) / spectra.duration
    S = 1.0 + 30.0 / (1.0 + np.abs(f - 0.45) / 0.01) ** (5.0 / 3.0)  # 3P, where the tower is not
    S *= 1.0 + 20.0 / ((1.0 - (f / 0.31) ** 2) ** 2 / (4.0 * 0.006**2) + 1.0)
    row = np.sqrt(0.5 * S) * (rng.standard_normal(8000) + 1j * rng.standard_normal(8000))
    found = trace(spectra, [row[:, None]], 0, 3, 0.25, 0.48)
    assert found.frequency[np.argmax(found.gain)] == pytest.approx(0.31, rel=0.01)
    assert found.gain.max() > 2.0 * MIN_PEAK_LOG_ODDS


def test_blocks_find_what_one_alone_does_not() -> None:
    rng = np.random.default_rng(6)
    spectra = turned_spectra(np.zeros((8000, 1)), turning(0.15, 8000, 10.0), 10.0, 0)
    f = np.arange(8000) / spectra.duration
    S = 1.0 + 1.0 / ((1.0 - (f / 0.31) ** 2) ** 2 / (4.0 * 0.006**2) + 1.0)
    rows = np.sqrt(0.5 * S[:, None]) * (rng.standard_normal((8000, 16)) + 1j * rng.standard_normal((8000, 16)))
    alone = trace(spectra, [rows[:, :1]], 0, 3, 0.25, 0.4)
    found = trace(spectra._replace(blocks=16.0), [rows], 0, 3, 0.25, 0.4)
    assert found.frequency[np.argmax(found.gain)] == pytest.approx(0.31, rel=0.01)
    assert found.gain.max() > max(MIN_PEAK_LOG_ODDS, 3.0 * alone.gain.max())


def test_rivals_are_told() -> None:
    at = np.linspace(-0.2, 0.2, 81)
    score = 10.0 * np.exp(-((at / 0.02) ** 2)) + 9.0 * np.exp(-(((at - 0.12) / 0.02) ** 2))
    best, rivals = best_of(score, at, at)
    assert best == pytest.approx(0.0, abs=0.006)
    assert rivals == pytest.approx([np.exp(0.12)], rel=0.01)


def test_gradient_is_the_slope_of_the_likelihood() -> None:
    found = posed()
    at = found.start + 0.05 * np.random.default_rng(2).standard_normal(len(found.start))
    value, gradient, information = found.model.likelihood(at)
    first = found.model.unknowns.of("statistics").start
    for i in (*range(first), first + 2, len(at) - 1):
        off = np.zeros(len(at))
        off[i] = 1e-5 * min(found.model.prior[1][i], 1.0)
        slope = (found.model.likelihood(at + off)[0] - found.model.likelihood(at - off)[0]) / (2.0 * off[i])
        assert gradient[i] == pytest.approx(slope, rel=2e-3, abs=2e-3 * np.sqrt(information[i, i]))
    assert np.isfinite(value)


def test_bands_know_instruments_and_masses() -> None:
    """Slopes of what all bands share, clocks of the blades' logger among them."""
    asked = question(record())
    names = [q.name for q in asked.parameters]
    compiled = compile_model(TURBINE.model, asked.sensors, instruments=True)
    tolerances = tolerances_of(TURBINE, asked.sensors, names)
    inexact = in_numbers(tolerances, compiled.parameters, TURBINE, asked.sensors, names)
    narrow = search_bands(asked._replace(compiled=compiled))
    assert narrow is not None
    wide = BandModel(tuple(b._replace(model=b.model._replace(inexact=inexact)) for b in narrow.model.bands))
    rng = np.random.default_rng(4)
    tau = wide.unknowns.of("tolerances", "clocks")
    at = wide.unknowns.from_other(narrow.start, narrow.model.unknowns)
    at[tau] = 0.5 * rng.standard_normal(len(tolerances))
    _, gradient, information = wide.likelihood(at)
    for i in range(tau.start, tau.stop):
        off = np.zeros(len(at))
        off[i] = 1e-3
        slope = (wide.likelihood(at + off)[0] - wide.likelihood(at - off)[0]) / 2e-3
        assert gradient[i] == pytest.approx(slope, rel=2e-3, abs=2e-3 * np.sqrt(information[i, i]))


@pytest.mark.slow
def test_a_stiffness_is_known_in_bands_as_masses_are() -> None:
    found = ws.identify(record(), TURBINE, formulation="spectral", prior=DrawnPrior(seed=1))
    assert 0.015 < found["k_beta_1"].std / found["k_beta_1"].estimate < 0.04


def test_modes_are_looked_for_where_they_are() -> None:
    """Priors are 30 % off in stiffness: 14 % in frequency."""
    hz = {place.name: place.frequency - (place.shape or 0) * HZ for place in posed().places}
    assert hz["tower x"] == pytest.approx(0.3152, rel=0.02)
    assert hz["lag backward"] == pytest.approx(0.8950, rel=0.02)
    assert hz["lag collective"] == pytest.approx(1.0442, rel=0.02)
    assert hz["lag forward"] == pytest.approx(1.3053, rel=0.02)


@pytest.mark.parametrize("missing", ["", TIPS[1]])
@pytest.mark.slow
def test_rotor_in_simulated_wind_is_found(missing: str) -> None:
    sensors = tuple(s.exact() for s in TURBINE.sensors if s.channel != missing)
    found = ws.identify(record(), TURBINE.exact(), formulation="spectral", sensors=sensors, prior=DrawnPrior(seed=1))
    for e in found.estimates:
        assert e.reference is not None
        if e.kind == "stiffness":
            assert abs(e.estimate - e.reference) < 3.0 * e.std
    assert found["k_x"].std < 0.01 * found["k_x"].estimate
    assert found["k_beta_1"].std < 0.01 * found["k_beta_1"].estimate
    assert found.diagnosis.trusted


@pytest.mark.slow
def test_loud_second_half_is_not_trusted() -> None:
    half = record().samples // 2
    loud = {name: np.where(np.arange(record().samples) < half, 0.25, 1.0) * record()[name] for name in TIPS}
    changed = record().with_channels({name: (values, "m/s^2") for name, values in loud.items()})
    found = ws.identify(changed, TURBINE, formulation="spectral")
    assert not found.diagnosis.trusted
    assert {"gain", "alignment", "masses", "clock"} <= {one.group for one in found.tolerances}


@pytest.mark.parametrize("seconds", [6.0, 10.0, 15.0, 30.0])
def test_a_record_of_few_turns_is_refused(seconds: float) -> None:
    with pytest.raises(RecordError, match="choose a longer record"):
        ws.identify(record().section(0.0, seconds), TURBINE, formulation="spectral")


def test_bands_take_no_load_model() -> None:
    with pytest.raises(ConfigurationError, match="leave loads= out"):
        ws.identify(record(), TURBINE, formulation="spectral", loads="rotor-wind")


def test_scale_model_is_read_whole() -> None:
    assert belongs_in_bands(question(record()))
    scale = load_turbine("verne555")
    asked = question(record())._replace(turbine=scale, sensors=scale.sensors)
    inputs = asked.inputs.copy()
    inputs[:, 1] = scale.rotor_speed
    assert not belongs_in_bands(asked._replace(inputs=inputs))


def test_nothing_is_used_twice_where_modes_are_near() -> None:
    """At 6 rpm both whirls and the collective mode are less than a band apart in the fixed frame."""
    slow = replace(TURBINE, rotor_speed=2.0 * np.pi * 0.1)
    made = simulate_record(slow, duration=200.0, rate=25.0, seed=3)
    asked = question(made)
    inputs = asked.inputs.copy()
    inputs[:, 1] = slow.rotor_speed
    places = (
        ModeLocation("tower x", None, 0.315, 0.004), ModeLocation("lag backward", 1, 1.09, 0.005),
        ModeLocation("lag collective", 0, 1.04, 0.005), ModeLocation("lag forward", -1, 1.10, 0.005),
    )  # fmt: skip
    found = pose_bands(asked._replace(turbine=slow, inputs=inputs), places)
    used = [
        (row.low + row.order * 0.1, row.high + row.order * 0.1)
        for band in found.model.bands
        for row in band.rows
        if not found.combined[row.combination].turns
    ]
    used.sort()
    assert all(a[1] <= b[0] + 1e-9 for a, b in pairwise(used))


@pytest.mark.slow
def test_a_lightly_damped_rotor_is_found_from_a_poor_prior() -> None:
    """9 rpm, no drift told: from this prior a search without bands ended 300 000 σ away, after a minute."""
    turbine = replace(load_turbine("nrel5mw"), rotor_speed=2.0 * np.pi * 9.0 / 60.0)
    wind = simulate_record(turbine, duration=540.0, rate=20.0, seed=7100, loads="wind")
    found = ws.identify(wind, turbine, formulation="spectral", prior=DrawnPrior(seed=7100))
    off = [
        (q.coordinate(found[q.name].estimate) - q.coordinate(turbine.values[q.name])) / found.cov[i, i] ** 0.5
        for i, q in enumerate(found.parameters)
    ]
    assert found.diagnosis.trusted
    assert np.abs(off).max() < 3.0
    assert found["k_x"].std / found["k_x"].estimate < 0.02


@pytest.mark.slow
def test_a_speed_that_varies_is_followed_by_the_blades() -> None:
    """±8 % was refused, though blades keep their frequencies in the frame that turns with them."""
    varying = KINDS["nrel5mw, wind, speed varies by 8 %"][2](7200)
    assert varying["rotor_speed"].std() / varying["rotor_speed"].mean() == pytest.approx(0.08, rel=0.1)
    turbine = load_turbine("nrel5mw")
    found = ws.identify(varying, turbine, formulation="spectral", prior=DrawnPrior(seed=7200))
    off = [
        (q.coordinate(found[q.name].estimate) - q.coordinate(turbine.values[q.name])) / found.cov[i, i] ** 0.5
        for i, q in enumerate(found.parameters)
    ]
    assert found.diagnosis.trusted
    assert np.abs(off).max() < 3.0


def test_modes_that_cannot_be_told_apart_are_not_read_in_bands() -> None:
    """The scale model's tower and blades are near each other, and a light one was a KeyError."""
    heavy = load_turbine("verne555").exact()
    light = heavy.with_values({name: 0.2 * heavy.values[name] for name in heavy.values if name.startswith("c_")})
    wind = simulate_record(light, duration=40.0, rate=50.0, seed=7300, loads="wind")
    parameters = DrawnPrior(seed=7300).parameters(light, list(light.model.coefficients), linear=False)
    inputs = np.zeros((wind.samples, 3))
    inputs[:, 0], inputs[:, 1] = np.unwrap(wind["rotor_azimuth"]), light.rotor_speed
    readings = np.column_stack([wind[s.channel] for s in light.sensors])
    compiled = compile_model(light.model, light.sensors, instruments=True)
    asked = RotorQuestion(light, light.sensors, readings, wind.rate, inputs, compiled, parameters, light.loads)
    assert belongs_in_bands(asked)
    assert search_bands(asked) is None


def test_levels_go_from_one_model_to_another_by_their_names() -> None:
    """A band whose modes have moved may have other rows; it was a ValueError."""
    whole = posed()
    on_blades = [place for place in whole.places if place.shape is not None]
    fewer = pose_bands(question(record(), sensors=TIPS), on_blades)
    start = whole.model.prior[0] + 0.3
    moved = fewer.model.start_from(start, whole.model)
    known = {
        s.name: s.given * np.exp(eta)
        for s, eta in zip(whole.model.statistics, start[whole.model.unknowns.of("statistics")], strict=True)
    }
    shared = fewer.model.unknowns.of("parameters", "lag")
    assert np.array_equal(moved[shared], start[shared])
    for s, eta in zip(fewer.model.statistics, moved[fewer.model.unknowns.of("statistics")], strict=True):
        assert s.given * np.exp(eta) == pytest.approx(known.get(s.name, s.given))


def test_sums_stand_for_the_products_of_all_blocks() -> None:
    """Blades are kept at k = 0, the support at 0 and ±1; groups of successive blocks, four at most."""
    rng = np.random.default_rng(3)
    support = np.array([True, False, False])
    blocks = [turned_spectra(rng.normal(size=(400, 3)), turning(HZ, 400, 10.0), 10.0, 1) for _ in range(11)]
    blocks = [block._replace(rotor_hz=HZ + 0.001 * i) for i, block in enumerate(blocks)]
    sums = BlockSums.of(turned_block(blocks[0], support), MAX_GROUPS)
    for block in blocks[1:]:
        sums = sums.plus(turned_block(block, support))
    assert sums.sizes == (4, 4, 3)
    assert sums.blocks == 11.0
    assert sums.last.rotor_hz == pytest.approx(HZ + 0.005)
    halves = sums.halves()
    assert halves is not None
    for groups, of in ((None, blocks), (halves[0], blocks[:4]), (halves[1], blocks[4:])):
        spectra = combine_groups(sums, groups)
        assert spectra.blocks == len(of)
        for (i, j), (k, other) in product(product(range(3), (0,)), ((0, 1), (1, 0), (-1, 0))):
            ours = np.sum(spectra.data[j][:, i] * spectra.data[k][:, other].conj(), axis=1)
            every = [b.data[j][:, i, 0] * b.data[k][:, other, 0].conj() for b in of]
            np.testing.assert_allclose(ours, np.sum(every, axis=0), atol=1e-9 * np.abs(every).max())
    again = BlockSums.restored(sums.stored(), TurnedBlock)
    assert np.array_equal(combine_groups(again).data[0], combine_groups(sums).data[0])
    assert again.halves() == halves
    first, second = (turned_block(block, support) for block in blocks[:2])
    forgotten = BlockSums.of(first, MAX_GROUPS).plus(second, 0.25)
    assert forgotten.counts == (0.25, 1.0)


def test_blocks_that_are_louder_by_turns_count_less() -> None:
    rng = np.random.default_rng(4)
    support = np.array([True, False])
    steady = [turned_spectra(rng.normal(size=(2000, 2)), turning(HZ, 2000, 10.0), 10.0, 1) for _ in range(8)]
    gusty = [b._replace(data={k: (1.0 + i % 2) * Y for k, Y in b.data.items()}) for i, b in enumerate(steady)]
    found = []
    for blocks in (steady, gusty):
        sums = BlockSums.of(turned_block(blocks[0], support), MAX_GROUPS)
        for block in blocks[1:]:
            sums = sums.plus(turned_block(block, support))
        found.append(sums.gusts)
    assert found[0] == pytest.approx(1.0, abs=0.02)
    assert found[1] == pytest.approx(1.36, abs=0.03)  # energies 1 and 4: mean 2.5, spread 1.5


def test_a_mode_that_no_spring_of_its_group_shows_leaves_the_rotor_to_be_read_whole():
    """Blades' modes among those of the support change their names with every factor: it ended in an error of NumPy."""
    asked = question(record())
    values = {q.name: q.centre for q in asked.parameters}
    spectra, combined = turned_spectra(asked.readings, asked.inputs[:, 0], asked.rate, 1), combine(asked.sensors, 3)

    def frequencies(of: Mapping[str, float]) -> dict[str, float]:
        return {"lag backward": 0.9, "tower side-side": 0.3} if dict(of) == values else {"lag backward": 0.9}

    ratios = {"lag backward": 0.01, "tower side-side": 0.01}
    assert find_places(frequencies, ratios, asked.parameters, spectra, combined, ("beta_1", "beta_2", "beta_3")) is None

"""The lifted spectrum, its transfer functions and its likelihood, against what does not use them."""

from dataclasses import replace

import numpy as np
import pytest

from windsysid.identification.model.prior import Prior
from windsysid.identification.model.tolerances import in_numbers, tolerances_of
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.rotor import RotorModel
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.record import simulate_record
from windsysid.simulation.wind.field import WindConditions, rotating_turbulence
from windsysid.spectral.rotor import likelihood as lifted_likelihood
from windsysid.spectral.rotor import model as lifted_model
from windsysid.spectral.rotor.build import pose_lifted
from windsysid.spectral.rotor.harmonic_transfer import coupled, matrix_harmonics
from windsysid.spectral.rotor.load_spectra import STATIONS, WindLoads, WindRotor
from windsysid.spectral.rotor.model import LiftedModel
from windsysid.spectral.rotor.problem import Posed, RotorQuestion
from windsysid.spectral.transforms.dft import taper
from windsysid.spectral.transforms.lifted import count_harmonics, lift, without_rotor_harmonics
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine

ROTOR_HZ = 1.16


def test_white_noise_has_the_density_that_it_should_have() -> None:
    rng = np.random.default_rng(1)
    azimuth = np.asarray(2.0 * np.pi * ROTOR_HZ * np.arange(20_000) / 100.0)
    found = lift(rng.standard_normal((20_000, 2)), azimuth, 100.0, 3)
    assert found.data.shape[1:] == (7, 2)
    squares = np.abs(found.data) ** 2
    # 115 bins, 7 harmonics, 2 channels: the mean of 1600 exponentials scatters by 2.5 %
    assert squares.mean() == pytest.approx(1.0 / 100.0, rel=0.1)


def test_what_repeats_in_every_turn_is_taken_out() -> None:
    azimuth = np.asarray(0.3 + 2.0 * np.pi * ROTOR_HZ * np.arange(9_000) / 100.0)
    values = 5.0 + 3.0 * np.cos(azimuth - 0.2) - 40.0 * np.sin(3.0 * azimuth)
    assert np.abs(lift(values[:, None], azimuth, 100.0, 3).data).max() < 1e-9


def test_lines_are_those_of_least_squares_under_the_taper() -> None:
    rng = np.random.default_rng(2)
    psi = 0.3 + 0.1 * np.arange(900) + 0.02 * np.cumsum(rng.normal(size=900)) / 30.0
    y, h = rng.normal(size=(900, 2)) + np.cos(3.0 * psi)[:, None], taper(900)
    left = without_rotor_harmonics(y, psi, h, 5)
    basis = np.column_stack([np.ones(900), *(f(k * psi) for k in range(1, 6) for f in (np.cos, np.sin))])
    fitted = np.linalg.lstsq(basis * h[:, None], y * h[:, None], rcond=None)[0]
    assert left == pytest.approx(y - basis @ fitted, abs=1e-11)


def test_the_lifted_vector_is_what_its_definition_says() -> None:
    """Sample by sample, at a speed that is not quite steady; ten turns and a little."""
    rng = np.random.default_rng(3)
    at = np.arange(1030)
    psi = 0.4 + 2.0 * np.pi * at / 100.0 + 0.05 * np.sin(2.0 * np.pi * at / 1000.0)
    y = rng.normal(size=(1030, 1))
    lifted = lift(y, psi, 10.0, 2)
    h, samples = lifted.taper, len(lifted.taper)
    assert round(lifted.rotor_hz * lifted.duration) == 10
    y, psi, at = y[:samples], psi[:samples], at[:samples]
    quiet = without_rotor_harmonics(y, psi, h, count_harmonics(lifted.rotor_hz, 10.0))[:, 0]
    for row, b in zip(lifted.data[:, :, 0], np.round(lifted.base * lifted.duration), strict=True):
        for k, found in zip(lifted.harmonics, row, strict=True):
            expected = np.sum(h * quiet * np.exp(-2j * np.pi * b * at / samples - 1j * k * psi)) / np.sqrt(10.0 * h @ h)
            assert found == pytest.approx(expected, abs=1e-10)


def test_a_line_is_found_at_its_place_in_the_lifted_vector() -> None:
    time = np.arange(10_000) / 100.0
    azimuth = 0.7 + 2.0 * np.pi * ROTOR_HZ * time
    value = np.cos(2.0 * np.pi * (2.0 * ROTOR_HZ + 0.3) * time)
    found = lift(value[:, None], azimuth, 100.0, 3)
    bin_, harmonic = np.unravel_index(np.argmax(np.abs(found.data[:, :, 0])), found.data.shape[:2])
    assert found.base[bin_] == pytest.approx(0.3, abs=0.006)
    assert found.harmonics[harmonic] == 2


@pytest.mark.parametrize("driven", ["load_x", "load_beta_1"])
def test_transfer_equals_integration_in_time(driven: str) -> None:
    """A harmonic load on a rotor of unequal blades makes sidebands as large as the transfer says; the kernels are
    integrated by Runge–Kutta."""
    turbine = load_turbine("verne555")
    still = {"gravity": 0.0, "eccentricity": 0.0, "c_beta_1": 40.0, "c_beta_2": 40.0, "c_beta_3": 40.0}
    turbine = turbine.with_values({**still, "k_beta_2": 3900.0, "c_x": 40.0, "c_y": 40.0})
    model, rate = compile_model(turbine.model, turbine.sensors), 400.0
    speed = 2.0 * np.pi * 1.0  # one turn a second: ten turns are ten seconds
    rotor = constant_speed_inputs(speed, 40.0, rate)
    time = np.arange(len(rotor)) / rate
    base = 0.3
    loads = np.zeros((len(rotor), len(model.loads)))
    loads[:, model.loads.index(driven)] = 1e-3 * np.cos(2.0 * np.pi * base * time)
    p = np.array([turbine.values[name] for name in model.parameters])
    start = np.zeros(len(model.states))
    rest = integrate(model, p, np.hstack([rotor, 0.0 * loads]), rate=rate, start=start).readings
    readings = integrate(model, p, np.hstack([rotor, loads]), rate=rate, start=start).readings - rest
    last = time >= 30.0
    orders = np.arange(-6, 7)
    seen = [
        2e3 * np.mean(readings[last] * np.exp(-2j * np.pi * (base + k) * time[last])[:, None], axis=0) for k in orders
    ]

    found = matrix_harmonics(model, p[None], np.zeros((1, 5)), speed)
    D, R = (coupled(X[:, 0], np.array([base]), orders, 1.0)[0] for X in found)
    force = np.zeros((13, 5))
    force[6, model.loads.index(driven)] = 1.0
    motion = np.linalg.solve(D.reshape(65, 65), force.ravel())
    expected = (R.reshape(65, 65) @ motion).reshape(13, 5)
    assert np.abs(np.array(seen) - expected).max() < 2e-3 * np.abs(expected).max()
    assert np.abs(expected[5]).max() > 1e-3 * np.abs(expected[6]).max()  # there are sidebands


def test_transfer_of_one_degree_of_freedom_is_the_textbooks() -> None:
    turbine = load_turbine("tower").with_values({"tilt": 0.0})
    model = compile_model(turbine.model, turbine.sensors)
    p = np.array([turbine.values[name] for name in model.parameters])
    found = matrix_harmonics(model, p[None], np.zeros((1, 2)), turbine.rotor_speed)
    f = np.array([0.1, 0.3163, 0.7])
    D, R = (coupled(X[:, 0], f, np.array([0]), 0.2)[:, 0, :, 0] for X in found)
    T = R @ np.linalg.inv(D)
    w, v = 2.0 * np.pi * f, turbine.values
    for i, name in enumerate(("side_side", "fore_aft")):
        expected = -(w**2) / (v[f"k_{name}"] + 1j * w * v[f"c_{name}"] - w**2 * v[f"mass_{name}"])
        assert T[:, i, i] == pytest.approx(expected, rel=1e-9)


def _posed(kind: str, duration: float = 40.0) -> Posed:
    """A small problem of each kind; its data are those of a short record."""
    turbine = load_turbine("tower" if kind.startswith("tower") else "verne555")
    rate, duration = (20.0, 300.0) if kind.startswith("tower") else (100.0, duration)
    record = simulate_record(turbine, duration=duration, rate=rate, seed=5)
    parameters = Prior(stiffness=1.1, damping=1.3).parameters(turbine, list(turbine.coefficients), linear=False)
    if kind == "rotor-wind":
        assert isinstance(turbine.model, RotorModel)
        model = replace(turbine.model, air_couples=True)
        turbine = replace(turbine, model=model, values={**turbine.values, "c_hub_blade": 0.0})
        parameters = (*parameters, Parameter("c_hub_blade", 0.0, 4.0, False, 8.0))
    inputs = np.zeros((record.samples, 5 if kind.startswith("tower") else 3))
    inputs[:, 0] = np.unwrap(record["rotor_azimuth"])
    inputs[:, 1] = turbine.rotor_speed
    inexact = kind.endswith(", inexact")
    question = RotorQuestion(
        turbine, turbine.sensors, np.column_stack([record[s.channel] for s in turbine.sensors]), rate, inputs,
        compile_model(turbine.model, turbine.sensors, instruments=inexact), parameters, turbine.loads,
    )  # fmt: skip
    posed = pose_lifted(question, "rotor-wind" if kind == "rotor-wind" else "broadband")
    if not inexact:
        return posed
    tolerances = tolerances_of(turbine, turbine.sensors, [q.name for q in parameters])
    numbers = in_numbers(
        tolerances, question.compiled.parameters, turbine, turbine.sensors, [q.name for q in parameters]
    )
    return posed._replace(model=posed.model._replace(inexact=numbers))


KINDS = (
    "tower", "rotor-wind", "broadband, inexact",
    *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("broadband", "tower, inexact")),
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_is_the_slope_of_the_likelihood(kind: str) -> None:
    model = _posed(kind).model
    at = _near(model)
    found = model.likelihood(at)
    for i, step in enumerate(1e-5 * np.minimum(model.prior[1], 1.0)):
        off = np.zeros(len(at))
        off[i] = step
        slope = (model.likelihood(at + off, slopes=False).value - model.likelihood(at - off, slopes=False).value) / (
            2.0 * step
        )
        assert found.gradient[i] == pytest.approx(slope, rel=1e-3, abs=1e-3 * np.sqrt(found.information[i, i]))


@pytest.mark.parametrize("kind", KINDS)
def test_information_is_fishers(kind: str) -> None:
    """tr S⁻¹ ∂S S⁻¹ ∂S summed over the bins, with ∂S by differences of S; each bin counts g / c_h."""
    model = _posed(kind).model._replace(joint=None)
    at = _near(model)
    S = model.spectrum(at).spectrum
    slopes = []
    for i, step in enumerate(1e-4 * np.minimum(model.prior[1], 1.0)):
        off = np.zeros(len(at))
        off[i] = step
        dS = (model.spectrum(at + off).spectrum - model.spectrum(at - off).spectrum) / (2.0 * step)
        slopes.append(np.linalg.solve(S, dS))
    share = model.data.shape[2] / model.overlap
    expected = np.array([[share * np.einsum("bij,bji->", a, b).real for b in slopes] for a in slopes])
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(model.likelihood(at).information - expected).max() < 1e-4 * scale.max()
    assert (np.abs(model.likelihood(at).information - expected) < 1e-3 * scale).all()


@pytest.mark.parametrize("kind", KINDS)
def test_loops_say_what_products_of_matrices_say(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The compiled loops for few entries and those for many, each taken for all, against NumPy's products; with some
    entries left out, and with what a taper adds."""
    model = _posed(kind).model
    at = _near(model)
    if model.window is None:
        left_out = np.zeros(model.left_out.shape, dtype=np.bool_)
        left_out[::3, 0] = True
        smear = 0.1 * model.spectrum(at).spectrum * ~left_out[:, :, None] * ~left_out[:, None, :]
        place, data = model.place._replace(left_out=left_out), model.data * ~left_out[:, :, None]
        model = model._replace(place=place, smear=smear, data=data)
    found, spectra = [], []
    for few, dense in ((0, 1000), (1000, 1000), (0, 0)):
        monkeypatch.setattr(lifted_likelihood, "MAX_LOOP_ENTRIES", few)
        monkeypatch.setattr(lifted_model, "MAX_LOOP_ENTRIES", dense)
        found.append(model.likelihood(at))
        spectra.append(model.spectrum(at).spectrum)
    for loops, spectrum in zip(found[1:], spectra[1:], strict=True):
        assert np.abs(spectrum - spectra[0]).max() < 1e-12 * np.abs(spectra[0]).max()
        assert loops.value == pytest.approx(found[0].value, rel=1e-11)
        assert np.abs(loops.gradient - found[0].gradient).max() < 1e-9 * np.abs(found[0].gradient).max()
        assert np.abs(loops.information - found[0].information).max() < 1e-9 * np.abs(found[0].information).max()


def test_a_late_logger_turns_the_phase_of_its_readings() -> None:
    """S of late readings is P S Pᴴ with P = e^{−iωκ}, noise and all, as white noise stays white."""
    model = _posed("broadband, inexact").model
    at = model.prior[0].copy()
    on_time = model.spectrum(at).spectrum
    at[model.unknowns.of("clocks")] = 2.0  # of the blades' logger: 2 ms
    m, place = len(model.combine), model.place
    frequency = place.base[:, None] + place.rotor_hz * place.orders[place.entries // m]
    phase = np.exp(-2j * np.pi * frequency * np.where(place.entries % m >= 2, 0.002, 0.0))
    expected = phase[:, :, None] * on_time * phase.conj()[:, None, :]
    assert np.abs(model.spectrum(at).spectrum - expected).max() < 1e-12 * np.abs(expected).max()


def test_every_bin_counts_once_where_neighbours_share_a_spectrum() -> None:
    """54 bins in 14 pools of three and four: the likelihood is that of the bins one by one, none dropped or added."""
    posed = _posed("broadband", 97.0)
    model = posed.model
    assert set(model.counts) == {3.0, 4.0}
    turns = int(97.0 * load_turbine("verne555").rotor_speed / (2.0 * np.pi))
    assert model.counts.sum() == (turns - 1) // 2 - 1
    at = _near(model)
    value = 0.0
    for S, Y, count in zip(model.spectrum(at).spectrum, model.data, model.counts, strict=True):
        for y in Y.T[: int(count)]:
            value += np.linalg.slogdet(S)[1] + (y.conj() @ np.linalg.solve(S, y)).real
        assert not Y[:, int(count) :].any()
    assert model.likelihood(at).value == pytest.approx(value / model.overlap, rel=1e-9)
    assert np.isfinite(model.powers(at)[0]).sum() == model.counts.sum() * model.data.shape[1]


def test_loads_that_grow_and_fall_make_bins_alike() -> None:
    """Noise whose power follows P(t): c_h is T ∫P² / (∫P)², and that of the taper where P stays as it is."""
    model = _posed("broadband", 97.0).model
    rng = np.random.default_rng(2)
    bins, entries, samples = int(model.counts.sum()), model.data.shape[1], 4096
    unit = np.broadcast_to(np.eye(entries, dtype=np.complex128), (len(model.data), entries, entries))
    for depth in (0.0, 0.6):
        power = (1.0 + depth * np.sin(2.0 * np.pi * 3.0 * np.arange(samples) / samples)) ** 2
        noise = np.sqrt(0.5 * power / power.mean()) * rng.standard_normal((2, entries, samples))
        whole = np.fft.fft(noise[0] + 1j * noise[1])[:, :bins].T / np.sqrt(samples)
        data = np.zeros_like(model.data)
        first = 0
        for row, count in zip(data, model.counts.astype(int), strict=True):
            row[:, :count] = whole[first : first + count].T
            first += count
        expected = max(model.overlap, float(np.mean(power**2) / np.mean(power) ** 2))
        # |M_d|² are known to 1/(bins entries), of which c_h holds 26
        assert model._replace(data=data).likeness(unit) == pytest.approx(expected, abs=0.05)


def _near(model: LiftedModel) -> np.ndarray:
    """Unknowns off their priors' centres."""
    rng = np.random.default_rng(3)
    mean, spread = model.prior
    return mean + 0.1 * np.minimum(spread, 1.0) * rng.standard_normal(len(mean))


@pytest.mark.slow
def test_spectra_of_the_wind_are_those_of_the_simulated_field() -> None:
    """Moments of a blade that reads the field with the weights of the model, by Welch's method, against the sum of the
    classes."""
    from scipy.signal import welch

    wind = WindConditions(speed=5.0, hub_height=6.0, turbulence_intensity=0.2)
    hinge, lever, rate = 0.2, 1.8, 20.0
    radii = hinge + (np.arange(STATIONS) + 0.5) / STATIONS * 1.5 * lever
    psi = 2.0 * np.pi * ROTOR_HZ * np.arange(int(1500 * rate)) / rate
    blades = rotating_turbulence(wind, psi, tuple(radii), rate=rate, seed=4).blades
    weights = radii * (radii - hinge)
    moment = blades @ (weights / weights.sum())
    frequency, spectra = welch(moment, rate, nperseg=1024, axis=0)
    measured = spectra.mean(axis=1)

    base = np.array([0.15, 0.3, 0.5])
    orders = np.arange(-2, 3)
    model = WindLoads(RotorModel().freedoms, WindRotor(3, hinge, lever, ROTOR_HZ, wind.std, 4.0), base, orders)
    values = {s.name: s.given for s in model.statistics}
    values |= {
        "load_wind_time": wind.length_scale / wind.speed,
        "load_decay": 12.0 / wind.speed,
        "load_rms_eddies": 1e-9,
    }
    own = model.spectra(values).own
    of_moments = own[:, own.shape[1] // 2 :].reshape(len(base), 3, -1).sum(axis=1)[:, 1:-1]
    ratios = [
        0.5 * measured[np.abs(frequency - abs(base[b] + order * ROTOR_HZ)) < 0.04].mean() / of_moments[b, k]
        for b in range(len(base))
        for k, order in enumerate(orders)
    ]
    # two sides; the mean of 120 exponentials scatters by 9 %, of all by 3 %, and spectra bend within Welch's window
    assert np.abs(np.log(ratios)).max() < 0.35
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15)

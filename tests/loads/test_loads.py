"""Load models: processes against their closed forms, and what drives what against forces drawn by hand."""

import numpy as np
import pytest
from scipy.linalg import expm

from windsysid.errors import ConfigurationError
from windsysid.loads.rotor_forces import BladeForces, blade_force, rotor_harmonic
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.process import Process, first_order, load_on, rational, second_order

FREQUENCY = np.array([0.0, 0.03, 0.4, 1.7, 12.0])
PROCESSES = {
    "first order": first_order(2.0, 0.5),
    "swinging": second_order(2.0, 1.3, 0.2),
    "critically damped": second_order(2.0, 1.3, 1.0),
    "overdamped": second_order(2.0, 1.3, 2.3),
    "two poles and a zero": rational(2.0, [-0.5, -3.5], [-9.0]),
    "three poles": rational(2.0, [-0.5, -3.0 + 4.0j, -3.0 - 4.0j], [-1.0]),
}


def drives(load: LoadModel, name: str, psi: float, state: np.ndarray) -> float:
    """The load `name` at the azimuth ψ: H(ψ) z written out."""
    if name not in load.outputs:
        return 0.0
    rows = load.outputs[name]
    k = np.arange(1, (len(rows) + 1) // 2)
    return float((rows[0] + np.cos(k * psi) @ rows[1::2] + np.sin(k * psi) @ rows[2::2]) @ state)


def test_spectra_are_the_textbooks():
    w = 2.0 * np.pi * FREQUENCY
    np.testing.assert_allclose(first_order(3.0, 0.7).spectrum(FREQUENCY), 2.0 * 9.0 * 0.7 / (1.0 + (0.7 * w) ** 2))
    w0, zeta = 2.0 * np.pi * 1.3, 0.2  # white noise through a low-pass: the variance is S(0) ω₀ / 4ζ
    closed = 4.0 * 4.0 * zeta / w0 * w0**4 / ((w0**2 - w**2) ** 2 + (2.0 * zeta * w0 * w) ** 2)
    np.testing.assert_allclose(second_order(2.0, 1.3, 0.2).spectrum(FREQUENCY), closed, rtol=1e-9)
    shape = (81.0 + w**2) / ((0.25 + w**2) * (12.25 + w**2))
    found = rational(2.0, [-0.5, -3.5], [-9.0]).spectrum(FREQUENCY)
    np.testing.assert_allclose(found / found[0], shape / shape[0], rtol=1e-9)


@pytest.mark.parametrize("process", PROCESSES.values(), ids=PROCESSES)
def test_a_process_is_as_loud_as_asked_and_stationary(process: Process):
    assert process.variance == pytest.approx(4.0, rel=1e-12)
    assert process.times(3.0).variance == pytest.approx(36.0, rel=1e-12)
    frequency = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 200_001)])
    spectrum = process.spectrum(frequency)
    area = 2.0 * np.sum(0.5 * (spectrum[1:] + spectrum[:-1]) * np.diff(frequency))
    assert area == pytest.approx(4.0, rel=2e-4)
    driven = process.drift @ process.cov + process.cov @ process.drift.T  # − noise, which enters the last state
    np.testing.assert_allclose(driven[:-1], 0.0, atol=1e-9 * np.abs(driven).max())
    assert driven[-1, -1] < 0.0


@pytest.mark.parametrize("process", PROCESSES.values(), ids=PROCESSES)
def test_steps_are_exact(process: Process):
    block = load_on("w", process)
    for step in (1e-4, 0.01, 0.3):
        transition, noise = block.discretise(step)
        np.testing.assert_allclose(transition, expm(process.drift * step), rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(transition @ process.cov @ transition.T + noise, process.cov, rtol=1e-12, atol=1e-12)
        assert np.linalg.eigvalsh(noise).min() >= -1e-14 * np.abs(process.cov).max()


@pytest.mark.parametrize("blades", [2, 3, 4])
@pytest.mark.parametrize("n", range(6))
def test_a_harmonic_pushes_blades_and_hub_as_forces_on_the_blades_would(blades: int, n: int):
    d, kappa, lever = 0.4, 0.3, 1.7
    names = ("load_x", "load_y", "load_roll", *(f"load_beta_{i}" for i in range(1, blades + 1)))
    to = BladeForces(names, blades, d, kappa)
    amplitudes = np.array([1.3, -0.7])[: 2 if n else 1]
    block = rotor_harmonic(first_order(1.0, 1.0), n, to, lever, "w")
    only_hub = rotor_harmonic(first_order(1.0, 1.0), n, to, lever, "w", moments=False)
    assert block.states == (("w", "w_sine") if n else ("w",))
    for psi in (0.0, 0.4, 2.9):
        theta = psi + 2.0 * np.pi * np.arange(blades) / blades
        force = amplitudes @ np.array([np.cos(n * theta), np.sin(n * theta)])[: len(amplitudes)]
        about_hub = np.sum(force * (1.0 + d / lever))
        expected = {"load_x": np.sum(-np.sin(theta) * force) / lever + kappa * about_hub, "load_roll": about_hub}
        expected |= {"load_y": np.sum(np.cos(theta) * force) / lever}
        for name, value in expected.items():
            for pushed in (block, only_hub):
                assert drives(pushed, name, psi, amplitudes) == pytest.approx(value, abs=1e-12), name
        for i, value in enumerate(force, start=1):
            assert drives(block, f"load_beta_{i}", psi, amplitudes) == pytest.approx(value, abs=1e-12)
            assert f"load_beta_{i}" not in only_hub.outputs


def test_the_hub_of_three_blades_feels_multiples_of_three_turns():
    to = BladeForces(("load_x", "load_y"), 3)
    for n, felt in ((0, ()), (1, (0,)), (2, (3,)), (3, ()), (4, (3,)), (5, (6,))):
        outputs = rotor_harmonic(first_order(1.0, 1.0), n, to, 1.0, "w").outputs
        heard = {(row + 1) // 2 for rows in outputs.values() for row in np.flatnonzero(rows.any(axis=1))}
        assert heard == set(felt), n


def test_a_force_on_one_blade_turns_with_it():
    to = BladeForces(("load_x", "load_y", "load_beta_1", "load_beta_2", "load_beta_3"), 3)
    block = blade_force(second_order(1.0, 2.0, 0.3), 2, to, 1.6, "eddy")
    state = np.array([2.0, 5.0])  # the second state is the rate, which pushes nothing
    for psi in (0.3, 4.0):
        theta = psi + 2.0 * np.pi / 3.0
        assert drives(block, "load_beta_2", psi, state) == pytest.approx(2.0)
        assert drives(block, "load_x", psi, state) == pytest.approx(-np.sin(theta) * 2.0 / 1.6)
        assert drives(block, "load_y", psi, state) == pytest.approx(np.cos(theta) * 2.0 / 1.6)
    assert set(block.outputs) == {"load_x", "load_y", "load_beta_2"}


def test_a_first_order_process_is_the_turbine_files_load():
    file, ours = GaussMarkov("load_x", 3.0, 0.7), load_on("load_x", first_order(3.0, 0.7))
    assert ours.states == file.states
    np.testing.assert_allclose(ours.cov, file.cov)
    np.testing.assert_allclose(ours.outputs["load_x"], file.outputs["load_x"])
    for mine, theirs in zip(ours.discretise(0.02), file.discretise(0.02), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-12)


@pytest.mark.parametrize("time_constant", [0.1, 1.0, 5.0])
def test_behind_a_low_pass_the_samples_have_the_spectrum_of_a_process_cut_off_there(time_constant: float):
    # Closed form of Gauss–Markov, gain of the resampler, all that folds back. Without the filter the samples hold twice
    # as much near half the rate.
    rate, f = 4.0, np.linspace(0.02, 1.98, 50)
    block = GaussMarkov("load_x", 1.0, time_constant, low_pass=0.5 * rate)
    transition, noise = block.discretise(1.0 / rate)
    row = block.outputs["load_x"][0]
    z = np.exp(2j * np.pi * f / rate)
    ours = [
        abs(
            row
            @ np.linalg.solve(x * np.eye(3) - transition, noise)
            @ np.linalg.solve(x * np.eye(3) - transition, np.eye(3)).conj().T
            @ row
        )
        for x in z
    ]

    def cut_off(x: np.ndarray) -> np.ndarray:
        gain = np.where(
            x < 0.4 * rate, 1.0, np.where(x < 0.6 * rate, np.cos(0.25 * np.pi * (x / rate - 0.4) / 0.1), 0.0)
        )
        return np.asarray(gain**2 / (1.0 + (2.0 * np.pi * x * time_constant) ** 2))

    ratio = np.log(ours / (cut_off(f) + cut_off(rate - f)))
    assert np.std(ratio) < 0.05


@pytest.mark.parametrize(
    ("rms", "poles", "zeros"),
    [
        (1.0, [1.0], []), (1.0, [0.0], []), (1.0, [-1.0], [-2.0]), (1.0, [-1.0 + 1.0j], []),
        (1.0, [-1.0, -2.0], [1.0j]),
        (0.0, [-1.0], []), (-1.0, [-1.0], []), (float("nan"), [-1.0], []), (1.0, [float("-inf")], []),
        (1.0, [float("nan")], []),
    ],
)  # fmt: skip
def test_a_spectrum_that_makes_no_sense_is_refused(rms: float, poles: list[complex], zeros: list[complex]):
    with pytest.raises(ConfigurationError, match="rational spectrum: expected a positive rms, poles in the left half"):
        rational(rms, poles, zeros)


def test_what_processes_of_one_shape_share_cannot_be_changed_by_one_of_them():
    quiet, loud = (rational(rms, [-0.5, -3.5], [-9.0]) for rms in (1.0, 5.0))
    assert quiet.drift is loud.drift
    with pytest.raises(ValueError, match="read-only"):
        quiet.drift[0, 0] = 1.0
    assert quiet.variance == pytest.approx(1.0, rel=1e-12)
    assert loud.variance == pytest.approx(25.0, rel=1e-12)

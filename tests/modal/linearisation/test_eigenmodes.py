"""Modes of linearised models: frequencies by hand, names, and intervals by rounding."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.modal.linearisation.whirling_rotor import Rotor
from windsysid.modal.linearisation.coordinates import model_coordinates
from windsysid.modal.linearisation.eigenmodes import LinearisedMode, model_modes
from windsysid.modal.linearisation.lin_file import read_lin_file


def modes_of(rotor: Rotor, folder: Path, **options: object) -> dict[str, LinearisedMode]:
    files = [read_lin_file(path) for path in rotor.write(folder, **options)]  # type: ignore[arg-type]
    return {mode.name: mode for mode in model_modes(files, model_coordinates(files[0])).modes}


def test_blades_on_a_rigid_hub_whirl_at_their_frequency_plus_and_minus_the_rotor_speed(tmp_path: Path):
    rotor = Rotor(hub=1e9, support=1e9 * 0.25, damping=0.2)
    found = modes_of(rotor, tmp_path)
    own = math.sqrt(rotor.blade**2 - rotor.speed**2 - 0.01)
    for pattern, shift in (("backward", -1.0), ("collective", 0.0), ("forward", 1.0)):
        mode, ω = found[f"edge {pattern}"], own + shift * rotor.speed
        assert mode.frequency.estimate == pytest.approx(ω / (2.0 * math.pi), rel=1e-6)
        assert mode.damping_ratio.estimate == pytest.approx(0.1 / math.hypot(0.1, ω), rel=1e-6)
        assert mode.participation[f"edge {pattern}"] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("speed", [0.0, 0.4, 1.2])
def test_whirling_modes_have_the_frequencies_of_the_quartic(tmp_path: Path, speed: float):
    rotor = Rotor(speed=speed)
    found = modes_of(rotor, tmp_path)
    assert sorted(2.0 * math.pi * mode.frequency.estimate for mode in found.values()) == pytest.approx(
        sorted([*np.abs(rotor.whirls()), math.sqrt(rotor.blade**2 - speed**2)]), rel=1e-7
    )
    if speed > 0.0:
        assert 2.0 * math.pi * found["edge backward"].frequency.estimate == pytest.approx(
            -rotor.whirls().min(), rel=1e-7
        )
        assert 2.0 * math.pi * found["edge forward"].frequency.estimate == pytest.approx(rotor.whirls().max(), rel=1e-7)


def test_participations_of_a_mode_add_up_to_one(tmp_path: Path):
    for mode in modes_of(Rotor(), tmp_path).values():
        assert sum(mode.participation.values()) == pytest.approx(1.0)
        assert list(mode.participation.values()) == sorted(mode.participation.values(), reverse=True)


def test_intervals_cover_what_four_digits_lose(tmp_path: Path):
    errors = []
    for k in range(20):
        rotor = Rotor(speed=0.9 + 0.03 * k, damping=0.05, blade=5.0 + 0.01 * k)
        exact = modes_of(rotor, tmp_path)
        rough = modes_of(rotor, tmp_path, number="{:12.3E}", azimuths=1)
        assert all(mode.frequency.std == 0.0 for mode in exact.values())
        for ours, true in zip(rough.values(), exact.values(), strict=True):
            errors.append((ours.frequency.estimate - true.frequency.estimate) / ours.frequency.std)
            errors.append((ours.damping_ratio.estimate - true.damping_ratio.estimate) / ours.damping_ratio.std)
    # Uniform errors: 95 % or more within two standard deviations; rms of 1 within its scatter.
    assert np.mean(np.abs(errors) < 2.0) > 0.93
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.3

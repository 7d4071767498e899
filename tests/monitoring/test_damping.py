"""Structural and aerodynamic damping against closed forms, and against the records that they were put into."""

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from validation.damping import STOP_RPM, STOP_WIND, air_of_the_tower, stop_record, structure

from windsysid import cli
from windsysid.cli.screen import first_screen
from windsysid.errors import ConfigurationError
from windsysid.inspection import inspect_record
from windsysid.monitoring.damping import _half_width, separate_damping
from windsysid.monitoring.separation import DampingBand, Separation
from windsysid.records.formats import write_record
from windsysid.results.posterior import Conditions, Posterior, load_posterior
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine
from windsysid.units import RPM

pytestmark = pytest.mark.usefixtures("without_effects")


C0, A, B = 8000.0, 60000.0, 20000.0
"""Structure, air at the fastest rotor speed, and at the strongest wind [N·s/m]."""


def result(
    c: float | Sequence[float],
    sigma: float | Sequence[float],
    rpm: float | None,
    wind: float | None,
    prior: tuple[float, float] = (1e5, 5e4),
) -> Posterior:
    """A record that says c ± sigma of c_fore_aft, or of both directions, combined with a prior."""
    turbine = load_turbine("tower")
    names = ("fore_aft", "side_side")[: np.size(c)]
    scale = np.array([2.0 * turbine.inertia(q) * turbine.natural_frequency(q) for q in names])
    parameters = tuple(Parameter(f"c_{q}", *prior, False, s) for q, s in zip(names, scale, strict=True))
    said, own = np.atleast_1d(c), np.atleast_1d(sigma)
    variance = 1.0 / (own**-2.0 + prior[1] ** -2.0)
    mean = variance * (said * own**-2.0 + prior[0] * prior[1] ** -2.0)
    conditions = Conditions(None if rpm is None else rpm / RPM, wind)
    name = f"{rpm} rpm, {wind} m/s"
    return Posterior(turbine, parameters, mean / scale, np.diag(variance / scale**2), name, True, conditions)


def told(band: DampingBand | None) -> DampingBand:
    """What a record set told."""
    assert band is not None
    return band


def line(rpm: float, wind: float, fastest: float = 12.0, strongest: float = 16.0) -> float:
    return C0 + A * rpm / fastest + B * wind / strongest if rpm else C0


def test_parked_and_running_are_subtracted_and_their_variances_added():
    (split,) = separate_damping([result(8000.0, 900.0, 0.0, 4.0), result(9e4, 5e3, 12.0, 9.0)]).splits
    outside = norm.sf(2.0)
    structure, air = told(split.structural), told(split.aerodynamic[1])
    assert structure.value == pytest.approx(8000.0, rel=1e-4)
    assert air.value == pytest.approx(82000.0, rel=1e-4)
    for band, sigma in ((structure, 900.0), (air, math.hypot(900.0, 5e3))):
        half = 0.5 * (band.high - band.low) / sigma
        # φ has the density 3 φ⁻⁴ where no scatter is seen
        tail = quad(lambda f, half=half: 3.0 * f**-4.0 * norm.sf(half / f), 1.0, np.inf)[0]
        assert tail == pytest.approx(outside, rel=2e-2)


def test_the_prior_of_the_file_plays_no_part():
    sets = [
        [result(8e3, 900.0, 0.0, 4.0, prior), result(9e4, 5e3, 12.0, 9.0, prior)] for prior in ((1e5, 5e4), (3e4, 1e4))
    ]
    one, other = (separate_damping(found).splits[0].structural for found in sets)
    assert one == pytest.approx(other, rel=1e-3)


def test_records_of_one_length_count_alike_whatever_they_say():
    # A likelihood's variance grows with c: taken at the fit, two parked records of one length have one weight, and
    # their mean is the answer.
    k = 900.0**2 / 8000.0
    said = (6000.0, 10000.0)
    (split,) = separate_damping([result(c, math.sqrt(k * c), 0.0, 4.0, prior=(8e3, 1e6)) for c in said]).splits
    assert told(split.structural).value == pytest.approx(8000.0, rel=1e-4)
    assert split.scatter == pytest.approx(math.sqrt(2.0 * 2000.0**2 / 900.0**2), rel=1e-4)
    values = load_turbine("tower").values
    assert split.critical == pytest.approx(2.0 * math.sqrt(values["k_fore_aft"] * values["mass_fore_aft"]))


@pytest.mark.parametrize(("free", "square"), [(0, 0.0), (3, 2.0), (3, 12.0), (10, 40.0)])
def test_bands_average_over_what_the_scatter_says_of_them(free: int, square: float):
    # φ has the density φ⁻⁴ before, and `free` squares of variance φ² add up to `square`: integrals by SciPy.
    def density(f: float) -> float:
        return float(f ** (-4.0 - free) * math.exp(-0.5 * square / f**2))

    half = _half_width(free, square)
    tail = quad(lambda f: density(f) * 2.0 * norm.sf(half / f), 1.0, np.inf)[0] / quad(density, 1.0, np.inf)[0]
    assert tail == pytest.approx(2.0 * norm.sf(2.0), rel=2e-2)


STATES = ((0.0, 4.0), (7.0, 6.0), (9.0, 8.0), (12.0, 10.0), (12.0, 13.0), (12.0, 16.0))


@pytest.mark.parametrize(
    ("parked", "factor", "least"),
    [(True, 2.0, 0.9), (True, 1.0, 0.954), (False, 1.0, 0.954), (False, 2.0, 0.9)],
)
@pytest.mark.slow
def test_bands_hold_though_records_scatter_more_than_they_say(parked, factor, least):
    rng, held = np.random.default_rng(3), []
    states = [state for state in STATES if parked or state[0]]
    for _ in range(100):
        true = np.array([line(*state) for state in states])
        found = true[:, None] * (1.0 + 0.08 * factor * rng.standard_normal((len(true), 2)))
        sigma = 0.08 * np.sqrt(found * true[:, None])  # of a likelihood: the variance in proportion to the estimate
        results = [result(f, s, *state, prior=(1e5, 1e6)) for f, s, state in zip(found, sigma, states, strict=True)]
        for split in separate_damping(results).splits:
            bands = (told(split.structural), *(band for band in split.aerodynamic if band is not None))
            truth = (C0, *(true[-len(bands) + 1 :] - C0))
            held += [band.low < t < band.high for band, t in zip(bands, truth, strict=True)]
    assert np.mean(held) > least, np.mean(held)


def test_one_rotor_speed_does_not_tell_and_says_what_would():
    found = separate_damping([result(line(12.0, wind), 500.0, 12.0, wind) for wind in (8.0, 12.0, 16.0)])
    (split,) = found.splits
    assert split.structural is None
    assert set(split.aerodynamic) == {None}
    assert told(split.calm).value == pytest.approx(C0 + A, rel=1e-3)
    assert told(split.per_wind).value == pytest.approx(B / 16.0, rel=1e-3)
    assert "cannot be separated" in found.sentence
    assert "min with the rotor parked or idling" in found.lacking[0]


def test_at_one_tip_speed_ratio_the_structure_is_told_though_rotor_speed_and_wind_are_not():
    states = [(rpm, 4.0 / 3.0 * rpm) for rpm in (6.0, 8.0, 10.0, 12.0)]
    (split,) = separate_damping([result(line(*state), 300.0, *state) for state in states]).splits
    assert told(split.structural).value == pytest.approx(C0, rel=1e-2)
    assert told(split.aerodynamic[-1]).value == pytest.approx(A + B, rel=1e-2)
    assert split.per_wind is None


def test_every_part_is_in_one_table_at_80_columns(monkeypatch):
    """The table was divided, with the units alone in its second part, and lost the row of the air."""
    monkeypatch.setenv("COLUMNS", "80")
    found = separate_damping([result(9e4, 5e3, 12.0, 9.0), result(2e4, 5e3, 0.0, 5.0)])
    assert found.sentence.startswith("c_fore_aft: structure")
    shown = first_screen(found.contents()).splitlines()
    (row,) = [line for line in shown if line.lstrip().startswith("air, 12 rpm, 9 m/s ")]
    assert max(len(line) for line in shown[shown.index(row) - 3 : shown.index(row) + 1]) <= 80
    assert sum(line.startswith("coefficient ") for line in shown) == 1


def test_a_single_record_gives_its_total_and_says_what_would_help():
    found = separate_damping([result(9e4, 5e3, 12.0, 9.0)])
    assert found.rows[0][1] == "total, 12 rpm, 9 m/s"
    assert (found.rows[0][0], found.rows[0][4]) == ("c_fore_aft [kN·s/m]", "90.0")
    # 4.9 % of critical at 2.036 rad/s: 16 / (ζ ω) = 2.7 min
    assert "one record gives the sum of structural and aerodynamic damping" in found.lacking[0]
    assert "record 3 min with the rotor parked or idling in weak wind for ±50 %" in found.lacking[0]


def test_a_parked_record_alone_tells_the_structure_and_that_the_air_is_missing():
    found = separate_damping([result(8e3, 900.0, 0.0, 4.0)])
    assert told(found.splits[0].structural).value == pytest.approx(8e3, rel=1e-3)
    assert "nothing is known of aerodynamic damping" in found.lacking[0]


def test_results_without_a_rotor_speed_are_left_out_or_refused():
    known, unknown = result(8e3, 900.0, 0.0, 4.0), result(9e4, 5e3, None, 9.0)
    found = separate_damping([known, unknown])
    assert [state.record for state in found.states] == [known.record]
    assert found.doubts == (f"{unknown.record} is left out: its rotor speed was not recorded",)
    with pytest.raises(ConfigurationError, match="expected results that say how fast the rotor turned"):
        separate_damping([unknown])


def test_scatter_is_said():
    parked = [result(c, 100.0, 0.0, 4.0) for c in (7000.0, 8000.0, 9000.0)]
    assert "records scatter about the fits by 9.9 of their own σ" in separate_damping(parked).doubts[0]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Results of the running and of the stopped rotor, from the command line, of one record with a stop."""
    home = tmp_path_factory.mktemp("stop")
    record = stop_record(0)
    write_record(record, home / "stop.nc")
    (stop,) = inspect_record(record).stops
    found = []
    for name, (start, end) in (("running", (60.0, 660.0)), ("stopped", (stop.start, stop.end))):
        command = ["identify", str(home / "stop.nc"), "--turbine", "tower", "--section", str(start), str(end)]
        said(*command, "--output", str(home / name), "--no-report")
        found.append(home / name)
    return found


def said(*arguments: str) -> int | None:
    """The exit code of a command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["windsysid", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
    return ended.value.code  # type: ignore[return-value]


@pytest.mark.slow
def test_a_stop_tells_structure_and_air_apart(folders):
    assert load_posterior(folders[1]).conditions.rotor_speed == pytest.approx(0.0, abs=0.01)
    assert load_posterior(folders[1]).conditions.wind_speed == pytest.approx(STOP_WIND)
    found: Separation = separate_damping([load_posterior(folder) for folder in folders])
    running, parked = (air_of_the_tower(rpm / RPM, STOP_WIND) for rpm in (STOP_RPM, 0.0))
    for split in found.splits:
        assert split.resolved
        standing = structure().values[split.name] + parked[split.name]
        assert told(split.structural).low < standing < told(split.structural).high
        assert (
            told(split.aerodynamic[0]).low < running[split.name] - parked[split.name] < told(split.aerodynamic[0]).high
        )
    assert found.lacking == ()


def test_parked_records_in_several_winds_go_back_to_none():
    states = ((0.0, 3.0), (0.0, 8.0), (0.0, 14.0), (12.0, 16.0))
    found = separate_damping(
        [result(line(*state) + (300.0 * state[1] if not state[0] else 0.0), 100.0, *state) for state in states]
    )
    (split,) = found.splits
    assert told(split.structural).value == pytest.approx(C0, rel=1e-3)
    assert told(split.aerodynamic[1]).value == pytest.approx(300.0 * 8.0, rel=1e-2)
    assert "extrapolated to no wind" in found.notes[0]


def test_the_command_says_it_and_writes_it(folders, tmp_path, capsys):
    output = tmp_path / "separation"
    assert said("damping", *map(str, folders), "--output", str(output)) in (0, None)
    assert "c_fore_aft: structure and a parked rotor's air" in capsys.readouterr().out
    assert sorted(path.name for path in output.glob("[!.]*")) == [
        "answer.json",
        "report.html",
        "summary.json",
    ]
    summary = json.loads((output / "summary.json").read_text())
    assert summary["coefficients"]["c_fore_aft"]["aerodynamic"][0]["value"] > 2e4
    assert summary["records"][1]["parked"]

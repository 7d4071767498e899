"""A narrow-band load that passed for a mode: with it, spectra and filters find the mode that was there."""

import pytest
import tomli_w
from validation.adversary.campaign import identify_one
from validation.adversary.loads import plus_narrow_band
from validation.adversary.scenarios import SCENARIOS, Scenario, record
from validation.towers import KINDS, Kind, _narrow, simulate

from tests.findings import codes, only, reasons
from windsysid.errors import ConfigurationError
from windsysid.identification.identify import identify
from windsysid.results.identification import Identification
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.tables import as_tables
from windsysid.turbine.turbine import Turbine

NARROW = Kind(loads=_narrow(0.335, 0.003, 0.15, 1))


def towers(kind: Kind, seed: int, monkeypatch: pytest.MonkeyPatch, **options: str) -> tuple[Identification, float]:
    """What is found of a tower, and the worst error in standard deviations."""
    monkeypatch.setitem(KINDS, "this", kind)
    made, true = simulate("this", seed)
    found = identify(made, "tower", prior=DrawnPrior(seed=seed), **options)  # type: ignore[arg-type]
    return found, max(abs(e.estimate - true[e.name]) / e.std for e in found.estimates)


@pytest.mark.slow
def test_a_narrow_band_that_passed_for_a_mode_is_taken_into_account(monkeypatch: pytest.MonkeyPatch):
    """Damping came out a third of the tower's."""
    broad, worst = towers(NARROW, 650000, monkeypatch, loads="broadband", formulation="spectral")
    assert worst > 8.0
    assert reasons(broad)[0].code == "narrow_band_load_preferred"
    assert reasons(broad)[0].data["frequency"] == pytest.approx(0.335, abs=0.0005)
    found, worst = towers(NARROW, 650000, monkeypatch, formulation="spectral")
    assert worst < 3.0
    assert found.diagnosis.trusted
    load = only(found.findings, "narrow_band_load").data
    assert (load["load"], load["frequency"]) == ("fore_aft", pytest.approx(0.335, abs=0.005))
    values = {one.name: one for one in found.statistics}
    assert values["narrow_band_frequency"].low < 0.335 < values["narrow_band_frequency"].high


@pytest.mark.slow
def test_a_weak_sea_is_taken_for_waves_offshore_only(monkeypatch: pytest.MonkeyPatch):
    """Waves of 3.3 s under a tower of 0.32 Hz: spectra explain the record as well without them, which shifts fore-aft
    stiffness and damping. Onshore they are a rival, and estimates were more than three standard deviations off."""
    sea = Kind(loads=_narrow(0.3, 0.03, 0.16, 1))
    onshore, off = towers(sea, 650010, monkeypatch, formulation="spectral")
    assert off < 3.0
    assert "narrow_band_load" not in codes(onshore.findings)
    assert "narrow_band_load_possible" in codes(onshore.findings)
    offshore, worst = towers(sea, 650010, monkeypatch, formulation="spectral", site="offshore")
    assert only(offshore.findings, "narrow_band_load").data["frequency"] == pytest.approx(0.3, abs=0.01)
    assert worst < 3.0
    assert offshore.diagnosis.trusted


@pytest.mark.slow
def test_filters_take_it_into_account(monkeypatch: pytest.MonkeyPatch):
    found, worst = towers(NARROW, 650000, monkeypatch, formulation="joint")
    assert worst < 3.0
    assert found.formulation == "joint"
    load = only(found.findings, "narrow_band_load").data
    assert (load["load"], load["frequency"]) == ("fore_aft", pytest.approx(0.335, abs=0.005))


@pytest.mark.parametrize("damping", [*(pytest.param(one, marks=pytest.mark.slow) for one in (0.5, 1.0)), 3.0])
def test_a_mode_that_is_damped_less_or_more_than_the_file_says_is_none(damping: float, monkeypatch: pytest.MonkeyPatch):
    found, worst = towers(Kind(damping=damping), 650001, monkeypatch, formulation="spectral")
    assert found.diagnosis.trusted
    assert worst < 3.0
    assert "narrow_band_load" not in codes(found.findings)


@pytest.mark.parametrize(
    "seeds", [(650_012,), pytest.param((650_010, 650_011, 650_012), marks=pytest.mark.slow)], ids=["one", "three"]
)
def test_one_that_the_readings_cannot_tell_from_a_mode_widens_the_interval(
    monkeypatch: pytest.MonkeyPatch, seeds: tuple[int, ...]
):
    doubts = []
    for seed in seeds:
        found, worst = towers(Kind(loads=_narrow(0.335, 0.003, 0.1, 1)), seed, monkeypatch, formulation="spectral")
        if found.diagnosis.trusted:
            assert worst < 3.0
        doubts += [one for one in found.findings if one.code == "narrow_band_load_possible"]
    assert "c_fore_aft" in {one.quantities[0] for one in doubts}


@pytest.mark.slow
def test_a_rotor_with_a_narrow_band_in_one_direction_is_right(monkeypatch: pytest.MonkeyPatch):
    """A coefficient of grade A or B was 4.7 standard deviations off."""
    kind = Scenario("loads", plus_narrow_band(1.7, 0.02, 0.25, (1,)))
    monkeypatch.setitem(SCENARIOS, "band on the support", kind)
    found = identify_one("band on the support", 9301)
    assert max(map(abs, found["z"])) < 3.0
    assert found["trusted"]


@pytest.mark.slow
def test_a_rotor_on_its_support_is_asked_too(monkeypatch: pytest.MonkeyPatch):
    """Trusted, and eight standard deviations off."""
    kind = Scenario("loads", plus_narrow_band(1.8, 0.02, 0.25, (0, 1)))
    monkeypatch.setitem(SCENARIOS, "band on the support", kind)
    broad = identify(
        record("band on the support", 9100), "verne555", prior=DrawnPrior(seed=9100), formulation="spectral",
        loads="broadband",
    )  # fmt: skip
    said = [one for one in broad.findings if one.code.startswith("narrow_band_load_")]
    assert any(one.data["frequency"] == pytest.approx(1.8, abs=0.05) for one in said)


@pytest.mark.parametrize(
    ("seed", "formulation"),
    [(9101, "spectral"), *(pytest.param(one, "auto", marks=pytest.mark.slow) for one in (9100, 9101, 9102, 9103))],
)
def test_a_rotor_with_a_narrow_band_on_its_support_is_trusted_and_right(
    seed: int, formulation: str, monkeypatch: pytest.MonkeyPatch
):
    """Searches ended at the load and were dropped: their evidence in every other bin was compared with that of broad
    loads in all bins."""
    kind = Scenario("loads", plus_narrow_band(1.8, 0.02, 0.25, (0, 1)), formulation=formulation)
    monkeypatch.setitem(SCENARIOS, "band on the support", kind)
    found = identify_one("band on the support", seed)
    assert max(map(abs, found["z"])) < 4.0
    assert found["trusted"]
    low, high = found["statistics"]["narrow_band_frequency"][1:]
    assert low < 1.82
    assert high > 1.78


def test_a_support_that_nothing_pushes_has_no_such_load(verne555: Turbine):
    tower = load_turbine("tower")
    made, _ = simulate("healthy", 650002)
    pushed = made.with_channels({f"load_{name}": (made.time * 0.0, "N") for name in ("side_side", "fore_aft")})
    with pytest.raises(ConfigurationError, match="narrow-band: expected a support with a spring"):
        identify(pushed, tower, loads="narrow-band", formulation="joint")


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_a_modal_mass_far_from_the_true_one_gives_no_negative_spectrum(tmp_path):
    """The spectrum of a load was a difference of two much larger ones: rounding made it negative."""
    tables = as_tables(load_turbine("tower"))
    tables["side_side"]["modal_mass"] = "1e-6 kg"
    (tmp_path / "tower.toml").write_text(tomli_w.dumps(tables), encoding="utf-8")
    made, _ = simulate("healthy", 650001)
    found = identify(made.section(0.0, 200.0), load_turbine(tmp_path / "tower.toml"), formulation="spectral")
    assert all(0.2 < mode.frequency.estimate < 0.5 for mode in found.modes)

"""The study of the change of direction: what it claims is what it finds."""

import numpy as np
import pytest

from windsysid.study.wind import (
    ARMS,
    DirectionChangeStudy,
    direction_change_figure,
    direction_change_study,
    load_spectra_figure,
    main,
    summary,
)

KNOWN, OLD, WITHHELD = ARMS


@pytest.fixture(scope="module")
def study() -> DirectionChangeStudy:
    return direction_change_study(0)


@pytest.mark.parametrize(("name", "factor"), [("k_x", 4.0), ("c_x", 3.0), ("k_y", 3.0), ("c_y", 2.0)])
def test_estimates_scatter_at_the_change_where_the_filter_holds_the_old_direction(study, name, factor):
    # Seeds 0 to 3: k_x 3 to 8 times the wander without a change, c_x 3 to 6.
    assert study.wander(OLD, name) > factor * study.wander(OLD, name, changed=False)
    assert study.wander(KNOWN, name) < 1.5 * study.wander(KNOWN, name, changed=False)


def test_nothing_differs_before_the_wind_turns(study):
    before = slice(0, 1700)  # the balance's filter looks ahead by about two seconds
    for name in ("k_x", "c_x"):
        pair = [study.arms[arm].history(name)[0][before][500:] for arm in (KNOWN, OLD)]
        np.testing.assert_allclose(pair[0], pair[1], rtol=0.02)


def test_known_loads_give_the_references_and_withheld_loads_do_not(study):
    for name in ("k_x", "k_y", "k_beta_1"):
        assert study.arms[KNOWN][name].estimate == pytest.approx(study.turbine.values[name], rel=0.005)
    for name in ("c_x", "c_y", "c_beta_1"):
        assert study.arms[KNOWN][name].estimate == pytest.approx(study.turbine.values[name], rel=0.05)
    assert abs(study.arms[WITHHELD]["k_x"].estimate / study.turbine.values["k_x"] - 1.0) > 0.02


def test_damping_is_structure_and_aerodynamics_where_only_loads_at_rest_are_known(study):
    own = study.under.wind.damping[:, 2, 2].mean()
    total = study.loads_at_rest["c_beta_1"].estimate
    assert total == pytest.approx(study.turbine.values["c_beta_1"] + own, rel=0.05)


def test_figures_and_text_are_made(study):
    assert len(direction_change_figure(study).axes) == 6
    assert len(load_spectra_figure(study).axes) == 3
    assert "loads of the old direction" in summary(study)


def test_an_output_that_is_a_file_is_one_line(tmp_path, capsys):
    taken = tmp_path / "taken"
    taken.write_text("")
    assert main(["--output", str(taken)]) == 2
    assert capsys.readouterr().err.startswith("error: ")

"""Values and tables of input files."""

from pathlib import Path

import pytest

from windsysid.errors import ConfigurationError
from windsysid.turbine.models.input_file import InputFile


def test_values_are_found_by_name_in_any_spelling(tmp_path: Path):
    path = tmp_path / "a.dat"
    path.write_text(
        'header\n -2.5 PreCone(1)  - deg\n"my file.dat"   TwrFile - x\n'
        "1.0D+03 Mass\n10, 19 Nodes - list\n.true. On - f\n",
        encoding="utf-8",
    )
    file = InputFile(path)
    assert file.number("precone1") == -2.5
    assert file.text("TwrFile") == "my file.dat"
    assert file.number("Mass") == 1000.0
    assert file.text("Nodes") == "10, 19"
    assert file.flag("On")
    assert not file.flag("Off")
    assert file.where("Mass", "PreCone1") == "a.dat:2, 4"
    with pytest.raises(
        ConfigurationError, match=r"a\.dat:2: PreCone1: expected a whole number of 0 or more, got -2\.5"
    ):
        file.count("PreCone1")


def test_a_folder_in_place_of_a_file_is_refused(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="is a folder"):
        InputFile(tmp_path)


def test_outputs_end_at_end(tmp_path: Path):
    path = tmp_path / "a.dat"
    path.write_text('OutList - x\n"-TwrBsMxt,  Azimuth" - two\nRotSpeed\nEND of it\n"Later"\n', encoding="utf-8")
    assert InputFile(path).outputs() == ["TwrBsMxt", "Azimuth", "RotSpeed"]

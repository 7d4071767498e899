"""A tower pulled and released: bands that hold, beside a damped cosine whose bands do not."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from validation.bjorko import Band, coverage, damped_cosine, decay, identify_decay, read_decay

from validation import bjorko

DATA = Path(__file__).parents[3] / "shared" / "data" / "bjorko" / "pull_release_10Hz.csv"
measured = pytest.mark.skipif(not DATA.is_file(), reason="the record of Björkö is not beside this checkout")


@pytest.mark.slow
def test_without_wind_both_methods_find_frequency_and_damping():
    record = decay(0.835, 0.015, load=0.0, noise=0.02, seconds=28.0, rate=10.0, seed=0)
    found = identify_decay(record)
    frequency, ratio = damped_cosine(record)
    assert frequency.estimate == pytest.approx(0.835, rel=1e-3)
    assert ratio.estimate == pytest.approx(0.015, rel=0.02)
    assert found["frequency"].estimate == pytest.approx(frequency.estimate, rel=1e-3)
    assert found["ratio"].estimate == pytest.approx(ratio.estimate, rel=0.05)


@pytest.mark.slow
def test_under_wind_the_bands_hold_and_those_of_a_damped_cosine_do_not():
    # 12 records: bands of 95 % miss more than two with a probability of 2 %, bands of 30 % miss fewer than six with 4
    # %.
    held = coverage(12)
    assert min(held["windsysid"]) >= 10
    assert max(held["damped cosine"]) <= 6


@pytest.mark.slow
@measured
def test_parts_of_the_measured_decay_agree_within_their_bands():
    record = read_decay(DATA)
    early, late = record.section(11.8, 18.0), record.section(18.0, 40.1)
    found = [identify_decay(part) for part in (early, late)]
    assert all(result.diagnosis.trusted for result in found)
    for name in ("frequency", "ratio"):
        a, b = (result[name] for result in found)
        assert abs(a.estimate - b.estimate) < 2.0 * np.hypot(a.std, b.std)
    before, after = (damped_cosine(part)[0] for part in (early, late))
    assert before.high < after.low  # the damped cosine contradicts itself
    for result in found:  # the crests counted by hand, 13.0 s to 28.5 s: 13 periods
        assert result["frequency"].low < 13.0 / 15.5 < result["frequency"].high


@measured
def test_bands_of_the_whole_decay():
    found = identify_decay(read_decay(DATA).section(11.8, 40.1))
    cosine: Band = damped_cosine(read_decay(DATA).section(11.8, 40.1))[0]
    assert found["frequency"].low < cosine.estimate < found["frequency"].high
    assert found["ratio"].std < 0.006


def test_a_file_that_is_no_decay_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "text.csv"
    path.write_text("time,strain\nnot,numbers\n")
    monkeypatch.setattr(sys, "argv", ["bjorko", "--data", str(path)])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(Path(bjorko.__file__)), run_name="__main__")
    assert isinstance(ended.value.code, str)  # what Python prints, with exit code 1
    assert "expected two columns" in ended.value.code
    assert "\n" not in ended.value.code

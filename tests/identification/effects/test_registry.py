"""The registry of effects: codes, the page that lists them, and a newcomer's effect in one file."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from windsysid.identification.effects import ALTERNATIVES, EFFECTS
from windsysid.identification.effects.regression import Regression, RegressorEffect
from windsysid.identification.job import Job
from windsysid.identification.model.effect import Effect
from windsysid.identification.model.prior_odds import odds_table
from windsysid.identification.pipeline import run
from windsysid.results.sentences import SENTENCES
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Site

ROOT = Path(__file__).parents[3]


def effects() -> list[Effect | RegressorEffect]:
    found: list[Effect | RegressorEffect] = []
    for one in (*EFFECTS, *ALTERNATIVES):
        found += one.effects.values() if isinstance(one, Regression) else [one]
    return found


def table() -> str:
    rows = []
    for one in effects():
        what = (type(one).__doc__ or "").split("\n\n")[0].replace("\n    ", " ").rstrip(".")
        how = "score test" if isinstance(one, RegressorEffect) else "evidence" if one in ALTERNATIVES else "own test"
        rows.append(f"| `{one.code}` | {what} | {how} | `{type(one).__module__.removeprefix('windsysid.')}` |")
    odds = [
        f"| `{code}` | {_as_odds(of['onshore'])} | {_as_odds(of['offshore'])} | {of['reason']} |"
        for code, of in odds_table().items()
    ]
    return "\n".join([
        "| code | effect | test | module |", "|---|---|---|---|", *rows, "",
        "| prior odds of | onshore | offshore | reason |", "|---|---|---|---|", *odds, "",
    ])  # fmt: skip


def _as_odds(odds: float) -> str:
    return f"{odds:g} : 1" if odds >= 1.0 else f"1 : {1.0 / odds:g}"


def test_every_effect_has_a_code_of_its_own():
    codes = [one.code for one in effects()]
    assert len(set(codes)) == len(codes)
    assert all(re.fullmatch(r"[a-z_]+", code) for code in codes)


def test_every_effect_has_prior_odds_at_every_site_and_a_reason():
    codes = {one.code for one in effects()}
    assert set(odds_table()) == {*codes, "waves", "other"}
    for of in odds_table().values():
        assert set(of) == {*get_args(Site), "reason"}
        assert all(of[site] > 0.0 for site in get_args(Site))


def test_every_waveform_has_a_sentence():
    assert {one.code for one in effects() if isinstance(one, RegressorEffect)} <= set(SENTENCES)


def test_the_page_lists_every_effect():
    assert (ROOT / "docs" / "effects.md").read_text(encoding="utf-8").endswith(table())


@pytest.mark.slow
def test_the_effect_of_the_contributors_page_is_found_and_included(monkeypatch: Any):
    """Its code is run as the page has it: mains hum that a converter of 12.5 Hz folds down to its alias."""
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(\"\"\"Mains hum.*?)```", page, re.DOTALL)
    assert len(code.split("\n")) < 120
    scope: dict[str, Any] = {"__name__": "mains_hum"}
    exec(compile(code, "CONTRIBUTING.md", "exec"), scope)
    monkeypatch.setitem(SENTENCES, "mains_hum", scope["SENTENCE"])
    turbine = load_turbine("tower")
    made = simulate_record(turbine, duration=150.0, rate=12.3, seed=7)
    hum = 0.05 * np.sin(2.0 * np.pi * 50.0 * made.time + 0.3)
    channel = "tower_x_acceleration"
    made = made.with_channels({channel: (made[channel] + hum, made.unit(channel))})
    job = Job(made, made, replace(turbine), None, None, None, 12.3, "broadband")
    _, fit = run(job, effects=((Regression([scope["MainsHum"]()]),),))
    (note,) = [one for one in fit.outcome.notes if one.code == "mains_hum"]
    assert note.channels == (channel,)
    assert abs(note.data["size"] - 0.05) < 0.01
    assert "hum at 50 Hz" in str(note)


if __name__ == "__main__":
    print(table(), end="")

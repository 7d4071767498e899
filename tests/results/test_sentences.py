"""The table of sentences: every code has one, that can be made and read; nothing else makes or reads them."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import windsysid
from windsysid.results.finding import Finding, read_finding
from windsysid.results.sentences import SENTENCES, UNKNOWN, names_cause, sentence
from windsysid.results.sentences.record import FAULTS

ROOT = Path(windsysid.__file__).parent

BECAUSE = Finding("prior_conflict", "reason", {"sigmas": 4.2}, ("k_x",)).summary()

EXAMPLE: dict[str, Any] = {
    "alone": True, "amplitude": 4.6, "angle": 0.0123, "at": 0.33, "because": BECAUSE, "blades": 3, "blocks": 5,
    "by": "gravity in its readings", "chance": 0.26, "change": 0.034, "channel": "tower_x_acceleration",
    "channels": ["blade_1_lag_acceleration", "tower_x_acceleration"], "coefficients": [["c_x", -0.1, True]],
    "colour": 0.14, "contradicted": True, "coordinate": "side_side", "coordinates": ["beta_1", "beta_2"],
    "correlation": -0.95, "count": 12, "damping": 0.12, "direction": "k_x +10 % and m +10 %", "drifts": {"z": 0.01},
    "duration": 600.0, "effect": "step", "end": 75.0, "error": "expected no missing samples", "estimate": 0.021,
    "explained": False, "factor": 4.0, "frequencies": [0.33, 0.36], "frequency": 0.612, "gain": 52.0, "group": "gain",
    "high": 1.31, "high_frequency": 4.0, "kept": 60.0, "kurtosis": 1.4, "lag": 1, "law": "stiffness", "least": 12.0,
    "level": 12.0, "load": "fore_aft", "loads": ["load_x", "load_y"], "logger": "rotor", "lost_mode": 4.02, "low": 0.31,
    "low_frequency": 1.0, "low_pass": 12.5, "mean_square": 1.44, "mode": 0.33, "model": "second-order",
    "modes": [["lag forward", -0.002, False]], "names": ["c_x", "tower x"], "of": "tower_x_acceleration",
    "offsets": {"y": -0.03}, "order": 1, "others": [0.4, 0.5], "over": "frequency", "part": "blades",
    "pieces": 1, "rate": 6e-05, "ratio": 1.2, "ranges": [[0.2, 0.7]], "read": 12000, "reason": "evidence",
    "recorded": 50.0, "resolution": 0.005, "rivals": {"broadband": 31.0}, "rms": 210.0, "rotor_frequency": 0.204,
    "seen": "their ratio k_x/m",
    "share": 0.4, "sigmas": 5.2, "size": 0.021, "start": 50.0, "state": "parked", "std": 0.002, "steps": 30,
    "text": "the text of the inspection, or of another version", "time": 302.9, "turns": 40,
    "unit": "N", "units": {"y": "m/s^2", "z": "m/s^2"}, "unseen_blades": True, "variation": 0.031, "weight": 3.4,
    "why": "speed", "wider": 3.7, "width": 0.015,
}  # fmt: skip
"""What findings hold, by name: a name means one thing in all of them."""

OTHERS: dict[str, dict[str, Any]] = {
    "ambiguous_peak": {"modes": ["tower x", "tower y"]}, "class_disagrees_in_bands": {"modes": ["lag collective"]},
    "bands_read": {"modes": {"tower x": 0.33}},
    "faint_peak": {"modes": ["tower x"]}, "modes_not_found": {"modes": {"tower x": 0.33}},
    "loads_of_spectra": {"loads": "broad spectra"},
    "loads_are_states": {"loads": "first-order Gauss–Markov"},
}  # fmt: skip
"""What a few of them hold under another name's meaning."""

LONG = {
    "damping_not_positive", "joint_as_spectra_are_doubtful", "loads_of_spectra", "loads_withheld", "resampled",
    "tolerance_off", "unexplained_peak",
}  # fmt: skip
"""Those of several sentences or findings, which may have more than 160 characters."""


def example(code: str, *quantities: str) -> str:
    return sentence(code, EXAMPLE | OTHERS.get(code, {}), quantities or ("k_x", "k_y"))


MAKERS = {"Finding", "_note", "_graded", "_differ"}
"""Functions that make a finding."""


def made_and_literals() -> tuple[set[str], set[str]]:
    """Codes of the findings that the package makes, and every text of the package but in the table."""
    made, literals = set(), set()
    for path in ROOT.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        made.update(re.findall(rf'(?<![.\w])(?:{"|".join(MAKERS)})\(\s*"([^"]*)"', text))
        if path.parent.name != "sentences":
            literals.update(re.findall(r'"([a-z0-9_]+)"', text))
    return made, literals


@pytest.mark.parametrize("code", [*SENTENCES])
def test_every_code_has_a_sentence_that_can_be_read(code: str):
    text = example(code)
    assert re.fullmatch(r"[a-z][a-z0-9_]*", code)
    assert not re.search(r"[{}]|  |None|\bnan\b|\['", text), text
    assert not text.endswith((":", ";")), text
    assert len(text) <= 160 or code in LONG, (len(text), text)


def test_every_code_that_is_made_is_in_the_table_and_every_one_of_it_is_made():
    made, literals = made_and_literals()
    assert made
    assert made <= set(SENTENCES)
    assert set(SENTENCES) - set(FAULTS) - {UNKNOWN} <= literals


def test_a_cause_is_left_out_where_it_is_known():
    finding = Finding("spectral_line", "reason", {"channel": "x", "frequency": 2.0, "rotor_frequency": 0.5})
    assert str(finding).endswith("near a natural frequency: likely a machine or waves; choose a section without it")
    assert str(finding.caused_by("transient")).endswith("Hz = 4.0P, near a natural frequency")
    plain = Finding("one_block", "reason")
    assert not names_cause(plain.code)
    assert plain.caused_by("transient") == plain


def test_a_finding_holds_plain_values_and_comes_back_from_them():
    finding = Finding(
        "tolerance_off", "note",
        {"group": "clock", "of": "rotor", "estimate": np.float64(2.13e-3), "std": np.inf, "contradicted": np.False_},
        ("k_x",),
    )  # fmt: skip
    stored = finding.summary()
    assert stored["data"]["std"] == "inf"
    assert type(stored["data"]["estimate"]) is float
    assert read_finding(stored) == finding
    assert hash(finding) == hash(read_finding(stored))


def test_a_finding_of_another_version_keeps_its_text():
    for stored in (
        {"code": "found_in_2040", "severity": "reason", "text": "something new", "quantities": ["k_x"], "data": {}},
        {"code": "prior_widened", "severity": "note", "text": "something new", "quantities": [], "data": {"a": 1}},
    ):
        found = read_finding(stored)
        assert (found.code, str(found)) == (UNKNOWN, "something new")
        assert (found.severity, found.quantities) == (stored["severity"], tuple(stored["quantities"]))


def test_what_is_off_is_said_in_engineering_units():
    def said(group: str, of: str, estimate: float, std: float) -> str:
        data = {"group": group, "of": of, "estimate": estimate, "std": std, "factor": 3.0}
        return sentence("tolerance_conflict", data).split(": more than 3 times")[0]

    assert said("clock", "rotor", 2.13e-3, 1e-4) == "the logger rotor is 2.13 ± 0.10 ms late"
    assert said("masses", "hub", -0.03, 0.01) == "the mass of hub is 3.0 ± 1.0 % smaller than its file says"
    assert said("gain", "top", 0.021, 0.004) == "the gain of top is 2.10 ± 0.40 % larger than its file says"
    assert said("alignment", "top", -0.0873, 0.0035) == "top is rotated by -5.00 ± 0.20°"


GIVEN = "the text of the inspection, or of another version"
"""What the example of a code ends in whose text is given to it: such codes share one row."""


def table() -> str:
    """The table of the generated page of codes: docs/reference.py."""
    examples = {code: example(code) for code in sorted(SENTENCES)}
    rows = [f"| `{code}` | {text} |" for code, text in examples.items() if not text.endswith(GIVEN)]
    given = ", ".join(f"`{code}`" for code, text in examples.items() if text.endswith(GIVEN))
    return "\n".join(["| code | sentence |", "|---|---|", *rows, f"| {given} | {GIVEN} |"]) + "\n"


def test_the_table_lists_every_code_once():
    listed = re.findall(r"`([a-z_]+)`", "\n".join(row.rsplit("|", 2)[0] for row in table().splitlines()))
    assert sorted(code for code in listed if code in SENTENCES) == sorted(SENTENCES)


if __name__ == "__main__":
    print(table(), end="")

"""The table of what is said of faults: every kind has a statement that can be made and read."""

import ast
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import windsysid
from windsysid.inspection.fault import SEVERITIES, Fault
from windsysid.inspection.sentences import ADVICE, STATEMENTS
from windsysid.results.sentences.record import FAULTS

SPANS = np.array([[12.3, 12.3], [45.0, 47.5], [60.0, 60.0], [61.0, 61.0], [70.0, 70.0]])

EXAMPLE: dict[str, Any] = {
    "amplitude": 4.6, "at": 360, "azimuth": 1.2, "channels": "tower_x", "degrees": 2.0, "distance": 8.0,
    "ends": [-19.6, 19.6], "every": 5, "gaps": 31, "gravities": 51.0, "identify": 20, "largest": 8.2, "levels": 3.1,
    "longest": 2.5, "mean": 9.7, "mistake": "mg marked as m/s²", "of": "tower_x_acceleration", "off": 3,
    "on_grid": True, "oma": 256, "origin": 12.0, "period": 9, "rate": 10.0, "ratio": 9.55, "relative": 41.0,
    "rms": 500.0, "rpm": 300.0, "share": 0.031, "slow": True, "speed": 31.4, "spread": 0.01, "standing": False,
    "step": 0.02, "swing": 7.0, "text": "12 stamps of 60 were shared", "turbine": "tower", "unit": "m/s^2",
    "upright": "tower_y", "usual": 1.3, "value": 0.0, "vibrating": 4, "worst": 0.2,
}  # fmt: skip


@pytest.mark.parametrize("severity", SEVERITIES)
@pytest.mark.parametrize("kind", [*STATEMENTS])
def test_every_kind_has_a_text_that_can_be_read(kind: str, severity: Any):
    fault = Fault("x", kind, severity, 12, SPANS, EXAMPLE)
    assert fault.text.startswith(fault.statement)
    assert not re.search(r"[{}]|  |None|\bnan\b|[:;]$", fault.text), fault.text
    assert max(len(fault.statement), len(fault.text) - len(fault.statement)) <= 160, fault.text


def test_every_fault_that_is_made_is_in_the_table():
    made = set()
    for path in (Path(windsysid.__file__).parent / "inspection").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or len(node.args) < 2:
                continue
            if getattr(node.func, "id", "") in ("Fault", "unit_fault"):
                kind = node.args[1]
                made |= {kind.value} if isinstance(kind, ast.Constant) else set()
    assert {"gaps", "spikes", "frozen", "no deflection so large"} < made
    assert made - {"unit"} <= set(STATEMENTS)
    assert set(ADVICE) <= set(STATEMENTS)
    assert {code.replace("_", " ") for code in FAULTS} - {"unit"} <= set(STATEMENTS)


def test_what_was_left_out_is_said_instead_of_what_to_do():
    fault = Fault("x", "frozen", "warning", 40, SPANS[1:2], {"longest": 2.5, "share": 0.04})
    said = "frozen: repeats one value for up to 2.5 s, 40 samples (4 %), at 45–47.5 s"
    assert (fault.statement, fault.text) == (said, f"{said}: treat them as missing")
    treated = Fault("x", "frozen", "warning", 40, SPANS[1:2], fault.data, treated_as_missing=True)
    assert treated.text == f"{fault.statement}: taken as missing"
    assert treated.summary()["data"] == {"longest": 2.5, "share": 0.04}

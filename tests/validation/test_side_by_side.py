"""The comparison of two checkouts: which quantities count, as usable, as covered and as worse."""

import math

import pytest
from validation.side_by_side import scored, shifts, summary_rows


def result(k: float, grade: str, seconds: float = 1.0) -> dict[str, object]:
    """An analysis with one stiffness, ±10 % at 2σ."""
    return {"quantities": {"k_x": {"at": math.log(k), "std": 0.05, "log": True, "grade": grade}}, "seconds": seconds}


def run(other: tuple[float, str], this: tuple[float, str], *, healthy: bool = True) -> dict[str, object]:
    """A record with a stiffness of 100 in both checkouts."""
    sides = {side: scored(result(*one), {"k_x": 100.0}) for side, one in (("other", other), ("this", this))}
    return {"set": "towers", "name": "healthy", "seed": 1, "healthy": healthy, **sides}


def test_shares_count_usable_quantities_only():
    runs = [run((100.0, "A"), (101.0, "B")), run((130.0, "C"), (130.0, "A"), healthy=False)]
    other, this = summary_rows(runs)
    assert other[3:8] == ("50.0 %", "100.0 %", "50.0 %", "100.0 %", "0.0")
    assert this[3:8] == ("100.0 %", "100.0 %", "50.0 %", "50.0 %", "5.2")
    assert this[8] == "1.00"


def test_a_refused_record_counts_as_not_usable():
    refused = scored({"refused": "too short", "seconds": 0.1}, {"k_x": 100.0, "c_x": 2.0})
    other, this = summary_rows([{**run((100.0, "A"), (100.0, "A")), "this": refused}])
    assert (other[3], this[3]) == ("50.0 %", "0.0 %")


def test_a_wrong_interval_of_this_checkout_is_listed_and_healthy_shifts_are_in_sigma():
    lines = shifts([run((105.0, "A"), (115.0, "B"))])
    assert lines[0].startswith(f"towers, healthy: shift {math.log(115 / 105) / 0.05:.3f} σ")
    assert lines[1:] == [
        "usable and beyond ±2σ: 1 in this checkout only, 0 in the other only",
        "  towers, healthy, seed 1: k_x: +0.98 σ, grade A → +2.80 σ, B",
    ]


def test_modes_are_matched_and_usable_ones_that_are_none_are_counted():
    def mode(f: float, z: float, grade: str) -> list[dict[str, object]]:
        return [{"at": math.log(value), "std": 0.01, "log": True, "grade": grade} for value in (f, z)]

    found = scored({"modes": [mode(1.0, 0.01, "A"), mode(1.5, 0.02, "B")], "seconds": 1.0}, [(1.01, 0.01), (3.0, 0.01)])
    assert found["none"] == 1
    assert found["expected"] == 4
    assert found["quantities"]["f 1"]["z"] == pytest.approx(-math.log(1.01) / 0.01)

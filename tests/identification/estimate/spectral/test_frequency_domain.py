"""Load models of spectra compared by their evidence."""

from types import SimpleNamespace
from typing import Any

import pytest

from windsysid.identification.estimate.spectral import frequency_domain
from windsysid.identification.estimate.spectral.frequency_domain import MAX_RIVAL_LOG_ODDS

Fits = dict[tuple[str, int], float]


@pytest.fixture
def selected(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Gives the chosen load model, in words why, and how many fits it took, for the log evidence of each model after
    the first stages and after the next."""

    def select(first: dict[str, float], later: dict[str, float]) -> tuple[str, dict[str, Any], int]:
        count = 0

        def fit(model: str, start: Any, stages: Any, smoothed: Any = None, *, rough: bool = False) -> Any:
            nonlocal count
            count += 1
            evidence = later if start == "later" else first
            return SimpleNamespace(unknowns="later", log_evidence=evidence[model])

        monkeypatch.setattr(frequency_domain, "fit", fit)
        poses: Any = {name: SimpleNamespace(model=name, start="first", smoothed=None) for name in first}
        found = frequency_domain._after_stages(poses)
        return found.name, found.why, count

    return select


def test_a_clear_winner_of_the_first_stages_is_fitted_alone(selected: Any):
    name, why, fits = selected({"a": 0.0, "b": MAX_RIVAL_LOG_ODDS + 1.0}, {"a": 0.0, "b": 0.0})
    assert (name, fits) == ("b", 3)
    assert why == {"rivals": {"a": MAX_RIVAL_LOG_ODDS + 1.0}, "part": True}


def test_rivals_are_compared_again_on_more_of_the_record(selected: Any):
    name, why, fits = selected({"a": 0.0, "b": 2.0}, {"a": 9.0, "b": 2.0})
    assert (name, fits) == ("a", 5)
    assert why == {"rivals": {"b": 7.0}, "part": False}

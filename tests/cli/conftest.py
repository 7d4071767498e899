"""Commands that identify the same record in the same way share one result: what is tested here is around it."""

import pytest

from tests.conftest import identify_once
from windsysid.identification import identify as front_door


@pytest.fixture(autouse=True)
def shared_answers(monkeypatch: pytest.MonkeyPatch, without_effects: None) -> None:
    monkeypatch.setattr(front_door, "identify", identify_once)


@pytest.fixture
def by_spectra(monkeypatch: pytest.MonkeyPatch, shared_answers: None) -> None:
    """Identify by spectra alone, without filters beside them, in tests that ask nothing of the automatic choice."""
    spectral = {"formulation": "spectral"}
    monkeypatch.setattr(front_door, "identify", lambda *given, **options: identify_once(*given, **(options | spectral)))


@pytest.fixture
def without_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the page of an identification empty."""
    monkeypatch.setattr("windsysid.reports.identification.identification_report", lambda *_: b"")

"""The sentences of findings, by code, in one table: nothing else writes, reads or changes them.

A sentence is a template (`windsysid.results.sentences.template`) or a function of a finding's data. ``{quantity}`` is
the first coefficient that the finding concerns, ``{because}`` the sentence of another finding. Where a sentence has two
parts, the second names a likely cause and what to do. It is left out where the cause is known otherwise
(`windsysid.results.finding.Finding.caused_by`).
"""

from collections.abc import Mapping, Sequence
from typing import Final

from windsysid.results.sentences.estimates import ESTIMATES
from windsysid.results.sentences.innovations import INNOVATIONS
from windsysid.results.sentences.model import MODEL
from windsysid.results.sentences.record import RECORD
from windsysid.results.sentences.spectra import SPECTRA
from windsysid.results.sentences.template import Data, Sentence, Template, fill

__all__ = ["SENTENCES", "UNKNOWN", "is_known", "names_cause", "sentence"]

UNKNOWN = "unknown"
"""The code of a finding of another version of windsysid, of which only the text is known."""

SENTENCES: Final[Mapping[str, Sentence]] = {**INNOVATIONS, **RECORD, **ESTIMATES, **SPECTRA, **MODEL, UNKNOWN: "{text}"}
"""For each code its sentence."""

_NOT_FINITE = ("nan", "inf", "-inf")


def sentence(code: str, data: Data, quantities: Sequence[str] = ()) -> str:
    """The sentence of a finding.

    Examples
    --------
    >>> sentence("spectral_line", {"channel": "x", "frequency": 3.48, "rotor_frequency": 1.16, "cause": "transient"})
    'x has a sinusoid at 3.48 Hz = 3.0P, near a natural frequency'
    """
    values = {name: float(value) if value in _NOT_FINITE else value for name, value in data.items()}
    values |= {"quantities": list(quantities), "quantity": next(iter(quantities), "")}
    if "because" in data:
        because = data["because"]
        values["because"] = sentence(because["code"], because["data"], because["quantities"])
    return "".join(fill(part, values) for part in _parts(code)[: 1 if "cause" in data else 2])


def names_cause(code: str) -> bool:
    """Test whether the sentence of a code names a likely cause."""
    return len(_parts(code)) > 1


def is_known(code: str, data: Data, quantities: Sequence[str]) -> bool:
    """Test whether this version can make the sentence of a finding."""
    try:
        return bool(sentence(code, data, quantities))
    except (KeyError, IndexError, TypeError, ValueError):
        return False


def _parts(code: str) -> tuple[Template, ...]:
    entry = SENTENCES[code]
    return entry if isinstance(entry, tuple) else (entry,)

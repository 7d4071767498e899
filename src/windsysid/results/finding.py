"""Findings of an identification about its own result, as data: code, severity, numbers and quantities.

Programs test the code; people read the sentence that `windsysid.results.sentences` makes of it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from windsysid.results.sentences import UNKNOWN, is_known, names_cause, sentence

__all__ = ["Finding", "Severity", "read_finding"]

Severity = Literal["note", "remark", "reason"]
"""A note says what was done to the record or the model. A remark does not speak against the result; a reason does."""


@dataclass(frozen=True)
class Finding:
    """One thing that a reader of a result must know.

    Attributes
    ----------
    code
        Which one: a key of `windsysid.results.sentences.SENTENCES`.
    severity
        ``note``, ``remark`` or ``reason``.
    data
        Numbers in SI and names that the sentence is made of, as JSON holds them; ``channel`` and ``channels`` are names
        of channels, ``because`` is another finding.
    quantities
        Names of the coefficients that it concerns; empty where it concerns all, or where that is not known.
    """

    code: str
    severity: Severity
    data: Mapping[str, Any] = field(default_factory=dict, hash=False)
    quantities: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "data", _plain(self.data))

    def __str__(self) -> str:
        return sentence(self.code, self.data, self.quantities)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that it concerns."""
        alone = self.data.get("channel")
        return (*([alone] if alone else []), *self.data.get("channels", ()))

    def caused_by(self, cause: str) -> "Finding":
        """Finding with a cause that is known otherwise: its sentence then names no likely one."""
        if "because" in self.data:
            return replace(self, data={**self.data, "because": read_finding(self.data["because"]).caused_by(cause)})
        return replace(self, data={**self.data, "cause": cause}) if names_cause(self.code) else self

    def summary(self) -> dict[str, Any]:
        """As plain values, for ``summary.json`` and ``identification.nc``."""
        return {
            "code": self.code, "severity": self.severity, "text": str(self), "quantities": list(self.quantities),
            "data": dict(self.data),
        }  # fmt: skip


def read_finding(stored: Mapping[str, Any]) -> Finding:
    """The finding of a `Finding.summary`; one of the code ``unknown`` with its text where this version of windsysid
    cannot make its sentence."""
    code, data, quantities = stored["code"], stored["data"], tuple(stored["quantities"])
    if not is_known(code, data, quantities):
        code, data = UNKNOWN, {"text": stored["text"], "code": code}
    return Finding(code, stored["severity"], data, quantities)


def _plain(value: Any) -> Any:
    """A value as JSON holds it; a number that is not finite becomes a text."""
    if isinstance(value, Finding):
        return value.summary()
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(one) for one in value]
    value = value.item() if isinstance(value, np.generic) else value
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value

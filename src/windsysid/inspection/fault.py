"""Faults of a record as data: kind, severity, places and numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from windsysid._types import Array
from windsysid.inspection.sentences import advice, statement

__all__ = ["SEVERITIES", "Fault", "Severity", "unit_fault"]

Severity = Literal["note", "warning", "unusable"]
SEVERITIES: tuple[Severity, ...] = ("unusable", "warning", "note")
"""The worst first. A note is good to know; a warning needs a hand; what is unusable has to be left out."""


@dataclass(frozen=True, eq=False)
class Fault:
    """One thing that is wrong with a record, or worth knowing of it.

    Attributes
    ----------
    channel
        Name; empty where the whole record is meant.
    kind
        ``spikes``, ``frozen``, ``clipping`` …: the same words for the same fault, for programs.
    severity
        ``note``, ``warning`` or ``unusable``.
    count
        Samples (or gaps) concerned.
    spans
        (n, 2) [s]: first and last time of each place; empty where it is everywhere.
    data
        Numbers and names that its text is made of (`windsysid.inspection.sentences`).
    treated_as_missing
        Whether the readings concerned were left out of what was read.
    """

    channel: str
    kind: str
    severity: Severity
    count: int
    spans: Array = field(default_factory=lambda: np.empty((0, 2)))
    data: Mapping[str, Any] = field(default_factory=dict)
    treated_as_missing: bool = False

    @property
    def statement(self) -> str:
        """Statement of the fault and its amount."""
        return statement(self.kind, self.count, self.spans, self.data)

    @property
    def text(self) -> str:
        """Statement of the fault, its amount, and the advice or the action taken."""
        do = "taken as missing" if self.treated_as_missing else advice(self.kind, self.severity, self.data)
        return f"{self.statement}: {do}" if do else self.statement

    def summary(self, most: int = 50) -> dict[str, Any]:
        """As plain values; at most `most` places."""
        return {
            "channel": self.channel,
            "kind": self.kind,
            "severity": self.severity,
            "text": self.text,
            "count": self.count,
            "spans_s": [[float(a), float(b)] for a, b in self.spans[:most]],
            "data": dict(self.data),
        }


def unit_fault(channel: str, evidence: str, severity: Severity = "warning", **data: Any) -> Fault:
    """Fault of kind ``unit``, with the evidence for it."""
    return Fault(channel, "unit", severity, 0, data={"evidence": evidence, **data})

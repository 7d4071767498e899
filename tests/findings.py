"""Findings of a result by severity and code."""

from windsysid.checks.verdict import Diagnosis
from windsysid.results.finding import Finding
from windsysid.results.values import IdentificationValues


def all_of(result: Diagnosis | IdentificationValues, severity: str) -> list[Finding]:
    """The findings of one severity, in their order."""
    return [one for one in result.findings if one.severity == severity]


def reasons(result: Diagnosis | IdentificationValues) -> list[Finding]:
    return all_of(result, "reason")


def remarks(result: Diagnosis | IdentificationValues) -> list[Finding]:
    return all_of(result, "remark")


def notes(result: Diagnosis | IdentificationValues) -> list[Finding]:
    return all_of(result, "note")


def codes(findings: "list[Finding] | tuple[Finding, ...]") -> list[str]:
    return [one.code for one in findings]


def only(findings: "list[Finding] | tuple[Finding, ...]", code: str) -> Finding:
    """The one finding of a code."""
    (found,) = [one for one in findings if one.code == code]
    return found

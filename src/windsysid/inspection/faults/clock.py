"""Faults of the clock of a record: gaps, irregular steps of the time stamps, and rows that were written twice."""

import numpy as np

from windsysid._types import Array
from windsysid.inspection.channels import VIBRATION, kinds
from windsysid.inspection.fault import Fault
from windsysid.inspection.faults.runs import spans_of
from windsysid.inspection.limits import MAX_OFF_GRID_STEPS, MAX_SEPARATE_GAPS, MAX_SHORT_GAP_SAMPLES
from windsysid.records.record import RATE_DOUBT, STAMPS, Record

__all__ = ["clock_faults"]


def clock_faults(record: Record) -> list[Fault]:
    """Gaps and irregular steps of the time stamps, and rows that were written twice."""
    found = [*_gaps_and_steps(record)]
    if STAMPS in record.attributes:
        found.append(Fault("", "shared time stamps", "note", 0, data={"text": record.attributes[STAMPS]}))
    if RATE_DOUBT in record.attributes:
        found.append(Fault("", "sampling rate", "warning", 0, data={"text": record.attributes[RATE_DOUBT]}))
    return found + _repeated_rows(record)


def _gaps_and_steps(record: Record) -> list[Fault]:
    steps = np.diff(record.time)
    usual = 1.0 / record.rate
    found = list[Fault]()
    scatter = _scatter_of_steps(steps / usual)
    gap = (np.rint(steps / usual) > 1) & (steps > (1.0 + 5.0 * scatter) * usual)  # scatter alone loses no sample
    short = gap & (steps <= (MAX_SHORT_GAP_SAMPLES + 1.5) * usual)
    if np.count_nonzero(short) > MAX_SEPARATE_GAPS:
        lost = int(np.sum(np.rint(steps[short] / usual) - 1))
        data = {
            "share": lost / (lost + record.samples), "gaps": int(np.count_nonzero(short)),
            "longest": float(steps[short].max()),
        }  # fmt: skip
        found.append(Fault("", "short gaps", "warning", lost, data=data))
    long = gap & ~short if found else gap
    if long.any():
        spans = np.column_stack([record.time[:-1][long], record.time[1:][long]])
        lost = int(np.sum(np.rint(steps[long] / usual) - 1))
        share = lost / (lost + record.samples)
        data = {"share": share, "longest": float(steps[long].max())}
        found.append(Fault("", "gaps", "unusable" if share > 0.5 else "warning", lost, spans, data))
    inside = steps[~gap] / usual - 1.0
    if inside.size and np.max(np.abs(inside)) > 0.01:
        worst, off = float(np.max(np.abs(inside))), (np.abs(steps / usual - 1.0) > 0.1) & ~gap
        count, spans = int(off.sum()), spans_of(record.time[1:], off)
        data = {"step": usual, "spread": float(np.std(inside)), "worst": worst, "off": count}
        data["on_grid"] = bool(count) and record.has_grid
        found.append(Fault("", "irregular sampling", "warning" if worst > 0.1 else "note", count, spans, data))
    return found


def _scatter_of_steps(steps: Array) -> float:
    """Standard deviation of the steps of a clock [usual steps]; about whole multiples for a regular clock that lost
    samples."""
    apart = float(np.percentile(np.abs(steps - np.maximum(np.rint(steps), 1.0)), 90.0))
    if apart > MAX_OFF_GRID_STEPS:
        apart = float(np.percentile(np.abs(steps - 1.0), 90.0))
    return apart / 1.645


def _repeated_rows(record: Record) -> list[Fault]:
    """Rows equal to the row before in every channel that never rests: a logger that wrote a sample twice."""
    same = record.values[1:] == record.values[:-1]
    lively = same.mean(axis=0) < 0.05
    vibration = [kind in VIBRATION or kind == "azimuth" for kind in kinds(record).values()]
    chosen = lively & np.array(vibration, dtype=np.bool_)
    if chosen.sum() < 2:
        return []
    repeated = np.concatenate([[False], same[:, chosen].all(axis=1)])
    if not repeated.any():
        return []
    spans = spans_of(record.time, repeated)
    return [Fault("", "repeated rows", "warning", int(repeated.sum()), spans, {"vibrating": int(chosen.sum())})]

"""Is `windsysid compare` right? False alarms, detections and bands, on pairs of simulated records that share nothing.

Every seed is four records of the packaged tower, each with loads and noise of its own: A, and B of the same turbine; a
third whose two damping coefficients are halved, and a fourth whose are doubled. Each is identified as a user would,
with statistics of loads and noise learned, and A compared with the other three. For every other seed the two sides have
priors that were moved apart. Side-side damping (0.6 % of critical) is hardly determined by so short a record, fore-aft
damping (12 %) is, and stiffness always.

Odds are a ratio of two probabilities of the data, so that without a change they exceed x : 1 in no more than one case
of x, whatever the truth (Markov's inequality: their mean without a change is 1). That is the promise to be kept: no
more than 1 % of coefficients beyond 100 : 1, and 10 % beyond 10 : 1.

    python -m validation.comparison --pairs 500

takes about a third of a second a record on an idle machine. Results are kept in ``--cache`` by seed, so that a run that
was stopped goes on where it was. ``--reuse 5`` compares each A with the others of five seeds, its own and the next
ones: five times as many pairs, which are not independent of each other, though the two sides of each pair are. Standard
errors are those of the number of seeds.
"""

import argparse
import math
import pickle
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from windsysid.identification.identify import identify
from windsysid.identification.model.prior import Prior
from windsysid.monitoring.change import QuantityChange
from windsysid.monitoring.comparison import compare
from windsysid.output.console import render
from windsysid.results.posterior import Posterior
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

DURATION, RATE = 200.0, 3.5
"""Of a record [s], [Hz]: 63 periods of the tower."""

FACTORS = {"nothing": 1.0, "c x 0.5": 0.5, "c x 2": 2.0}
"""Change between A and the other record, and its effect on both damping coefficients."""

PRIORS = (Prior(), Prior(stiffness=1.3, damping=0.5), Prior(stiffness=0.8, damping=2.5))
"""Of an unmoved result, and of the two sides of every other pair."""

INFORMED = 0.5
"""Least share of the information from the data, in the less informed result, that makes a coefficient informed."""


def tower() -> Turbine:
    """The packaged tower with 12 % fore-aft damping and without blade-passing lines, which take most of the time."""
    turbine = load_turbine("tower").exact()
    turbine = replace(turbine, loads=tuple(load for load in turbine.loads if not load.harmonic))
    return turbine.with_values({"c_fore_aft": 2.0 * turbine.values["c_fore_aft"]})


class Outcome(NamedTuple):
    """One coefficient or statistic of one pair."""

    what: str
    apart: bool
    name: str
    informed: float
    change: QuantityChange

    @property
    def truth(self) -> float:
        """B over A, in %."""
        return 100.0 * (FACTORS[self.what] - 1.0) if self.name.startswith("c_") else 0.0

    @property
    def held(self) -> bool:
        """True if the ±2σ band covers the true value."""
        return self.change.low <= self.truth <= self.change.high


def side(turbine: Turbine, seed: int, factor: float, prior: Prior) -> Posterior:
    """The result of one record."""
    names = [name for name in turbine.values if name.startswith("c_")]
    truth = turbine.with_values({name: factor * turbine.values[name] for name in names})
    record = simulate_record(truth, duration=DURATION, rate=RATE, seed=seed)
    return identify(record, turbine, formulation="joint", prior=prior, loads="broadband").posterior


def records(turbine: Turbine, seed: int, cache: Path) -> list[Posterior]:
    """The results of A and of the three others, from the cache where they are there."""
    path = cache / f"pair_{seed}.pickle"
    if not path.exists():
        priors = PRIORS[1:] if seed % 2 else (PRIORS[0], PRIORS[0])
        found = [side(turbine, 4 * seed, 1.0, priors[0])]
        found += [side(turbine, 4 * seed + i, factor, priors[1]) for i, factor in enumerate(FACTORS.values(), 1)]
        unfinished = path.with_suffix(".part")
        unfinished.write_bytes(pickle.dumps(found))
        unfinished.replace(path)
    return list(pickle.loads(path.read_bytes()))


def outcomes_of(before: Posterior, others: Sequence[Posterior], apart: bool) -> list[Outcome]:
    """A compared with all three others."""
    found = []
    for what, after in zip(FACTORS, others, strict=True):
        comparison = compare(before, after)
        for change in comparison.coefficients:
            share = min(_share(result, change.name) for result in (before, after))
            found.append(Outcome(what, apart, change.name, share, change))
        found += [Outcome(what, apart, change.name, 1.0, change) for change in comparison.statistics]
    return found


def _share(result: Posterior, name: str) -> float:
    """Share of the knowledge that comes from the data, as `windsysid.results.identification.Estimate` has it."""
    i = [q.name for q in result.parameters].index(name)
    return 1.0 - float(result.cov[i, i]) / result.parameters[i].prior[1] ** 2


def tables(outcomes: Sequence[Outcome], seeds: int, reuse: int) -> list[Any]:
    """False alarms, then detections with the bands."""
    from rich.table import Table

    made = f"{seeds * reuse} pairs from {seeds} seeds"

    alarms = Table(title=f"{made}, without a change", title_justify="left")
    for heading in (
        "",
        "compared",
        "beyond 100 : 1",
        "promised",
        "beyond 10 : 1",
        "promised",
        "±2σ holds 0",
        "mean z²",
    ):
        alarms.add_column(heading, justify="left" if not heading else "right")
    still = [o for o in outcomes if o.what == "nothing"]
    for label, group in _groups(still):
        beyond = [sum(o.change.log_odds > math.log(odds) for o in group) for odds in (100.0, 10.0)]
        alarms.add_row(
            label, str(len(group)), str(beyond[0]), f"≤ {len(group) / 100.0:.3g}", str(beyond[1]),
            f"≤ {len(group) / 10.0:.3g}",
            f"{_percent(sum(o.held for o in group), len(group), reuse)}",
            f"{sum(_z(o) ** 2 for o in group) / len(group):.2f}",
        )  # fmt: skip
    moved = Table(title=f"{made}, both damping coefficients moved", title_justify="left")
    for heading in ("", "compared", "beyond 100 : 1", "beyond 10 : 1", "truth in ±2σ", "median band B/A", "endless"):
        moved.add_column(heading, justify="left" if not heading else "right")
    for what in FACTORS:
        for label, group in _groups([o for o in outcomes if o.what == what and o.name.startswith("c_")])[1:]:
            if label.startswith("  c") and what != "nothing":
                _add(moved, f"{what}: {label.strip()}", group, reuse)
    for what in ("c x 0.5", "c x 2"):
        _add(moved, f"{what}: k, not moved", [o for o in outcomes if o.what == what and o.name.startswith("k_")], reuse)
    return [alarms, moved]


def _add(table: Any, label: str, group: Sequence[Outcome], reuse: int) -> None:
    n = len(group)
    beyond = [sum(o.change.log_odds > math.log(odds) for o in group) for odds in (100.0, 10.0)]
    ends = [sorted(1.0 + getattr(o.change, end) / 100.0 for o in group)[n // 2] for end in ("low", "high")]
    open_ = sum(math.isinf(o.change.high) or o.change.low <= -100.0 for o in group)
    table.add_row(
        label, str(n), *(_percent(count, n, reuse) for count in beyond), _percent(sum(o.held for o in group), n, reuse),
        f"{ends[0]:.2f} … {ends[1]:.2f}".replace("inf", "∞"), _percent(open_, n, reuse),
    )  # fmt: skip


def _groups(outcomes: Sequence[Outcome]) -> list[tuple[str, list[Outcome]]]:
    """Coefficients all together and by kind, then statistics."""
    coefficients = [o for o in outcomes if o.name.startswith(("k_", "c_"))]
    c = [o for o in coefficients if o.name.startswith("c_")]
    groups = [
        ("all coefficients", coefficients),
        ("  stiffness", [o for o in coefficients if o.name.startswith("k_")]),
        ("  c, informed", [o for o in c if o.informed >= INFORMED]),
        ("  c, hardly informed", [o for o in c if o.informed < INFORMED]),
        ("  one prior", [o for o in coefficients if not o.apart]),
        ("  priors apart", [o for o in coefficients if o.apart]),
        ("loads and noise", [o for o in outcomes if o not in coefficients]),
    ]
    return [(label, group) for label, group in groups if group]


def _z(outcome: Outcome) -> float:
    """The difference in standard deviations, from its probability by chance."""
    from scipy.special import erfcinv

    return math.sqrt(2.0) * float(erfcinv(max(outcome.change.chance, 1e-300)))


def _percent(count: int, of: int, reuse: int) -> str:
    """A share with its standard error, as if reused records held no more information."""
    share, independent = count / of, of / reuse
    return (
        f"{100.0 * share:.1f} ± {100.0 * math.sqrt(max(share * (1.0 - share), 0.25 / independent) / independent):.1f} %"
    )


def main() -> None:
    """Run the pairs and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--pairs", type=int, default=500, help="how many, of four records each")
    parser.add_argument(
        "--first-seed", type=int, default=1000, help="of the first pair; those below 1000 are for trials"
    )
    parser.add_argument(
        "--cache", type=Path, default=Path("build/validation-comparison"), help="folder that keeps what is done"
    )
    parser.add_argument("--reuse", type=int, default=1, help="seeds that each record without a change is compared with")
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    turbine, kept, seeds = tower(), list[list[Posterior]](), -(-options.pairs // options.reuse)
    for seed in range(options.first_seed, options.first_seed + seeds):
        kept.append(records(turbine, seed, options.cache))
        print(f"\r{len(kept)} of {seeds} seeds", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    outcomes = list[Outcome]()
    for i, (before, *_) in enumerate(kept):
        for k in range(options.reuse):
            j = (i + k) % seeds
            # Priors are moved for odd seeds, and to different places on the two sides.
            outcomes += outcomes_of(before, kept[j][1:], (options.first_seed + i) % 2 == 1 or (i + j) % 2 == 1)
    print(render(*tables(outcomes, seeds, options.reuse)))


if __name__ == "__main__":
    main()

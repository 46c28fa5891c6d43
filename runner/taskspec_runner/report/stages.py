"""How stages are named and tinted in the report."""

from __future__ import annotations

from collections.abc import Mapping

from taskspec_runner.report.data import Run, Visit

#: Tints there are; names beyond that share them.
TINTS = 8


def tints(run: Run) -> Mapping[str, int]:
    """Number of the tint of each stage, in the order of first visits."""
    names = dict.fromkeys(v.stage for v in run.visits)
    return {name: i % TINTS for i, name in enumerate(names)}


def label(run: Run, visit: Visit) -> str:
    """Name of a visit; numbered where its stage was visited more than once."""
    often = sum(v.stage == visit.stage for v in run.visits) > 1
    return f"{visit.stage} {visit.number}" if often else visit.stage

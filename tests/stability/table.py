"""The page docs/stability.md: every case of the grid, predicted and run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

from stability.cases import Family
from stability.trial import Verdict

TITLE = """\
# Predicted stability and runs

`taskspec validate` says of a file, before anything moves, whether its stages will be stable on the
contact that the file states, with the sampling, the sensor's filter and its delay that the run has
(TS501 to TS507). This page holds that prediction against simulation. `make stability` makes it.

**The prediction.** A stage is one function, which is differentiated at the predicted equilibrium
and closed around the same linear plant that the simulator steps: semi-implicit Euler steps, the
torque held between them, the contact as spring, damper and the mass that the simulator adds, the
force one tick late. The eigenvalues of the map over one period say how each motion goes on. It
holds about the pose of the start; H, g and the tip's Jacobian stay as they are there, and there is
no friction. A tool that friction holds (TS506) is held against runs in
`tests/stability/test_stability_sticking.py`: 5 % on either side of the boundary.

**A case.** An arm presses with 10 N on a plane without damping, under gains that settle. Then one
gain becomes a multiple of its critical value, the arm gets a small push (about 0.2 N), and the
motion of the joint that moves most is watched for ten predicted time constants, at most 60 s. It
rings if it is larger in the last third of that time than in the third before, if it becomes ten
times as large as right after the push, if the tool leaves the surface, or if the run is stopped.
Less than 1e-5 of its first third, or 1e-10 rad/s, counts as nothing. The innermost factors are
2.5 % from the boundary, or 5 % where ten time constants would be longer than 60 s. For a gain that
has a least value the factor divides.

Growth is the real part of the least stable pole [1/s], negative where it settles. The measured one
is that of the joint's motion between the two thirds; far past the boundary torque limits and the
surface bound it, and far inside a quicker mode may still be the larger one, or nothing is left (-).

**Validate** is what `validate` reports of the file: the gravest of TS501 and TS502. No case past
its boundary is without an error. For every press errors begin at 0.981 of the critical gain or
before, and there is one at 1.002 of it
(`test_an_error_from_two_percent_below_the_critical_gain_on` in
`tests/stability/test_stability_grid.py`).
"""
HEAD = (
    "case",
    "delay",
    "gain",
    "factor",
    "value",
    "frequency",
    "growth",
    "measured",
    "run",
    "does",
    "validate",
)


def page(verdicts: Sequence[Verdict]) -> str:
    """The page."""
    cases = len(verdicts)
    wrong = sum(not v.holds for v in verdicts)
    summary = (
        f"{cases} cases, {len({v.case.family.name + v.case.family.swept for v in verdicts})} "
        f"presses, {len({v.case.family.law for v in verdicts})} laws; "
        f"{'none' if wrong == 0 else wrong} of them goes against its prediction.\n"
    )
    parts = [TITLE, summary]
    for law, group in groupby(verdicts, key=lambda v: v.case.family.law):
        lines = [_row(HEAD), _row(["---"] * len(HEAD))]
        lines += [_row(_cells(v)) for v in group]
        parts.append(f"## {law}\n\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)


def _cells(v: Verdict) -> list[str]:
    family: Family = v.case.family
    return [
        family.name,
        f"{family.delay:g} ms",
        family.swept,
        f"{v.case.factor:g}",
        f"{v.case.gain:.4g}",
        f"{v.mode.frequency:.3g} Hz",
        f"{v.mode.s.real:.3g}",
        "-" if math.isnan(v.growth) else f"{v.growth:.3g}",
        f"{v.seconds:.3g} s",
        f"{'rings' if v.rings else 'settles'}{'' if v.holds else ' (wrong)'}",
        v.told,
    ]


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"

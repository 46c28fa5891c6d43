"""What a stage under `solve: qp` keeps, and what of its forces contacts return, for `explain`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby

from taskspec.explain.returned_forces import returned_at_start
from taskspec.program.program import Program
from taskspec.program.reference.infeasible_forces import is_moment
from taskspec.program.stages.stage import CompiledStage
from taskspec.text.units import FORCE, MOMENT, scaled, show

_JOINT = re.compile(r"(.*) of joint (\d+)\Z")


def limit_rows(program: Program, stage: CompiledStage) -> Iterator[tuple[str, str]]:
    """Pairs of what and how; none for a closed form."""
    if stage.resolution is None:
        return
    solver = stage.resolution.solver.upper()
    kept = "; ".join(joined([row.text for row in stage.resolution.rows]))
    yield "keeps", f"by a quadratic program ({solver}): {kept}"
    returned = returned_at_start(program, stage)
    if returned is None or not returned.forces:
        return
    lost = {name: left for name, left in returned.left.items() if left}
    if not lost:
        yield "returned", "all that it asks for, at the start pose"
        return
    because = ", ".join(returned.because) or "nothing there returns a force in this direction"
    for name, left in lost.items():
        wanted = returned.forces[name]
        near, far = (_effort(value, turns=is_moment(name)) for value in (wanted - left, wanted))
        yield "nearest", f"{near} on {name} where {far} is asked: {because}"


def _effort(value: float, *, turns: bool) -> str:
    return show(value, MOMENT, 3) if turns else scaled(value, FORCE, 3)


def joined(texts: Sequence[str]) -> list[str]:
    """Limits in words, with those that all joints have put together."""

    def kind(text: str) -> str:
        found = _JOINT.match(text)
        return text if found is None else found[1]

    made = []
    for name, group in groupby(texts, kind):
        members = list(group)
        joints = [found[2] for text in members if (found := _JOINT.match(text))]
        if len(joints) > 1:
            made.append(f"{name} of joints {joints[0]} to {joints[-1]}")
        else:
            made.extend(members)
    return [text for text in made if not text.startswith("speed aside")]

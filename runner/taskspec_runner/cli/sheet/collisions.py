"""What the links of the arm are held against in a trial, and what is left out of that."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.program import Program
from taskspec_runner.trial.collisions import Surroundings


def collision_rows(program: Program) -> Iterator[tuple[str, str]]:
    """A pair of what and how; none in a world without shapes."""
    around = Surroundings(program.context)
    if not around.names and not around.left_out:
        return
    parts = [f"links are held against {', '.join(around.names)}"] if around.names else []
    parts += [f"not against {name}, which {why}" for name, why in around.left_out.items()]
    yield "collisions", "; ".join(parts)

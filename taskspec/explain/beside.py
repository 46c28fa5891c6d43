"""What stands beside the law of a stage: each object says it in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Protocol

from taskspec.program.plan import StagePlan
from taskspec.statics.held_body import held_bodies, jaw_command
from taskspec.statics.shown_payload import shown_payload
from taskspec.statics.sliding_layer import sliding_layers
from taskspec.statics.tank_demand import first_contact, tank_demand


class Described(Protocol):
    """Something that says what it is."""

    def rows(self) -> Iterable[tuple[str, str]]:
        """Pairs of what and how."""


def beside(stage: StagePlan, plans: Mapping[str, StagePlan]) -> Iterator[tuple[str, str]]:
    """Pairs of what and how: bodies that are held, what the law adapts to, estimates and bounds.

    Args:
        stage: which one.
        plans: of all stages, by name.
    """
    parts: list[Described | None] = [
        jaw_command(stage),
        *held_bodies(stage, plans),
        tank_demand(stage),
        first_contact(stage),
        shown_payload(stage),
        *sliding_layers(stage),
        stage.observer,
        stage.estimates,
    ]
    for part in parts:
        if part is not None:
            yield from part.rows()

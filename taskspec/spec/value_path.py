"""The path by which `vary` and `truth` name a value."""

from __future__ import annotations

from taskspec.deferred_methods import dataclass


@dataclass(frozen=True, slots=True)
class ValuePath:
    """A path such as `world.table.stiffness` or `robot.payload.mass`, taken apart.

    Attributes:
        section: what comes first: `world` or `robot`, or what somebody wrote instead.
        owner: the object of the world; "" of other sections.
        key: what is named below the object, or below the section; "" if nothing is.
    """

    section: str
    owner: str
    key: str

    @classmethod
    def of(cls, text: str) -> ValuePath:
        """Takes a path apart."""
        section, _, key = text.partition(".")
        owner = ""
        if section == "world":
            owner, _, key = key.partition(".")
        return cls(section, owner, key)

    @property
    def steps(self) -> tuple[str, ...]:
        """The attributes from the object, or from the section, to the value."""
        return tuple(self.key.split("."))

    @property
    def first(self) -> str:
        """The first of the steps, such as `motion` of `motion.speed`."""
        return self.steps[0]

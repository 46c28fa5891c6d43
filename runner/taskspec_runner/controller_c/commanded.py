"""What an exported controller commands the joints, in the words and numbers of its files."""

from __future__ import annotations

from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec.spec.servo import COMMANDS, PLURALS
from taskspec.text.units import FORCE, LENGTH, VELOCITY, Dimension


@dataclass(frozen=True, slots=True)
class CommandedQuantity:
    """The quantity that is commanded.

    Attributes:
        name: `torque`, `velocity` or `position`.
        dimension: of that of a slide.
        means: what it is of the joints; `of_joint` in short.
        at_start, at_end: sentences on the first answer, and on those after the end.
    """

    name: str
    dimension: Dimension
    means: str
    of_joint: str
    at_start: str
    at_end: str

    @property
    def number(self) -> int:
        """As the protocol of docs/protocol.md numbers it."""
        return COMMANDS.index(self.name)

    @property
    def plural(self) -> str:
        """Several of them."""
        return PLURALS[self.name]

    @classmethod
    def of(cls, program: Program) -> CommandedQuantity:
        """What a program commands."""
        dimension = {"torque": FORCE, "velocity": VELOCITY, "position": LENGTH}
        name = program.context.drives.commands
        found = {
            "torque": (
                f"of the drives on the joints; {gravity_words(program)}",
                gravity_words(program),
                "Its torques carry the arm; they are zero where the sample is not finite.",
                "the torques take the arm's motion away and carry it.",
            ),
            "velocity": (
                "of the joints, which the arm's own servo follows",
                "which the arm's own servo follows",
                "Its velocities are zero.",
                "the velocities fall to zero and stay there.",
            ),
            "position": (
                "of the joints, which the arm's own servo follows",
                "which the arm's own servo follows",
                "Its positions are those of the sample, or of the file's start where the sample "
                "is not finite.",
                "the positions slow down and stay where they are then.",
            ),
        }
        return cls(name, dimension[name], *found[name])


def gravity_words(program: Program) -> str:
    """What the torques hold of the arm's weight."""
    if program.context.loaded.task.robot.balanced:
        return "nothing for the weight, which a counterweight carries (robot.balanced)"
    return "gravity included"

"""Short task files: an arm that touches a plane, without friction unless it says so."""

from __future__ import annotations

from dataclasses import dataclass

SPRING = "stiffness: 10 kN/m, damping: 0"

_TASK = """
taskspec: 1
name: theory
robot: {{model: {robot}{more}}}
{world}law: {law}
stages:
{stages}
"""


@dataclass(frozen=True, slots=True)
class Arm:
    """An arm whose tool touches a plane where it starts.

    Attributes:
        robot: model, tool and start. plane: its pose.
        normal: the world's axis along the plane's normal. axes: that the arm has.
        into: +1 or -1, the way into the plane. surface: where it is on that axis [m].
    """

    robot: str
    plane: str
    normal: str
    axes: str
    into: int
    surface: float

    def task(
        self, law: str, *stages: str, contact: str | None = SPRING, more: str = "", rest: str = ""
    ) -> str:
        """The text of a task; `N:` in a stage is the normal axis, `force: +` into the plane.

        Args:
            law: of the file. stages: one line each. contact: of the plane; None for no plane.
            more: further keys of the robot. rest: further sections.
        """
        world = (
            ""
            if contact is None
            else f"world: {{plane: {{shape: plane, {self.plane}, {contact}}}}}\n"
        )
        lines = "\n".join(f"  {self._own(stage)}" for stage in stages)
        more = f", {more}" if more else ""
        return _TASK.format(robot=self.robot, more=more, world=world + rest, law=law, stages=lines)

    def _own(self, stage: str) -> str:
        return stage.replace("N:", f"{self.normal}:").replace(
            "force: +", "force: " if self.into > 0 else "force: -"
        )

    def depth(self, millimetres: float) -> str:
        """A position that far below the surface."""
        return f"{1000 * self.surface + self.into * millimetres:.9g} mm"


_WALL = "xyz: [{x} mm, 0, 0], rpy: [0, -90 deg, 0]"
_TABLE = "xyz: [0, 0, 300 mm]"

#: The two-link arm at a right angle: its inertia at the tip is diagonal in the world's x and y, and
#: the ball of its tool is so small that the tip meets the wall also where the arm has turned.
SQUARE = Arm(
    "planar2, tool: {radius: 100 um}, start: {joints: [90 deg, -90 deg]}",
    _WALL.format(x=300), "x", "x y", 1, 0.3,
)  # fmt: skip
PLANAR3 = Arm(
    "planar3, start: {xyz: [450 mm, 200 mm, 0], rpy: [0, 0, 0]}",
    _WALL.format(x=450), "x", "x y rz", 1, 0.45,
)  # fmt: skip
UR5E = Arm("ur5e, start: {xyz: [400 mm, 100 mm, 300 mm]}", _TABLE, "z", "x y z rx ry rz", -1, 0.3)
PANDA = Arm("panda, start: {xyz: [500 mm, 0, 300 mm]}", _TABLE, "z", "x y z rx ry rz", -1, 0.3)

ARMS = {"planar2": SQUARE, "planar3": PLANAR3, "ur5e": UR5E, "panda": PANDA}

"""The world of a task in words, for `explain`: what its objects are and how they give way."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.compiler import Program
from taskspec.program.world.stiffness import Compliance
from taskspec.spec import EquationObject, Hinge, Mechanism, Screw, Shape, Slide
from taskspec.spec.mechanism import Detent
from taskspec.text.show import show
from taskspec_runner.cli.measures import stiffness

#: Units of a mechanism's coordinate, effort and damping, by whether it turns.
UNITS = {True: ("deg", "N*m", "N*m*s/rad"), False: ("mm", "N", "N*s/m")}


def object_accounts(program: Program) -> Iterator[tuple[str, str]]:
    """Every object by name, and what it is."""
    context = program.context
    for name, declared in context.loaded.task.world.items():
        if isinstance(declared, Shape):
            yield name, ", ".join(_shape(declared, context.compliances[name]))
        elif isinstance(declared, EquationObject):
            yield name, ", ".join(_equation(declared, context.compliances[name]))
        else:
            yield name, ", ".join(_mechanism(declared))


def _shape(shape: Shape, contact: Compliance) -> Iterator[str]:
    yield shape.shape if shape.mass is None else f"loose {shape.shape} of {show(shape.mass, 'kg')}"
    rigid = " (rigid)" if shape.stiffness == "rigid" else ""
    yield f"{stiffness(contact.stiffness)}{rigid}"
    yield show(contact.damping, "N*s/m")
    yield f"friction {shape.friction:.3g}" if shape.friction else "frictionless"
    if shape.motion is not None:
        yield "moves by " + " and ".join(f"{a} {e}" for a, e in shape.motion.axes.items())


def _equation(declared: EquationObject, contact: Compliance) -> Iterator[str]:
    joints, relation = declared.equation.joints, declared.equation.relation
    where = "on joints" if joints else f"in {declared.frame or 'world'}"
    yield f"{declared.equation} {where}"
    yield "holds both ways" if relation == "=" else "holds one way"
    rigid = " (rigid)" if declared.stiffness == "rigid" else ""
    if joints:
        yield f"{show(contact.stiffness, 'N*m/rad')}{rigid}"
        yield show(contact.damping, "N*m*s/rad")
    else:
        yield f"{stiffness(contact.stiffness)}{rigid}"
        yield show(contact.damping, "N*s/m")


def _mechanism(declared: Mechanism) -> Iterator[str]:
    angle, effort, rate = UNITS[declared.angular]
    yield declared.mechanism
    if isinstance(declared, Screw):
        yield f"pitch {show(declared.pitch, 'mm/turn')}"
    if isinstance(declared, Hinge | Screw):
        yield f"inertia {show(declared.inertia, 'kg*m^2')}"
    if isinstance(declared, Slide | Screw):
        yield f"mass {show(declared.mass, 'kg')}"
    if declared.damping:
        yield f"damping {show(declared.damping, rate)}"
    if declared.friction:
        yield f"friction {show(declared.friction, effort)}"
    if declared.stop is not None:
        low, high = declared.stop
        yield f"stops at {show(low, angle)} and {show(high, angle)}"
    if declared.detent is not None:
        yield _detent(declared.detent, angle, effort)
    yield f"{declared.knob} knob"


def _detent(detent: Detent, angle: str, effort: str) -> str:
    width = show(detent.width, angle)
    return f"snaps at {show(detent.at, angle)} +- {width} with {show(detent.force, effort)}"

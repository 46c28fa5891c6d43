"""The world of a task in words, for `explain`: what its objects are and how they give way."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.geometry.axis import AXES
from taskspec.program.program import Program
from taskspec.program.world.bushings import BushingModel
from taskspec.program.world.stiffness import Compliance
from taskspec.spec import Bushing, EquationObject, Hinge, Mechanism, Screw, Shape, Slide
from taskspec.spec.mechanism import Detent
from taskspec.text.units import (
    DAMPING,
    FORCE,
    INERTIA,
    LENGTH,
    MASS,
    STIFFNESS,
    Dimension,
    scaled,
    show,
)


def object_rows(program: Program) -> Iterator[tuple[str, str]]:
    """Every object by name, and what it is."""
    context = program.context
    for name, declared in context.loaded.task.world.items():
        if isinstance(declared, Shape):
            yield name, ", ".join(_shape(declared, context.compliances[name]))
        elif isinstance(declared, EquationObject):
            yield name, ", ".join(_equation(declared, context.compliances[name]))
        elif isinstance(declared, Bushing):
            yield name, ", ".join(_bushing(context.bushings[name]))
        else:
            yield name, ", ".join(_mechanism(declared))


def _shape(shape: Shape, contact: Compliance) -> Iterator[str]:
    yield shape.shape if shape.mass is None else f"loose {shape.shape} of {show(shape.mass, MASS)}"
    rigid = " (rigid)" if shape.stiffness == "rigid" else ""
    yield f"{scaled(contact.stiffness, STIFFNESS)}{rigid}"
    yield show(contact.damping, DAMPING)
    yield f"friction {shape.friction:.3g}" if shape.friction else "frictionless"
    if shape.on is not None:
        yield f"on {shape.on}"
    if shape.motion is not None:
        yield "moves by " + " and ".join(f"{a} {e}" for a, e in shape.motion.axes.items())


def _equation(declared: EquationObject, contact: Compliance) -> Iterator[str]:
    angular, relation = declared.equation.angular, declared.equation.relation
    where = "on joints" if declared.equation.joints else f"in {declared.frame or 'world'}"
    yield f"{declared.equation} {where}"
    yield "holds both ways" if relation == "=" else "holds one way"
    if contact.exact:
        yield "exactly, by a multiplier"
        return
    rigid = " (rigid)" if declared.stiffness == "rigid" else ""
    yield f"{scaled(contact.stiffness, STIFFNESS.on(rotation=angular))}{rigid}"
    yield show(contact.damping, DAMPING.on(rotation=angular))


def _bushing(model: BushingModel) -> Iterator[str]:
    yield "bushing"
    for matrix, dimension in ((model.stiffness, STIFFNESS), (model.damping, DAMPING)):
        own = zip(AXES, matrix.diagonal(), strict=True)
        yield " ".join(f"{a} {scaled(float(k), a.of(dimension))}" for a, k in own if k)
    K = model.stiffness
    coupled = [f"{AXES[j]} {AXES[i]} {K[j, i]:.6g}" for i in range(6) for j in range(i) if K[j, i]]
    if coupled:
        yield f"couples {', '.join(coupled)} (SI)"


def _mechanism(declared: Mechanism) -> Iterator[str]:
    way, effort, damping = (d.on(rotation=declared.angular) for d in (LENGTH, FORCE, DAMPING))
    yield declared.mechanism
    if isinstance(declared, Screw):
        yield f"pitch {show(declared.pitch, 'mm/turn')}"
    if isinstance(declared, Hinge | Screw):
        yield f"inertia {show(declared.inertia, INERTIA)}"
    if isinstance(declared, Slide | Screw):
        yield f"mass {show(declared.mass, MASS)}"
    if declared.damping:
        yield f"damping {show(declared.damping, damping)}"
    if declared.friction:
        yield f"friction {show(declared.friction, effort)}"
    if declared.stop is not None:
        low, high = declared.stop
        yield f"stops at {show(low, way)} and {show(high, way)}"
    if declared.detent is not None:
        yield _detent(declared.detent, way, effort)
    yield f"{declared.knob} knob"


def _detent(detent: Detent, way: Dimension, effort: Dimension) -> str:
    width = show(detent.width, way)
    return f"snaps at {show(detent.at, way)} +- {width} with {show(detent.force, effort)}"

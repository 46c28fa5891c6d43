"""`law`: which control law a stage follows, and its gains."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field
from pydantic.json_schema import SkipJsonSchema

from taskspec.spec.gains import AxisValues, Gain
from taskspec.spec.laws import LAWS
from taskspec.spec.model import Model, mapping, short_form
from taskspec.spec.quantities import ForJoints
from taskspec.spec.reading import Reading
from taskspec.spec.words import Word, Words
from taskspec.text.codes import register
from taskspec.text.data import Map, Text
from taskspec.text.units import (
    ANGULAR_DAMPING,
    ANGULAR_STIFFNESS,
    DAMPING,
    FREQUENCY,
    INERTIA,
    MASS,
    NUMBER,
    STIFFNESS,
)

register(
    {
        "TS206": "an unknown law",
        "TS207": "a gain that the law does not have",
        "TS213": "a goal in the null space under a law that leaves it alone",
    }
)

_GAINS = ("mass", "stiffness", "damping", "bandwidth", "damping_ratio")
DEFAULT = "hybrid"
NULL_SPACE_GOALS = ("posture", "joint-limits", "manipulability")
_SAY_DAMPING = "the law pd-joint calls it 'damping'"

Damping = Annotated[AxisValues, Gain(DAMPING, ANGULAR_DAMPING, least=0)]


class ForceGains(Model):
    """Gains of a force loop.

    Attributes:
        proportional: dimensionless.
        integral: [1/s].
        damping: on the measured velocity along a force axis [N*s/m, N*m*s/rad].
    """

    noun = "the gains of a force loop"

    proportional: Annotated[AxisValues, Gain(NUMBER, NUMBER, least=0)] | None = Field(
        None, title="Proportional gain"
    )
    integral: Annotated[AxisValues, Gain(FREQUENCY, FREQUENCY, least=0)] | None = Field(
        None, title="Integral gain"
    )
    damping: Damping | None = Field(None, title="Damping along force axes")


class Law(Model):
    """A control law. Gains that are left out are designed.

    Attributes:
        kind: its name; it stands for one equation.
        mass: apparent mass [kg, kg*m^2].
        stiffness: [N/m, N*m/rad].
        damping: [N*s/m, N*m*s/rad].
        joint_damping: what a file calls the `damping` of a law that damps joints [N*m*s/rad]: one
            for all joints, or one for each.
        bandwidth: of motion axes [Hz].
        damping_ratio: of motion axes.
        force: gains of the force loop.
        orientation: how orientation errors are measured.
        null_space: what a redundant arm does with the joints that the task leaves free; these
            goals are added up.
        solve: how what the law asks for becomes torque: by its own closed form, or by a quadratic
            program that keeps the limits.
        solver: of the quadratic program.
    """

    noun = "a law"
    short: ClassVar = {"enum": list(LAWS)}

    kind: Annotated[str, Word(tuple(LAWS), "law", code="TS206")] = Field(
        DEFAULT, title="Control law"
    )
    mass: Annotated[AxisValues, Gain(MASS, INERTIA, above=0)] | None = Field(
        None, title="Apparent mass"
    )
    stiffness: Annotated[AxisValues, Gain(STIFFNESS, ANGULAR_STIFFNESS, least=0)] | None = Field(
        None, title="Stiffness"
    )
    damping: Damping | None = Field(None, title="Damping")
    joint_damping: SkipJsonSchema[
        Annotated[tuple[float, ...], ForJoints(ANGULAR_DAMPING)] | None
    ] = None
    bandwidth: Annotated[AxisValues, Gain(FREQUENCY, FREQUENCY, above=0)] | None = Field(
        None, title="Bandwidth of motion axes"
    )
    damping_ratio: Annotated[AxisValues, Gain(NUMBER, NUMBER, above=0)] | None = Field(
        None, title="Damping ratio of motion axes"
    )
    force: ForceGains | None = Field(None, title="Gains of the force loop")
    orientation: Annotated[
        Literal["so3", "rpy", "zyz"], Word(("so3", "rpy", "zyz"), "orientation error")
    ] = Field("so3", title="Orientation error")
    null_space: Annotated[tuple[str, ...], Words(Word(NULL_SPACE_GOALS, "null-space goal"))] = (
        Field(("posture",), title="Goals in the null space")
    )
    solve: Annotated[
        Literal["closed-form", "qp"], Word(("closed-form", "qp"), "way to the torques")
    ] = Field("closed-form", title="Way to the torques")
    solver: Annotated[Literal["daqp", "osqp"], Word(("daqp", "osqp"), "solver")] = Field(
        "daqp", title="Solver of the quadratic program"
    )

    @classmethod
    def expand(cls, data: object, reading: Reading) -> object:  # noqa: ARG003
        """Read a bare name as a law with designed gains, and damping in the joints as such."""
        full = short_form(data, "kind")
        if not isinstance(full, Map):
            return full
        kind = full.get("kind")
        if isinstance(kind, str) and kind in LAWS and LAWS[kind].damps_joints:
            renamed = Map({"joint_damping" if k == "damping" else k: v for k, v in full.items()})
            renamed.node = full.node
            return renamed
        return full

    @classmethod
    def rules(cls, data: Map, reading: Reading) -> None:
        """Report gains, and goals of the null space, that the named law does not have."""
        if "joint_damping" in data.node.entries:
            span = data.node.key_span("joint_damping")
            reading.error("TS020", "unknown key 'joint_damping' in a law", span, _SAY_DAMPING)
        if "solver" in data and data.get("solve", "closed-form") == "closed-form":
            reading.error(
                "TS026",
                "a solver is of the quadratic program, and this law does not solve one",
                data.node.key_span("solver"),
                "add 'solve: qp'",
            )
        kind = data.get("kind", DEFAULT)
        if not isinstance(kind, str) or kind not in LAWS:
            return
        if "null_space" in data and not LAWS[kind].holds_null_space:
            reading.error(
                "TS213",
                f"the law '{kind}' leaves the null space alone",
                data.node.key_span("null_space"),
                f"laws that do not: {', '.join(k for k, f in LAWS.items() if f.holds_null_space)}",
            )
        has = LAWS[kind].gains
        force = mapping(data.get("force"))
        given = [(key, data) for key in _GAINS if key in data]
        if "force" in data and not any(gain.startswith("force.") for gain in has):
            given.append(("force", data))
        else:
            given += [(key, force) for key in force if key in ForceGains.model_fields]
        for key, owner in given:
            name = f"force.{key}" if owner is force else key
            if name not in has:
                reading.error(
                    "TS207",
                    f"the law '{kind}' has no gain '{name}'",
                    owner.node.key_span(key),
                    f"its gains: {', '.join(has)}",
                )


def law_of(data: object) -> str | None:
    """Return the supported law that a raw `law` names, the default for None, else None."""
    if data is None:
        return DEFAULT
    kind = data.get("kind", DEFAULT) if isinstance(data, Map) else data
    return str(kind) if isinstance(kind, Text | str) and kind in LAWS else None

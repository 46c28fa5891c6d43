"""What led to the end of a trial, as far as its ticks show it.

Each function looks for one cause and says in numbers what it is and what changes it. The closed
forms, such as the blow v sqrt(k m) of a mass on a contact, explain what was simulated; they find
nothing by themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import ROTATIONS, Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.plan import StagePlan
from taskspec.program.plan.design import FLIPPING
from taskspec.program.sensor import SensorModel
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.robot.rebuild import GRAVITY
from taskspec.rules.finding import Place
from taskspec.rules.places import motion_of
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE, key_of
from taskspec.spec.robot import Robot
from taskspec.text.units import FORCE, LENGTH, MASS, VELOCITY, inside, show
from taskspec_runner.trial.impact import impact_at
from taskspec_runner.trial.moment import Moment

Vector = NDArray[np.float64]

#: A cause explains a difference of forces from this share of it on.
EXPLAINS = 0.5
#: A blow is over after so many half periods of the mass on its contact.
BLOWS = 4.0
#: Share of a limit up to which a blow is to come: its reference goes on meanwhile, and adds to it.
BLOW_ROOM = 0.9
#: Standard deviations within which readings of a run stay, but for some.
DEVIATIONS = 3.0
#: A mechanism is at its stop from this share of its range on.
AT_STOP = 0.02
#: Ticks before a stop's force over which a mechanism's speed is taken.
_BEFORE_A_STOP = 50
#: A mechanism rests that is slower, by whether it turns [rad/s or m/s].
STOP_SPEED = {False: 0.01, True: 0.02}
#: A command is what passes a limit from this share of it on.
COMMANDED = 0.97
#: How far a flip from reading to reading may be from its frequency, of that.
FLIPS = 0.1
#: A motor is at its limit from this share of it on.
SATURATED = 0.995
#: Ticks before an end of which a saturation is read off.
_SATURATED_TICKS = 50
#: A tool stays where it is that comes by less nearer to a surface, or farther off it [m].
_STAYS = 1e-4
#: A tool that nothing touches follows a force loop, not its reference, if it is so much faster.
RUNS_AWAY = 1.5


@dataclass(frozen=True, slots=True)
class Cause:
    """Why something happened.

    Attributes:
        text: the cause, with its numbers.
        hint: what changes it.
        place: where the file has it; None where nowhere.
    """

    text: str
    hint: str
    place: Place | None = None


def first_cause(moment: Moment, *finders: Callable[[Moment], Cause | None]) -> Cause | None:
    """What the first of some functions finds that finds anything."""
    return next((cause for find in finders if (cause := find(moment)) is not None), None)


# --- what a sensor measures that is no contact ---------------------------------------------------


def sensor_error(
    moment: Moment, named: Collection[str] = (), *, reading: bool = True
) -> Cause | None:
    """What makes the measured force another than the true one: the largest part of it.

    Args:
        moment: to look at.
        named: the axes that matter; none for all.
        reading: whether the reading that matters is of this tick, not of the next one.
    """
    error = float(np.linalg.norm(moment.error))
    true, measured = moment.force(), moment.force(measured=True)
    if error <= TOUCHING or error < 0.1 * float(np.linalg.norm(measured)):
        return None
    found = [*_parts_of_error(moment)]
    if not found:
        return None
    size, cause = max(found, key=lambda each: each[0])
    if size < EXPLAINS * error:
        return None
    counts = [not named or str(axis) in named for axis in moment.axes]
    if not any(counts):
        counts = [True] * len(moment.axes)
    i = int(np.argmax(np.abs(moment.error) * counts))
    axis = moment.axes[i]
    reads = (
        f"{'' if reading else 'a tick before, '}force.{axis} is measured as "
        f"{show(float(measured[i]), 'N', 3)} where the tool applies "
        f"{show(float(true[i]), 'N', 3)}"
    )
    return Cause(f"{reads}: {cause.text}", cause.hint, cause.place)


def _parts_of_error(moment: Moment) -> Iterator[tuple[float, Cause]]:
    """Sizes [N] and causes of what a sensor adds to a contact's force."""
    true, nominal = moment.true.robot, moment.nominal.robot
    tares = [*moment.tares_before()]
    tare = "tare the sensor in a stage before it touches (tare: true)"
    bias = float(np.linalg.norm(true.sensor.bias[:3]))
    if bias and not tares:
        declared = any(nominal.sensor.bias)
        yield (
            bias,
            Cause(
                f"the sensor has a {'declared ' if declared else ''}bias of {show(bias, 'N', 3)} "
                "that no stage has tared",
                tare,
                FILE.robot.sensor.bias if declared else None,
            ),
        )
    if true.sensor.at == "wrist":
        mass = _carried(true)
        yield (
            mass * float(np.linalg.norm(moment.acceleration)),
            Cause(
                f"the tool's {show(mass, 'kg', 3)}, accelerated with "
                f"{float(np.linalg.norm(moment.acceleration)):.3g} m/s^2, pull on the wrist sensor "
                "as a contact does",
                "accelerate more gently, or wait for more than the mass times the acceleration",
                motion_of(moment.stage),
            ),
        )
        heavier = mass - _carried(nominal)
        if heavier and not tares:
            yield (
                abs(heavier) * float(np.linalg.norm(GRAVITY)),
                Cause(
                    f"the tool weighs {show(abs(heavier) * 9.81, 'N', 3)} "
                    f"{'more' if heavier > 0 else 'less'} than its nominal mass, which the wrist "
                    "sensor measures as a contact",
                    f"give robot.tool its true mass, or {tare}",
                    FILE.robot.tool,
                ),
            )
    if true.sensor.noise is not None:
        b = SensorModel.of(true.sensor, moment.stage.context.period).pole
        spread = true.sensor.noise.force * math.sqrt((1 - b) / (1 + b))
        yield (
            DEVIATIONS * spread,
            Cause(
                f"the sensor's noise has a standard deviation of {show(spread, 'N', 2)}",
                "wait for more, for a longer time with 'for', or give the sensor a filter",
                key_of(FILE.robot.sensor.noise),
            ),
        )


def _carried(robot: Robot) -> float:
    """Mass of a robot's tool with its payload [kg]."""
    return robot.tool.mass + (0.0 if robot.payload is None else robot.payload.mass)


# --- forces --------------------------------------------------------------------------------------


def commanded(moment: Moment) -> Cause | None:
    """Set points that are themselves beyond the force at which the run stops."""
    plans = moment.stage.plans
    axes = [a for a in moment.axes if a in plans and plans[a].set_point]
    wanted = {a: moment.value(f"force.{a}.ref") for a in axes}
    wanted = {a: force for a, force in wanted.items() if math.isfinite(force)}
    equations = [
        value
        for name in moment.stage.spec.constraints
        if math.isfinite(value := moment.value(f"{name}.force.ref"))
    ]
    size = float(np.linalg.norm([*wanted.values(), *equations])) if wanted or equations else 0.0
    bearing = float(np.linalg.norm(moment.force(measured=True)))
    if not size or size < COMMANDED * bearing:
        return None
    own = FILE.stages[moment.stage.name]
    axis = max(wanted, key=lambda a: abs(wanted[a]), default=None)
    return Cause(
        f"{show(size, 'N', 3)} are commanded there",
        "lower the set point, or raise the limit, for this stage by its own `limits`",
        key_of(own.axes[axis]) if axis is not None else key_of(own.constraints),
    )


def blow(moment: Moment) -> Cause | None:
    """A touch with a speed: a mass m that meets a contact k with v presses with v sqrt(k m)."""
    row, contact = moment.first_touch, moment.pressed
    touch = impact_at(moment, row, contact) if row is not None and contact else None
    if touch is None:
        return None
    passed = moment.value("clock") - moment.value("clock", touch.row)
    weak = touch.peak < EXPLAINS * float(np.linalg.norm(moment.force()))
    if passed > BLOWS * touch.half_period or weak:
        return None
    bound = moment.stage.limits.force
    hint = "come there more slowly"
    if bound is not None and touch.peak > bound:
        slower = inside(BLOW_ROOM * touch.speed * bound / touch.peak, upper=True, digits=2)
        hint = f"come there with {show(slower, 'mm/s')} or less, or raise the limit"
    return Cause(
        f"the tool meets {touch.contact!r} with {show(touch.speed, 'mm/s', 3)}, and "
        f"{show(touch.mass, 'kg', 2)} on {show(touch.stiffness, 'kN/m', 3)} make of that about "
        f"{show(touch.peak, 'N', 2)}",
        hint,
        motion_of(moment.stage),
    )


def late_force(moment: Moment, frequency: float) -> Cause | None:
    """A measured force that flips from reading to reading, of an oscillation's frequency [Hz].

    On a force axis a law makes m z'' = u + f, with its apparent mass m or that which is free to
    turn. Where friction or a wall holds the tool, nothing turns: it takes r = Lambda / m times as
    much force to move it so, all of it is borne at once, and the error u + f of a reading that is d
    ticks old becomes (1 - r) times itself: beyond r = 2 it grows, at 1/(2 (d + 1) T).
    """
    stage = moment.stage
    period, sensor = stage.context.period, moment.true.robot.sensor
    ticks = SensorModel.of(sensor, period).delay_ticks + 1
    if not moment.touches or abs(2 * ticks * period * frequency - 1) > FLIPS:
        return None
    plants = stage.design_rules.plants
    by_law = stage.gains.get("force.mass") or stage.gains.get("mass", {})
    masses = {
        a: by_law[a].value if a in by_law else plants[a].h
        for a, plan in stage.plans.items()
        if plan.force
    }
    axis = max(masses, key=lambda a: plants[a].held / masses[a], default=None)
    if axis is None or plants[axis].held <= FLIPPING * masses[axis]:
        return None
    ratio, mass = plants[axis].held / masses[axis], axis.of(MASS)
    # (1 - b) r = 1, with the b of a low-pass of this frequency.
    low_pass = -np.log1p(-1 / ratio) / (2 * np.pi * period)
    contact = f"{moment.pressed!r}" if moment.pressed else "what it touches"
    late = "a tick" if ticks == 1 else f"{ticks} ticks"
    remedies = [
        f"give the sensor a low-pass, such as robot.sensor: {{filter: {show(low_pass, 'Hz', 2)}}}",
        f"hold {axis!r} instead of controlling its {'torque' if axis.is_rotation else 'force'}",
    ]
    if axis in by_law and by_law[axis].origin == "file":
        remedies.insert(0, f"leave out the mass of {axis!r}, which is then designed")
    return Cause(
        f"the force comes {late} late, and {contact} holds the tool, which has "
        f"{show(plants[axis].held, mass, 2)} along {axis!r} there and not the "
        f"{show(masses[axis], mass, 2)} that the law moves",
        ", or ".join(remedies),
        _axis_place(moment, axis),
    )


def mechanism(moment: Moment) -> Cause | None:
    """The held mechanism: at its stop, taken along with a force, or held against."""
    held = moment.stage.context.held
    if not held:
        return None
    model = moment.nominal.mechanisms[held]
    angular = moment.stage.context.mechanisms[held].angular
    unit = LENGTH.on(rotation=angular)
    place = moment.value(f"{held}.{'angle' if angular else 'travel'}")
    if model.stop is not None and math.isfinite(place):
        near = AT_STOP * (model.stop[1] - model.stop[0])
        for stop in model.stop:
            if abs(place - stop) <= near:
                speed = _met_with(moment, held, angular=angular)
                meets = "is at" if speed is None else f"meets, with {speed},"
                slower = "" if speed is None else "come there more slowly, "
                return Cause(
                    f"{held!r} {meets} its stop, {show(stop, unit, 3)}, and the motion goes on",
                    f"{slower}shorten the motion, or move until a force says that it is there",
                    motion_of(moment.stage),
                )
    axis, force, rate = _axis_of_force(moment)
    if axis is None:
        return None
    along = abs(rate) * abs(force) >= EXPLAINS * float(
        np.linalg.norm(moment.force()) * moment.value("speed")
    )
    driving = _driving(moment)
    if along and rate and len(driving) > 1:
        both = " and ".join(repr(each) for each in driving)
        return Cause(
            f"{both} both move {held!r}, which goes one way alone, and {axis!r} bears "
            f"{show(abs(force), axis.of(FORCE), 3)}",
            "move it by one axis, and let the others follow it or give way",
            _axis_place(moment, axis),
        )
    if along and rate:
        return Cause(
            f"{axis!r} takes {held!r} along with {show(abs(force), axis.of(FORCE), 3)}",
            f"move more slowly, or let {axis!r} give way: {axis}: {{{axis.effort}: 0}}",
            _axis_place(moment, axis),
        )
    return Cause(
        f"{held!r} does not let {axis!r} move as it is to, and the grip bears "
        f"{show(abs(force), axis.of(FORCE), 3)}",
        f"let it give way: {axis}: {{{axis.effort}: 0}}",
        _axis_place(moment, axis),
    )


def _met_with(moment: Moment, held: str, *, angular: bool) -> str | None:
    """How fast a mechanism came to where it is, in words; None where it rested there."""
    column = f"{held}.{'angle' if angular else 'travel'}"
    places = moment.stretch(column)[-_BEFORE_A_STOP:]
    if len(places) < 2:
        return None
    fastest = float(np.nanmax(np.abs(np.diff(places)))) / moment.stage.context.period
    rest = STOP_SPEED[angular]
    return show(fastest, VELOCITY.on(rotation=angular), 3) if fastest > rest else None


def _driving(moment: Moment) -> list[Axis]:
    """The axes that are to move with a velocity of their own, along and about which none gives."""
    found = []
    for axis, plan in moment.stage.plans.items():
        rate = moment.value(f"velocity.{axis}.ref")
        if not plan.force and not plan.open_loop and abs(np.nan_to_num(rate)) > 0:
            found.append(axis)
    return found


def _axis_place(moment: Moment, axis: Axis) -> Place | None:
    """The key of an axis, if the stage has it."""
    own = FILE.stages[moment.stage.name]
    return key_of(own.axes[axis]) if axis in moment.stage.spec.axes else None


def _axis_of_force(moment: Moment) -> tuple[Axis | None, float, float]:
    """The axis that bears most of the force, this force [N] and the rate along it [m/s]."""
    force = np.nan_to_num(moment.force())
    if not force.any():
        return None, 0.0, 0.0
    axis = moment.axes[int(np.argmax(np.abs(force)))]
    return axis, moment.value(f"force.{axis}"), moment.value(f"velocity.{axis}")


def motion_into_contact(moment: Moment) -> Cause | None:
    """An axis that is motion-controlled while what it presses on gives way to nothing."""
    force = np.abs(np.nan_to_num(moment.force()))
    if not len(force) or not force.any() or not moment.touches or moment.stage.spec.constraints:
        return None
    axis = moment.axes[int(np.argmax(force))]
    plan = moment.stage.plans.get(axis)
    error = moment.value(f"error.{axis}")
    if plan is None or plan.force or plan.open_loop or not math.isfinite(error):
        return None
    on = repr(moment.pressed) if moment.pressed else "what it touches"
    return Cause(
        f"{axis!r} is motion-controlled, and its reference is {show(abs(error), 'mm', 2)} beyond "
        f"where {on} lets the tool go",
        f"give {axis!r} a force, or end the motion before",
        _axis_place(moment, axis),
    )


# --- motions -------------------------------------------------------------------------------------


def runaway(moment: Moment) -> Cause | None:
    """A force loop on an axis along which nothing returns the force, or friction too little."""
    if moment.stage.context.held:
        return None
    touching = moment.value("touching") > 0
    for axis, plan in moment.stage.plans.items():
        rate = abs(moment.value(f"velocity.{axis}"))
        wanted = moment.value(f"{axis.effort}.{axis}.ref")
        fastest = max(abs(moment.value(f"velocity.{a}")) for a in moment.stage.translations)
        if not plan.set_point or not wanted or axis.is_rotation or rate < fastest / RUNS_AWAY:
            continue
        if touching and abs(moment.stage.contacts.facing(axis)) > MOSTLY:
            continue
        returns = "friction returns less than" if touching else "nothing returns"
        return Cause(
            f"{returns} the {show(wanted, 'N', 3)} on {axis!r}, and the tool goes there with "
            f"{show(rate, 'mm/s', 3)}",
            f"press harder, lower the force, or give {axis!r} a velocity"
            if touching
            else "let a stage before it touch: a velocity until a force is measured",
            key_of(FILE.stages[moment.stage.name].axes[axis]),
        )
    return None


def reference_speed(moment: Moment) -> Cause | None:
    """A reference that is itself faster than the limit on speed, or nearly so."""
    bound = moment.stage.limits.speed
    rates = [moment.value(f"velocity.{a}.ref") for a in moment.axes]
    wanted = float(np.linalg.norm(np.nan_to_num(rates)))
    if bound is None or wanted < 0.8 * bound:
        return None
    return Cause(
        f"the reference goes with {show(wanted, 'mm/s', 3)} there",
        "move more slowly, or raise the limit, for this stage by its own `limits`",
        motion_of(moment.stage),
    )


def behind(moment: Moment) -> Cause | None:
    """The axis that is farthest off its reference, and what it bears."""
    plans = moment.stage.plans
    led = [a for a in moment.axes if a in plans and plans[a].motion and not plans[a].set_point]
    errors = {a: abs(np.nan_to_num(moment.value(f"error.{a}"))) for a in led}
    axis = max(errors, key=lambda a: errors[a], default=None)
    if axis is None or not errors[axis]:
        return None
    return Cause(
        f"the tool is {show(float(errors[axis]), 'mm', 3)} off its reference along {axis!r}, and "
        f"applies {show(moment.value(f'force.{axis}'), 'N', 3)} there",
        "end the motion before, move more slowly, stiffen the law, or raise the limit",
        _axis_place(moment, axis),
    )


def saturated(moment: Moment) -> Cause | None:
    """Joints whose motors are at their limits just before."""
    robot = moment.stage.context.robot
    if moment.row + 1 - moment.visit.first < _SATURATED_TICKS:
        return None
    joints = [
        i + 1
        for i in range(robot.n)
        if np.mean(
            np.abs(moment.stretch(f"joint.{i + 1}.torque")[-_SATURATED_TICKS:])
            >= SATURATED * robot.torque_limit[i]
        )
        >= EXPLAINS
    ]
    if not joints:
        return None
    names = ", ".join(f"joint {i} ({robot.torque_limit[i - 1]:g} N*m)" for i in joints)
    return Cause(
        f"the torque is at its limit in {names}",
        "command less, move more slowly, or start where the arm bears it better",
        motion_of(moment.stage),
    )


def turned_joint(moment: Moment, joint: int) -> Cause:
    """How far a joint was turned in a stage, and by what."""
    robot, held = moment.stage.context.robot, moment.stage.context.held
    column = f"joint.{joint + 1}.position"
    began, now = moment.value(column, moment.visit.first), moment.value(column)
    unit = LENGTH.on(rotation=turns_at(robot, joint))
    by = f"{held!r} takes it along: it" if held else "it"
    back = "turned back" if turns_at(robot, joint) else "drawn back"
    room = float(robot.upper[joint] - robot.lower[joint])
    return Cause(
        f"{by} goes from {show(began, unit, 3)} to {show(now, unit, 3)} in this stage, and has "
        f"{show(room, unit, 3)} between its limits",
        f"start with joint {joint + 1} {back} (robot.start), or shorten the motion",
        motion_of(moment.stage),
    )


def fast_joint(moment: Moment, joint: int) -> Cause | None:
    """A joint that has to go fast since the arm is near a singularity, or since the tip is."""
    robot = moment.stage.context.robot
    v = abs(moment.value(f"joint.{joint + 1}.velocity"))
    speed = moment.value("speed")
    turns = float(np.linalg.norm([np.nan_to_num(moment.value(f"velocity.{a}")) for a in ROTATIONS]))
    unit = VELOCITY.on(rotation=turns_at(robot, joint))
    if not math.isfinite(speed):
        return None
    return Cause(
        f"the tool goes with {show(speed, 'mm/s', 3)} and turns with {show(turns, 'deg/s', 3)} "
        f"there, for which joint {joint + 1} has {show(v, unit, 3)}",
        "move more slowly, or start in another posture",
        motion_of(moment.stage),
    )


def left_apart(moment: Moment) -> Cause | None:
    """A stage that waits for a contact and has not come to one."""
    contact = moment.stage.contacts.approached or moment.stage.contacts.main
    if contact is None or moment.value("touching") > 0 or not moment.has(f"{contact}.gap"):
        return None
    gap = moment.value(f"{contact}.gap")
    if not gap > 0:
        return None
    begun = moment.value(f"{contact}.gap", moment.visit.first)
    if abs(gap - begun) < _STAYS:
        return Cause(
            f"it stays {show(gap, 'mm', 3)} off {contact!r}",
            "move towards it: a velocity until a force is measured",
            motion_of(moment.stage),
        )
    if gap > begun:
        return Cause(
            f"it moves away from {contact!r}, which is {show(gap, 'mm', 3)} off",
            "turn the motion round: coordinates and forces are along the frame's axes",
            motion_of(moment.stage),
        )
    return Cause(
        f"{show(gap, 'mm', 3)} are left to {contact!r}",
        "give it more time or travel, or move faster",
        motion_of(moment.stage),
    )


def no_number(text: str, stage: StagePlan) -> Cause | None:
    """An axis whose reference is no finite number, as the end of a run names it."""
    axis = next((a for a in stage.spec.axes if f"the reference of velocity.{a} " in text), None)
    if axis is None:
        return None
    return Cause(
        "its expression has no value there",
        "keep its argument in range with max, min or clamp",
        key_of(FILE.stages[stage.name].axes[axis]),
    )


def unfinished_path(moment: Moment) -> Cause | None:
    """A stage without a guard whose path has not come to its end."""
    if moment.value("path_done") > 0:
        return None
    travel = moment.value("travel")
    return Cause(
        f"its motion is not at its end, {show(travel, 'mm', 3)} from where the stage began",
        "give it more time, or move faster",
        motion_of(moment.stage),
    )

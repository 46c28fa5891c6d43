"""What the laws of a run store, what changes it, and whether a stage gains energy by itself.

The log has the state as each tick begins, and what acts from there to the next one. What is stored
is taken at the ticks; the work of a power between two of them by the trapezoidal rule, that of
forces which are held over the period (contact, joint torques) by the mean velocity. Nothing of it
is evaluated while the run goes on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import linear
from taskspec.control.reference import Reference, opposite
from taskspec.control.state import TaskState
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.case import Case, FreeDirections
from taskspec.laws.gains import rows as matrix_rows
from taskspec.laws.gains import value_of
from taskspec.motion import blend
from taskspec.program.bound import RowFunction
from taskspec.program.plan import StagePlan
from taskspec.program.program import Program
from taskspec.program.reference.force_references import wound
from taskspec.program.signals import applied
from taskspec.program.stages.commanded import stage_energy
from taskspec.program.worlds import true_world
from taskspec.robot.rigid_body import rigid_body
from taskspec.signals import ENERGY
from taskspec.signals.entries import TOUCHING
from taskspec.spec import Task
from taskspec.text.units import joules, si_unit
from taskspec_runner.record.history import History, NotRecordedError, Visit
from taskspec_runner.verdict.tank import TankCourse

Vector = NDArray[np.float64]

#: What feeds the storage from outside: the environment, and what the task asks for.
PORTS = ("contact", "reference", "force")
#: What feeds it from within. Of a law with an energy tank that is the tank, whatever it pays for.
INNER = ("integral", "gains", "torques", "sampling", "tank", "rest")
#: A gain of energy below this share of what was stored and went through a port is none: by some
#: percent sampled loops are off their continuous rates. Nor is one below [J].
_SHARE, _LEAST = 0.05, 1e-3
#: Ticks of a run up to which its summary and its report have energies: ten minutes at 1 kHz.
MOST = 600_000
#: A part of a unit normal that is none.
_NO_PART = 1e-6
#: How the terms are called in a sentence.
WORDS = {
    "integral": "the integral of its force loop",
    "gains": "gains that vary",
    "torques": "torques beside its equation (null space, feed-forward, limits, hand-over)",
    "sampling": "springs that are held over a period",
    "tank": "its energy tank",
    "rest": "what its equation leaves out (delay, sensor, model)",
}


@dataclass(frozen=True)
class StageEnergy:
    """The energies of one visit of a stage.

    Attributes:
        visit: of the stage.
        signals: (n,) by name of the language.
        works: (n,) what each term has put in since the visit began, by name [J]; `dissipated` is
            taken out, and `rest` makes the sum what is stored.
        storage: the law's storage function in words.
        tank: of its law; None without one.
    """

    visit: Visit
    signals: Mapping[str, Vector]
    works: Mapping[str, Vector]
    storage: str
    tank: TankCourse | None = None

    @property
    def stored(self) -> Vector:
        """(n,) the storage function [J]."""
        return self.signals["energy.stored"]

    @property
    def observed(self) -> Vector:
        """(n,) what was stored at first, and what came in at the contact since [J].

        Below zero, more has left there than there was: the passivity observer of Hannaford and
        Ryu (2002) at the contact port. What is in an energy tank at first was there, too.
        """
        found: Vector = self.stored[0] + self.works["contact"]
        return found if self.tank is None else found + self.tank.energy[0]

    @property
    def _net(self) -> Vector:
        """(n,) what has come from within, less what dampers took [J].

        What an energy tank gives it has had before.
        """
        net: Vector = sum(map(self._inner, INNER), -self.works["dissipated"])
        return net

    def _inner(self, name: str) -> Vector:
        """(n,) what a term has put in from within [J]; a tank what it had not got before."""
        if name != "tank" or self.tank is None:
            return self.works[name]
        net: Vector = self.works[name] + self.tank.energy - self.tank.energy[0]
        return net

    @cached_property
    def gain(self) -> tuple[int, int, str] | None:
        """First and last row of the greatest gain from within, and its greatest term; or none.

        That is more than what ports brought and dampers took: the dissipation inequality of the
        storage function fails from the one row to the other.
        """
        net = self._net
        last = int(np.argmax(net - np.minimum.accumulate(net)))
        first = int(np.argmin(net[: last + 1]))
        through = max(float(np.max(np.abs(self.works[name]))) for name in PORTS)
        most = max(_SHARE * (float(np.max(self.stored)) + through), _LEAST)
        if not net[last] - net[first] > most:
            return None
        put_in = {n: float(self._inner(n)[last] - self._inner(n)[first]) for n in INNER}
        by = max(put_in, key=lambda name: put_in[name])
        # What is late lends as much as is stored, and takes it back: more than that is a gain.
        lent = by == "rest" and net[last] - net[first] < np.max(self.stored)
        return None if lent else (first, last, by)

    def as_data(self, clock: Vector) -> dict[str, Any]:
        """The entry of a summary; `clock` is (rows,) of the run [s]."""
        first, data = self.visit.first, dict[str, Any]()
        if self.gain is not None:
            start, end, by = self.gain
            net = self._net
            data["gained"] = {
                "start": float(clock[first + start]),
                "end": float(clock[first + end]),
                "energy": float(net[end] - net[start]),
                "by": by,
                "work": float(self.works[by][end] - self.works[by][start]),
            }
        return {
            "stage": self.visit.stage,
            "start": float(clock[first]),
            "storage": self.storage,
            "stored": {"first": float(self.stored[0]), "most": float(np.max(self.stored)),
                       "last": float(self.stored[-1])},
            "work": {name: float(values[-1]) for name, values in self.works.items()},
            "observed": float(np.min(self.observed)),
            **({} if self.tank is None else {"tank": self.tank.as_data()}),
            **data,
        }  # fmt: skip


class RunEnergies:
    """The energies of a run: of every visit of a stage whose law states a storage function."""

    def __init__(self, program: Program, history: History, true: Task | None = None) -> None:
        """Of a run.

        Args:
            program: that ran.
            history: what it recorded.
            true: the task with the world as it was; None for what its `truth` says.
        """
        self._program, self._history, self._world = program, history, true

    @cached_property
    def visits(self) -> tuple[StageEnergy, ...]:
        """Those of each visit of two ticks and more; of a log that lacks what they need, none."""
        try:
            return tuple(self._visits())
        except NotRecordedError:
            return ()

    def _visits(self) -> Iterator[StageEnergy]:
        stages = {stage.name: stage.plan for stage in self._program.stages}
        made: dict[str, _OfStage] = {}
        true = self._world or true_world(self._program.context).task
        for visit in self._history.visits():
            plan = stages.get(visit.stage)
            if plan is None or not plan.law.control_law.storage or visit.last == visit.first:
                continue
            if visit.stage not in made:
                made[visit.stage] = _OfStage(plan, stages, true)
            if made[visit.stage].stated:
                yield made[visit.stage].at(self._history, visit)

    def column(self, name: str) -> Vector:
        """(rows,) a signal over the run, NaN where its law does not state it."""
        return self._joined((each.visit, each.signals.get(name)) for each in self.visits)

    def work(self, name: str) -> Vector:
        """(rows,) what a term has put in since the visit began [J], NaN where nothing is stored."""
        return self._joined((each.visit, each.works[name]) for each in self.visits)

    def _joined(self, parts: Iterable[tuple[Visit, Vector | None]]) -> Vector:
        values = np.full(len(self._history), np.nan)
        for visit, found in parts:
            if found is not None:
                values[visit.rows] = found
        return values

    def beside(self) -> History:
        """The history with the signals of energy beside those of its log."""
        units = {name: each.unit or si_unit(each.dimension) for name, each in ENERGY.items()}
        units = {**self._history.units, **units}
        return replace(self._history, columns=_Beside(self._history.columns, self), units=units)


class _Beside(Mapping[str, Vector]):
    """The columns of a log, and beside them energies, which are worked out at their first use."""

    def __init__(self, columns: Mapping[str, Vector], made: RunEnergies) -> None:
        self._columns, self._made = columns, made

    def __getitem__(self, name: str) -> Vector:
        return self._made.column(name) if name in ENERGY else self._columns[name]

    def __contains__(self, name: object) -> bool:
        return name in ENERGY or name in self._columns

    def __iter__(self) -> Iterator[str]:
        yield from self._columns
        yield from ENERGY

    def __len__(self) -> int:
        return len(self._columns) + len(ENERGY)


class _OfStage:
    """The law of a stage as a function of what a log has of a tick."""

    def __init__(self, plan: StagePlan, stages: Mapping[str, StagePlan], true: Task) -> None:
        context = plan.context
        self._plan, self._stages, self._true = plan, stages, true
        self._period = context.period
        n, axes = context.robot.n, plan.axes
        # Of the inertia the upper triangle, as the model terms have it.
        sizes = {"H": n * (n + 1) // 2, "v": n} | dict.fromkeys(
            ("error", "velocity", "reference", "measured", "desired", "integral", "held"),
            len(axes),
        ) | {"t": 1, "granted": 1, "filled": 1}  # fmt: skip
        symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        self._varying = [
            (name, on) for name, on in plan.law.varying if on in plan.gains.get(name, {})
        ]
        live = {name: dict(by) for name, by in plan.gains.items()}
        varied = ca.SX.sym("gains", len(self._varying))
        for i, (name, on) in enumerate(self._varying):
            live[name][on] = replace(live[name][on], value=varied[i])
        inertia = ca.triu2symm(ca.SX(ca.Sparsity.upper(n), symbols["H"]))
        unknown = ca.SX.nan(len(axes))
        case = Case(
            state=TaskState(
                axes=axes,
                H_factor=linear.cholesky(inertia),
                J=ca.SX.nan(len(axes), n),
                drift=unknown,
                velocity=symbols["velocity"],
                mobility=ca.SX.nan(len(axes), len(axes)),
                f=opposite(symbols["measured"]),
            ),
            reference=Reference(
                error=symbols["error"],
                velocity=symbols["reference"],
                acceleration=unknown,
                force=opposite(symbols["desired"]),
                force_integral=opposite(symbols["integral"]),
                released=opposite(symbols["held"])
                * blend.offset_shape(symbols["t"] / blend.BLEND_TIME),
            ),
            gains=live,
            joint_velocity=symbols["v"],
            force=tuple(a for a in axes if plan.plans[a].force),
            soft=tuple(a for a in axes if plan.plans[a].soft),
            normal=tuple(a for a in axes if plan.plans[a].yields),
            free=FreeDirections(unknown, unknown, np.nan) if plan.consistent else None,
        )
        self._tank = plan.law.tank
        tank = () if self._tank is None else (symbols["granted"], symbols["filled"])
        found = stage_energy(plan, case, *tank)
        self.stated = found is not None
        if found is None:
            return
        named = found.signals() | {"commanded": found.commanded}
        self._names = [name for name, value in named.items() if value is not None]
        self._joints = "commanded" in self._names or self._tank is not None
        results = ca.densify(ca.vertcat(*(named[name] for name in self._names)))
        self._taken = (*symbols, "gains")
        self._function = RowFunction(ca.Function("energy", [*symbols.values(), varied], [results]))
        self._terms = RowFunction(rigid_body(context.robot).function)

    def at(self, history: History, visit: Visit) -> StageEnergy:
        """The energies of a visit."""
        given = self._given(history, visit)
        now = self._evaluated(given)
        contact = self._evaluated(given | {"measured": given["force"]})["power.contact"]
        signals = now | {"power.contact": contact, "power.gains": self._of_gains(given)}
        signals["energy.contact"] = self._of_surfaces(history, visit)
        if self._tank is not None:
            signals.pop("power.gains")
            return self._beside_a_tank(history, visit, signals, given)
        lyapunov = self._lyapunov(signals, given, history, visit)
        if lyapunov is not None:
            signals["energy.lyapunov"] = lyapunov
        works = self._works(signals, given)
        signals.pop("commanded", None)
        return StageEnergy(visit, signals, works, self._plan.law.control_law.storage)

    def _beside_a_tank(
        self,
        history: History,
        visit: Visit,
        signals: Mapping[str, Vector],
        given: dict[str, Vector],
    ) -> StageEnergy:
        """The energies of a visit whose tank pays for all that is not passive."""
        assert self._tank is not None
        T, tank = self._period, TankCourse.of(self._tank, history, visit)
        mean = given | {"measured": given["force"], "velocity": _mean(given["velocity"])}
        nothing = np.zeros(len(given["q"]))
        works = dict.fromkeys((*PORTS, *INNER), nothing) | {
            "contact": _summed(self._evaluated(mean)["power.contact"][:-1] * T),
            "tank": _summed(tank.power[1:] * T),
            "dissipated": _summed(signals["power.dissipated"][1:] * T),
        }
        stored = signals["energy.stored"] - signals["energy.stored"][0]
        works["rest"] = stored - works["contact"] - works["tank"] + works["dissipated"]
        storage = "1/2 q'^T H q' + r 1/2 e^T K_m e"
        return StageEnergy(visit, signals, works, storage, tank)

    def _given(self, history: History, visit: Visit) -> dict[str, Vector]:
        """(rows, size) of the visit: what the function takes, true forces and torques."""
        rows, axes = visit.rows, self._plan.axes
        columns, n = history.columns, self._plan.context.robot.n
        nothing = np.zeros(visit.last + 1 - visit.first)

        def table(names: list[str]) -> Vector:
            for name in history.unrecorded.intersection(names):
                raise NotRecordedError(name)
            found = [columns[each][rows] if each in columns else nothing for each in names]
            return np.nan_to_num(np.stack(found, axis=1)) if names else np.zeros((len(nothing), 0))

        joints = range(1, n + 1)
        given = {
            "q": table([f"joint.{i}.position" for i in joints]),
            "v": table([f"joint.{i}.velocity" for i in joints]),
            "error": table([f"error.{a}" for a in axes]),
            "velocity": table([f"velocity.{a}" for a in axes]),
            "reference": table([f"velocity.{a}.ref" for a in axes]),
            "measured": table([f"{applied(a)}.measured" for a in axes]),
            "desired": table([f"{applied(a)}.ref" for a in axes]),
            "gains": table([f"gain.{name}.{on}" for name, on in self._varying]),
            "force": table([applied(a) for a in axes]),
            "torque": table([f"joint.{i}.torque" for i in joints]),
            "held": np.tile(self._held(history, visit), (len(nothing), 1)),
            "t": table(["t"]),
            "granted": table(["tank.spring"]),
            "filled": table(["tank.filled"]),
        }
        touching = table([f"force.{a}.measured" for a in AXES[:3]])
        touched = np.linalg.norm(touching, axis=1) > TOUCHING
        # A law with a mass of its own does not go by the joints.
        H = np.zeros((len(nothing), n * (n + 1) // 2))
        given["H"], given["gravity"] = H, np.zeros_like(given["v"])
        if self._joints:
            given["H"], _, given["gravity"], *_ = self._terms(given["q"], given["v"])
        given["integral"] = self._integrals(given, touched[:, None].astype(float))
        return given

    def _held(self, history: History, visit: Visit) -> Vector:
        """(axes,) what the stage before held on axes that now release it [N, N m].

        Of a stage in another frame it is not known from a log, and counts as none.
        """
        plan, found = self._plan, np.zeros(len(self._plan.axes))
        before = self._stages.get(str(history.stages[visit.first - 1])) if visit.first else None
        if before is None or before.frame.name != plan.frame.name:
            return found
        for i, axis in enumerate(plan.axes):
            now, column = plan.plans[axis], history.columns.get(f"{applied(axis)}.measured")
            releases = (now.yields or now.soft) and not (now.open_loop or now.set_point)
            if releases and column is not None and before.plans[axis].set_point:
                found[i] = column[visit.first - 1]
        return found

    def _integrals(self, given: dict[str, Vector], touched: Vector) -> Vector:
        """(rows, axes) integrals of f_d - f as the robot applies it, as the controller makes them.

        They begin with what holds the springs as the stage begins, or at zero.
        """
        plan, found = self._plan, np.zeros_like(given["error"])
        if plan.contacts.gripped:
            touched = np.ones_like(touched)
        for i, axis in enumerate(plan.axes):
            if not plan.plans[axis].force or "force.integral" not in plan.gains:
                continue
            rate = self._gain(given, "force.integral", axis)
            stiffness = self._gain(given, "stiffness", axis) * plan.plans[axis].motion
            spring = stiffness * given["error"][:, i : i + 1]
            first = 0.0
            if plan.plans[axis].motion and not axis.is_rotation and rate[0, 0] > 0:
                first = -spring[0, 0] / rate[0, 0]
            desired, measured = (given[n][:, i : i + 1] for n in ("desired", "measured"))
            steps = np.hstack([desired, measured, touched, spring, rate])
            found[:, i] = self._wind(first, steps)
        return found

    def _wind(self, first: float, steps: Vector) -> Vector:
        """(rows,) of one integral."""
        values = _winding(self._period).mapaccum(len(steps))(first, steps.T)
        return np.array(values).reshape(len(steps))

    def _gain(self, given: dict[str, Vector], name: str, axis: Axis) -> Vector:
        """(rows, 1) a gain on an axis."""
        if (name, axis) in self._varying:
            i = self._varying.index((name, axis))
            return given["gains"][:, i : i + 1]
        return np.full((len(given["q"]), 1), value_of(self._plan.gains, name, axis))

    def _evaluated(self, given: dict[str, Vector]) -> dict[str, Vector]:
        """(rows,) of each energy and power."""
        (values,) = self._function(*(given[name] for name in self._taken))
        return dict(zip(self._names, values.T, strict=True))

    def _of_gains(self, given: dict[str, Vector]) -> Vector:
        """(rows,) what a change of gains makes of what is stored, over the period up to a tick."""
        if not self._varying:
            return np.zeros(len(given["q"]))
        before = np.vstack([given["gains"][:1], given["gains"][:-1]])
        changed = self._evaluated(given)["energy.stored"]
        changed = changed - self._evaluated(given | {"gains": before})["energy.stored"]
        return changed / self._period

    def _of_surfaces(self, history: History, visit: Visit) -> Vector:
        """(rows,) of the surfaces that are pressed in, 1/2 k d^2 [J]."""
        found = np.zeros(visit.last + 1 - visit.first)
        for name, shape in self._true.shapes.items():
            stiffness, gap = shape.stiffness, history.columns.get(f"{name}.gap")
            if gap is not None and isinstance(stiffness, float):
                depth = np.fmax(-gap[visit.rows], 0.0)
                found += stiffness * depth**2 / 2
        return found

    def _lyapunov(
        self,
        signals: Mapping[str, Vector],
        given: dict[str, Vector],
        history: History,
        visit: Visit,
    ) -> Vector | None:
        """(rows,) (4.22), (4.28): with the contact, less what both springs have at rest.

        None of laws with a force loop, or with gains that vary.
        """
        plan = self._plan
        if plan.law.control_law.force_loop or self._varying:
            return None
        whole = signals["energy.stored"] + signals["energy.contact"]
        name = plan.contacts.main
        shape, gap = self._true.shapes.get(name or ""), history.columns.get(f"{name}.gap")
        if shape is None or gap is None or not isinstance(shape.stiffness, float):
            return whole
        normal = np.array([plan.contacts.facing(axis) for axis in plan.axes])
        K: Vector = np.array(matrix_rows(plan.gains, "stiffness", plan.axes), dtype=float)
        on = np.abs(normal) > _NO_PART
        if not on.any() or np.diag(K)[on].min() <= 0:
            return whole
        held = np.diag(K) > 0
        yielding = normal[held] @ np.linalg.solve(K[np.ix_(held, held)], normal[held])
        depth = np.fmax(-(gap[visit.rows] + given["error"] @ normal), 0.0)
        least = depth**2 / (yielding + 1 / shape.stiffness) / 2
        found: Vector = whole - least
        return found

    def _works(self, signals: Mapping[str, Vector], given: dict[str, Vector]) -> dict[str, Vector]:
        """(rows,) what each term has put in since the visit began [J]."""
        T = self._period

        def over(power: Vector) -> Vector:
            return _summed((power[1:] + power[:-1]) / 2 * T)

        held = {"measured": given["force"], "velocity": _mean(given["velocity"])}
        works = {
            "contact": _summed(self._evaluated(given | held)["power.contact"][:-1] * T),
            **{n: over(signals[f"power.{n}"]) for n in ("reference", "force", "integral")},
            "gains": _summed(signals["power.gains"][1:] * T),
            **dict.fromkeys(("torques", "sampling", "tank"), np.zeros(len(given["q"]))),
            "dissipated": over(signals["power.dissipated"]),
        }
        works["force"] += self._displaced(given)
        if "commanded" in signals and self._plan.context.drives.torques:
            works |= self._beside(given, over(signals["commanded"]), works["reference"])
        stored = signals["energy.stored"] - signals["energy.stored"][0]
        known = sum((works[n] for n in (*PORTS, *INNER[:-1])), -works["dissipated"])
        return works | {"rest": stored - known}

    def _displaced(self, given: dict[str, Vector]) -> Vector:
        """(rows,) what set points put into springs by displacing their references [J]."""
        plan, T, error = self._plan, self._period, given["error"]
        on = np.array([float(plan.plans[axis].open_loop) for axis in plan.axes])
        if not on.any():
            return np.zeros(len(error))
        led = _mean(given["reference"] - given["velocity"])[:-1] * T
        by = np.vstack([(np.diff(error, axis=0) - led) * on, 0 * on])
        middle = _mean(error)

        def spring(error: Vector) -> Vector:
            return self._evaluated(given | {"error": error})["energy.spring"]

        # Of 1/2 e^T K e the mixed part is e^T K d.
        return _summed((spring(middle + by) - spring(middle) - spring(by))[:-1])

    def _beside(
        self, given: dict[str, Vector], equation: Vector, reference: Vector
    ) -> dict[str, Vector]:
        """What joint torques do beyond the law's equation, and what holding its springs does.

        While a reference moves that the law feeds forward, it is the reference that does it.
        """
        done = (
            np.sum((given["torque"] - given["gravity"]) * _mean(given["v"]), axis=1)[:-1]
            * self._period
        )
        step = np.diff(given["error"], axis=0, append=given["error"][-1:])
        held = self._evaluated(given | {"error": step})["energy.spring"][:-1]
        beyond = done - np.diff(equation) - held
        moves = np.abs(given["reference"]).max(axis=1, initial=0.0) > 0
        fed = moves[:-1] & self._plan.law.control_law.feeds_forward
        return {
            "sampling": _summed(held),
            "torques": _summed(np.where(fed, 0.0, beyond)),
            "reference": reference + _summed(np.where(fed, beyond, 0.0)),
        }


def _summed(works: Vector) -> Vector:
    """(rows,) sums of works (rows - 1,) since the first row."""
    return np.concatenate([[0.0], np.cumsum(works)])


def _mean(values: Vector) -> Vector:
    """(rows, size) the mean of each row and the next; of the last itself."""
    return (values + np.vstack([values[1:], values[-1:]])) / 2


@lru_cache(maxsize=1)
def _winding(period: float) -> ca.Function:
    """One step of an integral: its value, then set point, force, touching, spring and gain."""
    integral, step = ca.SX.sym("integral"), ca.SX.sym("step", 5)
    desired, measured, touching, spring, rate = (step[i] for i in range(5))
    grown = wound(integral, desired, period * (desired - measured), rate, touching, spring)
    return ca.Function("wound", [integral, step], [grown])


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """Where stages gained energy by themselves, and by what."""
    yield from (gain_text(each) for each in summary.get("energy", ()) if "gained" in each)


def gain_text(data: Mapping[str, Any]) -> str:
    """What a stage gained by itself, of its entry in a summary."""
    gained = data["gained"]
    amount, work = (joules(gained[key]) for key in ("energy", "work"))
    return (
        f"stage {data['stage']} gained {amount} by itself from {gained['start']:.3f} to "
        f"{gained['end']:.3f} s: {work} by {WORDS[gained['by']]}"
    )


def energy_block(program: Program, history: History, true: Task) -> dict[str, Any]:
    """The entry of a summary, `energy`: of each visit of a stage whose law stores any.

    A longer run than of `MOST` ticks has none, as it would take its memory several times.
    """
    if len(history) > MOST:
        return {}
    visits = RunEnergies(program, history, true).visits
    clock = history.columns["clock"] if visits else np.zeros(0)
    return {"energy": [each.as_data(clock) for each in visits]} if visits else {}

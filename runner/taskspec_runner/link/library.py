"""A task's plant driven by its exported controller, a shared library in this process."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec_runner.controller_c.source import Controller, controller_of
from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.plant.plant import Plant

Vector = NDArray[np.float64]


class ExportedController(Protocol):
    """An instance of a controller that was exported, in this process.

    Attributes:
        q, v, wrench, reactions: of the sample that it is to answer.
        command: (n,) of the last answer, what the joints are commanded.
        grip: (1,) what each jaw is to press with [N]; (0,) where the task does not grip.
    """

    q: Vector
    v: Vector
    wrench: Vector
    reactions: Vector
    command: Vector
    grip: Vector

    @property
    def state(self) -> int:
        """Of the last answer, 0 while the task goes on."""

    def answer(self, stamp: float, *, first: bool = False) -> None:
        """Has the controller answer the sample that is written, at a time [s]."""

    def set(self, param: int, value: float) -> None:
        """Sets a live param by its number [SI]; before the first answer the task begins with it."""


class ControllerLibrary:
    """One instance of an exported controller.

    Attributes:
        memory: (bytes,) of the instance.
        sample: the numbers of the input, in their order in the header.
        q, v, wrench, reactions: of the sample.
        command: (n,) of the last answer, what the joints are commanded.
        grip: (1,) what each jaw is to press with [N]; (0,) where the task does not grip.
        state: of the last answer, 0 while the task goes on.
        stage: of the last answer.
    """

    def __init__(
        self,
        path: Path,
        controller: Controller,
        joints: int,
        reactions: int,
        *,
        grips: bool = False,
    ) -> None:
        """Loads a library and prepares an instance.

        Args:
            path: of the library.
            controller: that it is to be made of.
            joints, reactions: numbers of a sample.
            grips: whether the task grips.

        Raises:
            InputError: it is no library, or not of this controller.
        """
        name = controller.name
        again = f"compile it: cc -std=c99 -O2 -shared -fPIC {name}.c -o {name}.so -lm"
        try:
            # By its whole path: a bare name would be searched for elsewhere.
            self._library = ctypes.CDLL(str(path.resolve(strict=True)))
        except FileNotFoundError as error:
            raise InputError(
                f"there is no {path}; export the task with 'taskspec export FILE --c DIR' and "
                f"{again}"
            ) from error
        except OSError as error:
            raise InputError(
                f"{path} is no shared library that this machine can load: {error}; {again}"
            ) from error
        try:
            functions = {
                part: getattr(self._library, f"{name}_{part}")
                for part in ("size", "init", "start", "step", "task", "bear", "set")
            }
        except AttributeError as error:
            raise InputError(
                f"{path} is no library of the task {name!r}: {error}; export the task with "
                f"'taskspec export FILE --c DIR' and {again}"
            ) from error
        functions["size"].restype = ctypes.c_uint64
        functions["task"].restype = ctypes.c_char_p
        made_of = functions["task"]().decode("ascii", "replace")
        if made_of != controller.digest:
            raise InputError(
                f"{path} was made of another state of the task, or by another version: "
                f"{made_of[:12]}, and not {controller.digest[:12]}; export and compile it again"
            )
        pointer = ctypes.c_void_p
        functions["init"].restype = pointer
        functions["init"].argtypes = [pointer]
        for part in ("start", "step"):
            functions[part].argtypes = [pointer] * 3
        functions["set"].argtypes = [pointer, ctypes.c_int32, ctypes.c_double]
        functions["set"].restype = ctypes.c_double
        self._start, self._step = functions["start"], functions["step"]
        self._set = functions["set"]
        # Of doubles, as which it is to be aligned.
        self.memory = np.zeros(-(-functions["size"]() // 8)).view(np.uint8)
        self._instance = functions["init"](self.memory.ctypes.data)
        # The structures of the header hold doubles, and three integers at last.
        self.sample = np.zeros(2 * joints + 6 + max(reactions, 1) + 1)
        ends = np.cumsum([joints, joints, 6, reactions])
        self.q, self.v, self.wrench, self.reactions, _ = np.split(self.sample, ends)
        doubles = 8 * (joints + grips)
        self._answer = np.zeros(doubles + 16, dtype=np.uint8)
        self.command = self._answer[: 8 * joints].view(np.float64)
        self.grip = self._answer[8 * joints : doubles].view(np.float64)
        self._given = self._instance, self.sample.ctypes.data, self._answer.ctypes.data
        self._ends = self._answer[doubles:].view(np.int32)

    @property
    def state(self) -> int:
        """Of the last answer, 0 while the task goes on."""
        return int(self._ends[0])

    @property
    def stage(self) -> int:
        """Number of the stage of the last answer."""
        return int(self._ends[1])

    def answer(self, stamp: float, *, first: bool = False) -> None:
        """Has the controller answer the sample that is written, at a time [s]."""
        self.sample[-1] = stamp
        called = self._start if first else self._step
        called(*self._given)

    def set(self, param: int, value: float) -> None:
        """Sets a live param by its number [SI]; before the first answer the task begins with it."""
        self._set(self._instance, param, value)


class LibraryPlant:
    """The plant of the loop whose joints an exported controller commands.

    Attributes:
        arm: itself, whose divergence the loop checks.
        diverged: as the plant's arm.
    """

    def __init__(
        self, library: ExportedController, parts: Assembly[Plant], sensing: Sensing
    ) -> None:
        self._library, self._plant, self._sensing = library, parts.plant, sensing
        self._machine, self._period = parts.machine, parts.program.context.period
        self._ticks, self._started, self.diverged = 0, False, False
        task = parts.program.context.loaded.task
        #: What the live params are set to over there [SI].
        self._set = [param.value for param in task.live.values()]

    @property
    def arm(self) -> LibraryPlant:
        """The arm, as the loop uses it."""
        return self

    def read(self) -> None:
        """Senses, and gives the controller what is measured."""
        self._sensing.read()
        machine, library = self._machine, self._library
        library.q[:], library.v[:] = machine.q, machine.v
        library.wrench[:] = machine.wrench if machine.sensor is None else machine.sensor.reading
        library.reactions[: len(machine.reactions)] = machine.reactions
        if not self._started:
            self._started = True
            self._pass_on(machine.live.table.begins)
            library.answer(0.0, first=True)

    def step(self, command: Vector) -> None:
        """Holds the controller's commands for one control period.

        Raises:
            LinkError: it has ended the task, which the file's own machine has not.
        """
        self._pass_on(self._machine.live.table.targets)
        self._library.answer(self._ticks * self._period)
        if self._library.state and not self._machine.ended:
            error = LinkError(
                "controller_stopped", f"the library ended the task: state {self._library.state}"
            )
            error.ticks = self._ticks
            raise error
        command[:] = self._library.command
        if self._machine.grip.used:
            np.asarray(self._machine.grip.command)[:] = self._library.grip
        self._machine.predict()
        self._plant.step(command)
        self.diverged = self._plant.arm.diverged
        self._ticks += 1

    def _pass_on(self, targets: Iterable[float]) -> None:
        """Sets the live params that are to go elsewhere than they do [SI]."""
        for i, (wanted, present) in enumerate(zip(targets, self._set, strict=True)):
            if wanted != present:
                self._library.set(i, wanted)
                self._set[i] = wanted

    def release(self) -> Plant:
        """The plant without its controller."""
        return self._plant

    def alarm(self) -> tuple[str, str] | None:
        """The alarm of the simulator; None without one."""
        return self._plant.alarm()


class InLibrary:
    """The link of a program's plant to its exported controller."""

    #: Its logs have the truth.
    measured = False
    #: The plant waits for each answer.
    lock_step = True

    def __init__(self, path: Path, program: Program) -> None:
        """Loads the library of a program's controller.

        Raises:
            InputError: it is none.
        """
        context = program.context
        self._path = path
        task = context.loaded.task
        self._library: ExportedController = ControllerLibrary(
            path,
            controller_of(program),
            context.robot.n,
            len(task.reported),
            grips=bool(task.gripped),
        )

    def assemble(self, program: Program, world: World) -> Assembly[LibraryPlant]:
        """Assembles the parts of the run; the file's own machine runs beside."""
        parts = assemble(program, world)
        parts.machine.followed = False
        arm, equations = parts.plant.arm, parts.plant.views.equations
        sensing = Sensing(arm, equations, parts.machine, world.noise_seed)
        plant = LibraryPlant(self._library, parts, sensing)
        return Assembly(program, world, parts.bus, plant, parts.machine, sensing=plant)

    def finish(self, text: str) -> None:
        """Nothing is to be reported to a library."""

    def as_data(self) -> dict[str, Any]:
        """The entry of a summary about the link."""
        return {"end": "plant", "mode": "lock-step", "name": self._path.name}

"""A task's plant driven by its FMU, which FMPy runs in this process."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from taskspec.missing import library
from taskspec.program.program import Program
from taskspec_runner.controller_c.fmu import FMI_VERSIONS, GRIP, REPORTS, fmu_of, output_group
from taskspec_runner.errors import InputError
from taskspec_runner.link.library import InLibrary


class ControllerFmu:
    """One instance of the FMU of a task's controller.

    Attributes:
        q, v: (n,) positions [rad, m] and velocities [rad/s, m/s] of the sample.
        wrench: (6,) of the sample [N, N m], as the FMU's variables say.
        reactions: (m,) of the sample [N, N m].
        command: (n,) of the last answer, what the joints are commanded.
        state: of the last answer, 0 while the task goes on.
    """

    def __init__(self, path: Path, program: Program) -> None:
        """Extracts an FMU and instantiates it.

        Raises:
            InputError: it is no FMU, or not of this program.
            MissingLibraryError: FMPy is not installed.
        """
        fmpy = library("fmpy", "--on fmu:PATH")
        try:
            about = fmpy.read_model_description(str(path.resolve(strict=True)))
            version = int(about.fmiVersion[0])
            identifier = about.coSimulation.modelIdentifier
        except Exception as error:  # whatever a parser makes of a file that is none
            raise InputError(
                f"{path} is no FMU for co-simulation: {error}; export the task with "
                f"'taskspec export FILE --fmu PATH'"
            ) from error
        token = about.guid if version == 2 else about.instantiationToken
        if version not in FMI_VERSIONS or token != fmu_of(program, version).token:
            raise InputError(
                f"{path} was made of another state of the task, or by another version; "
                f"export it again"
            )
        references = {v.name: v.valueReference for v in about.modelVariables}
        groups = ("position.", "velocity.", "wrench.", "reaction.", *REPORTS)
        self._inputs = [references[name] for name in references if name.startswith(groups)]
        commanded = output_group(program.context.drives.commands)
        self._commands = [references[name] for name in references if name.startswith(commanded)]
        self._grip = [references[name] for name in references if name == GRIP]
        self._state = [references["state"]]
        self._params = [references[name] for name in references if name.startswith("set.")]
        slave = library(f"fmpy.fmi{version}", "--on fmu:PATH")
        # What is loaded needs its file no more; where it does, the folder stays.
        with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            fmpy.extract(str(path), folder)
            try:
                self._fmu: Any = getattr(slave, f"FMU{version}Slave")(
                    guid=token,
                    unzipDirectory=folder,
                    modelIdentifier=identifier,
                    instanceName=identifier,
                )
            except Exception as error:  # FMPy says in plain ones that a binary is not there
                raise InputError(
                    f"{path} has no binary that can be loaded here: {error}; "
                    f"compile it: fmpy compile {path}"
                ) from error
        self._fmu.instantiate()
        real = version == 2
        self._set = self._fmu.setReal if real else self._fmu.setFloat64
        self._get = self._fmu.getReal if real else self._fmu.getFloat64
        self._get_state = self._fmu.getInteger if real else self._fmu.getInt64
        self._period = program.context.period
        joints = len(self._commands)
        self._sample, self.command = np.zeros(len(self._inputs)), np.zeros(joints)
        self.grip = np.zeros(len(self._grip))
        ends = np.cumsum([joints, joints, 6])
        self.q, self.v, self.wrench, self.reactions = np.split(self._sample, ends)
        self.state = 0

    def answer(self, stamp: float, *, first: bool = False) -> None:
        """Has the FMU answer the sample that is written, at a time [s]."""
        if first:
            if hasattr(self._fmu, "setupExperiment"):
                self._fmu.setupExperiment(startTime=stamp)
            self._fmu.enterInitializationMode()
        self._set(self._inputs, self._sample)
        if first:
            self._fmu.exitInitializationMode()
        else:
            self._fmu.doStep(stamp, self._period)
        self.command[:] = self._get(self._commands)
        if self._grip:
            self.grip[:] = self._get(self._grip)
        self.state = int(self._get_state(self._state)[0])

    def set(self, param: int, value: float) -> None:
        """Sets a live param by its number [SI]; before the first answer the task begins with it."""
        self._set([self._params[param]], [value])


class InFmu(InLibrary):
    """The link of a program's plant to the FMU of its controller."""

    def __init__(self, path: Path, program: Program) -> None:
        """Loads the FMU of a program's controller.

        Raises:
            InputError: it is none.
            MissingLibraryError: FMPy is not installed.
        """
        self._path, self._library = path, ControllerFmu(path, program)

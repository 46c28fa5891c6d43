"""The controller of a task as an FMU: a zip of its C, of what describes it, and of a binary."""

from __future__ import annotations

import hashlib
import io
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from uuid import UUID
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from taskspec.deferred_methods import dataclass
from taskspec.native.kernel_c import number
from taskspec.program.program import Program
from taskspec.spec import Task
from taskspec.text.units import Dimension, in_si, si_unit
from taskspec_runner.controller_c.commanded import CommandedQuantity
from taskspec_runner.controller_c.source import Controller, controller_of, filled
from taskspec_runner.controller_c.states import BEARS, STATES

#: Versions of FMI that there are FMUs of.
FMI_VERSIONS = (2, 3)
_FOLDER = Path(__file__).parent / "fmi"
#: What a gripper is commanded, and what it reports: unit and text, in the order of a sample.
GRIP = "gripper.command"
REPORTS = {
    "gripper.force": ("N", "what each jaw presses with; 0 with nothing in it"),
    "gripper.slip": ("m", "how far what is gripped has slid since the jaws closed"),
}
#: The exponents of its SI units, by the name of a unit.
_UNITS = {
    "s": {"s": 1},
    "m": {"m": 1},
    "rad": {"rad": 1},
    "m/s": {"m": 1, "s": -1},
    "rad/s": {"rad": 1, "s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
}
#: Names of the machine's systems and processors in those of a platform.
_SYSTEMS = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}
_PROCESSORS = {"x86_64": "x86_64", "AMD64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_COMPILERS = ("cc", "gcc", "clang")
_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden", "-shared")
#: When all files of an FMU were written, so that the same task has the same bytes.
_WRITTEN = (1980, 1, 1, 0, 0, 0)
#: What the standard's grammar of structured names has beyond letters, digits and underscores.
_QUOTABLE = re.compile(r"[\w!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]+", re.ASCII)


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """A variable of an FMU.

    Attributes:
        name: by the standard's structured names.
        form: Float64, Int64, Enumeration or String.
        causality: independent, input, output or parameter.
        text: what it is.
        start: of an input or a parameter.
        unit: of a number.
        declared: name of an enumeration.
        range: of a param that may be set, its least and its greatest value.
    """

    name: str
    form: str
    causality: str
    text: str
    start: str | None = None
    unit: str | None = None
    declared: str | None = None
    range: tuple[float, float] | None = None

    @property
    def facts(self) -> dict[str, str]:
        """Attributes that all versions have, and what they say of how it changes."""
        changes = "continuous" if self.causality in ("independent", "input") else "discrete"
        changes = "fixed" if self.causality == "parameter" else changes
        found = {"description": self.text, "causality": self.causality, "variability": changes}
        if self.causality == "output":
            found["initial"] = "calculated"
        elif self.causality == "parameter":
            found["initial"] = "exact"
        return found

    @property
    def values(self) -> dict[str, str]:
        """Attributes that are of its type."""
        found = {"declaredType": self.declared, "unit": self.unit, "start": self.start}
        found |= {"min": "0", "max": str(2**31 - 1)} if self.form == "Int64" else {}
        if self.range is not None:
            found |= dict(zip(("min", "max"), map(repr, self.range), strict=True))
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True, slots=True)
class Fmu:
    """The files of an FMU, without a binary.

    Attributes:
        controller: the C in it.
        fmi: version of the interface, 2 or 3.
        token: that names its state.
        files: their texts by their paths in it.
    """

    controller: Controller
    fmi: int
    token: str
    files: Mapping[str, str]

    def binary(self) -> tuple[str, bytes]:
        """Compiles the binary for this machine; its path in the FMU, and its bytes.

        Raises:
            NoBinaryError: there is no compiler, it fails, or the machine has no name in FMI.
        """
        path = self._binary_path()
        compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
        if compiler is None:
            raise NoBinaryError(f"there is no C compiler ({', '.join(_COMPILERS)})")
        with tempfile.TemporaryDirectory() as folder:
            for name, text in self.files.items():
                if name.startswith("sources/"):
                    (Path(folder) / Path(name).name).write_text(text, encoding="utf-8")
            made = Path(folder) / Path(path).name
            command = [compiler, *_FLAGS, f"-I{_FOLDER}", f"fmi{self.fmi}.c"]
            command += [f"{self.controller.name}.c", "-o", made.name, "-lm"]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            if done.returncode:
                reason = (done.stderr.strip() or f"code {done.returncode}").splitlines()[0]
                raise NoBinaryError(f"{compiler} failed: {reason}")
            return path, made.read_bytes()

    def _binary_path(self) -> str:
        system, suffix = _SYSTEMS.get(platform.system(), ("", ""))
        processor = _PROCESSORS.get(platform.machine(), "")
        if not system or not processor:
            raise NoBinaryError(f"{platform.system()} on {platform.machine()} is not supported")
        folder = f"{processor}-{system}"
        if self.fmi == 2 and processor == "x86_64":
            folder = f"{system}64"
        return f"binaries/{folder}/{self.controller.name}{suffix}"

    def to_bytes(self, binary: tuple[str, bytes] | None = None) -> bytes:
        """The zip, with a binary or without."""
        files = [(name, text.encode()) for name, text in self.files.items()]
        written = io.BytesIO()
        with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in [*files, *([binary] if binary else [])]:
                entry = zipfile.ZipInfo(name, _WRITTEN)
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, content)
        return written.getvalue()


class NoBinaryError(Exception):
    """No binary can be made here; the message says why."""


def fmu_of(program: Program, fmi: int = 3) -> Fmu:
    """The FMU of a program's controller, for version 2 or 3 of the interface.

    Raises:
        UnsupportedOperationError: an expression has an operation that C lacks.
    """
    controller = controller_of(program)
    variables = _variables(program, controller)
    parts = {
        "NAME": controller.name,
        "UPPER": controller.name.upper(),
        "TITLE": program.context.loaded.task.name,
        "COMMAND": CommandedQuantity.of(program).name,
        "VERSION": version("taskspec-robotics"),
        "GRIPS": str(int(bool(program.context.loaded.task.gripped))),
        "GRIP_OUT": "f->out.grip" if program.context.loaded.task.gripped else "0.0",
        "PERIOD": number(program.context.period),
        "INPUTS": str(
            sum(v.causality == "input" for v in variables) - len(program.context.loaded.task.live)
        ),
    }
    templates = {name: (_FOLDER / name).read_text("utf-8") for name in ("fmu.h", f"fmi{fmi}.c")}
    describe = {2: _description_2, 3: _description_3}[fmi]
    described = describe(program, controller, variables, "")
    made_of = "\n".join((controller.digest, *templates.values(), _text(described)))
    hashed = hashlib.sha256(made_of.encode()).digest()
    token = f"{{{UUID(bytes=hashed[:16])}}}"
    parts["TOKEN"] = token
    files = {"modelDescription.xml": _text(describe(program, controller, variables, token))}
    if fmi == 3:
        files["sources/buildDescription.xml"] = _text(_build(controller))
    files |= {f"sources/{name}": filled(text, parts) for name, text in templates.items()}
    files[f"sources/{controller.name}.h"] = controller.header
    files[f"sources/{controller.name}.c"] = controller.source
    return Fmu(controller, fmi, token, files)


def _variables(program: Program, controller: Controller) -> list[FmuVariable]:
    """The variables, in the order of their references."""
    context = program.context
    robot = context.robot
    written = [_written(name, i) for i, name in enumerate(robot.joint_names)]
    found = [FmuVariable("time", "Float64", "independent", "time of the simulation", unit="s")]

    def of_joints(what: str, units: tuple[str, str], causality: str, text: str) -> None:
        starts = context.start if what == "position" else [0.0] * robot.n
        for i, joint in enumerate(robot.joint_names):
            start = repr(float(starts[i])) if causality == "input" else None
            unit = units[0] if robot.hinges[i] else units[1]
            name, says = f"{what}.{written[i]}", f"{text} of {joint}"
            found.append(FmuVariable(name, "Float64", causality, says, start, unit))

    of_joints("position", ("rad", "m"), "input", "measured position")
    of_joints("velocity", ("rad/s", "m/s"), "input", "measured velocity")
    for what, unit in (("force", "N"), ("moment", "N.m")):
        for axis in "xyz":
            name, text = f"wrench.{what}.{axis}", f"{what} along {axis}. {controller.wrench}"
            found.append(FmuVariable(name, "Float64", "input", text, "0.0", unit))
    for i, (name, equation) in enumerate(context.equations.items()):
        text = f"along the unit gradient of left minus right of {name}: {equation.constraint}"
        unit = "N.m" if equation.angular else "N"
        found.append(
            FmuVariable(f"reaction.{_written(name, i)}", "Float64", "input", text, "0.0", unit)
        )
    if context.loaded.task.gripped:
        for name, (unit, text) in REPORTS.items():
            found.append(FmuVariable(name, "Float64", "input", text, "0.0", unit))
    commanded = CommandedQuantity.of(program)
    units = {"torque": ("N.m", "N"), "velocity": ("rad/s", "m/s"), "position": ("rad", "m")}
    said = f"commanded {commanded.name}, {commanded.of_joint},"
    group = output_group(commanded.name).removesuffix(".")
    of_joints(group, units[commanded.name], "output", said)
    if context.loaded.task.gripped:
        text = "what each jaw of the gripper is to press with; 0 opens it"
        found.append(FmuVariable(GRIP, "Float64", "output", text, None, "N"))
    text = "control periods within a communication step that may lack a sample; more end the task"
    found += [
        FmuVariable("state", "Enumeration", "output", "whether the task goes on", declared="State"),
        FmuVariable("stage", "Enumeration", "output", "in which it is, or ended", declared="Stage"),
        FmuVariable("lost_samples", "Int64", "parameter", text, str(BEARS)),
        FmuVariable("event", "String", "output", "short name of what ended the task, or empty"),
        FmuVariable(
            "reason",
            "String",
            "output",
            "why the task has ended, or that it goes on, as a sentence",
        ),
    ]
    return found + _params(context.loaded.task)


def _params(task: Task) -> list[FmuVariable]:
    """What the params are set to that may be set, then their values."""
    set_to, values = list[FmuVariable](), list[FmuVariable]()
    for name, param in task.live.items():
        unit, ends = _unit_of(param.dimension) or None, (param.low, param.high)
        rate = f"{in_si(param.rate, param.dimension)} per second" if param.rate else ""
        goes = f"goes to at {rate}" if rate else "jumps to"
        text = f"what the param {name} {goes}; beyond its range the nearest value in it"
        start = repr(param.value)
        set_to.append(FmuVariable(f"set.{name}", "Float64", "input", text, start, unit, range=ends))
        text = f"value of the param {name}"
        values.append(FmuVariable(f"param.{name}", "Float64", "output", text, None, unit))
    return set_to + values


def _unit_of(dimension: Dimension) -> str:
    """The SI unit of a param in the notation of FMI, whose exponents are whole; empty for none."""
    d = dimension
    whole = all(float(n).is_integer() for n in (d.mass, d.length, d.time, d.angle))
    return si_unit(d).replace("*", ".") if whole else ""


def _units(task: Task) -> dict[str, dict[str, int]]:
    """The exponents of the SI units of a task's variables, by the name of a unit."""
    found = dict(_UNITS)
    for param in task.live.values():
        d = param.dimension
        powers = {"kg": d.mass, "m": d.length, "s": d.time, "rad": d.angle}
        if name := _unit_of(d):
            found.setdefault(name, {base: int(n) for base, n in powers.items() if n})
    return found


def output_group(commanded: str) -> str:
    """What the names of the commands begin with; positions and velocities are inputs, too."""
    return "torque." if commanded == "torque" else f"command.{commanded}."


def _written(name: str, i: int) -> str:
    """A name as a part of a structured one, or its number where the grammar has no such name."""
    if not _QUOTABLE.fullmatch(name):
        return f"number[{i + 1}]"
    return name if name.isidentifier() else f"'{name}'"


def _types(program: Program) -> dict[str, list[tuple[str, int, str]]]:
    """Name, value and text of the items of each enumeration."""
    return {
        "State": [(name.lower(), i, text) for i, (name, text) in enumerate(STATES)],
        "Stage": [(stage.name, i, "") for i, stage in enumerate(program.stages)],
    }


def _description_3(
    program: Program, controller: Controller, variables: Sequence[FmuVariable], token: str
) -> Element:
    """The description of an FMU of FMI 3.0."""
    period = number(program.context.period)
    root = _root(program, {"fmiVersion": "3.0", "instantiationToken": token})
    SubElement(
        root,
        "CoSimulation",
        modelIdentifier=controller.name,
        canGetAndSetFMUState="true",
        fixedInternalStepSize=period,
    )
    _add_units(root, program.context.loaded.task, variables)
    types = SubElement(root, "TypeDefinitions")
    for name, items in _types(program).items():
        _add_items(SubElement(types, "EnumerationType", name=name), items)
    _add_categories(root)
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=period)
    listed = SubElement(root, "ModelVariables")
    structure = SubElement(root, "ModelStructure")
    outputs = []
    for reference, v in enumerate(variables):
        names = {"name": v.name, "valueReference": str(reference)}
        SubElement(listed, v.form, names | v.facts | v.values)
        if v.causality == "output":
            outputs.append(str(reference))
    # Between communication points no output depends on what the inputs are set to.
    for output in outputs:
        SubElement(structure, "Output", valueReference=output, dependencies="")
    for output in outputs:
        SubElement(structure, "InitialUnknown", valueReference=output)
    return root


def _description_2(
    program: Program, controller: Controller, variables: Sequence[FmuVariable], token: str
) -> Element:
    """The description of an FMU of FMI 2.0."""
    root = _root(program, {"fmiVersion": "2.0", "guid": token})
    simulation = SubElement(
        root,
        "CoSimulation",
        modelIdentifier=controller.name,
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
    )
    files = SubElement(simulation, "SourceFiles")
    for name in ("fmi2.c", f"{controller.name}.c"):
        SubElement(files, "File", name=name)
    _add_units(root, program.context.loaded.task, variables)
    types = SubElement(root, "TypeDefinitions")
    for name, items in _types(program).items():
        of_type = SubElement(types, "SimpleType", name=name)
        _add_items(SubElement(of_type, "Enumeration"), items)
    _add_categories(root)
    period = number(program.context.period)
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=period)
    listed = SubElement(root, "ModelVariables")
    forms = {"Float64": "Real", "Int64": "Integer"}
    outputs = []
    # FMI 2.0 needs no variable for the time; its index is that of the list, from 1.
    for i, v in enumerate(variables[1:], 1):
        names = {"name": v.name, "valueReference": str(i)}
        scalar = SubElement(listed, "ScalarVariable", names | v.facts)
        SubElement(scalar, forms.get(v.form, v.form), v.values)
        if v.causality == "output":
            outputs.append(str(i))
    structure = SubElement(root, "ModelStructure")
    of_steps = SubElement(structure, "Outputs")
    at_first = SubElement(structure, "InitialUnknowns")
    for index in outputs:
        SubElement(of_steps, "Unknown", index=index, dependencies="")
        SubElement(at_first, "Unknown", index=index)
    return root


def _root(program: Program, facts: dict[str, str]) -> Element:
    name, tool = program.context.loaded.task.name, f"taskspec {version('taskspec-robotics')}"
    plural = CommandedQuantity.of(program).plural
    text = f"The controller of the task {name}: joint {plural}, a period after each sample"
    facts = facts | {"modelName": name, "description": text, "generationTool": tool}
    return Element("fmiModelDescription", facts | {"variableNamingConvention": "structured"})


def _add_units(root: Element, task: Task, variables: Sequence[FmuVariable]) -> None:
    units = SubElement(root, "UnitDefinitions")
    used = {v.unit for v in variables}
    for name, exponents in _units(task).items():
        if name in used:
            unit = SubElement(units, "Unit", name=name)
            SubElement(unit, "BaseUnit", {base: str(e) for base, e in exponents.items()})


def _add_items(enumeration: Element, items: Sequence[tuple[str, int, str]]) -> None:
    for name, value, text in items:
        facts = {"name": name, "value": str(value)} | ({"description": text} if text else {})
        SubElement(enumeration, "Item", facts)


def _add_categories(root: Element) -> None:
    categories = SubElement(root, "LogCategories")
    for name, text in (
        ("logStatusWarning", "what ended a task that did not reach its end"),
        ("logStatusError", "calls that are refused"),
    ):
        SubElement(categories, "Category", name=name, description=text)


def _build(controller: Controller) -> Element:
    """How the sources of an FMU of FMI 3.0 are compiled."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    made = SubElement(root, "BuildConfiguration", modelIdentifier=controller.name)
    files = SubElement(made, "SourceFileSet", language="C99")
    for name in ("fmi3.c", f"{controller.name}.c"):
        SubElement(files, "SourceFile", name=name)
    SubElement(
        files,
        "PreprocessorDefinition",
        name="FMI3_OVERRIDE_FUNCTION_PREFIX",
        value="1",
        optional="true",
        description="names without prefix, as a shared library has them",
    )
    SubElement(made, "Library", name="m", external="true")
    return root


def _text(root: Element) -> str:
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text.decode() + "\n"

"""The files of a controller in C, and what they are made of."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from taskspec.control.qp.dual import dual_solver
from taskspec.deferred_methods import dataclass
from taskspec.native import expressions_c, kernel_c
from taskspec.native.kernel import Kind
from taskspec.native.kernel_c import number
from taskspec.program import events
from taskspec.program.evaluation import Evaluation, evaluate
from taskspec.program.execution import controller
from taskspec.program.execution.controller_memory import controller_memories
from taskspec.program.execution.exits import repeats
from taskspec.program.execution.live_params import declare, request
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.transition import END, exits
from taskspec.program.program import Program
from taskspec.spec.params import LiveParam
from taskspec.text.units import si_unit
from taskspec_runner.controller_c.header import header_facts, wrench_lines
from taskspec_runner.controller_c.layout import Layout
from taskspec_runner.controller_c.states import BEARS, STATES

_FOLDER = Path(__file__).parent / "c"
#: Of an instance beside its layout, as controller.c has it.
_OWN_BYTES = 104
_EVALUATION = """\
struct Evaluation {
    int64_t code;
    const double *const *arguments;
    double *const *results;
};
static void ts_evaluate(struct Evaluation *f);"""
_GRIP_OUT = """
    double grip; /* what each jaw of the gripper is to press with [N]; 0 opens it */"""
#: Words of C and C++, which name no structure, and headers of C, which a file may not hide.
_TAKEN = frozenset(
    "alignas alignof and and_eq asm auto bitand bitor bool break case catch char class compl "  # noqa: SIM905
    "concept const consteval constexpr constinit const_cast continue co_await co_return co_yield "
    "decltype default delete do double dynamic_cast else enum explicit export extern false float "
    "for friend goto if inline int long mutable namespace new noexcept not not_eq nullptr operator "
    "or or_eq private protected public register reinterpret_cast requires restrict return short "
    "signed sizeof static static_assert static_cast struct switch template this thread_local throw "
    "true try typedef typeid typename union unsigned using virtual void volatile wchar_t while xor "
    "xor_eq assert complex ctype errno fenv inttypes iso646 limits locale math setjmp signal "
    "stdalign stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath "
    "threads time uchar wchar wctype".split()
)
#: What the machine calls of the kernel.
_KERNEL = (
    *(controller.start, controller.control, controller.open_stage, controller.leave),
    *(controller.begin, controller.stop),
    *(declare, request),
)


@dataclass(frozen=True, slots=True)
class Controller:
    """The C of a task's controller.

    Attributes:
        name: what its functions and types begin with.
        digest: SHA-256 of what it is made of, in hexadecimal.
        header, source: texts of its two files.
        size: bytes that are enough for an instance.
        wrench: what the wrench of a sample is.
    """

    name: str
    digest: str
    header: str
    source: str
    size: int
    wrench: str

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Writes NAME.h and NAME.c; their paths.

        Raises:
            OSError: the folder cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        paths = folder / f"{self.name}.h", folder / f"{self.name}.c"
        for path, text in zip(paths, (self.header, self.source), strict=True):
            path.write_text(text, encoding="utf-8")
        return paths


def controller_of(program: Program) -> Controller:
    """The C of a program's controller.

    Raises:
        UnsupportedOperationError: an expression has an operation that C lacks.
    """
    name = identifier(program.context.loaded.task.name)
    machine = program.machine(own=dual_solver)
    memories = controller_memories(machine)
    for memory in memories:
        memory.alone, memory.solves = 1, memory.has_program
    layout = Layout(memories)
    text, header = ((_FOLDER / f"controller.{end}").read_text(encoding="utf-8") for end in "ch")
    facts = _facts(program, machine, name, layout)
    parts = {
        "INITIAL": _initial(layout),
        "FUNCTIONS": _functions(layout),
        "PRELUDE": kernel_c.PRELUDE + expressions_c.PRELUDE.rstrip(),
        "KERNEL": _kernel(),
        "MEMBERS": "\n".join(f"    {member};" for member in layout.members()),
        "FILLING": "\n".join(f"    {line}" for line in layout.filling()),
        "EVENTS": _events(machine),
        **facts,
    }
    made_of = "\n".join((text, header, *(f"{key} {part}" for key, part in sorted(parts.items()))))
    parts["HASH"] = digest = hashlib.sha256(made_of.encode()).hexdigest()
    size, wrench = int(parts["SIZE"]), " ".join(wrench_lines(program, machine))
    return Controller(name, digest, filled(header, parts), filled(text, parts), size, wrench)


def identifier(name: str) -> str:
    """A name of C for a task's name."""
    written = re.sub(r"\W", "_", name, flags=re.ASCII)
    taken = written in _TAKEN or not written[:1].isalpha()
    return f"task_{written}" if taken else written


def filled(text: str, parts: dict[str, str]) -> str:
    """A template, whose places are @NAME@."""
    return re.sub(r"@([A-Z_]+)@", lambda match: parts[match[1]], text)


def _kernel() -> str:
    text = kernel_c.kernel_c(
        *_KERNEL, repeats, instead={evaluate: "ts_evaluate"}, structures={Evaluation: _EVALUATION}
    )
    names = "|".join(function.__name__ for function in (*_KERNEL, repeats))
    # Nothing but the functions of the header is visible outside.
    return re.sub(rf"^(\w+) ({names})\(", r"static \1 \2(", text, flags=re.MULTILINE)


def _functions(layout: Layout) -> str:
    """The functions of CasADi's, and the one that calls them by their numbers."""
    functions = [
        expressions_c.expression_c(function, f"ts_f{number_of}_{function.name()}")
        for number_of, function in layout.functions.values()
    ]
    cases = [
        f"    case {n}: ts_f{n}_{f.name()}(f->arguments, f->results); break;"
        for n, f in layout.functions.values()
    ]
    switch = [
        "static void ts_evaluate(struct Evaluation *f)",
        "{",
        "    switch (f->code) {",
        *cases,
        "    default: break;",
        "    }",
        "}",
    ]
    return "\n\n".join([*functions, "\n".join(switch)])


def _initial(layout: Layout) -> str:
    """Tables of the numbers that are not zero at first, and of what functions read and write."""
    lines = []
    for block in layout.blocks.values():
        values = block.values
        known = np.flatnonzero((values != 0) | np.signbit(values))
        rows = [
            f"{{{i}, {number(float(values[i])) if block.type == 'double' else int(values[i])}}}"
            for i in known
        ]
        lines += [
            f"static const struct {{ int32_t at; {block.type} value; }}",
            f"    ts_first_{block.name}[] = {{",
            *_wrapped(rows or ["{0, 0}"]),
            "};",
        ]
    for name, places in (("arguments", layout.arguments), ("results", layout.results)):
        rows = [str(place) for place in places] or ["0"]
        lines += [f"static const int32_t ts_{name}_at[] = {{", *_wrapped(rows), "};"]
    return "\n".join(lines)


def _wrapped(rows: Sequence[str]) -> list[str]:
    return [f"    {', '.join(rows[i : i + 8])}," for i in range(0, len(rows), 8)]


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + escaped.encode("ascii", "replace").decode().replace("??", "?\\?") + '"'


def _events(machine: Machine) -> str:
    """The events of all stages: what a run is after one that no stage follows, and what it is."""
    rows = []
    for outs in exits([runner.stage for runner in machine.runners]):
        for out in outs:
            status = "STOPPED" if out.event.kind == events.LIMIT else "FAILED"
            status = "DONE" if out.to == END else status
            rows.append(
                f"    {{TS_{status}, {_quoted(out.event.name)}, {_quoted(out.event.text)}}},"
            )
    return "\n".join(rows)


def _facts(program: Program, machine: Machine, name: str, layout: Layout) -> dict[str, str]:
    context = program.context
    loaded, robot = context.loaded, context.robot
    stages = [runner.stage.name for runner in machine.runners]
    return {
        "NAME": name,
        "UPPER": name.upper(),
        "TITLE": loaded.task.name,
        "VERSION": version("taskspec-robotics"),
        "JOINTS": str(robot.n),
        "REACTIONS": str(len(loaded.task.reported)),
        "REACTION_ROOM": str(max(len(loaded.task.reported), 1)),
        "GRIP_OUT": _GRIP_OUT if loaded.task.gripped else "",
        "GRIP_ANSWER": "\n    out->grip = m->now->grip->command[0];" if loaded.task.gripped else "",
        "PERIOD": number(context.period),
        "RATE": f"{1 / context.period:g}",
        "START": ", ".join(number(float(q)) for q in context.start),
        "SENSOR": str(int(machine.sensor is not None)),
        "SIZE": str(layout.size + 8 * robot.n + _OWN_BYTES),
        "BEARS": str(BEARS),
        "STATES": "\n".join(
            f"    /* {text} */\n    {name.upper()}_{state} = {i},"
            for i, (state, text) in enumerate(STATES)
        ).removesuffix(","),
        "STATE_WORDS": "\n".join(f"    {_quoted(text)}," for _, text in STATES),
        "STAGES": str(len(stages)),
        "STAGE_NAMES": ", ".join(map(_quoted, stages)),
        "READING": _reading(machine, layout),
        "PARAMS": str(len(loaded.task.live)),
        "PARAM_ENUM": _param_enum(name, loaded.task.live),
        "PARAM_FACTS": _param_facts(loaded.task.live),
        **header_facts(program, machine),
    }


def _param_enum(name: str, live: Mapping[str, LiveParam]) -> str:
    """The enumeration of the params that may be set; without any there is none."""
    if not live:
        return "/* This task has none. */"
    rows = ",\n".join(f"    {name}_param_{param} = {i}" for i, param in enumerate(live))
    return f"enum {name}_param {{\n{rows}\n}};"


def _param_facts(live: Mapping[str, LiveParam]) -> str:
    """The rows of the table of params; one of nothing without any, as C has no empty tables."""
    rows = [
        f"    {{{_quoted(name)}, {_quoted(si_unit(param.dimension))}, "
        f"{', '.join(number(x) for x in (param.value, param.low, param.high, param.rate))}}},"
        for name, param in live.items()
    ]
    return "\n".join(rows or ['    {"", "", 0.0, 0.0, 0.0, 0.0},'])


def _reading(machine: Machine, layout: Layout) -> str:
    """Where the wrench of a sample goes."""
    zero = machine.sensor
    array = machine.wrench if zero is None else zero.reading
    return f"m->numbers + {layout.blocks[Kind.VECTOR].place(array)}"

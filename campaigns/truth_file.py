"""What is said of one file of `make truth`, and what its run does: a row of the campaign."""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import language_tasks
import numpy as np
import truth_tasks
from language_draft import LanguageDraft
from truth_tasks import TruthDraft

#: Where files come from: the one that rules were fitted to, and one that reads the language alone.
GENERATORS = {"workshop": truth_tasks, "language": language_tasks}
Draft = TruthDraft | LanguageDraft
#: A file: the name of its generator, its seed and its number.
Key = tuple[str, int, int]
#: How much longer a stage is run that is refused though its run ended well.
LONGER = 10.0
#: Time of a stage after which it gets a push [s], and the push: velocities of the joints [rad/s].
PUSHED, PUSH = 0.3, 0.005
#: Less than this of the push counts as nothing; so do velocities of the order of rounding [rad/s].
NOTHING, ROUNDING = 1e-4, 1e-10
#: A contact that is this much softer, or gains that are as much lower or higher, are beyond the
#: boundary where the file's are 2 % from it: errors begin 2 % inside of it.
INSIDE = 0.98**2
#: Of ends, the gravest first.
WELL, REFUSED, CRASHED = "well", "refused", "crashed"


@dataclass
class Explanation:
    """A finding of `validate`.

    Attributes:
        stage: that it is about; empty for none.
        measured: what a run that ended well did of it; empty where nothing measures that.
    """

    code: str
    severity: str
    stage: str
    text: str
    measured: str = ""


@dataclass
class Row:
    """What came of one file.

    Attributes:
        number: of the file. scene, slip, law, robot: see `truth_tasks`.
        said: what `validate` finds. refused: whether it keeps the file from being run. forced:
            whether it runs all the same.
        end: the gravest thing about the run: `well`, `stop: LIMIT`, `failed: WHY`, `oscillation`,
            `saturation`, `missed`; or `refused`, where it cannot be run, or `crashed`.
        stage: in which. text: in one sentence. ends: all that is wrong with it.
        broken: the expectations that it missed. verdict: of the run.
        grew: what came of a refused stage that was run longer after a push, of a file that ended
            well; empty if nothing did. near: whether it is within 2 % of the boundary.
        looked, ran: processor time of validation, and of the run [s]. clock: simulated time [s].
    """

    number: int
    scene: str = ""
    slip: str = ""
    law: str = ""
    robot: str = ""
    said: list[dict[str, str]] = field(default_factory=list)
    refused: bool = False
    forced: bool = False
    end: str = CRASHED
    stage: str = ""
    text: str = ""
    ends: list[str] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    verdict: str = ""
    exit_code: int | None = None
    longer: str = ""
    grew: str = ""
    near: bool = False
    looked: float = 0.0
    ran: float = 0.0
    clock: float = 0.0


def drafted(key: Key) -> Draft:
    """The draft of a file."""
    generator, seed, number = key
    return GENERATORS[generator].draft(seed, number)  # type: ignore[no-any-return]


def row_of(generator: str, seed: int, number: int) -> dict[str, Any]:
    """The row of a file."""
    key = (generator, seed, number)
    made = drafted(key)
    text, row = made.written(), Row(number)
    row.scene, row.slip, row.law, row.robot = made.kind, made.slip, made.law, made.model
    try:
        _fill(row, text, key)
    except Exception as error:
        row.end = CRASHED
        row.text = f"{type(error).__name__}: {' '.join(str(error).split())}"[:400]
    return asdict(row)


def _fill(row: Row, text: str, key: Key) -> None:
    from taskspec.compiler import admit
    from taskspec.program.program import refusals
    from taskspec.spec import load_text
    from taskspec.text.diagnostic import SpecError
    from taskspec_runner.session import execute_program
    from taskspec_runner.trial.check import check

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        GENERATORS[key[0]].write_companions(folder)
        began = time.process_time()
        try:
            examined = check(load_text(text, "task.yaml", base=folder))
        except SpecError as error:
            row.looked = time.process_time() - began
            row.said = said(text, error.diagnostics)
            row.refused, row.end, row.text = True, REFUSED, str(error)[:400]
            return
        row.looked = time.process_time() - began
        row.said = said(text, examined.findings)
        row.refused = bool(refusals(examined.findings))
        began = time.process_time()
        try:
            program = admit(examined, force=True)
        except SpecError as error:
            row.refused, row.end, row.text = True, REFUSED, str(error)[:400]
            return
        row.forced = row.refused
        run = execute_program(program, folder / "run", report=False)
        row.ran = time.process_time() - began
        _judge(row, run)
        if row.end == WELL:
            _measure(row, run)
        if row.forced and row.end == WELL:
            accused = [each["stage"] for each in row.said if each["severity"] == "error"]
            _run_longer(row, key, next(filter(None, accused), ""), folder)


def said(text: str, findings: Sequence[Any]) -> list[dict[str, str]]:
    """Findings with the stages that they stand in."""
    stages = _stages_by_line(text)
    made = []
    for each in findings:
        line = each.span.line if each.span is not None else 0
        sentence = f"{line}: {each.message}"[:300]
        # A gain of the file is where the loop of a stage is mended: the message names the stage.
        named = re.search(r"stage '(\w+)'", each.message)
        stage = stages.get(line, "" if named is None else named[1])
        made.append(asdict(Explanation(each.code, str(each.severity), stage, sentence)))
    return made


def _stages_by_line(text: str) -> dict[int, str]:
    """The stage that each line of `stages` belongs to, by the number of the line from 1."""
    stages, inside, name = {}, False, ""
    for number, line in enumerate(text.splitlines(), 1):
        if line and not line.startswith(" "):
            inside = line == "stages:"
        elif inside and line.startswith("  ") and line[2] != " ":
            name = line.strip().partition(":")[0]
        if inside and name:
            stages[number] = name
    return stages


def _ended(status: str, reason: str) -> str:
    """How a run that did not come to its end is called; empty for one that did."""
    word = {"stopped": "stop", "failed": "failed"}.get(status)
    return "" if word is None else f"{word}: {reason}"


def _judge(row: Row, run: Any) -> None:
    """Notes how a run ended."""
    summary: Mapping[str, Any] = run.summary
    ending = summary["ending"]
    row.verdict, row.exit_code, row.clock = run.verdict, run.exit_code, run.end
    row.broken = [each.text for each in run.expectations if not each.passed]
    status = summary["status"]
    ends: list[tuple[str, str, str]] = []
    if ended := _ended(status, ending["reason"]):
        ends.append((ended, ending["stage"], ending["text"]))
    for kind in ("oscillation", "saturation"):
        ends += [(kind, each.stage, each.line) for each in run.faults if each.kind == kind][:1]
    if row.broken:
        ends.append(("missed", "", run.reason))
    row.ends = [end for end, _, _ in ends]
    row.end, row.stage, row.text = ends[0] if ends else (WELL, "", "")
    row.text = row.text[:400]


def _measure(row: Row, run: Any) -> None:
    """Notes what a run that ended well did of what was announced."""
    from truth_measured import Measured

    measured = Measured(run)
    for each in row.said:
        if each["severity"] != "info":
            each["measured"] = measured.of(each)


# --- longer, after a push ------------------------------------------------------------------------


def _run_longer(row: Row, key: Key, stage: str, folder: Path) -> None:
    """Runs a file with a stage that is longer, with and without a push in it."""
    made = drafted(key)
    if stage not in made.stages:
        row.longer = "no stage is accused"
        return
    made.lengthen(stage, LONGER)
    calm, pushed = _watched(made, stage, 0.0, folder), _watched(made, stage, PUSH, folder)
    for each in (calm, pushed):
        if each.end != WELL:
            row.longer, row.grew = f"{each.end}: {each.text}"[:300], each.end
            return
    growth = _growth(calm.motion, pushed.motion)
    row.longer = f"{len(calm.motion)} looks, the push becomes {growth:.3g} of what it was"
    row.grew = "grows" if growth > 1 else ""
    row.near = not row.grew and _is_near(key, row, folder)


@dataclass
class Watched:
    """A run in which a stage was watched.

    Attributes:
        end, text: of the run. motion: (looks, n) joint velocities since the push.
    """

    end: str
    text: str
    motion: np.ndarray


def _watched(made: Draft, stage: str, push: float, folder: Path) -> Watched:
    from taskspec.compiler import admit
    from taskspec.examination import examine
    from taskspec.spec import load_text
    from taskspec_runner.loop.assembly import assemble
    from taskspec_runner.loop.fixed_step import run as simulate

    loaded = load_text(made.written(), "task.yaml", base=folder)
    program = admit(examine(loaded), force=True)
    parts = assemble(program)
    joints = parts.plant.arm.velocities
    push_by = push * np.where(np.arange(joints.stop - joints.start) % 2, -1.0, 1.0)
    looks: list[np.ndarray] = []

    def watch(machine: Any, clock: float) -> None:
        del clock
        if machine.stage.name != stage or machine.t < PUSHED:
            return
        if not looks:
            parts.plant.data.qvel[joints] += push_by
        looks.append(parts.plant.data.qvel[joints].copy())

    class Nowhere:
        def add(self) -> None:
            """Keeps nothing."""

    period = program.context.period
    outcome = simulate(parts.machine, parts.plant, parts.bus, Nowhere(), period, watch)
    ended = _ended(outcome.status, outcome.reason)
    return Watched(ended or WELL, outcome.text, np.array(looks))


def _growth(calm: np.ndarray, pushed: np.ndarray) -> float:
    """By what the difference of two motions grows from one third of the time to the next."""
    count = min(len(calm), len(pushed))
    if count < 9:
        return 0.0
    apart = np.linalg.norm(pushed[:count] - calm[:count], axis=1)
    first, before, last = (float(np.sqrt(np.mean(each**2))) for each in np.array_split(apart, 3))
    if last < max(NOTHING * first, ROUNDING) or before == 0.0:
        return 0.0
    return max(last / before, last / first / 10)


def _is_near(key: Key, row: Row, folder: Path) -> bool:
    """Whether nothing refuses the file where contacts are a little softer, or gains a little else.

    What is stable, and refused for a gain that is on the boundary, is near by what it says: where
    nothing is touched no contact would move that boundary.
    """
    from taskspec.examination import examine
    from taskspec.program.program import refusals
    from taskspec.spec import load_text

    errors = [each for each in row.said if each["severity"] == "error"]
    if {each["code"] for each in errors} - {"TS501"}:
        return False
    if all("on the boundary of stability" in each["text"] for each in errors):
        return True
    softer, lower, higher = drafted(key), drafted(key), drafted(key)
    softer.soften(INSIDE)
    lower.gain_factor, higher.gain_factor = INSIDE, 1 / INSIDE
    return any(
        not refusals(examine(load_text(made.written(), "task.yaml", base=folder)).findings)
        for made in (softer, lower, higher)
    )

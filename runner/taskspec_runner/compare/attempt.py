"""A task under one law: compiled or refused, then run, and what came of it in one sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from taskspec.compiler import UNSTABLE, admit
from taskspec.deferred_methods import dataclass
from taskspec.examination import examine
from taskspec.program.program import Program, refusals
from taskspec.spec import LoadedTask
from taskspec.spec.expectation import titled
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.source import Source
from taskspec_runner.loop.interrupt import BY_SIGNAL
from taskspec_runner.runs import Run

#: Outcomes, besides `failed` and `stopped`, which are those of a run.
PASSED, MISSED, REFUSED, CRASHED, SKIPPED = "passed", "missed", "refused", "crashed", "not run"
INTERRUPTED = "interrupted"
#: Of a run to its end of a task that expects nothing.
DONE = "done"
#: What stands for the law of a task as its file has it, with the gains of the file.
AS_WRITTEN = "as written"


@dataclass(frozen=True, slots=True)
class Attempt:
    """One law's try at a task.

    Attributes:
        law: its name, or `AS_WRITTEN`.
        program: the compiled task, None where the law is refused.
        diagnostics: what was found about the task under this law.
        sources: the texts they are in.
        run: that was made, None if there was none.
        crash: what an internal error says of itself, empty without one.
    """

    law: str
    program: Program | None
    diagnostics: tuple[Diagnostic, ...]
    sources: Mapping[str, Source]
    run: Run | None = None
    crash: str = ""

    @property
    def folder(self) -> str:
        """Name of the folder of its run, below that of the comparison."""
        return folder_of(self.law)

    @property
    def kind(self) -> str:
        """The law itself, also of a task as written; empty where that is not known."""
        if self.law != AS_WRITTEN:
            return self.law
        return self.program.context.loaded.task.law.kind if self.program else ""

    @property
    def good(self) -> bool:
        """Whether it came to its end and did all that was expected."""
        return self.outcome in (PASSED, DONE)

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The findings that keep the law from running."""
        return refusals(self.diagnostics) if self.program is None else ()

    @property
    def broken_off(self) -> int:
        """Exit code of a signal that ended the run, 0 if none did."""
        code = self.run.exit_code if self.run else 0
        return code if code > BY_SIGNAL else 0

    @property
    def outcome(self) -> str:
        """How it came out, as one word."""
        if self.crash:
            return CRASHED
        if self.program is None:
            return REFUSED
        if self.run is None:
            return SKIPPED
        if self.broken_off:
            return INTERRUPTED
        if self.run.summary["status"] != "done":
            return str(self.run.summary["status"])
        if self.run.exit_code:
            return MISSED
        return PASSED if self.run.summary["expectations"] else DONE

    @property
    def reason(self) -> str:
        """Why the law did not do all that was asked, in one sentence; empty if it did."""
        if self.crash:
            return self.crash
        if self.program is None:
            return _refusal(self.errors)
        if self.run is None:
            return "the comparison was interrupted before"
        if self.good:
            return ""
        if self.outcome == MISSED:
            return _missed(self.run)
        end = self.run.summary["ending"]
        return f"in stage {end['stage']} at {end['clock']:.3f} s: {end['text']}"


def folder_of(law: str) -> str:
    """Name of the folder of a law's run."""
    return law.replace(" ", "-")


def attempt(law: str, load: Callable[[str], LoadedTask]) -> Attempt:
    """Compiles a task under a law.

    A law that is predicted to be unstable is compiled all the same: its run shows what comes of it.

    Args:
        law: a law that the language knows, or `AS_WRITTEN`.
        load: gives the task under a law; may raise `SpecError`.
    """
    try:
        examined = examine(load(law))
        against = {d.code for d in refusals(examined.findings)}
        program = admit(examined, force=against == {UNSTABLE})
    except SpecError as error:
        return Attempt(law, None, error.diagnostics, error.sources)
    return Attempt(law, program, program.findings, program.context.loaded.sources)


def _refusal(errors: tuple[Diagnostic, ...]) -> str:
    first, *others = errors
    text = f"{first.code}: {first.message}"
    if first.span is not None and not first.source.startswith("--"):
        text += f" (line {first.span.line})"
    return f"{text}; {_more(len(others))}" if others else text


def _missed(run: Run) -> str:
    missed = [e for e in run.summary["expectations"] if not e["passed"]]
    if not missed:
        return run.faults[0].line if run.faults else ""
    first, *others = missed
    said = first["explanation"]
    text = said if said.startswith(first["text"].split(" ")[0]) else f"{first['text']}: {said}"
    text = titled(str(first.get("name") or ""), text)
    return f"{text}; {_more(len(others))}" if others else text


def _more(number: int) -> str:
    return f"and {number} more"

"""The language server: what editors ask over LSP, answered by the modules beside it.

Findings come in steps, each as soon as it is known: text, names and units with every change, all
rules once the text rests for a moment, those on stability last; the trial when the file is saved.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from lsprotocol import types as lsp
from pygls.lsp.server import LanguageServer
from pygls.uris import from_fs_path, to_fs_path
from pygls.workspace import TextDocument

from taskspec import __version__
from taskspec.spec.names import why_not
from taskspec.text.diagnostic import Diagnostic, Severity
from taskspec.text.source import Span
from taskspec_runner.editor import places
from taskspec_runner.editor.completion import Sort, proposals
from taskspec_runner.editor.fixes import fixes
from taskspec_runner.editor.names import DECLARING
from taskspec_runner.editor.opened import OpenedFile
from taskspec_runner.record.folder import RUNS
from taskspec_runner.record.names import REPORT, SUMMARY, TASK

Find = Callable[[], tuple[Diagnostic, ...]]
RUN, VALIDATE, SHOW_REPORT = "taskspec.run", "taskspec.validate", "taskspec.report"
#: A text that has not changed for so long is examined by all rules [s].
REST = 0.15

_SEVERITIES = {
    Severity.ERROR: lsp.DiagnosticSeverity.Error,
    Severity.WARNING: lsp.DiagnosticSeverity.Warning,
    Severity.INFO: lsp.DiagnosticSeverity.Information,
}
_SORTS = {
    Sort.KEY: lsp.CompletionItemKind.Property,
    Sort.WORD: lsp.CompletionItemKind.EnumMember,
    Sort.NAME: lsp.CompletionItemKind.Reference,
    Sort.UNIT: lsp.CompletionItemKind.Unit,
    Sort.SIGNAL: lsp.CompletionItemKind.Variable,
    Sort.FUNCTION: lsp.CompletionItemKind.Function,
}


class TaskServer(LanguageServer):
    """A server with the files that are open."""

    def __init__(self) -> None:
        super().__init__(
            "taskspec", __version__, text_document_sync_kind=lsp.TextDocumentSyncKind.Incremental
        )
        self._opened: dict[str, OpenedFile] = {}
        self._found: dict[str, tuple[Diagnostic, ...]] = {}
        self._waiting: dict[str, asyncio.Task[None]] = {}
        self._pictures = TemporaryDirectory(prefix="taskspec-pictures-")

    def opened(self, uri: str) -> OpenedFile:
        """The file of a document, with its text as it is now."""
        text = self.workspace.get_text_document(uri).source
        found = self._opened.get(uri)
        if found is None:
            found = self._opened[uri] = OpenedFile(Path(to_fs_path(uri) or uri), text)
        elif found.source.text != text.replace("\r\n", "\n"):
            found.change(text)
        return found

    def task(self, uri: str) -> OpenedFile | None:
        """The same if it is a task, or nothing yet."""
        opened = self.opened(uri)
        return opened if opened.is_task or not opened.source.text.strip() else None

    def closed(self, uri: str) -> None:
        """Forgets a file."""
        self._opened.pop(uri, None)
        self._found.pop(uri, None)
        if (waiting := self._waiting.pop(uri, None)) is not None:
            waiting.cancel()
        self._publish(uri, ())

    def findings(self, uri: str) -> tuple[Diagnostic, ...]:
        """The findings that were published last."""
        return self._found.get(uri, ())

    async def changed(self, uri: str) -> None:
        """Publishes what reading finds now, and what all rules find when the text rests."""
        opened = self.opened(uri)
        if not opened.is_task:
            self._publish(uri, ())
            return
        self._publish(uri, opened.read())
        self._later(uri, (partial(opened.examined, stability=False), opened.examined), REST)

    async def saved(self, uri: str) -> None:
        """Publishes what a trial finds, too."""
        opened = self.opened(uri)
        if opened.is_task:
            self._later(uri, (opened.tried,), 0.0)

    def _later(self, uri: str, steps: Sequence[Find], rest: float) -> None:
        if (before := self._waiting.pop(uri, None)) is not None:
            before.cancel()
        self._waiting[uri] = asyncio.ensure_future(self._examine(uri, steps, rest))

    async def _examine(self, uri: str, steps: Sequence[Find], rest: float) -> None:
        await asyncio.sleep(rest)
        text = self.opened(uri).source.text
        for find in steps:
            found = await asyncio.to_thread(find)
            if uri in self._opened and self._opened[uri].source.text == text:
                self._publish(uri, found)

    async def picture(self, uri: str) -> Path | None:
        """A file with the start pose of a task; None where an error is found in it."""
        opened = self.opened(uri)
        name = hashlib.sha256(f"{opened.path}\0{opened.source.text}".encode()).hexdigest()[:16]
        path = Path(self._pictures.name) / f"{name}.svg"
        if not path.exists():
            drawn = await asyncio.to_thread(opened.picture)
            if drawn is None:
                return None
            path.write_bytes(drawn)
        return path

    def _publish(self, uri: str, found: Sequence[Diagnostic]) -> None:
        self._found[uri] = tuple(found)
        shown = []
        for each in found:
            span = self.place(uri, each)
            text = each.message if not each.hint else f"{each.message}\n{each.hint}"
            if span is None or span.source:
                where = "" if each.span is None else f" ({each.source}:{each.span.line})"
                text += where
            shown.append(
                lsp.Diagnostic(
                    self.range_of(uri, span),
                    text,
                    severity=_SEVERITIES[each.severity],
                    code=each.code,
                    source="taskspec",
                    related_information=[
                        lsp.DiagnosticRelatedInformation(
                            lsp.Location(uri, self.range_of(uri, note.span)), note.message
                        )
                        for note in each.notes
                        if not note.span.source
                    ],
                )
            )
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, shown))

    def place(self, uri: str, finding: Diagnostic) -> Span | None:
        """Where a finding is shown in the document: what led to it, if it is in another text."""
        span = finding.span
        if span is None:
            return None
        here = str(self._opened[uri].path)
        if finding.source == here and not span.source:
            return span
        return next((place for _, place in span.via if place.source in ("", here)), None)

    def range_of(self, uri: str, span: Span | None) -> lsp.Range:
        """A place as the client counts; the first line of the document where there is none."""
        document = self.workspace.get_text_document(uri)
        if span is None or span.source:
            first = document.lines[0].rstrip() if document.lines else ""
            return lsp.Range(lsp.Position(0, 0), lsp.Position(0, len(first)))
        plain = lsp.Range(
            lsp.Position(span.line - 1, span.column - 1),
            lsp.Position(span.end_line - 1, span.end_column - 1),
        )
        return document.position_codec.range_to_client_units(document.lines, plain)

    def between(self, uri: str, start: int, end: int) -> lsp.Range:
        """The range between two offsets."""
        return self.range_of(uri, self.opened(uri).source.span(start, end))


def _offset(document: TextDocument, position: lsp.Position) -> int:
    """The offset of a position in the text with plain line ends."""
    offset = int(document.offset_at_position(position))
    return offset - document.source.count("\r\n", 0, offset)


def server() -> TaskServer:
    """A server that answers; `start_io` has it serve one client."""
    made = TaskServer()
    made.feature(lsp.TEXT_DOCUMENT_DID_OPEN)(_did_open)
    made.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)(_did_change)
    made.feature(lsp.TEXT_DOCUMENT_DID_SAVE)(_did_save)
    made.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)(_did_close)
    made.feature(
        lsp.TEXT_DOCUMENT_COMPLETION,
        lsp.CompletionOptions(trigger_characters=[" ", "{", "[", ",", ".", ":"]),
    )(_completion)
    made.feature(lsp.TEXT_DOCUMENT_HOVER)(_hover)
    made.feature(lsp.TEXT_DOCUMENT_DEFINITION)(_definition)
    made.feature(lsp.TEXT_DOCUMENT_RENAME)(_rename)
    made.feature(
        lsp.TEXT_DOCUMENT_CODE_ACTION,
        lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix]),
    )(_code_action)
    made.feature(lsp.TEXT_DOCUMENT_CODE_LENS)(_code_lens)
    made.command(VALIDATE)(_validate)
    made.command(RUN)(_run)
    made.command(SHOW_REPORT)(_report)
    return made


async def _did_open(ls: TaskServer, params: lsp.DidOpenTextDocumentParams) -> None:
    await ls.changed(params.text_document.uri)


async def _did_change(ls: TaskServer, params: lsp.DidChangeTextDocumentParams) -> None:
    await ls.changed(params.text_document.uri)


async def _did_save(ls: TaskServer, params: lsp.DidSaveTextDocumentParams) -> None:
    await ls.saved(params.text_document.uri)


def _did_close(ls: TaskServer, params: lsp.DidCloseTextDocumentParams) -> None:
    ls.closed(params.text_document.uri)


def _completion(ls: TaskServer, params: lsp.CompletionParams) -> list[lsp.CompletionItem]:
    uri = params.text_document.uri
    opened = ls.task(uri)
    if opened is None:
        return []
    offset = _offset(ls.workspace.get_text_document(uri), params.position)
    return [
        lsp.CompletionItem(
            each.text.rstrip(": ("),
            kind=_SORTS[each.sort],
            detail=each.about or None,
            sort_text=f"{number:04}",
            filter_text=each.text,
            text_edit=lsp.TextEdit(ls.between(uri, each.start, offset), each.text),
        )
        for number, each in enumerate(proposals(opened, offset))
    ]


async def _hover(ls: TaskServer, params: lsp.HoverParams) -> lsp.Hover | None:
    uri = params.text_document.uri
    offset = _offset(ls.workspace.get_text_document(uri), params.position)
    opened = ls.task(uri)
    found = None if opened is None else places.hover(opened, offset)
    if found is None:
        return None
    text, start, end = found
    if opened is not None and places.is_about_all(opened, offset):
        picture = await ls.picture(uri)
        text += "" if picture is None else f"\n\n![the start pose]({picture.as_uri()})"
    content = lsp.MarkupContent(lsp.MarkupKind.Markdown, text)
    return lsp.Hover(content, ls.between(uri, start, end))


def _definition(ls: TaskServer, params: lsp.DefinitionParams) -> lsp.Location | None:
    uri = params.text_document.uri
    offset = _offset(ls.workspace.get_text_document(uri), params.position)
    span = places.definition(ls.opened(uri), offset)
    if span is None:
        return None
    if not span.source:
        return lsp.Location(uri, ls.range_of(uri, span))
    at = lsp.Position(span.line - 1, span.column - 1)
    end = lsp.Position(span.end_line - 1, span.end_column - 1)
    other = from_fs_path(str(Path(span.source).resolve()))
    return None if other is None else lsp.Location(other, lsp.Range(at, end))


def _rename(ls: TaskServer, params: lsp.RenameParams) -> lsp.WorkspaceEdit | None:
    uri = params.text_document.uri
    opened = ls.opened(uri)
    offset = _offset(ls.workspace.get_text_document(uri), params.position)

    def uri_of(name: str) -> str:
        return (from_fs_path(str(Path(name).resolve())) or name) if name else uri

    def text_of(name: str) -> str:
        return str(ls.workspace.get_text_document(uri_of(name)).source).replace("\r\n", "\n")

    found = places.renames(opened, offset, text_of)
    if found is None:
        return None
    name, spans = found
    _check_name(opened, name, params.new_name)
    changes = {
        uri_of(file): [lsp.TextEdit(ls.range_of(uri_of(file), s), params.new_name) for s in own]
        for file, own in spans.items()
    }
    return lsp.WorkspaceEdit(changes=changes)


def _code_action(ls: TaskServer, params: lsp.CodeActionParams) -> list[lsp.CodeAction]:
    uri = params.text_document.uri
    opened = ls.opened(uri)
    found = []
    for each in ls.findings(uri):
        place = ls.range_of(uri, ls.place(uri, each))
        if place.end.line < params.range.start.line or place.start.line > params.range.end.line:
            continue
        for fix in fixes(each, opened.source):
            edit = lsp.TextEdit(ls.between(uri, fix.start, fix.end), fix.text)
            found.append(
                lsp.CodeAction(
                    f"{fix.title} ({each.code})",
                    kind=lsp.CodeActionKind.QuickFix,
                    is_preferred=fix.only or None,
                    edit=lsp.WorkspaceEdit(changes={uri: [edit]}),
                )
            )
    return found


def _code_lens(ls: TaskServer, params: lsp.CodeLensParams) -> list[lsp.CodeLens]:
    uri = params.text_document.uri
    if not ls.opened(uri).is_task:
        return []
    first = lsp.Range(lsp.Position(0, 0), lsp.Position(0, 0))
    titles = {RUN: "Run", VALIDATE: "Validate with a trial", SHOW_REPORT: "Open the last report"}
    found = [
        lsp.CodeLens(first, command=lsp.Command(title, name, arguments=[uri]))
        for name, title in titles.items()
    ]
    return [*found, *_verdict(ls.opened(uri), uri)]


def _verdict(opened: OpenedFile, uri: str) -> Iterator[lsp.CodeLens]:
    """At `expect` what the last run came to; it opens its report."""
    lines = opened.source.text.split("\n")
    at = next((n for n, line in enumerate(lines) if line.startswith("expect:")), None)
    folder = _newest(opened.path)
    if at is None or folder is None:
        return
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        passed = [bool(each["passed"]) for each in summary["expectations"]]
        text = (folder / TASK).read_text(encoding="utf-8")
    except (OSError, ValueError, KeyError):
        return
    title = f"Last run: {summary['status']}, {sum(passed)} of {len(passed)} hold"
    title += "" if text.replace("\r\n", "\n") == opened.source.text else ", of another text"
    place = lsp.Range(lsp.Position(at, 0), lsp.Position(at, 0))
    yield lsp.CodeLens(place, command=lsp.Command(title, SHOW_REPORT, arguments=[uri]))


def _newest(path: Path) -> Path | None:
    """The folder of the newest run of a file that has a report; None where there is none."""
    reports = (path.parent / RUNS).glob(f"{path.stem}*/{REPORT}")
    newest = max(reports, key=lambda each: each.stat().st_mtime, default=None)
    return None if newest is None else newest.parent


async def _validate(ls: TaskServer, uri: str) -> None:
    await ls.saved(uri)


async def _run(ls: TaskServer, uri: str) -> None:
    path = ls.opened(uri).path
    command = [sys.executable, "-m", "taskspec_runner", "run", str(path), "--quiet"]
    ran = await asyncio.to_thread(
        subprocess.run, command, capture_output=True, text=True, cwd=path.parent, check=False
    )
    said = (ran.stdout + ran.stderr).strip().splitlines() or [f"{path.name}: passed"]
    kind = lsp.MessageType.Info if ran.returncode == 0 else lsp.MessageType.Warning
    ls.window_show_message(lsp.ShowMessageParams(kind, said[-1]))


async def _report(ls: TaskServer, uri: str) -> None:
    path = ls.opened(uri).path
    newest = _newest(path)
    if newest is None:
        text = f"no run of {path.name} under {path.parent / RUNS} yet"
        ls.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Info, text))
        return
    shown = lsp.ShowDocumentParams((newest / REPORT).resolve().as_uri(), external=True)
    await ls.window_show_document_async(shown)


def _check_name(opened: OpenedFile, name: str, new: str) -> None:
    """Refuses a name that cannot be given, or that is given already.

    Raises:
        ValueError: with the reason; the editor shows it.
    """
    assert opened.names is not None
    kind = opened.names.declared[name].kind
    section = next(key for key, own in DECLARING.items() if own == kind)
    reason = why_not(new, section)
    if reason is not None:
        raise ValueError(reason)
    if new in opened.names.declared:
        raise ValueError(f"{new!r} names a {opened.names.declared[new].kind} already")

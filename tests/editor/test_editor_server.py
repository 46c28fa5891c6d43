"""A session of an editor with the server, over its pipes."""

from __future__ import annotations

import asyncio
import json
import re
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from test_editor import TASK

pytest.importorskip("pygls")
from lsprotocol import types as lsp
from pygls.lsp.client import LanguageClient

#: A session takes some seconds; on a machine that does other things more [s].
PATIENCE = 90.0


class Editor:
    """A client with one open file.

    Attributes:
        published: findings of the file, the newest last.
        shown: messages that the server asks to show.
    """

    def __init__(self, path: Path) -> None:
        self.uri = path.resolve().as_uri()
        self.published: list[list[lsp.Diagnostic]] = []
        self.shown: list[str] = []
        self._client = LanguageClient("test", "1")
        self._version = 0

        @self._client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def published(params: lsp.PublishDiagnosticsParams) -> None:
            assert params.uri == self.uri
            self.published.append(list(params.diagnostics))

        @self._client.feature(lsp.WINDOW_SHOW_MESSAGE)
        def shown(params: lsp.ShowMessageParams) -> None:
            self.shown.append(params.message)

    async def start(self, text: str) -> lsp.InitializeResult:
        await self._client.start_io(sys.executable, "-m", "taskspec_runner", "lsp")
        capabilities = lsp.ClientCapabilities()
        result = await self._client.initialize_async(lsp.InitializeParams(capabilities))
        self._client.initialized(lsp.InitializedParams())
        item = lsp.TextDocumentItem(self.uri, "yaml", self._version, text)
        self._client.text_document_did_open(lsp.DidOpenTextDocumentParams(item))
        return result

    async def stop(self) -> None:
        await self._client.shutdown_async(None)
        self._client.exit(None)
        await self._client.stop()

    def change(self, text: str) -> None:
        self._version += 1
        self._client.text_document_did_change(
            lsp.DidChangeTextDocumentParams(
                lsp.VersionedTextDocumentIdentifier(self._version, self.uri),
                [lsp.TextDocumentContentChangeWholeDocument(text)],
            )
        )

    def save(self) -> None:
        self._client.text_document_did_save(lsp.DidSaveTextDocumentParams(self.document))

    @property
    def document(self) -> lsp.TextDocumentIdentifier:
        return lsp.TextDocumentIdentifier(self.uri)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._client, name)

    async def until(self, holds: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not holds():
            assert time.monotonic() < end, [[d.message for d in each] for each in self.published]
            await asyncio.sleep(0.02)

    async def until_published(self, code: str | None) -> lsp.Diagnostic | None:
        """Waits for a finding of a code, or for none at all."""

        def newest() -> list[lsp.Diagnostic] | None:
            return self.published[-1] if self.published else None

        if code is None:
            await self.until(lambda: newest() == [])
            return None
        await self.until(lambda: any(each.code == code for each in newest() or ()))
        return next(each for each in self.published[-1] if each.code == code)


def session(path: Path, text: str, talk: Callable[[Editor], Awaitable[None]]) -> None:
    async def all_of_it() -> None:
        editor = Editor(path)
        try:
            await editor.start(text)
            await talk(editor)
        finally:
            await editor.stop()

    asyncio.run(all_of_it())


def at(text: str, word: str) -> lsp.Position:
    offset = text.index(word)
    line = text.count("\n", 0, offset)
    return lsp.Position(line, offset - (text.rfind("\n", 0, offset) + 1))


def applied(text: str, edits: list[lsp.TextEdit]) -> str:
    lines = text.split("\n")

    def offset(place: lsp.Position) -> int:
        return sum(len(line) + 1 for line in lines[: place.line]) + place.character

    for edit in sorted(edits, key=lambda each: offset(each.range.start), reverse=True):
        text = text[: offset(edit.range.start)] + edit.new_text + text[offset(edit.range.end) :]
    return text


def test_findings_come_as_one_types_and_go_by_their_fix(tmp_path: Path) -> None:
    wrong = TASK.replace("{force: 40 N}", "{force: 40}").replace("shape: plane", "shape: plan")

    async def talk(editor: Editor) -> None:
        found = await editor.until_published("TS110")
        assert found is not None
        assert found.range.start == at(wrong, "40}")
        text = wrong
        for word, code in (("40}", "TS110"), ("plan,", "TS025")):
            await editor.until_published(code)
            here = lsp.Range(at(text, word), at(text, word))
            params = lsp.CodeActionParams(editor.document, here, lsp.CodeActionContext([]))
            actions = await editor.text_document_code_action_async(params)
            assert actions
            edit = actions[0].edit
            assert edit is not None
            text = applied(text, edit.changes[editor.uri])
            editor.change(text)
        assert text == TASK
        await editor.until_published(None)

    session(tmp_path / "press.yaml", wrong, talk)


def test_a_saved_file_is_tried(tmp_path: Path) -> None:
    late = TASK.replace("for 70 %", "for 100 %")

    async def talk(editor: Editor) -> None:
        await editor.until_published(None)
        editor.save()
        await editor.until(lambda: bool(editor.published[-1]))
        assert any("expect" in each.message or "push" in each.message
                   for each in editor.published[-1])  # fmt: skip

    session(tmp_path / "press.yaml", late, talk)


def test_words_are_completed_explained_found_and_renamed(tmp_path: Path) -> None:
    async def talk(editor: Editor) -> None:
        await editor.until_published(None)
        place = at(TASK, "-press}}")
        completion = await editor.text_document_completion_async(
            lsp.CompletionParams(editor.document, lsp.Position(place.line, place.character + 1))
        )
        assert "press" in {each.label for each in completion}
        inside = lsp.Position(place.line, place.character + 2)
        hover = await editor.text_document_hover_async(lsp.HoverParams(editor.document, inside))
        assert "param" in hover.contents.value
        target = await editor.text_document_definition_async(
            lsp.DefinitionParams(editor.document, inside)
        )
        assert target.range.start == at(TASK, "press: 10")
        renamed = await editor.text_document_rename_async(
            lsp.RenameParams(editor.document, inside, "load")
        )
        text = applied(TASK, renamed.changes[editor.uri])
        assert "params: {load: 10 N}" in text
        assert "force: -load" in text
        assert "name: press" in text
        with pytest.raises(Exception, match="unit"):
            await editor.text_document_rename_async(lsp.RenameParams(editor.document, inside, "N"))
        lenses = await editor.text_document_code_lens_async(lsp.CodeLensParams(editor.document))
        assert [each.command.title for each in lenses] == [
            "Run", "Validate with a trial", "Open the last report",
        ]  # fmt: skip

    session(tmp_path / "press.yaml", TASK, talk)


def test_a_file_that_is_no_task_gets_nothing(tmp_path: Path) -> None:
    async def talk(editor: Editor) -> None:
        await editor.until_published(None)
        lenses = await editor.text_document_code_lens_async(lsp.CodeLensParams(editor.document))
        assert not lenses

    session(tmp_path / "compose.yaml", "services: {web: {image: nginx}}\n", talk)


def test_columns_count_as_the_editor_counts_them(tmp_path: Path) -> None:
    """A sign beyond the first 65,536 counts twice there, and once here."""
    wrong = TASK.replace("{force: 40 N}", '{"\N{MECHANICAL ARM}": 1, force: 40}')

    async def talk(editor: Editor) -> None:
        found = await editor.until_published("TS110")
        assert found is not None
        place = at(wrong, "40}")
        assert found.range.start == lsp.Position(place.line, place.character + 1)

    session(tmp_path / "press.yaml", wrong, talk)


def test_the_last_run_and_the_start_pose_are_shown(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "press-1"
    folder.mkdir(parents=True)
    summary = {"status": "missed", "expectations": [{"passed": True}, {"passed": False}]}
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / "report.html").write_text("")
    (folder / "task.yaml").write_text(TASK)

    async def talk(editor: Editor) -> None:
        await editor.until_published(None)
        params = lsp.CodeLensParams(editor.document)
        last = (await editor.text_document_code_lens_async(params))[-1]
        assert last.command.title == "Last run: missed, 1 of 2 hold"
        assert last.range.start == at(TASK, "expect:")
        (folder / "task.yaml").write_text(TASK.replace("10 N", "9 N"))
        last = (await editor.text_document_code_lens_async(params))[-1]
        assert last.command.title.endswith(", of another text")
        place = at(TASK, "robot:")
        hover = await editor.text_document_hover_async(lsp.HoverParams(editor.document, place))
        (picture,) = re.findall(r"!\[the start pose\]\(file://(.+)\)", hover.contents.value)
        assert "<svg" in Path(picture).read_text()[:400]

    session(tmp_path / "press.yaml", TASK, talk)

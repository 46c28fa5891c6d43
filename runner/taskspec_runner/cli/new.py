"""`taskspec new`: a task of one's own, begun from one that runs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import typer

from taskspec.schema import FILE_NAME
from taskspec.text.suggest import suggestion
from taskspec_runner.cli.given import task_name
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record.whole import write_whole

_SUFFIX = ".yaml"
_MODEL_LINE = re.compile(r"^(# yaml-language-server: \$schema=)(\S+)[^\n]*\n", re.MULTILINE)
#: How an editor comes to complete a task whose schema is somewhere else.
_COMPLETION = (
    "for completion in an editor, write the schema beside it with: "
    "taskspec schema --write FOLDER\n"
    f"and begin the file with: # yaml-language-server: $schema={FILE_NAME}"
)
_NAME_LINE = re.compile(r"^name:.*?(?=[ \t]+#|$)", re.MULTILINE)


def new_task(
    template: str | None, out: Path | None, model: str | None = None, flange: str | None = None
) -> int:
    """Copies a template, lists the templates, or writes a first task for a robot."""
    if model is not None:
        if template is not None:
            raise InputError("a task begins from a template or from --model, not from both")
        return _for_robot(model, out, flange)
    if flange is not None:
        raise InputError("--flange goes with --model")
    if template is None:
        _list_templates()
        return 0
    target = out or Path(f"my-{template}{_SUFFIX}")
    if target.is_dir():
        target = target / f"my-{template}{_SUFFIX}"
    written = copy_template(_template(template), target)
    for path in written:
        typer.echo(f"wrote {path}", err=True)
    if not _MODEL_LINE.search(target.read_text(encoding="utf-8")):
        typer.echo(_COMPLETION, err=True)
    typer.echo(str(target))
    return 0


def _for_robot(model: str, out: Path | None, flange: str | None) -> int:
    from taskspec_runner.cli.first_task import first_task

    stem = re.sub(r"[^a-z0-9]+", "-", Path(model.rpartition(":")[2]).name.partition(".")[0].lower())
    name = f"{stem.strip('-') or 'robot'}-first{_SUFFIX}"
    target = out or Path(name)
    if target.is_dir():
        target = target / name
    for line in first_task(model, target, flange):
        typer.echo(line, err=True)
    typer.echo(f"wrote {target}, which has passed once: taskspec run {target}", err=True)
    typer.echo(str(target))
    return 0


def templates() -> dict[str, Path]:
    """Template names to their files: those of the installed package, else of the checkout.

    Raises:
        InputError: there are none.
    """
    for folder in _folders():
        found = sorted(folder.glob(f"**/*{_SUFFIX}")) if folder.is_dir() else []
        if found:
            return {path.stem: path for path in found}
    raise InputError("the templates were not installed with this copy of taskspec")


def copy_template(source: Path, target: Path) -> list[Path]:
    """Copies a task under a new name, with the files that it refers to.

    Returns:
        The files that were written, the task first.

    Raises:
        InputError: a file is there already.
        OutputError: a file cannot be written.
    """
    text = renamed(source.read_text(encoding="utf-8"), task_name(target))
    contents = {target: _with_schema(text, source, target).encode()}
    for name in _references(source):
        contents[target.parent / name] = (source.parent / name).read_bytes()
    for path, content in contents.items():
        if path.exists() and (path == target or path.read_bytes() != content):
            raise InputError(f"{path} exists already; choose another place with --out")
    for path, content in contents.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content)
        except OSError as error:
            raise OutputError.of(path, error) from error
    return list(contents)


def renamed(text: str, name: str) -> str:
    """The text of a task with another `name`."""
    return _NAME_LINE.sub(f"name: {name}", text, count=1)


def _list_templates() -> None:
    from rich.text import Text

    from taskspec_runner.cli.console import show, table
    from taskspec_runner.cli.loading import load

    made = table("template", "about", indent=0)
    for name, path in templates().items():
        made.add_row(Text(name), Text(load(path).task.about or ""))
    show(made)


def _template(name: str) -> Path:
    found = templates()
    if name not in found:
        hint = suggestion(name, found, "templates")
        raise InputError(f"there is no template {name!r}; {hint}")
    return found[name]


def _folders() -> Iterator[Path]:
    package = Path(str(resources.files("taskspec")))
    yield package / "data" / "tasks"
    yield package.parent / "tasks"


def _references(source: Path) -> Iterator[str]:
    """Files that a task names relative to itself: tables of points and robots."""
    from taskspec.robot import builtin_names
    from taskspec_runner.cli.loading import load

    task = load(source).task
    if task.robot.model not in builtin_names():
        yield task.robot.model
    for stage in task.stages.values():
        if stage.path is not None and stage.path.file is not None:
            yield stage.path.file


def _with_schema(text: str, source: Path, target: Path) -> str:
    """The text with the editor's line relative to the target, or without it.

    Only a schema beside or below the target moves along with it.
    """
    home = target.parent.resolve()

    def point(match: re.Match[str]) -> str:
        path = (source.parent / match[2]).resolve()
        below = path.is_file() and path.is_relative_to(home)
        return f"{match[1]}{path.relative_to(home).as_posix()}\n" if below else ""

    return _MODEL_LINE.sub(point, text)

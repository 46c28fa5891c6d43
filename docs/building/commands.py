"""The reference of the command line, from the commands themselves."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, get_args, get_type_hints

from typer.models import ArgumentInfo

from taskspec_runner.cli.app import app

_HEAD = """\
# Command line

This page is made from the commands when the site is built; `taskspec COMMAND --help` says the
same. Results go to standard output, progress and what is wrong to standard error. The exit codes
are those of [conventions](conventions.md#endings-and-exit-codes).

| command | does |
| --- | --- |
"""
_OF_TYPES = {bool: "", int: "INTEGER", float: "NUMBER", str: "TEXT", Path: "PATH"}


@dataclass(frozen=True)
class Parameter:
    """An argument or an option of a command, as it is written and explained."""

    names: str
    value: str
    meaning: str
    default: str
    is_argument: bool


def reference() -> str:
    """The page, as Markdown."""
    commands = {_name(command): command.callback for command in app.registered_commands}
    rows = (f"| [`{n}`](#taskspec-{n}) | {inspect.getdoc(c)} |\n" for n, c in commands.items())
    sections = (_section(name, callback) for name, callback in commands.items())
    return _HEAD + "".join(rows) + "".join(sections)


def _name(command: Any) -> str:
    return str(command.name or command.callback.__name__)


def _section(name: str, callback: Callable[..., Any]) -> str:
    found = list(parameters(callback))
    arguments = [
        p.value if p.default == "required" else f"[{p.value}]" for p in found if p.is_argument
    ]
    options = [] if all(p.is_argument for p in found) else ["[OPTIONS]"]
    usage = " ".join(["taskspec", name, *options, *arguments])
    lines = ["", f"## taskspec {name}", "", inspect.getdoc(callback) or "", ""]
    lines += ["```sh", usage, "```", ""]
    if found:
        lines += ["| | meaning | default |", "| --- | --- | --- |"]
        lines += [f"| {p.names} | {p.meaning} | {p.default} |" for p in found]
    return "\n".join(lines) + "\n"


def parameters(callback: Callable[..., Any]) -> Iterator[Parameter]:
    """Arguments and options of a command in their order, from its signature."""
    plain = inspect.unwrap(callback)
    hints = get_type_hints(plain, include_extras=True)
    for name, parameter in inspect.signature(plain).parameters.items():
        kind, info = get_args(hints[name])[:2]
        (kind,) = [k for k in (get_args(kind) or (kind,)) if k is not type(None)][:1]
        needed = parameter.default is parameter.empty
        is_argument = isinstance(info, ArgumentInfo)
        value = _value(kind, name, info)
        names = ", ".join(f"`{word}`" for word in _words(info) or (f"--{name}",))
        if is_argument:
            names = f"`{value}`"
        elif kind is not bool:
            names += f" {value}" if "`" in value else f" `{value}`"
        default = "required" if needed else _default(parameter.default, info.show_default)
        yield Parameter(names, value, info.help or "", default, is_argument)


def _words(info: Any) -> list[str]:
    """The names that an option is declared with; typer keeps the first of them as its default."""
    return [word for word in (info.default, *(info.param_decls or ())) if isinstance(word, str)]


def _value(kind: Any, name: str, info: Any) -> str:
    if info.metavar:
        return str(info.metavar)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return ", ".join(f"`{member.value}`" for member in kind)
    inner = next(iter(get_args(kind)), kind)
    return name.upper() if isinstance(info, ArgumentInfo) else _OF_TYPES[inner]


def _default(value: Any, shown: bool | str) -> str:
    if isinstance(shown, str):
        return f"`{shown}`" if "/" in shown or "-" in shown else shown
    value = value.value if isinstance(value, Enum) else value
    return "" if value in (None, []) or value is False else f"`{value}`"

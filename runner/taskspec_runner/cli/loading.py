"""Task files as the command line names them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from taskspec.spec import LoadedTask, load_task
from taskspec.text import nodes
from taskspec.text.characters import normal
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.source import Source
from taskspec.text.yaml import MAX_BYTES, read
from taskspec_runner.errors import InputError


def load(path: Path, sets: Sequence[str] = (), law: str | None = None) -> LoadedTask:
    """Loads a task file.

    Args:
        path: the file.
        sets: overrides as `KEY=VALUE`.
        law: a law that replaces that of the file and of every stage.

    Raises:
        SpecError: the task is wrong.
        InputError: the file cannot be opened or is not UTF-8, or an override is not one.
    """
    given = [_override(text) for text in sets]
    try:
        overrides = _laws(path, law) if law is not None else {}
        return load_task(path, overrides | dict(given))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        place = f"byte {error.start}"
        raise InputError(f"cannot read {path}: it is not UTF-8 ({place})") from error


def _override(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"--set needs KEY=VALUE, such as params.press=20N, not {text!r}")
    return key.strip(), value


def _laws(path: Path, law: str) -> dict[str, str]:
    """Overrides of every `law` in a file; a file that cannot be parsed has none to replace."""
    with path.open("rb") as file:
        # A file that is too long or not UTF-8 is found out when it is loaded.
        text = normal(file.read(MAX_BYTES).decode("utf-8", "replace"))
    root = read(Source(str(path), text), Diagnostics(str(path)))
    stages = root.get("stages") if isinstance(root, nodes.Mapping) else None
    own = [
        f"stages.{name}.law"
        for name, (_, stage) in (
            stages.entries if isinstance(stages, nodes.Mapping) else {}
        ).items()
        if isinstance(stage, nodes.Mapping) and stage.get("law") is not None
    ]
    return dict.fromkeys(["law", *own], law)

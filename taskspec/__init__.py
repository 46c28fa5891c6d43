"""The task language and its compiler: text in, controller out."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping
    from typing import Any

    from taskspec.spec import LoadedTask

__version__ = "0.1.0"
__all__ = ["__version__", "load"]


def load(
    path: str | os.PathLike[str],
    set: Mapping[str, Any] | None = None,
) -> LoadedTask:
    """Read and check a task file.

    Args:
        path: the file.
        set: overrides, dotted path or bare name of a param to YAML text, as in
            `{"press": "20 N", "world.table.stiffness": "5 kN/m"}`; numbers, lists and mappings are
            what a file would have there.

    Returns:
        The task, to be handed to `taskspec_runner.run`.

    Raises:
        SpecError: the task is wrong; it carries everything that was found.
        TypeError: an override is nothing that a file can have.
        OSError: the file cannot be opened.
        UnicodeDecodeError: it is not UTF-8.
    """
    # The models take a quarter of a second to import, which a name need not cost.
    import json
    from pathlib import Path

    from taskspec.spec import load_task
    from taskspec.text.diagnostic import SpecError

    given = {k: v if isinstance(v, str) else json.dumps(v) for k, v in (set or {}).items()}
    try:
        return load_task(Path(path), given)
    except SpecError as error:
        from taskspec.unread import with_robot

        raise with_robot(error) from None

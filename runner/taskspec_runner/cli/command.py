"""Commands whose options stand in dataclasses, as typer takes them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, get_type_hints


def flattened(command: Callable[..., int]) -> Callable[..., int]:
    """A command that takes the fields of each parameter that is a dataclass, by name.

    Typer makes an option of each parameter of a function, from its annotation and its default. So
    the options of a dataclass stand once, and a command is given them as one object.
    """
    groups: dict[str, Any] = {}
    flat = []
    hints = get_type_hints(command, include_extras=True)
    for name, parameter in inspect.signature(command).parameters.items():
        hint = hints[name]
        if not is_dataclass(hint):
            flat.append(parameter.replace(annotation=hint))
            continue
        groups[name] = hint
        options = get_type_hints(hint, include_extras=True)
        flat += [
            parameter.replace(
                name=each.name, annotation=options[each.name], default=_default_of(each)
            )
            for each in fields(hint)
        ]

    def called(**given: Any) -> int:
        for name, group in groups.items():
            given[name] = group(**{each.name: given.pop(each.name) for each in fields(group)})
        return command(**given)

    called.__name__, called.__doc__ = command.__name__, command.__doc__
    called.__annotations__ = {each.name: each.annotation for each in flat}
    called.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    return called


def _default_of(field: Field[Any]) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()

"""Columns of the log as nested names, for tools that show signals as a tree."""

from __future__ import annotations

import functools

#: What a column says beside another; `force.z` is a number and cannot hold a `ref` of its own.
_BESIDE = ("ref", "measured")


@functools.cache
def path_of(column: str) -> tuple[str, ...]:
    """The nested name of a column: `force.z.ref` is `z_ref` in `force`, beside its `z`."""
    parts = column.split(".")
    if len(parts) > 1 and parts[-1] in _BESIDE:
        parts[-2:] = ["_".join(parts[-2:])]
    return tuple(parts)

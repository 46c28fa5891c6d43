"""Signals of three components, written out."""

from __future__ import annotations

from dataclasses import replace

from taskspec.signals import VECTORS
from taskspec.text.expression import tree


def written_out(node: tree.Node) -> tree.Node:
    """Replaces the argument of norm(vector) by the vector's components."""
    match node:
        case tree.Call("norm", (tree.Name(path, frame) as name,)) if path[-1] in VECTORS:
            axes = VECTORS[path[-1]].bare
            return replace(
                node, args=tuple(replace(name, path=(*path, axis), frame=frame) for axis in axes)
            )
        case tree.Negate(x) | tree.Not(x) | tree.Held(x, _):
            return replace(node, x=written_out(x))
        case tree.Binary(_, left, right) | tree.Compare(_, left, right):
            return replace(node, left=written_out(left), right=written_out(right))
        case tree.Power(base, _):
            return replace(node, base=written_out(base))
        case tree.Call(_, args):
            return replace(node, args=tuple(map(written_out, args)))
        case tree.Reduce(_, arg):
            return replace(node, arg=written_out(arg))
        case tree.WithinNode(x, low, high):
            return replace(node, x=written_out(x), low=written_out(low), high=written_out(high))
        case tree.Logic(_, items):
            return replace(node, items=tuple(map(written_out, items)))
        case _:
            return node

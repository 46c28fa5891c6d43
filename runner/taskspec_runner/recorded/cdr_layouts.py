"""Messages in CDR as columns: where the numbers and texts of one are, and of which others too.

Messages of one length whose lists and texts are as long have their fields at the same places. These
are worked out once, by the definition that rosbags has parsed; the numbers of all such messages are
then read at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.recorded.mcap_chunks import ChannelMessages

#: Numbers that one list may bring as columns; a longer one is a picture or a point cloud.
LONGEST_LIST = 64
#: Layouts of a channel that are tried before one is worked out.
_LAYOUTS = 64
#: Bytes before the first field, from behind which alignment counts; the second one is the order.
_ENCAPSULATION = 4
_DTYPES = {
    "bool": "u1", "byte": "u1", "octet": "u1", "char": "u1", "uint8": "u1", "int8": "i1",
    "uint16": "u2", "int16": "i2", "uint32": "u4", "int32": "i4", "uint64": "u8", "int64": "i8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
#: Kinds of fields, as rosbags numbers them.
_BASE, _NAME, _ARRAY = 1, 2, 3


class DamagedMessageError(Exception):
    """A message that its definition does not fit; the message says why."""


@dataclass(frozen=True, slots=True)
class FieldLayout:
    """Where the fields of messages are that agree in the lengths of their texts and lists.

    Attributes:
        numbers: names of fields that follow each other, where the first begins, and their type.
        texts: names of fields, and where each begins and ends.
        fixed: where bytes begin that are the same in all of these messages, and the bytes.
    """

    numbers: tuple[tuple[tuple[str, ...], int, np.dtype[Any]], ...]
    texts: tuple[tuple[str, int, int], ...]
    fixed: tuple[tuple[int, NDArray[np.uint8]], ...]

    def fits(self, messages: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(n,) Whether messages (n, size) are laid out so."""
        found = np.ones(len(messages), dtype=bool)
        for start, content in self.fixed:
            same = messages[:, start : start + len(content)] == content
            if not same.all():
                found &= same.all(axis=1)
        return found

    def columns(self, messages: NDArray[np.uint8]) -> Iterator[tuple[str, NDArray[np.float64]]]:
        """The name and the values (n,) of each field of numbers of messages (n, size)."""
        for names, start, dtype in self.numbers:
            part = messages[:, start : start + len(names) * dtype.itemsize].view(dtype)
            yield from zip(names, part.T.astype(np.float64, order="C"), strict=True)

    def words(
        self, messages: NDArray[np.uint8]
    ) -> Iterator[tuple[str, list[str], NDArray[np.int64]]]:
        """The name of each field of text, its texts, and which each message (n, size) has (n,)."""
        for name, start, end in self.texts:
            part = messages[:, start:end]
            if end == start or (part == part[0]).all():
                kinds, codes = part[:1], np.zeros(len(part), dtype=np.int64)
            else:
                kinds, codes = np.unique(part, axis=0, return_inverse=True)
            yield name, [bytes(kind).decode() for kind in kinds], codes.reshape(-1)


class CdrMessages:
    """Messages of one definition."""

    def __init__(self, definitions: Mapping[str, Any], name: str) -> None:
        """Takes the fields of messages, as rosbags has them, and which of them it is."""
        self._definitions, self._name = definitions, name
        self._layouts: dict[int, list[FieldLayout]] = {}

    def split(
        self, found: ChannelMessages
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.uint8], FieldLayout]]:
        """Rows of messages of one layout, their bytes (k, size), and the layout.

        Raises:
            DamagedMessageError: one does not fit the definition.
        """
        lengths = found.ends - found.starts
        for size in dict.fromkeys(lengths.tolist()):
            rows = np.flatnonzero(lengths == size)
            layouts = self._layouts.setdefault(size, [])
            tried = iter([*layouts])
            while len(rows):
                layout = next(tried, None)
                if layout is None:
                    layout = self._layout(found.of_rows(rows[:1]).tobytes())
                    layouts.insert(0, layout)
                    del layouts[_LAYOUTS:]
                messages = found.of_rows(rows)
                fits = layout.fits(messages)
                if fits.all():
                    yield rows, messages, layout
                    break
                if fits.any():
                    yield rows[fits], messages[fits], layout
                    rows = rows[~fits]

    def _layout(self, content: bytes) -> FieldLayout:
        walk = _Walk(content, self._definitions)
        walk.message(self._name, "")
        # What follows may be padding.
        if len(content) - walk.at >= _ENCAPSULATION:
            raise DamagedMessageError(f"it has {len(content) - walk.at} bytes more than its fields")
        return walk.layout()


class _Walk:
    """The way through one message, field by field.

    Attributes:
        at: the byte behind the last field.
    """

    def __init__(self, content: bytes, definitions: Mapping[str, Any]) -> None:
        self._content, self._definitions, self.at = content, definitions, _ENCAPSULATION
        if len(content) < _ENCAPSULATION:
            raise DamagedMessageError("it is too short")
        self._order = "<" if content[1] & 1 else ">"
        self._fixed = [(0, _ENCAPSULATION)]
        self._numbers: dict[str, tuple[int, np.dtype[Any]]] = {}
        self._texts: dict[str, tuple[int, int]] = {}

    def message(self, name: str, path: str) -> None:
        """Goes through the fields of a message.

        Those of a joint state are there by the names of the joints too, as `position[elbow]`: their
        order is that of whoever sent the message.
        """
        lists: dict[str, tuple[int, int, np.dtype[Any]]] = {}
        names: list[tuple[int, int]] = []
        for field, (kind, what) in self._definitions[name][1]:
            here = f"{path}.{field}" if path else field
            if kind == _BASE:
                self._single(what[0], here)
            elif kind == _NAME:
                self.message(what, here)
            else:
                (inner, of), count = what
                count = count if kind == _ARRAY else self._count()
                if inner == _BASE and of[0] not in ("string", "wstring"):
                    start, dtype = self._several(of[0], count, here)
                    lists[field] = count, start, dtype
                    continue
                before = (dict(self._numbers), dict(self._texts)) if count > LONGEST_LIST else None
                paths = (f"{here}[{i}]" for i in range(count))
                if inner == _BASE:
                    texts = [self._text(each) for each in paths]
                    names = texts if field == "name" else names
                else:
                    for each in paths:
                        self.message(of, each)
                if before is not None:
                    self._numbers, self._texts = before
        if names:
            self._by_joint(path, names, lists)

    def _by_joint(
        self,
        path: str,
        names: Sequence[tuple[int, int]],
        lists: Mapping[str, tuple[int, int, np.dtype[Any]]],
    ) -> None:
        for field in ("position", "velocity", "effort"):
            if field in lists and lists[field][0] == len(names):
                _, start, dtype = lists[field]
                head = f"{path}.{field}" if path else field
                for i, (begin, end) in enumerate(names):
                    joint = self._content[begin:end].decode()
                    self._numbers[f"{head}[{joint}]"] = start + i * dtype.itemsize, dtype
                    self._fixed.append((begin, end))

    def _single(self, kind: str, path: str) -> None:
        if kind in ("string", "wstring"):
            self._text(path)
        else:
            start, dtype = self._several(kind, 1, "")
            self._numbers[path] = start, dtype

    def _several(self, kind: str, count: int, path: str) -> tuple[int, np.dtype[Any]]:
        """Goes through numbers; returns where the first is."""
        if kind not in _DTYPES:
            raise DamagedMessageError(f"numbers of the kind {kind} are not read")
        dtype = np.dtype(f"{self._order}{_DTYPES[kind]}")
        if count:
            self._align(dtype.itemsize)
        start = self.at
        self._move(count * dtype.itemsize)
        if path and count <= LONGEST_LIST:
            for i in range(count):
                self._numbers[f"{path}[{i}]"] = start + i * dtype.itemsize, dtype
        return start, dtype

    def _text(self, path: str) -> tuple[int, int]:
        """Goes through a text; returns where it is, without the zero at its end."""
        length = self._count()
        start = self.at
        self._move(length)
        self._texts[path] = start, max(self.at - 1, start)
        return self._texts[path]

    def _count(self) -> int:
        """A number of bytes or items, which is one of what makes a layout."""
        self._align(4)
        start = self.at
        self._move(4)
        self._fixed.append((start, self.at))
        count = int(np.frombuffer(self._content, f"{self._order}u4", 1, start)[0])
        # No item is shorter than a byte.
        if count > len(self._content) - self.at:
            raise DamagedMessageError("a text or a list is longer than it")
        return count

    def _align(self, to: int) -> None:
        self.at += -(self.at - _ENCAPSULATION) % to

    def _move(self, by: int) -> None:
        self.at += by
        if self.at > len(self._content):
            raise DamagedMessageError("it is shorter than its fields")

    def layout(self) -> FieldLayout:
        """What was found."""
        runs: list[tuple[list[str], int, np.dtype[Any]]] = []
        for name, (start, dtype) in self._numbers.items():
            names, first, kind = runs[-1] if runs else ([], -1, dtype)
            if runs and kind == dtype and start == first + len(names) * dtype.itemsize:
                names.append(name)
            else:
                runs.append(([name], start, dtype))
        content = np.frombuffer(self._content, np.uint8)
        return FieldLayout(
            tuple((tuple(names), start, dtype) for names, start, dtype in runs),
            tuple((name, start, end) for name, (start, end) in self._texts.items()),
            tuple((start, content[start:end]) for start, end in self._fixed),
        )

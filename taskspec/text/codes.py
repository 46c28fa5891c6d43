"""Every stable diagnostic code, with a title in one line. A code is never given a new meaning."""

from __future__ import annotations

from collections.abc import Mapping

CODES: dict[str, str] = {}
"""All codes, to their titles: TS0xx text and shape, TS1xx names, units and expressions, TS2xx axes,
laws and frames, TS3xx contact, TS4xx robots and reach, TS5xx stability, TS6xx stages, TS7xx
expectations. The page of a code is `docs/diagnostics/CODE.md`."""


def register(codes: Mapping[str, str]) -> None:
    """Adds codes with their titles; whatever reports a code calls this beside it.

    Raises:
        ValueError: a code is registered already.
    """
    for code, title in codes.items():
        if code in CODES:
            raise ValueError(f"diagnostic code {code} is already taken: {CODES[code]}")
        CODES[code] = title

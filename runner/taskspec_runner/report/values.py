"""Values of a JSON file that may hold anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

Json = Mapping[str, Any]


def number(value: object) -> float | None:
    """A finite number, else None."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def mapping(value: object) -> Json:
    """A mapping, an empty one in place of anything else."""
    return value if isinstance(value, Mapping) else {}


def mappings(value: object) -> list[Json]:
    """The mappings of a list, none in place of anything else."""
    return [v for v in value if isinstance(v, Mapping)] if isinstance(value, list) else []

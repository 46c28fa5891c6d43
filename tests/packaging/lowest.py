"""The lowest versions that pyproject.toml allows, as pins for pip."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"
_BOUND = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*>=\s*([0-9][0-9A-Za-z.]*)")


def pins(requirements: Iterable[str]) -> Iterator[str]:
    """`NAME==VERSION` of each requirement with a lower bound."""
    for each in requirements:
        match = _BOUND.match(each)
        if match:
            yield f"{match[1]}=={match[2]}"


def all_pins(extras: Iterable[str] = ("mcap", "dask", "dev")) -> list[str]:
    """Pins of all that the project needs, of its extras, and of what its tests read with."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    optional = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(r for extra in extras for r in optional[extra])]
    return sorted(set(pins(wanted)))


if __name__ == "__main__":
    sys.stdout.write("\n".join(all_pins()) + "\n")

"""Quantities as a person reads them."""

from __future__ import annotations

from taskspec.text.units import to_si


def show(value: float, unit: str, digits: int = 4) -> str:
    """An SI value written in `unit`, such as `show(0.015, "mm")` = "15 mm"."""
    return f"{value / to_si(1.0, unit).value:.{digits}g} {unit}"

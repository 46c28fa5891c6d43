"""Every case past its predicted boundary grows in the run, every case inside settles."""

from __future__ import annotations

import pytest

from stability.cases import FACTORS, Family, families
from stability.trial import boundary, cases, judge, told

GRID = list(families())
#: Of every run of the tests: one press of each law, and these factors of its critical gain.
FEW = (0.9, 1.1)
#: An error begins 2 % inside the boundary, and no gain beyond it is without one.
REFUSED = (0.981, 1.002)


def one_of_each() -> list[Family]:
    first: dict[str, Family] = {}
    for family in GRID:
        first.setdefault(f"{family.law} {family.swept}", family)
    return list(first.values())


def label(family: Family) -> str:
    return f"{family.law}, {family.swept}: {family.name}, {family.delay:g} ms"


def test_the_grid_is_large_enough():
    assert len(GRID) * len(FACTORS) >= 300
    assert len({label(family) for family in GRID}) == len(GRID)


@pytest.mark.parametrize("family", one_of_each(), ids=label)
def test_either_side_of_the_boundary(family, request):
    """A subset, for every run of the tests; the whole grid holds these too."""
    if request.config.getoption("stability_table", default=None) is not None:
        pytest.skip("part of the whole grid")
    for case in cases(family, FEW):
        verdict = judge(case, brief=True)
        assert verdict.holds, verdict


@pytest.mark.parametrize("family", GRID, ids=label)
def test_an_error_from_two_percent_below_the_critical_gain_on(family, request):
    """Every press of the whole grid; one of each law in every run of the tests."""
    whole = request.config.getoption("stability_table", default=None) is not None
    if not whole and family not in one_of_each():
        pytest.skip("--stability-table runs it")
    assert {told(case) for case in cases(family, REFUSED)} == {"TS501 error"}


@pytest.mark.parametrize("family", GRID, ids=label)
def test_whole_grid(family, request, verdicts):
    if request.config.getoption("stability_table", default=None) is None:
        pytest.skip("--stability-table runs it")
    for case in cases(family):
        verdict = judge(case)
        verdicts.append(verdict)
        assert verdict.holds, verdict
        assert case.factor < 1 or verdict.told == "TS501 error", verdict


def test_a_boundary_is_where_the_modes_say():
    """The search on interpolated controllers and a compiled stage agree on where growth begins."""
    from stability.trial import analysed

    family = GRID[0]
    found = boundary(family)
    # Searched to 5e-4 of the gain, on the stable side.
    for factor, stable in ((0.9995, True), (1.0015, False)):
        growth = analysed(family, found.value * factor).modes()[0].s.real
        assert (growth < 0) == stable

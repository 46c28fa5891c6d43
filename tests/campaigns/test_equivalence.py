from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from equivalence import Logs, compared, difference

_CLOCK = [0.0, 0.001, 0.002]
_FINE = {"exit_code": 0, "diagnostics": []}


def log(force: list[float], clock: list[float] = _CLOCK, **more: list[float]) -> pa.Table:
    return pa.table({"clock": clock, "stage": ["a"] * len(clock), "force": force, **more})


def finding(**keys: object) -> dict[str, object]:
    found = {"code": "TS304", "severity": "warning", "line": 3, "column": 2, "message": "m"}
    return {"exit_code": 0, "diagnostics": [found | keys]}


@pytest.mark.parametrize(
    ("now", "reported"),
    [
        (log([1.0, 0.0, np.nan]), ""),
        (log([1.0, 0.0, -np.nan]), ""),
        (log([1.0, -0.0, np.nan]), "force at tick 1, 0.0010 s"),
        (log([np.nextafter(1.0, 2.0), 0.0, 1.0]), "force at tick 0, 0.0000 s"),
        (log([1.0, 0.0], _CLOCK[:2]), "3 ticks, now 2"),
        (log([1.0, 0.0, np.nan], torque=[0.0] * 3), "columns: gone [], new ['torque']"),
        (log([1.0, 0.0, np.nan]).select(["force", "clock", "stage"]), "order of the columns"),
    ],
)
def test_logs_are_equal_bit_for_bit(now: pa.Table, reported: str) -> None:
    found = difference(log([1.0, 0.0, np.nan]), now)
    assert found.startswith(reported)
    assert bool(found) == bool(reported)


@pytest.mark.parametrize(
    ("base", "tree", "differs", "worded"),
    [
        (finding(), finding(), False, False),
        (finding(), finding(message="n"), False, True),
        (finding(), finding(line=4), True, True),
        (finding(), finding(severity="error"), True, False),
        (finding(), _FINE, True, True),
        (finding(), {"crash": "KeyError: 'x'"}, True, False),
        (_FINE, _FINE | {"exit_code": 1}, True, False),
    ],
)
def test_diagnostics_keep_their_code_and_place(
    base: dict[str, object], tree: dict[str, object], differs: bool, worded: bool
) -> None:
    row = compared("x", {"validated": base}, {"validated": tree}, Logs(Path(), Path()))
    assert (bool(row.detail), bool(row.worded)) == (differs, worded)


def test_runs_that_end_otherwise_differ() -> None:
    ended = [
        {"validated": _FINE, "ran": ran} for ran in ({"refused": ["TS501 error"]}, {"crash": "x"})
    ]
    logs = Logs(Path(), Path())
    assert compared("x", ended[0], ended[0], logs).run == "equal"
    assert compared("x", ended[0], ended[1], logs).run == "differs"

"""The Python page: its blocks run, one after the other, as a reader would."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from documents import ROOT, TASKS, text_of

from taskspec_runner.result import RunResult

PAGE = ROOT / "docs" / "python.md"


def test_blocks_run(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(TASKS / "wipe-table.yaml", tmp_path / "wipe.yaml")
    names: dict[str, Any] = {}
    blocks = re.findall(r"^```python\n(.*?)^```$", text_of(PAGE), re.M | re.S)
    assert len(blocks) >= 6
    for block in blocks:
        exec(compile(block, PAGE.name, "exec"), names)
    assert names["result"].passed
    assert names["soft"].metrics != names["result"].metrics
    assert names["soft"].manifest["seed"] == 3
    assert names["force"].unit == "N"
    assert names["path"].suffix == ".parquet"
    assert (tmp_path / "wipe.svg").is_file()
    assert np.isfinite(names["error"]).all()


def test_links_lead_somewhere():
    for link in re.findall(r"\]\(([^)#]+)[^)]*\)", text_of(PAGE)):
        assert (PAGE.parent / link).exists(), link


def test_verdicts_and_attributes_are_those_of_a_result():
    named = set(re.findall(r"result\.(\w+)", text_of(PAGE)))
    assert named <= set(dir(RunResult)) | {"folder"}

"""The shape of the code in numbers, for one checkout or for two side by side.

    python benchmarks/structure.py [FOLDER [FOLDER]]

Counted in the text: lines, files, imports, classes. Counted as it runs, each in a fresh process:
modules that are loaded, functions that are called in one compile, files that one run opens.
Measured: what validating costs, in turns where there are two checkouts. Nothing is written into the
folders.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PRODUCT, TESTS = ("taskspec", "runner"), ("tests",)
TASK = "tasks/wipe-table.yaml"
#: Functions that ask what a stage is made of.
QUERIES = (
    "law_of",
    "limits_of",
    "frame_of",
    "contact_of",
    "stiffness_of",
    "plants",
    "plan_axes",
    "path_shape",
    "frame_at_start",
    "compile_stage",
)
FILES = ("log.arrow", "manifest.json", "task.yaml", "summary.json")
VALIDATE = "from taskspec_runner.cli import main; main()"

#: Scripts that run in a fresh process of a checkout; each ends by printing a line of JSON.
_COUNT = """
loaded = [name for name in sys.modules if name.split(".")[0] in ("taskspec", "taskspec_runner")]
print(json.dumps({"ours": len(loaded), "all": len(sys.modules)}))
"""
_LOADED_VALIDATE = (
    """
import contextlib, io, json, sys
sys.argv = ["taskspec", "validate", TASK]
try:
    from taskspec_runner.cli.entry import run as main
except ImportError:  # a commit whose `main` leaves the process to Python
    from taskspec_runner.cli import main
with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()), \\
        contextlib.redirect_stderr(io.StringIO()):
    main()
"""
    + _COUNT
)
_LOADED_CHECK = (
    """
import json, sys
import taskspec
try:
    from taskspec.examination import check_task
except ImportError:  # a commit before rules had a registry
    from taskspec.check import check_task
check_task(taskspec.load(TASK))
"""
    + _COUNT
)
_CALLS = """
import collections, json, sys
import taskspec
from taskspec.compiler import compile_task
loaded, calls = taskspec.load(TASK), collections.Counter()
def count(frame, event, argument):
    if event == "call":
        code = frame.f_code
        if "/taskspec/" in code.co_filename and not code.co_name.startswith("<"):
            calls[code.co_qualname] += 1
sys.setprofile(count)
compile_task(loaded)
sys.setprofile(None)
print(json.dumps(calls))
"""
_OPENED = """
import collections, json, os, sys, tempfile
from pathlib import Path
import taskspec, taskspec_runner
opened = collections.Counter()
def hook(event, arguments):
    if event != "open" or not isinstance(arguments[0], (str, os.PathLike)):
        return
    path, mode, flags = arguments
    name = Path(path).name
    if name in FILES and here in str(path) and not flags & (os.O_WRONLY | os.O_RDWR):
        opened[f"{name} read"] += 1
with tempfile.TemporaryDirectory() as here:
    loaded = taskspec.load(TASK)
    sys.addaudithook(hook)
    taskspec_runner.run(loaded, Path(here) / "run")
    print(json.dumps(opened))
"""


# --- the text --------------------------------------------------------------------------------


@dataclass
class Text:
    """What the Python files of some folders are made of.

    Attributes:
        files, lines, blank, imports: numbers. short: files with fewer than 30 lines.
        single: files that define one thing. functions: how many.
        classes: name to places. bare: dataclasses without a method. dataclasses: all of them.
    """

    files: int = 0
    lines: int = 0
    blank: int = 0
    imports: int = 0
    short: int = 0
    single: int = 0
    functions: int = 0
    dataclasses: int = 0
    bare: int = 0
    classes: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    def add(self, path: Path, name: str) -> None:
        """Counts a file; `name` says where it is."""
        text = path.read_text("utf-8")
        tree, lines = ast.parse(text), text.splitlines()
        self.files, self.lines = self.files + 1, self.lines + len(lines)
        self.blank += sum(not line.strip() for line in lines)
        self.short += 0 < len(lines) < 30
        made = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        self.single += sum(isinstance(node, made) for node in tree.body) == 1
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom):
                self.imports += (node.end_lineno or node.lineno) - node.lineno + 1
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                self.functions += 1
            elif isinstance(node, ast.ClassDef):
                self._add_class(node, name)

    def _add_class(self, node: ast.ClassDef, name: str) -> None:
        self.classes[node.name].append(f"{name}:{node.lineno}")
        if any("dataclass" in ast.unparse(each) for each in node.decorator_list):
            self.dataclasses += 1
            self.bare += not any(isinstance(each, ast.FunctionDef) for each in node.body)

    @property
    def twice(self) -> dict[str, list[str]]:
        """Public classes of one name in several places."""
        public = {name: at for name, at in self.classes.items() if not name.startswith("_")}
        return {name: at for name, at in sorted(public.items()) if len(at) > 1}


def text_of(checkout: Path, folders: Sequence[str]) -> Text:
    """What is in the Python files of some folders of a checkout."""
    found = Text()
    for folder in folders:
        for path in sorted((checkout / folder).rglob("*.py")):
            found.add(path, str(path.relative_to(checkout)))
    return found


# --- processes -------------------------------------------------------------------------------


class Checkout:
    """A folder with the sources, and processes that run in it."""

    def __init__(self, folder: Path, compiled: Path) -> None:
        self.folder = folder.resolve()
        paths = (self.folder, self.folder / "runner")
        kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        self._environment = {
            **kept,
            "PYTHONPATH": os.pathsep.join(map(str, paths)),
            "PYTHONPYCACHEPREFIX": str(compiled),
            "MUJOCO_GL": "disable",
        }

    def data(self, script: str) -> dict[str, Any]:
        """What a script prints last, read as JSON; why not, if it fails."""
        names = f"TASK, FILES = {str(self.folder / TASK)!r}, {FILES!r}\n"
        done = self._run("-c", names + script)
        if done.returncode:
            return {"not measured": done.stderr.strip().rpartition("\n")[2]}
        return dict(json.loads(done.stdout.strip().rpartition("\n")[2]))

    def timed(self, *words: str) -> tuple[float, float]:
        """Real and processor time of the command line [s]."""
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = self._run("-c", VALIDATE, *words)
        real = time.perf_counter() - began
        if done.returncode not in (0, 2):
            raise SystemExit(done.stderr)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return real, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def _run(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *words],
            env=self._environment,
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
        )


Table = dict[str, list[str]]


def counted(texts: Sequence[Text]) -> Table:
    """Rows on the text."""
    table: Table = {}
    for label, name in (
        ("Python files", "files"),
        ("lines", "lines"),
        ("files below 30 lines", "short"),
        ("files with one definition", "single"),
        ("functions", "functions"),
        ("dataclasses", "dataclasses"),
        ("dataclasses without a method", "bare"),
    ):
        table[label] = [f"{getattr(text, name)}" for text in texts]
    table["import lines"] = [f"{t.imports} ({100 * t.imports / t.lines:.1f} %)" for t in texts]
    table["blank lines"] = [f"{t.blank} ({100 * t.blank / t.lines:.1f} %)" for t in texts]
    table["classes"] = [f"{sum(map(len, t.classes.values()))}" for t in texts]
    table["public class names used twice"] = [f"{len(t.twice)}" for t in texts]
    return table


def loaded(checkouts: Sequence[Checkout]) -> Table:
    """Rows on modules, calls and files."""
    table: Table = {}
    for label, script in (("validate", _LOADED_VALIDATE), ("check_task", _LOADED_CHECK)):
        found = [each.data(script) for each in checkouts]
        table[f"modules loaded for {label}, ours"] = [_one(each, "ours") for each in found]
        table[f"modules loaded for {label}, all"] = [_one(each, "all") for each in found]
    calls = [each.data(_CALLS) for each in checkouts]
    table["calls in one compile, all"] = [_sum(each) for each in calls]
    for name in QUERIES:
        table[f"  {name}"] = [_sum(_named(each, name)) for each in calls]
    for rank in range(8):
        table[f"  most called, {rank + 1}"] = [_ranked(each, rank) for each in calls]
    opened = [each.data(_OPENED) for each in checkouts]
    for name in FILES:
        table[f"one run reads {name}"] = [_one(each, f"{name} read", "0") for each in opened]
    return table


def _one(found: Mapping[str, Any], key: str, missing: str = "?") -> str:
    return str(found.get("not measured", found.get(key, missing)))


def _named(calls: Mapping[str, Any], name: str) -> dict[str, Any]:
    return {k: v for k, v in calls.items() if k.rpartition(".")[2] == name or k == "not measured"}


def _sum(calls: Mapping[str, Any]) -> str:
    return str(calls.get("not measured", sum(v for v in calls.values() if isinstance(v, int))))


def _ranked(calls: Mapping[str, Any], rank: int) -> str:
    if "not measured" in calls:
        return "?"
    name, number = sorted(calls.items(), key=lambda pair: -pair[1])[rank]
    return f"{number} {name}"


def costs(checkouts: Sequence[Checkout], rounds: int) -> Table:
    """Rows on what validating takes; the checkouts take turns."""
    names = ("tasks",)
    files = [len(list((each.folder / "tasks").rglob("*.yaml"))) for each in checkouts]
    cold: list[list[tuple[float, float]]] = [[] for _ in checkouts]
    many: list[list[tuple[float, float]]] = [[] for _ in checkouts]
    for turn in range(rounds + 1):
        for i, each in enumerate(checkouts):
            one, several = each.timed("validate", TASK), each.timed("validate", *names)
            if turn:  # the first one compiles the modules
                cold[i].append(one)
                many[i].append(several)
    median = statistics.median
    table: Table = {"validate cold, real [s]": [f"{median(r for r, _ in t):.3f}" for t in cold]}
    table["validate cold, processor [s]"] = [f"{median(c for _, c in t):.3f}" for t in cold]
    table["validate tasks/, processor a file [ms]"] = [
        f"{1e3 * median(c for _, c in t) / n:.1f}" for t, n in zip(many, files, strict=True)
    ]
    warm = [
        (median(c for _, c in m) - median(c for _, c in o)) for m, o in zip(many, cold, strict=True)
    ]
    table["  each file after the first [ms]"] = [
        f"{1e3 * w / (n - 1):.1f}" for w, n in zip(warm, files, strict=True)
    ]
    return table


def printed(title: str, table: Table) -> Iterator[str]:
    """The lines of a table."""
    yield f"\n{title}"
    wide = max(len(label) for label in table) + 2
    for label, values in table.items():
        yield f"  {label:{wide}}" + "  ".join(f"{value:>36}" for value in values)


def main() -> None:
    """Counts, measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folders", nargs="*", type=Path, default=[ROOT], help="one or two checkouts"
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--text", action="store_true", help="count in the text only")
    arguments = parser.parse_args()
    for title, folders in (("product", PRODUCT), ("tests", TESTS)):
        texts = [text_of(folder, folders) for folder in arguments.folders]
        print(*printed(title, counted(texts)), sep="\n")
        if folders is PRODUCT:
            product = texts
    if not arguments.text:
        with tempfile.TemporaryDirectory() as place:
            each = [Checkout(f, Path(place) / str(i)) for i, f in enumerate(arguments.folders)]
            print(*printed("as it runs", loaded(each)), sep="\n")
            print(*printed("what it costs", costs(each, arguments.rounds)), sep="\n")
    for folder, text in zip(arguments.folders, product, strict=True):
        print(f"\nclass names used twice or more in {folder}")
        for name, at in text.twice.items():
            print(f"  {name}: {', '.join(at)}")


if __name__ == "__main__":
    main()

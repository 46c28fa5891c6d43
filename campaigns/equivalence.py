"""Holds the tree against an earlier commit: the same logs bit for bit, the same diagnostics.

    python campaigns/equivalence.py --base COMMIT

Every shipped task and many random ones run on both sides, and every column of the two logs is
compared. Every file of the corpus, every shipped and every random file is validated on both sides;
code, severity and place of the diagnostics are compared, wording may change and is counted. Both
sides are given the files of the tree, in one environment. What the base made is kept under
`runs/equivalence`, by its commit and the text of the file.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.metadata
import inspect
import io
import json
import platform
import queue
import shutil
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import yaml

sys.path.insert(0, str(Path(__file__).parent))

from random_tasks import COMPANIONS, write_tasks
from workers import Worker, serve

ROOT = Path(__file__).resolve().parents[1]
#: What a run depends on beside the code.
PACKAGES = ("casadi", "daqp", "mujoco", "numpy", "osqp", "pin", "pyarrow", "scipy")
#: After which a file is given up as hanging [s].
LOST = 600.0
GROUPS = ("shipped", "random", "corpus")


# --- a worker: one side, many files ----------------------------------------------------------


def answer(order: Mapping[str, Any]) -> dict[str, Any]:
    """What the taskspec of this process makes of a file."""
    made: dict[str, Any] = {"validated": _guarded(validated, order["file"])}
    if order["log"]:
        made["ran"] = _guarded(ran, order["file"], Path(order["log"]))
    return made


def _guarded(what: Any, *args: Any) -> dict[str, Any]:
    """What a function returns, or what it failed with."""
    try:
        return dict(what(*args))
    except BaseException as error:
        return {"crash": f"{type(error).__name__}: {' '.join(str(error).split())}"}


def validated(file: str) -> dict[str, Any]:
    """What `taskspec validate` finds in a file, or `run` in one whose overrides are wrong."""
    from taskspec_runner.cli import main

    lines = Path(file).read_text("utf-8", "replace").splitlines()
    sets = [line.removeprefix("# --set ") for line in lines if line.startswith("# --set ")]
    words = ["run" if sets else "validate", "--format", "json", file]
    words += [word for pair in sets for word in ("--set", pair)]
    printed, sys.argv = io.StringIO(), ["taskspec", *words]
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
            main()
    except SystemExit as done:
        code = done.code
    # Where the file lies is no part of what is found.
    found = json.loads(printed.getvalue().replace(str(Path(file).parent), "."))
    if found.get("internal_errors"):
        return {"crash": f"internal error: {found['internal_errors']}"}
    return {"exit_code": code, "diagnostics": found["diagnostics"]}


def ran(file: str, log: Path) -> dict[str, Any]:
    """How a run of a file ends; its log is left at `log`, packed."""
    import taskspec
    import taskspec_runner

    # Runs of this kind go on whatever is predicted of them.
    options = {"report": False}
    if "force" in inspect.signature(taskspec_runner.run).parameters:
        options["force"] = True
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        try:
            taskspec_runner.run(taskspec.load(file), folder, **options)
        except Exception as error:
            found = getattr(error, "diagnostics", None)
            if found is None:
                raise
            return {"refused": sorted(f"{d.code} {d.severity}" for d in found)}
        summary = json.loads((folder / "summary.json").read_text("utf-8"))
        with pa.ipc.open_stream(folder / "log.arrow") as reader:
            table = reader.read_all()
    packed = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_file(log, table.schema, options=packed) as writer:
        writer.write_table(table)
    return {
        "exit_code": summary["exit_code"],
        "status": summary["status"],
        "ending": summary["ending"],
        "expectations": [[each["text"], each["passed"]] for each in summary["expectations"]],
    }


# --- comparing -------------------------------------------------------------------------------


def difference(base: pa.Table, tree: pa.Table) -> str:
    """The first place at which two logs differ; empty if they are equal bit for bit."""
    ours, theirs = tree.column_names, base.column_names
    if set(ours) != set(theirs):
        gone, new = sorted(set(theirs) - set(ours)), sorted(set(ours) - set(theirs))
        return f"columns: gone {gone}, new {new}"
    for name in theirs:
        a, b = base.schema.field(name), tree.schema.field(name)
        if not a.equals(b, check_metadata=True):
            return f"column {name}: {a.type} {a.metadata}, now {b.type} {b.metadata}"
    found = []
    ticks = min(base.num_rows, tree.num_rows)
    for number, name in enumerate(theirs):
        unequal = _unequal(_values(base, name)[:ticks], _values(tree, name)[:ticks])
        if unequal.any():
            found.append((int(np.argmax(unequal)), number, name))
    if found:
        tick, _, name = min(found)
        a, b = (_values(each, name)[tick : tick + 1].tolist()[0] for each in (base, tree))
        clock = _values(base, "clock")[tick] if "clock" in theirs else float("nan")
        return (
            f"{name} at tick {tick}, {clock:.4f} s: {a!r}, now {b!r}; "
            f"{len(found)} of {len(theirs)} columns differ"
        )
    if base.num_rows != tree.num_rows:
        return f"{base.num_rows} ticks, now {tree.num_rows}"
    return "" if ours == theirs else "order of the columns"


def _values(table: pa.Table, name: str) -> np.ndarray[Any, Any]:
    column = table[name]
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    return np.asarray(column.to_numpy())


def _unequal(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """(n,) Where two columns differ; zeros of different signs do, two NaN do not."""
    if a.dtype != np.float64:
        return np.asarray(a != b)
    unequal = a.view(np.int64) != b.view(np.int64)
    return np.asarray(unequal & ~(np.isnan(a) & np.isnan(b)))


def places(found: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """Code, severity and place of each diagnostic, sorted."""
    keys = ("code", "severity", "line", "column")
    return sorted(tuple(d.get(key) or 0 for key in keys) for d in found["diagnostics"])


def wording(found: Mapping[str, Any]) -> list[str]:
    """What is said in each diagnostic, sorted."""
    where = ("{code} {line}:{column}".format_map(d) for d in found["diagnostics"])
    said = (f"{d['message']} | {d.get('hint') or ''}" for d in found["diagnostics"])
    return sorted(f"{place}: {text}" for place, text in zip(where, said, strict=True))


@dataclass
class Row:
    """What came of one file.

    Attributes:
        name: group and name of the file. run: `equal`, `differs`, or empty for one that is only
            validated. detail: what differs. worded: messages and hints that are other ones.
        ending: how the run of the tree ended.
    """

    name: str
    run: str = ""
    detail: list[str] = field(default_factory=list)
    worded: list[str] = field(default_factory=list)
    ending: str = ""


def compared(name: str, base: Mapping[str, Any], tree: Mapping[str, Any], logs: Logs) -> Row:
    """Holds what the tree made of a file against what the base made of it."""
    row = Row(name)
    row.detail += _diagnosed(base["validated"], tree["validated"])
    if "crash" not in base["validated"] and "crash" not in tree["validated"]:
        before, now = (Counter(wording(each["validated"])) for each in (base, tree))
        row.worded = [f"- {text}" for text in (before - now).elements()]
        row.worded += [f"+ {text}" for text in (now - before).elements()]
    if "ran" not in tree:
        return row
    row.ending = _ending(tree["ran"])
    wrong = _ended(base["ran"], tree["ran"])
    if not wrong and "status" in tree["ran"]:
        reported = difference(logs.base(), logs.tree())
        wrong = [reported] if reported else []
    elif "status" in base["ran"] and "status" in tree["ran"]:
        wrong.append(difference(logs.base(), logs.tree()) or "the logs are equal")
    row.run, row.detail = "differs" if wrong else "equal", row.detail + wrong
    return row


def _ending(made: Mapping[str, Any]) -> str:
    return str(made.get("status") or ("refused" if "refused" in made else "crashed"))


def _diagnosed(base: Mapping[str, Any], tree: Mapping[str, Any]) -> list[str]:
    if "crash" in base or "crash" in tree:
        a, b = (each.get("crash", "no crash") for each in (base, tree))
        return [] if a == b else [f"validate: {a}, now {b}"]
    before, now = Counter(places(base)), Counter(places(tree))
    gone, new = (
        [f"{code} {severity} {line}:{column}" for code, severity, line, column in each.elements()]
        for each in (before - now, now - before)
    )
    found = [f"diagnostics: gone {gone}, new {new}"] if gone or new else []
    if base["exit_code"] != tree["exit_code"]:
        found.append(f"validate: exit code {base['exit_code']}, now {tree['exit_code']}")
    return found


def _ended(base: Mapping[str, Any], tree: Mapping[str, Any]) -> list[str]:
    """What differs in how two runs ended."""
    for kind in ("crash", "refused"):
        if kind in base or kind in tree:
            a, b = (each.get(kind, f"no {kind}") for each in (base, tree))
            return [] if a == b else [f"run: {_short(a)}, now {_short(b)}"]
    keys = dict.fromkeys([*base, *tree])
    differing = [key for key in keys if base.get(key) != tree.get(key)]
    return [f"{key}: {_short(base.get(key))}, now {_short(tree.get(key))}" for key in differing]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 160 else text[:157] + "..."


@dataclass(frozen=True)
class Logs:
    """Where the logs of the two sides are."""

    before: Path
    now: Path

    def base(self) -> pa.Table:
        return pa.ipc.open_file(self.before).read_all()

    def tree(self) -> pa.Table:
        return pa.ipc.open_file(self.now).read_all()


# --- the files -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A file to be held to both sides.

    Attributes:
        name: group and name. path: of the file. runs: whether it is run, or validated only.
    """

    name: str
    path: Path
    runs: bool


def shipped_cases(tree: Path) -> Iterator[Case]:
    for path in sorted((tree / "tasks").rglob("*.yaml")):
        yield Case(f"shipped/{path.stem}", path, True)


def random_cases(folder: Path, numbers: Sequence[int]) -> Iterator[Case]:
    for path in write_tasks(folder, numbers):
        yield Case(f"random/{path.stem}", path, True)


def corpus_cases(tree: Path) -> Iterator[Case]:
    for path in sorted((tree / "tests" / "corpus").rglob("*.yaml")):
        yield Case(f"corpus/{path.stem}", path, False)


def key_of(case: Case, around: str) -> str:
    """What a result of the base is kept under: all that it depends on but the commit."""
    digest = hashlib.sha256(around.encode())
    digest.update(str(case.runs).encode() + case.path.read_bytes())
    return digest.hexdigest()[:24]


def surroundings(tree: Path) -> str:
    """A digest of packages, interpreter and processor, and of the files that tasks refer to."""
    parts = [platform.python_version(), platform.machine(), _processor()]
    parts += [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES]
    parts += [f"{name} {text}" for name, text in COMPANIONS.items()]
    beside = (tree / "tasks", tree / "tests" / "corpus")
    others = (p for folder in beside for p in sorted(folder.rglob("*")) if p.is_file())
    digest = hashlib.sha256("\n".join(parts).encode())
    for path in others:
        if path.suffix not in (".yaml", ".out", ".py", ".pyc"):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def _processor() -> str:
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        return next((line for line in lines if line.startswith("model name")), "")
    return platform.processor()


def commit_of(name: str) -> str:
    """The full name of a commit."""
    command = ["git", "-C", str(ROOT), "rev-parse", "--verify", f"{name}^{{commit}}"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def export_commit(commit: str, folder: Path) -> None:
    """Writes the files of a commit into a folder."""
    command = ["git", "-C", str(ROOT), "archive", commit]
    packed = subprocess.run(command, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")


def copy_tree(folder: Path) -> None:
    """Writes the tree as it is now into a folder, so that it may change while it is compared."""
    unwanted = shutil.ignore_patterns(".*", "__pycache__", "runs", "build", "dist", "*.egg-info")
    shutil.copytree(ROOT, folder, ignore=unwanted, symlinks=True)


# --- the command -----------------------------------------------------------------------------


class Bench:
    """The two sides, `base` and `tree` in the folder `scratch`, and what the base made before."""

    def __init__(self, commit: str, kept: Path, scratch: Path) -> None:
        self._kept, self._scratch = kept / commit[:16], scratch
        self._kept.mkdir(parents=True, exist_ok=True)
        self._around = surroundings(scratch / "tree")
        self._local = threading.local()
        self._workers: list[Worker] = []

    def row(self, case: Case) -> Row:
        """Holds a file to both sides, the base's only if it is not known."""
        key = key_of(case, self._around)
        kept, log = self._kept / f"{key}.json", self._kept / f"{key}.arrow"
        logs = Logs(log, self._scratch / f"{key}.arrow")
        if kept.is_file():
            base = json.loads(kept.read_text("utf-8"))
        else:
            base = self._made("base", case.path, log if case.runs else None)
            if not any("crash" in each for each in base.values()):
                kept.write_text(json.dumps(base), "utf-8")
        tree = self._made("tree", case.path, logs.now if case.runs else None)
        try:
            return compared(case.name, base, tree, logs)
        finally:
            logs.now.unlink(missing_ok=True)

    def _made(self, side: str, file: Path, log: Path | None) -> dict[str, Any]:
        """What a side makes of a file; its log is left at `log`, if it is to be run."""
        order = {"file": str(file), "log": "" if log is None else str(log)}
        made = self._worker(side).ask(order)
        if isinstance(made, dict):
            return made
        return {"validated": {"crash": made}, **({} if log is None else {"ran": {"crash": made}})}

    def _worker(self, side: str) -> Worker:
        """The worker of this thread."""
        if not hasattr(self._local, side):
            worker = Worker(Path(__file__), self._scratch / side, LOST)
            setattr(self._local, side, worker)
            self._workers.append(worker)
        return getattr(self._local, side)  # type: ignore[no-any-return]

    def close(self) -> None:
        for worker in self._workers:
            worker.close()


def rows_of(bench: Bench, cases: Sequence[Case], jobs: int) -> Iterator[Row]:
    """A row for each file, as they are done."""
    waiting: queue.SimpleQueue[Case | None] = queue.SimpleQueue()
    done: queue.SimpleQueue[Row] = queue.SimpleQueue()
    for case in [*cases, *[None] * jobs]:
        waiting.put(case)

    def run() -> None:
        while (case := waiting.get()) is not None:
            try:
                done.put(bench.row(case))
            except Exception as error:
                failed = f"the comparison failed: {type(error).__name__}: {error}"
                done.put(Row(case.name, "differs", [failed]))

    for _ in range(jobs):
        threading.Thread(target=run, daemon=True).start()
    for _ in cases:
        yield done.get()


def accepted(path: Path) -> dict[str, str]:
    """Files that differ on purpose, with the reason."""
    if not path.is_file():
        return {}
    listed = yaml.safe_load(path.read_text("utf-8")) or {}
    return {str(name): str(reason) for name, reason in listed.items()}


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def progress(text: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


def report(rows: Iterable[Row], reasons: Mapping[str, str], *, worded: bool) -> int:
    """Prints the table; how many rows differ without a reason."""
    rows = sorted(rows, key=lambda row: row.name)
    for row in rows if worded else ():
        for text in row.worded:
            say(f"{row.name}: {text}")
    wrong = [row for row in rows if row.detail and row.name not in reasons]
    excepted = [row for row in rows if row.detail and row.name in reasons]
    for title, listed in (("differs", wrong), ("differs on purpose", excepted)):
        for row in listed:
            reason = f" ({reasons[row.name]})" if row.name in reasons else ""
            say(f"{title}: {row.name}{reason}")
            for detail in row.detail:
                say(f"    {detail}")
    for name in sorted(set(reasons) & {row.name for row in rows if not row.detail}):
        say(f"equal, though listed as differing: {name}")
    say(f"{'':10} {'files':>6} {'run':>6} {'equal':>6} {'differ':>6} {'listed':>6} {'wording':>8}")
    for group in GROUPS:
        of = [row for row in rows if row.name.startswith(f"{group}/")]
        counts = (
            len(of),
            sum(row.run != "" for row in of),
            sum(not row.detail for row in of),
            sum(row in wrong for row in of),
            sum(row in excepted for row in of),
        )
        other = sum(bool(row.worded) for row in of)
        say(f"{group:10} " + " ".join(f"{n:6}" for n in counts) + f" {other:8}")
    endings = Counter(row.ending for row in rows if row.ending)
    say("runs: " + ", ".join(f"{n} {how}" for how, n in endings.most_common()))
    return len(wrong)


def main() -> int:
    """Compares; the exit code is 1 if anything differs that is not listed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--base", help="the commit that the tree is held against")
    parser.add_argument("--tasks", type=int, default=200, help="how many random tasks")
    parser.add_argument("--first", type=int, default=0, help="number of the first random task")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", choices=GROUPS, action="append", help="may be repeated")
    parser.add_argument("--match", default="", help="only files whose group/name contains this")
    parser.add_argument(
        "--accept",
        type=Path,
        default=Path(__file__).with_name("accepted.yaml"),
        help="YAML: group/name of a file that differs on purpose, and the reason",
    )
    parser.add_argument("--wording", action="store_true", help="show messages that are other ones")
    parser.add_argument("--cache", type=Path, default=ROOT / "runs" / "equivalence")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        serve(answer)
        return 0
    if not arguments.base:
        parser.error("--base is required")
    began, groups, commit = time.monotonic(), arguments.only or GROUPS, commit_of(arguments.base)
    scratch = Path(tempfile.mkdtemp(prefix="equivalence-")).resolve()
    tree = scratch / "tree"
    try:
        export_commit(commit, scratch / "base")
        copy_tree(tree)
        cases = [*(shipped_cases(tree) if "shipped" in groups else ())]
        if "random" in groups:
            numbers = range(arguments.first, arguments.first + arguments.tasks)
            cases += random_cases(scratch / "random", numbers)
        cases += corpus_cases(tree) if "corpus" in groups else ()
        cases = [case for case in cases if arguments.match in case.name]
        bench = Bench(commit, arguments.cache.resolve(), scratch)
        rows: list[Row] = []
        for row in rows_of(bench, cases, arguments.jobs):
            rows.append(row)
            differing = sum(bool(each.detail) for each in rows)
            progress(f"{len(rows)} of {len(cases)}, {differing} differ: {row.name}")
        progress("")
        bench.close()
    except KeyboardInterrupt:
        return 130
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    wrong = report(rows, accepted(arguments.accept), worded=arguments.wording)
    say(f"base {commit[:12]}, {len(rows)} files, {time.monotonic() - began:.0f} s")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())

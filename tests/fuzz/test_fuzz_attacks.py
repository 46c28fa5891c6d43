"""What was tried against readers of YAML, one row each: refused with a code, or harmless."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from attacked import MEMORY, Victim

ROOT = Path(__file__).parents[2]
HEAD = "taskspec: 1\nrobot: {model: panda}\nstages: {a: {time: 1 s}}\n"
LAUGHS = "a0: &a0 [x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 10)
)
MERGES = "m0: &m0 {k: 1}\n" + "".join(
    f"m{i}: &m{i} {{<<: [*m{i - 1}, *m{i - 1}]}}\n" for i in range(1, 25)
)


@dataclass(frozen=True)
class Attack:
    """A file.

    Attributes:
        content: of it. codes: one of which it ends in; none if it is harmless.
    """

    content: str | bytes
    codes: tuple[str, ...] = ()


def key(value: str, *codes: str) -> Attack:
    """A value where any text may stand."""
    return Attack(f"{HEAD}about: {value}\n", codes)


def param(value: str, *codes: str) -> Attack:
    """A value where a quantity stands."""
    return Attack(f"{HEAD}params: {{p: {value}}}\n", codes)


def model(value: str, *codes: str) -> Attack:
    """The path of a robot."""
    return Attack(f"taskspec: 1\nrobot: {{model: {value}}}\nstages: {{a: {{time: 1 s}}}}\n", codes)


def protection(value: str, *codes: str) -> Attack:
    """A protection: the path of a file, or one in place."""
    robot = f"robot: {{model: panda, protection: {value}}}"
    return Attack(f"taskspec: 1\n{robot}\nstages: {{a: {{time: 1 s}}}}\n", codes)


def table(value: str, *codes: str) -> Attack:
    """The path of a table."""
    path = f"path: {{file: {value}, speed: 10 mm/s}}"
    return Attack(f"taskspec: 1\nrobot: {{model: panda}}\nstages: {{a: {{{path}}}}}\n", codes)


def expectation(value: str) -> Attack:
    """An expression."""
    quoted = value.replace("'", "''")
    codes = ("TS101", "TS114", "TS115", "TS116", "TS118", "TS120", "TS121", "TS713")
    return Attack(f"{HEAD}expect: ['{quoted}']\n", codes)


ROWS: dict[str, Attack] = {
    "billion laughs": Attack(HEAD + LAUGHS, ("TS005",)),
    "merge bomb": Attack(HEAD + MERGES, ("TS005", "TS006")),
    "nested 500 deep": key("[" * 500, "TS009"),
    "nested 100 000 deep": key("[" * 100_000, "TS009"),
    "nested mappings": key("{a: " * 500, "TS009"),
    "dashes": Attack("- " * 100_000, ("TS009",)),
    "questions": Attack("? " * 100_000, ("TS009",)),
    "too large": Attack(HEAD + "#" * 300_000, ("TS009",)),
    "too many parts": key("[" + "1," * 30_000 + "]", "TS009"),
    "a long text": key("x" * 9000, "TS009"),
    "an integer of 5000 digits": param("9" * 5000, "TS015"),
    "a hexadecimal of 100 000 digits": param("0x" + "f" * 100_000, "TS009"),
    "a hexadecimal": param("0x1F", "TS101", "TS111"),
    "!!int foo": param("!!int foo", "TS007"),
    "!!bool foo": param("!!bool foo", "TS007"),
    "!!timestamp foo": param("!!timestamp foo", "TS007"),
    "!!int ''": param("!!int ''", "TS007"),
    "!!set": key("!!set {a, b}", "TS007"),
    "!!omap": key("!!omap [a: 1]", "TS007"),
    "!!binary": key("!!binary aGk=", "TS007"),
    "!!python": key("!!python/object/apply:os.system [id]", "TS007"),
    "a date that is none is a difference": param("2024-99-99"),
    "a date as text": key("2024-01-01"),
    "an escape beyond Unicode": key('"\\U00110000"', "TS001"),
    "the value sign": param("=", "TS103"),
    "a lone surrogate, escaped": key('"\\ud800"', "TS002"),
    "a lone surrogate": Attack(HEAD.encode() + b"about: \xed\xa0\x80\n", ("unreadable",)),
    "bidirectional signs": key("a\u202eb", "TS002"),
    "bidirectional signs, escaped": key('"a\\u2066b"', "TS002"),
    "a key given twice": Attack(HEAD + "about: a\nabout: b\n", ("TS004",)),
    "no": key("no"),
    "on as a key": Attack(HEAD + "on: 1\n", ("TS020",)),
    "sexagesimal": param("1:30", "TS101"),
    "octal is decimal": param("010"),
    "1e3 is a number": param("1e3"),
    ".nan": param(".nan", "TS015"),
    ".inf": param("-.inf", "TS015"),
    "1e400": param("1e400", "TS015"),
    "1e300": param("1e300 N", "TS015"),
    "NUL": key("a\0b", "TS002"),
    "a tab": Attack(HEAD + "\tabout: a\n", ("TS003",)),
    "a byte order mark": Attack(b"\xef\xbb\xbf" + HEAD.encode()),
    "UTF-16": Attack(HEAD.encode("utf-16"), ("unreadable",)),
    "UTF-32": Attack(HEAD.encode("utf-32"), ("unreadable",)),
    "two documents": Attack(HEAD + "---\n" + HEAD, ("TS008",)),
    "empty": Attack("", ("TS010",)),
    "a list": Attack("- a\n", ("TS010",)),
    "a list of itself": Attack("&a [*a]\n", ("TS005",)),
    "a merge key": Attack(HEAD + "<<: {about: a}\n", ("TS006",)),
    "bytes": Attack(bytes(range(256)) * 100, ("unreadable",)),
    "a path above": model("../../x", "TS402"),
    "/etc/passwd": model("/etc/passwd", "TS402"),
    "a device": model("/dev/zero", "TS402"),
    "a pipe": model("pipe.xml", "TS402"),
    "a link to another kind": model("link.xml", "TS402"),
    "a link to itself": model("loop.xml", "TS401", "TS402"),
    "a name that no system has": model("a" * 5000 + ".xml", "TS401", "TS402"),
    "a robot elsewhere": model("/opt/robots/arm.urdf", "TS409"),
    "a robot above": model("../arm.xml", "TS409"),
    "a robot behind a link that leads out": model("out.xml", "TS409"),
    "a table elsewhere": table("/var/log/points.csv", "TS409"),
    "a table above the project": table("../points.csv", "TS409"),
    "a table behind a link that leads out": table("out.csv", "TS409"),
    "a table above": table("../../../../etc/passwd", "TS223"),
    "a table that is a device": table("/dev/zero", "TS223"),
    "a table that is a pipe": table("pipe.csv", "TS223"),
    "a table behind a link": table("link.csv", "TS409"),
    "a table of a process": table("/proc/self/environ", "TS223"),
    "a table name that no system has": table("a" * 5000 + ".csv", "TS223"),
    "a table that is a folder": table("folder.csv", "TS223"),
    "a protection elsewhere": protection("/var/log/arm.yaml", "TS409"),
    "a protection above": protection("../arm.yaml", "TS409"),
    "a protection behind a link that leads out": protection("out.yaml", "TS409"),
    "a protection that is a device": protection("/dev/zero", "TS134", "TS409"),
    "a protection that is a pipe": protection("pipe.yaml", "TS134"),
    "a protection behind a link to itself": protection("loop.yaml", "TS134", "TS409"),
    "a protection that is a folder": protection("folder.yaml", "TS134"),
    "a protection name that no system has": protection("a" * 5000 + ".yaml", "TS134", "TS409"),
    "a protection beyond numbers": protection("{source: s, tip: {speed: 1e400 m/s}}", "TS015"),
    "a protection that is nothing": protection(
        "{source: s, joints: {speed: []}}", "TS023", "TS021"
    ),
    "an escape sequence": key("\x1b[2J", "TS002"),
    "an escape sequence in a name": Attack(HEAD + '"\\e[2J": 1\n', ("TS002",)),
    "a command to GitHub": Attack(HEAD + '"\\n::error::owned": 1\n', ("TS020",)),
    "a command to GitHub in a word": Attack(
        HEAD.replace("panda", '"\\n::error::owned"'), ("TS401",)
    ),
    "an old command to GitHub": Attack(HEAD + "'##[set-output name=a]b': 1\n", ("TS020",)),
    "a script": Attack(HEAD + "'<script>alert(1)</script>': 1\n", ("TS020",)),
    **{
        f"expression {value}": expectation(value)
        for value in (
            "__import__('os').system('id')",
            "().__class__.__bases__[0].__subclasses__()",
            "open('/etc/passwd').read()",
            "max.__globals__ > 1",
            "(lambda: 0)() > 1",
            "exec('1') > 1",
            "2**9**9**9 > 1",
            "9^8^8 > 1",
            "{{7*7}} > 1",
            "a; b",
            "x := 3",
            "force.z > '__class__'",
        )
    },
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("pipe.xml", "pipe.csv", "pipe.yaml"):
        os.mkfifo(tmp_path / name)
    for name in ("link.xml", "link.csv"):
        (tmp_path / name).symlink_to("/etc/passwd")
    for name in ("out.xml", "out.csv", "out.yaml"):
        outside = tmp_path.parent / f"{tmp_path.name}-{name}"
        outside.write_text("root:", encoding="utf-8")
        (tmp_path / name).symlink_to(outside)
    (tmp_path / "loop.xml").symlink_to(tmp_path / "loop.xml")
    (tmp_path / "loop.yaml").symlink_to(tmp_path / "loop.yaml")
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "folder.yaml").mkdir()
    return tmp_path


def hold(path: Path, codes: tuple[str, ...], victim: Victim) -> str:
    """Holds a file to the promises; returns what was printed about it."""
    answer = victim.validate(path)
    assert answer.broken == ()
    assert bool(answer.unreadable) == ("unreadable" in codes)
    assert bool(answer.errors or answer.unreadable) == bool(codes)
    assert not answer.errors or answer.errors & set(codes)
    assert not victim.slow(answer)
    assert answer.memory < MEMORY
    assert all(c == "\n" or c.isprintable() for c in answer.text)
    assert not re.search(r"^\s*(::error::|##\[)", answer.text, re.MULTILINE)
    return answer.text


@pytest.mark.parametrize("attack", ROWS.values(), ids=ROWS)
def test_attacks(attack: Attack, folder: Path, victim: Victim) -> None:
    path = folder / "t.yaml"
    content = attack.content
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    text = hold(path, attack.codes, victim)
    assert "root:" not in text


@pytest.mark.parametrize("name", ["pipe.yaml", "/dev/zero", "/dev/null", "absent.yaml"])
def test_task_files_that_are_none(name: str, folder: Path, victim: Victim) -> None:
    codes = {"/dev/zero": ("TS002", "TS009"), "/dev/null": ("TS010",)}.get(name, ("unreadable",))
    hold(folder / name, codes, victim)


def test_nothing_executes_what_a_file_says() -> None:
    forbidden = re.compile(
        r"(?<![.\w])(eval|exec|compile)\(|yaml\.load\(|sympify|pickle|allow_pickle=True|os\.system"
    )
    # Looking for words is quick, and few lines have one of these.
    words = ("eval(", "exec(", "compile(", "yaml.load(", "sympify", "pickle", "os.system")
    # It has no word of a task file: the methods of our own dataclasses are written of their fields.
    known = ("taskspec/deferred_methods.py",)
    packages = (ROOT / "taskspec", ROOT / "runner" / "taskspec_runner")
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for package in packages
        for path in sorted(package.rglob("*.py"))
        if path.relative_to(ROOT).as_posix() not in known
        for line in path.read_text("utf-8").splitlines()
        if any(word in line for word in words) and forbidden.search(line)
    ]
    assert found == []

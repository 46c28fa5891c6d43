"""Machine code: from text to addresses, from a cache that may be spoiled, in threads."""

from __future__ import annotations

import ctypes
import gc
import os
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from taskspec.native import engine as engine_module
from taskspec.native.engine import Engine, EngineError, available, default_store, missing
from taskspec.native.libm import declaration, symbol
from taskspec.store import VARIABLE, Store, cache_folder

HALF = (
    "define double @half(double %x) {\n %y = fmul double %x, 0x3FE0000000000000\n ret double %y\n}"
)
SINE = (
    f"{declaration('sin')}\n"
    "define double @sine(double %x) {\n"
    f" %y = call double {symbol('sin')}(double %x)\n %z = call double @half(double %y)\n"
    " ret double %z\n}\ndeclare double @half(double)\n"
    "define internal i64 @hidden() {\n ret i64 1\n}"
)


FACTS = engine_module._machine_facts()


def call(engine: Engine, name: str, x: float) -> float:
    return engine.function(name, ctypes.c_double, ctypes.c_double)(x)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "cache")


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("cache/*"))


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_texts_call_each_other_and_libm(level, store) -> None:
    engine = Engine([HALF, SINE], level=level, store=store)
    sine = ctypes.CDLL(None).sin
    sine.restype, sine.argtypes = ctypes.c_double, [ctypes.c_double]
    assert engine.names == ("half", "sine")
    assert call(engine, "sine", 1.25) == 0.5 * sine(1.25)
    with pytest.raises(KeyError, match="hidden"):
        engine.address("hidden")


def test_code_is_kept_by_its_content(store, tmp_path) -> None:
    first, again = Engine([HALF, SINE], store=store), Engine([HALF, SINE], store=store)
    assert (first.kept, again.kept) == (False, True)
    assert call(first, "sine", 0.3) == call(again, "sine", 0.3)
    assert not Engine([HALF], store=store).kept
    assert not Engine([HALF], level=2, store=store).kept
    # Two texts are not the one that they make together.
    assert not Engine(
        ["\n".join([HALF, SINE.replace("declare double @half(double)", "")])], store=store
    ).kept
    assert len(files(tmp_path)) == 4


@pytest.mark.parametrize(
    "change",
    [
        ("_SCHEMA", -1),
        ("_machine_facts", lambda: (FACTS[0], "x86-64" if "x86" in FACTS[0] else "", "")),
    ],
)
def test_code_of_another_version_or_processor_is_made_anew(change, store, monkeypatch) -> None:
    Engine([HALF], store=store)
    monkeypatch.setattr(engine_module, *change)
    other = Engine([HALF], store=store)
    assert not other.kept
    assert call(other, "half", 3.0) == 1.5


def damages(sound: bytes, foreign: bytes) -> list[bytes]:
    middle = len(sound) // 2
    flipped = bytearray(sound)
    flipped[middle] ^= 1
    return [
        b"",
        sound[:10],
        sound[:middle],
        sound[:-1],
        bytes(flipped),
        foreign,
        b"\0" * len(sound),
    ]


@pytest.mark.parametrize("which", range(7))
def test_a_spoiled_file_is_made_anew(which, store, tmp_path) -> None:
    """Cut, damaged, or of another key: machine code that is not this one must never run."""
    Engine([HALF], store=store)
    (kept,) = files(tmp_path)
    sound = kept.read_bytes()
    Engine([HALF, SINE], store=store)
    (other,) = set(files(tmp_path)) - {kept}
    kept.write_bytes(damages(sound, other.read_bytes())[which])
    engine = Engine([HALF], store=store)
    assert not engine.kept
    assert call(engine, "half", 3.0) == 1.5
    assert kept.read_bytes() == sound
    assert Engine([HALF], store=store).kept


def test_a_store_that_cannot_keep_is_no_error(tmp_path) -> None:
    """No folder, a file in its place, one below a file, one that others may write to."""
    file = tmp_path / "file"
    file.write_text("here")
    open_to_all = tmp_path / "open"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    for folder in (None, file, file / "below", Path("/proc/nothing"), open_to_all):
        for _ in range(2):
            engine = Engine([HALF], store=Store(folder))
            assert not engine.kept
            assert call(engine, "half", 3.0) == 1.5
    assert file.read_text() == "here"
    assert list(open_to_all.iterdir()) == []


def test_a_store_keeps_to_its_size_by_leaving_the_least_used(tmp_path) -> None:
    # Each file of 100 bytes has a head of 17 + 32; three of them leave a tenth of the limit.
    store = Store(tmp_path, limit=500)
    for number, key in enumerate("abc"):
        store.put(key, key.encode() * 100)
        path = max(tmp_path.iterdir(), key=lambda p: p.stat().st_mtime_ns)
        os.utime(path, (number, number))
    assert store.get("a") == b"a" * 100
    store.put("d", b"d" * 100)
    assert {key for key in "abcd" if store.get(key)} == {"a", "c", "d"}
    store.put("large", b"x" * 1000)
    assert store.get("large") is None
    assert {key for key in "abcd" if store.get(key)} == {"a", "c", "d"}


def test_where_code_is_kept(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert cache_folder() == tmp_path
    Engine([HALF])
    assert len(list((tmp_path / "native").iterdir())) == 1
    monkeypatch.setenv(VARIABLE, "")
    assert cache_folder() is None
    assert not Engine([HALF], store=default_store()).kept
    monkeypatch.delenv(VARIABLE)
    if sys.platform == "linux":
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
        assert cache_folder() == tmp_path / "xdg" / "taskspec"
        monkeypatch.setenv("XDG_CACHE_HOME", "relative")
        assert cache_folder() == Path.home() / ".cache" / "taskspec"


def test_threads_share_a_cache_and_an_engine(store) -> None:
    def one(number: int) -> float:
        engine = Engine([HALF, SINE if number % 2 else ""], store=store)
        return sum(call(engine, "half", float(k)) for k in range(100))

    with ThreadPoolExecutor(8) as pool:
        assert set(pool.map(one, range(40))) == {2475.0}
    shared = Engine([HALF], store=store)
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(lambda x: call(shared, "half", x), range(100))) == [
            x / 2 for x in range(100)
        ]


def test_a_function_keeps_its_code(store) -> None:
    half = Engine([HALF], store=store).function("half", ctypes.c_double, ctypes.c_double)
    gc.collect()
    for _ in range(20):
        Engine([HALF, SINE], store=store)
        gc.collect()
        assert half(5.0) == 2.5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HALF.replace("half", "floor"), "a text defines floor, which LLVM calls by itself"),
        ("define double @f(", "LLVM refuses the code"),
        (
            "define i64 @f() {\n %x = call i64 @nowhere()\n ret i64 %x\n}\ndeclare i64 @nowhere()",
            "no text defines nowhere, which",
        ),
    ],
)
def test_bad_code_is_named(text, message, store) -> None:
    with pytest.raises(EngineError, match=f"(?s){message}"):
        Engine([text], store=store)


def test_without_llvmlite_there_is_a_reason(monkeypatch) -> None:
    assert available()
    assert missing() is None
    missing.cache_clear()
    engine_module._llvm.cache_clear()
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    try:
        assert not available()
        assert "pip install llvmlite" in str(missing())
        with pytest.raises(EngineError, match="llvmlite is not installed"):
            Engine([HALF], store=Store(None))
    finally:
        missing.cache_clear()


def test_llvmlite_is_loaded_by_an_engine_alone() -> None:
    code = (
        "import sys; import taskspec.native.engine, taskspec.native.expressions;"
        "assert not [m for m in sys.modules if m.startswith('llvmlite')]"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such bits")
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o707])
def test_a_store_below_a_folder_that_others_may_write_to_keeps_nothing(tmp_path, mode) -> None:
    """Whoever may write there may put another folder in its place; /tmp has a sticky bit."""
    above = tmp_path / "above"
    folder = above / "cache" / "native"
    store = Store(folder)
    store.put("a", b"data")
    assert store.get("a") == b"data"
    assert {each.stat().st_mode & 0o777 for each in (above, folder.parent, folder)} == {0o700}
    above.chmod(mode)
    assert store.get("a") is None
    store.put("b", b"data")
    assert len(list(folder.iterdir())) == 1
    above.chmod(mode | stat.S_ISVTX)
    assert store.get("a") == b"data"
    above.chmod(0o755)
    (tmp_path / "link").symlink_to(above)
    assert Store(tmp_path / "link" / "cache" / "native").get("a") == b"data"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="gives folders away")
def test_a_store_below_a_folder_of_another_user_keeps_nothing(tmp_path) -> None:
    folder = tmp_path / "above" / "native"
    store = Store(folder)
    store.put("a", b"data")
    os.chown(folder.parent, 65534, 65534)
    assert store.get("a") is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="makes pipes")
@pytest.mark.parametrize("kind", ["pipe", "device", "link", "link to itself", "folder"])
def test_what_is_no_file_in_a_store_is_passed_over(tmp_path, kind) -> None:
    """Nothing waits for the other end of a pipe, or reads a device to its end."""
    store = Store(tmp_path / "native")
    store.put("a", b"data")
    (path,) = (tmp_path / "native").iterdir()
    sound = tmp_path / "sound"
    path.rename(sound)
    make = {
        "pipe": lambda: os.mkfifo(path),
        "device": lambda: path.symlink_to("/dev/zero"),
        "link": lambda: path.symlink_to(sound),
        "link to itself": lambda: path.symlink_to(path.name),
        "folder": path.mkdir,
    }
    make[kind]()
    assert store.get("a") is None
    store.put("a", b"again")
    assert store.get("a") == (None if kind == "folder" else b"again")
    assert sound.read_bytes().endswith(b"data")

"""Makes the pictures of pages as a browser shows them: reports, a run, a comparison, others.

    python docs/images/screens.py

They are what is seen without scrolling in a window (1100 x 940), so narrow that it can be read in
the column of a page, and on a phone (390 x 844). The tasks are those of the tutorial, so that its
readers have the same pages. Without chromium or chrome the pictures stay as they are.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from threading import Thread

from PIL import Image

from taskspec.compiler import compile_task
from taskspec.program.worlds import true_world
from taskspec.spec import load_task
from taskspec_runner.live.watched_run import WatchedRun
from taskspec_runner.session import execute_program

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
TUTORIAL = HERE.parent / "tutorial"
sys.path.insert(0, str(ROOT / "tests"))
from browser import Browser, browser_path  # noqa: E402

#: Steps of the tutorial whose reports are shown: one that passes, one that misses.
REPORTS = {"report": "press-3", "report-missed": "wipe-1"}
#: The step that is compared, and under which laws.
COMPARED = "wipe-2"
LAWS = ("hybrid", "parallel", "impedance", "pd")
#: The task that is swept.
SWEPT = HERE.parent / "how-to" / "sweep.yaml"
#: The task that is identified, and the world that it was run in.
IDENTIFIED = HERE.parent / "how-to" / "identify.yaml"
HIDDEN = (
    "world.bench.stiffness=22 kN/m",
    "world.bench.friction=0.31",
    "world.bench.xyz=[0, 0, 299.6 mm]",
)
#: The task whose slider is moved, which one, by which key, and at what run time [s].
MOVED, SLIDER, KEY, MOVED_AT = HERE.parent / "how-to" / "watch.yaml", "live-press", "Home", 2
#: Run time at which the page of a run that goes on is taken [s].
WATCHED = 4
#: Width and height [CSS px], and pixels of the picture for each of them.
SIZES = {"desktop": (1100, 940, 1.2), "phone": (390, 844, 1.5)}


def main() -> None:
    """Makes all of them."""
    path = browser_path()
    if path is None:
        sys.stderr.write("no chromium or chrome: pictures of pages stay as they are\n")
        return
    with tempfile.TemporaryDirectory() as folder, Browser(path) as browser:
        for name, step in REPORTS.items():
            program = compile_task(load_task(TUTORIAL / f"{step}.yaml"))
            page = execute_program(program, Path(folder) / name).report
            assert page is not None
            for size in SIZES:
                shoot(browser, page, f"{name}-{size}.png", size)
        shoot(browser, compared(Path(folder) / "compare"), "compare-desktop.png", "desktop")
        shoot(browser, swept(Path(folder) / "sweep"), "sweep-desktop.png", "desktop")
        shoot(browser, identified(Path(folder)), "identify-desktop.png", "desktop")
        watch(browser, Path(folder) / "watch")
        slide(browser, Path(folder) / "slide")


def compared(out: Path) -> Path:
    """The page of a task under several laws."""
    laws = [word for law in LAWS for word in ("--law", law)]
    command("compare", f"{TUTORIAL / COMPARED}.yaml", *laws, "--out", str(out))
    return out / "compare.html"


def swept(out: Path) -> Path:
    """The page of a task in many worlds."""
    command("sweep", str(SWEPT), "--out", str(out))
    return out / "sweep.html"


def identified(folder: Path) -> Path:
    """The page of a task that was run in a world that is not its file's."""
    hidden = [word for value in HIDDEN for word in ("--set", f"truth.{value}")]
    named, page = str(IDENTIFIED), "identified.html"
    command("run", named, "--out", "runs/press", *hidden, folder=folder)
    command("identify", named, "runs/press", "--what", "world", "--page", page, folder=folder)
    return folder / page


def command(*words: str, folder: Path | None = None) -> None:
    """Runs a command, in a folder; exit code 1, something missed, is to be seen."""
    line = [sys.executable, "-m", "taskspec_runner", *words]
    done = subprocess.run(line, capture_output=True, check=False, cwd=folder)
    if done.returncode not in (0, 1):
        sys.exit(done.stderr.decode())


def watch(browser: Browser, out: Path) -> None:
    """A picture of the page of a run that goes on, some seconds after its start."""
    program = compile_task(load_task(TUTORIAL / f"{COMPARED}.yaml"))
    with WatchedRun(program, true_world(program.context)) as page:
        place(browser, page.server.url, "desktop")
        running = Thread(target=execute_program, args=(program, out), kwargs={"spectator": page})
        running.start()
        wait(browser, WATCHED)
        save(browser, "watch-desktop.png")
        running.join()


def slide(browser: Browser, out: Path) -> None:
    """The same of a run whose slider has been moved."""
    program = compile_task(load_task(MOVED))
    with WatchedRun(program, true_world(program.context)) as page:
        place(browser, page.server.url, "desktop")
        given = {"spectator": page, "hand": page.sliders}
        running = Thread(target=execute_program, args=(program, out), kwargs=given)
        running.start()
        wait(browser, MOVED_AT)
        browser.run(f"document.getElementById('{SLIDER}').focus()")
        browser.key(KEY)
        wait(browser, MOVED_AT + 1)
        save(browser, "watch-sliders.png")
        running.join()


def wait(browser: Browser, clock: float) -> None:
    """Until a run that goes on has come to a time [s]."""
    while not browser.run(f"parseFloat(document.getElementById('time').textContent) > {clock}"):
        time.sleep(0.05)


def shoot(browser: Browser, page: Path, name: str, size: str) -> None:
    """A picture of what is seen of a page without scrolling."""
    place(browser, page.resolve().as_uri(), size)
    save(browser, name)


def place(browser: Browser, url: str, size: str) -> None:
    """Opens a page on a screen."""
    width, height, sharp = SIZES[size]
    browser.size(width, height, phone=size == "phone", sharp=sharp)
    browser.visit(url)


def save(browser: Browser, name: str) -> None:
    """A picture of what is seen now."""
    if browser.errors:
        sys.exit(f"{name}: {browser.errors}")
    Image.open(io.BytesIO(browser.png())).convert("RGB").save(HERE / name, optimize=True)


if __name__ == "__main__":
    main()

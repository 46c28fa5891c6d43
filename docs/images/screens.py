"""Makes the pictures of pages as a browser shows them: reports and a comparison.

    python docs/images/screens.py

They are what is seen without scrolling on a desk (1280 x 900) and on a phone (390 x 844). It needs
chromium or chrome, and EGL or OSMesa for the arm.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from taskspec.compiler import compile_task
from taskspec.spec import load_task
from taskspec_runner.session import execute_program

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from browser import Browser, browser_path  # noqa: E402

#: Wipes whose reports are shown: one as shipped, one that reaches its force too late.
WIPES: dict[str, dict[str, str]] = {
    "report": {},
    "report-missed": {"stages.wipe.axes.z.ramp": "2 s"},
}
COMPARED = ("hybrid", "parallel", "impedance", "pd")
#: Width and height [CSS px], and pixels of the picture for each of them.
SIZES = {"desktop": (1280, 900, 1.0), "phone": (390, 844, 1.5)}


def main() -> None:
    """Makes all of them."""
    path = browser_path()
    if path is None:
        sys.exit("this needs chromium or chrome")
    with tempfile.TemporaryDirectory() as folder, Browser(path) as browser:
        for name, sets in WIPES.items():
            program = compile_task(load_task(ROOT / "tasks" / "wipe-table.yaml", overrides=sets))
            page = execute_program(program, Path(folder) / name).report
            assert page is not None
            for size in SIZES:
                shoot(browser, page, f"{name}-{size}.png", size)
        shoot(browser, compared(Path(folder) / "compare"), "compare-desktop.png", "desktop")


def compared(out: Path) -> Path:
    """The page of a press under several laws."""
    laws = [word for law in COMPARED for word in ("--law", law)]
    task = str(ROOT / "tasks" / "press-parallel.yaml")
    command = [sys.executable, "-m", "taskspec_runner", "compare", task, *laws, "--out", str(out)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return out / "compare.html"


def shoot(browser: Browser, page: Path, name: str, size: str) -> None:
    """A picture of what is seen of a page without scrolling."""
    width, height, sharp = SIZES[size]
    browser.size(width, height, phone=size == "phone", sharp=sharp)
    browser.open(page)
    if browser.errors:
        sys.exit(f"{page}: {browser.errors}")
    Image.open(io.BytesIO(browser.png())).convert("RGB").save(HERE / name, optimize=True)


if __name__ == "__main__":
    main()

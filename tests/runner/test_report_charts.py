"""What a reader does with the charts of a report: finds the bound, zooms, measures, saves."""

from __future__ import annotations

import base64
import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from screen import DESKTOP, shown
from short_tasks import TAP

from browser import Browser, browser_path
from taskspec.compiler import compile_task
from taskspec.spec import load_text
from taskspec_runner.report import write_report
from taskspec_runner.session import execute_program

pytestmark = pytest.mark.skipif(
    browser_path() is None, reason="there is no chromium or chrome on this machine"
)

#: What is expected of the tap, each broken by it: of several signals, by means and in a frame.
BROKEN = {
    "norm": "max(norm(force)) < 3 N",
    "rms": "rms(hold.error.y) < 1e-9 mm",
    "mean": "mean(hold.force.x) < 4 N",
    "frame": "max(abs(force.x in world)) < 3 N",
    "spread": "max(hold.force.x) - min(hold.force.x) < 0.5 N",
    "last": "last(hold.force.x) < 4 N",
    "moving": "hold.force.x < 1 N + 1 N * smooth(hold.t / 1 s)",
}
MAIN = "document.querySelector('.main [data-chart]')"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Without WebGL: a page is there in half a second, and charts are where they are beside it."""
    path = browser_path()
    assert path is not None
    with Browser(path, "--disable-3d-apis") as found:
        yield found


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Reports of the tap: as it is, without expectations, and with each that it breaks."""
    folder = tmp_path_factory.mktemp("pages")
    head, kept = TAP.partition("expect:\n")[0], TAP
    texts = {"good": kept, "done": head}
    texts |= {n: f"{head}expect:\n  - {e}\n  - approach.visits <= 1\n" for n, e in BROKEN.items()}
    found = {}
    for name, text in texts.items():
        program = compile_task(load_text(text, "tap.yaml"))
        found[name] = write_report(execute_program(program, folder / name, report=False))
    return found


def box(browser: Browser, of: str) -> dict[str, float]:
    found: dict[str, float] = browser.run(f"{of}.getBoundingClientRect().toJSON()")
    return found


def drag(browser: Browser, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Draws with the mouse between two places of the main chart, as shares of it."""
    at = box(browser, f"{MAIN}.querySelector('.plot')")
    (x, y), (u, v) = (
        (at["x"] + p * at["width"], at["y"] + q * at["height"]) for p, q in (start, end)
    )
    browser.mouse("Moved", x, y)
    browser.mouse("Pressed", x, y, down=True, clicks=1)
    browser.mouse("Moved", u, v, down=True)
    browser.mouse("Released", u, v, clicks=1)


def texts(browser: Browser, of: str, where: str = MAIN) -> list[str]:
    found: list[str] = browser.run(
        f"[...{where}.querySelectorAll({of!r})].map((e) => e.textContent)"
    )
    return found


@pytest.mark.parametrize("name", BROKEN)
def test_the_bound_that_broke_is_on_the_first_chart_and_on_screen(
    browser: Browser, pages: dict[str, Path], name: str
) -> None:
    shown(browser, pages[name])
    # The line that is measured crosses a bound in red, at the time that is said, with its name.
    drawn = ".plot .band.bad" if name != "moving" else ".plot .trace.bound"
    assert browser.run(f"{MAIN}.querySelectorAll('{drawn}').length") == 1
    assert browser.run(f"{MAIN}.querySelectorAll('.plot .upright.broken').length") == 1
    said = BROKEN[name]
    # A name that is longer than its chart is left to the legend.
    assert name == "moving" or any(said[:12] in text for text in texts(browser, ".plot .name"))
    assert any(said in text for text in texts(browser, ".legend li"))
    for step in ("", "document.querySelector('.look').click()"):
        browser.run(step or "0")
        at = box(browser, MAIN)
        assert at["top"] >= 0
        assert at["bottom"] <= DESKTOP[1]
        # The bound and the time at which it broke are in the part that is shown.
        if name != "moving":
            edge = box(browser, f"{MAIN}.querySelector('.plot .edge.bad')")
            assert at["top"] < edge["top"] < at["bottom"]
        upright = box(browser, f"{MAIN}.querySelector('.plot .upright.broken')")
        assert at["left"] < upright["left"] < at["right"]
    assert browser.errors == []


def test_every_bound_and_upright_has_a_name(browser: Browser, pages: dict[str, Path]) -> None:
    shown(browser, pages["norm"])
    nameless = browser.run(
        """[...document.querySelectorAll("[data-chart]")].filter((f) => {
        const looks = (of) => [...f.querySelectorAll(of)].map((p) => p.getAttribute("class"));
        const legend = looks(".legend li svg path");
        const drawn = looks(".plot .edge, .plot .level, .plot .upright, .plot .trace");
        return drawn.some((look) => !legend.includes(look));
        }).map((f) => f.dataset.chart)"""
    )
    assert nameless == []
    inside = texts(browser, ".plot .name")
    assert any("broken" in text for text in inside)
    assert any(BROKEN["norm"] in text for text in inside)
    # Names cover neither each other nor the edge of the chart.
    boxes = browser.run(
        f"""[...{MAIN}.querySelectorAll(".plot .name")]
        .map((t) => t.getBoundingClientRect().toJSON())"""
    )
    frame = box(browser, f"{MAIN}.querySelector('.plot')")
    for i, one in enumerate(boxes):
        assert frame["left"] <= one["left"] < one["right"] <= frame["right"]
        for other in boxes[:i]:
            assert (
                one["right"] <= other["left"]
                or other["right"] <= one["left"]
                or one["bottom"] <= other["top"] + 4
                or other["bottom"] <= one["top"] + 4
            )


@pytest.mark.parametrize("name", ["good", "norm"])
def test_margin_bars_agree_with_their_text(
    browser: Browser, pages: dict[str, Path], name: str
) -> None:
    shown(browser, pages[name])
    found = browser.run(
        """[...document.querySelectorAll(".expectations .meter")].map((m) => [
        m.firstElementChild.getBoundingClientRect().width / m.getBoundingClientRect().width,
        m.nextElementSibling.textContent])"""
    )
    assert found
    for share, text in found:
        left = re.fullmatch(r"(\S+) % left", text)
        assert share == pytest.approx(float(left[1]) / 100 if left else 0.0, abs=0.02), text


def test_a_run_without_expectations_is_done_and_not_passed(
    browser: Browser, pages: dict[str, Path]
) -> None:
    shown(browser, pages["done"])
    text = browser.run("document.getElementById('verdict').innerText")
    assert "Done" in text
    assert "nothing was judged" in text
    assert "assed" not in browser.run("document.body.innerText").replace("passed its", "")
    colours = [
        browser.run(f"getComputedStyle({of}).color")
        for of in ("document.querySelector('#verdict strong')", "document.body")
    ]
    assert colours[0] == colours[1]


def test_zooming_shows_every_sample(browser: Browser, pages: dict[str, Path]) -> None:
    shown(browser, pages["good"])
    drag(browser, (0.70, 0.5), (0.73, 0.5))
    line = f"{MAIN}.querySelector('.plot path.trace.line').getAttribute('d')"
    times = texts(browser, ".plot text.mid")
    points = re.findall(r"[ML]([-\d.]+) ([-\d.]+)", browser.run(line))
    x = np.array([float(a) for a, _ in points])
    start, end = float(times[0]), float(times[-1].removesuffix(" s"))
    # Ticks of a millisecond, evenly apart over the window, none left out.
    width = browser.run(f"{MAIN}.querySelector('.plot > svg > svg').getAttribute('width')")
    assert 5 <= len(points) <= 60
    np.testing.assert_allclose(np.diff(x), np.diff(x)[0], atol=0.11)
    assert np.diff(x)[0] > float(width) / 60
    assert end > start


def test_a_drag_up_or_down_zooms_values_of_one_chart(
    browser: Browser, pages: dict[str, Path]
) -> None:
    shown(browser, pages["good"])
    times, values = texts(browser, ".plot text.mid"), texts(browser, ".plot text.end")
    other = "document.querySelectorAll('[data-chart]')[1]"
    beside = texts(browser, ".plot text.end", other)
    drag(browser, (0.5, 0.3), (0.505, 0.5))
    assert texts(browser, ".plot text.mid") == times
    assert texts(browser, ".plot text.end") != values
    assert texts(browser, ".plot text.end", other) == beside
    # Both at once by a diagonal; all again by the button.
    drag(browser, (0.4, 0.3), (0.6, 0.7))
    assert texts(browser, ".plot text.mid") != times
    browser.run("document.querySelector('.windows [data-start]').click()")
    assert (texts(browser, ".plot text.mid"), texts(browser, ".plot text.end")) == (times, values)
    # By keys, for those who have no mouse.
    browser.run(f"{MAIN}.querySelector('.plot').focus()")
    browser.key("ArrowUp")
    assert texts(browser, ".plot text.end") != values
    browser.key("0")
    assert texts(browser, ".plot text.end") == values


def test_two_cursors_tell_differences(browser: Browser, pages: dict[str, Path]) -> None:
    shown(browser, pages["good"])
    at = box(browser, f"{MAIN}.querySelector('.plot')")
    inside = browser.run(f"Number({MAIN}.querySelector('.plot > svg > svg').getAttribute('width'))")
    y, left = at["y"] + 100, at["x"] + 62
    clock = "document.querySelector('.bar output').textContent"
    read = []
    for share in (0.5, 0.9):
        x = left + share * inside
        browser.mouse("Moved", x, y)
        browser.mouse("Pressed", x, y, down=True, clicks=1)
        browser.mouse("Released", x, y, clicks=1)
        read.append((float(browser.run(clock).split(" s")[0]), texts(browser, ".legend output")[0]))
    (first, before), (second, after) = read
    shown_pins = (
        "[...document.querySelectorAll('.main .cursor.pinned')].filter("
        "(c) => getComputedStyle(c).display === 'block').length"
    )
    assert browser.run(shown_pins) == 2
    told = float(re.search(r"Δt ([\d.]+) s", browser.run(clock))[1])  # type: ignore[index]
    assert told == pytest.approx(second - first, abs=1.1e-3)
    number = {"−": "-"}
    was = float(before.split()[0].translate(str.maketrans(number)))
    value, change = (float(part.translate(str.maketrans(number))) for part in after.split("Δ"))
    # Both numbers are rounded to a thousandth of the range.
    assert change == pytest.approx(value - was, abs=2e-2)
    browser.run(f"{MAIN}.querySelector('.plot').focus()")
    browser.key("Escape")
    assert browser.run(shown_pins) == 0


def test_a_click_isolates_a_trace_and_shift_takes_one_away(
    browser: Browser, pages: dict[str, Path]
) -> None:
    shown(browser, pages["good"])
    chart = "document.querySelector('[data-chart=\"joint torques\"]')"
    drawn = f"{chart}.querySelectorAll('.plot path.trace').length"
    whole = browser.run(drawn)
    assert whole > 1
    button = f"{chart}.querySelector('.legend button')"
    browser.run(f"{button}.click()")
    assert browser.run(drawn) == 1
    assert browser.run(f"{button}.getAttribute('aria-pressed')") == "true"
    browser.run(f"{button}.click()")
    assert browser.run(drawn) == whole
    shift = "new MouseEvent('click', {shiftKey: true, bubbles: true})"
    browser.run(f"{button}.dispatchEvent({shift})")
    assert browser.run(drawn) == whole - 1
    assert browser.run(f"{button}.getAttribute('aria-pressed')") == "false"


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_chart_is_saved_as_svg_and_png(
    browser: Browser, pages: dict[str, Path], *, dark: bool
) -> None:
    shown(browser, pages["norm"], dark=dark)
    saved = {}
    for form in ("svg", "png"):
        saved[form] = browser.run(
            f"""new Promise((done) => {{
            const made = URL.createObjectURL;
            HTMLAnchorElement.prototype.click = function () {{ window.named = this.download; }};
            URL.createObjectURL = (blob) => {{
                const reader = new FileReader();
                reader.onload = () => done([blob.type, reader.result.split(",")[1], window.named]);
                reader.readAsDataURL(blob);
                return made(blob);
            }};
            document.querySelector(".main [data-save={form}]").click(); }})"""
        )
    kind, content, _ = saved["svg"]
    assert kind == "image/svg+xml"
    text = base64.b64decode(content).decode()
    picture = ET.fromstring(text)
    ns = "{http://www.w3.org/2000/svg}"
    words = " ".join(t.text or "" for t in picture.iter(f"{ns}text"))
    assert "All forces" in words
    assert BROKEN["norm"] in words
    # Colours are written out: nothing in it needs the page.
    assert "var(--" not in text
    assert "class=" not in text
    paths = [p.get("stroke") for p in picture.iter(f"{ns}path")]
    assert len({p for p in paths if p and p.startswith("rgb")}) >= 4
    kind, content, _ = saved["png"]
    assert kind == "image/png"
    image = Image.open(io.BytesIO(base64.b64decode(content))).convert("RGB")
    assert image.width == 2 * round(float(picture.get("width") or 0))
    assert len(image.getcolors(1 << 24) or ()) > 20
    assert (sum(image.getpixel((2, 2))) < 200) is dark  # type: ignore[arg-type]
    assert browser.errors == []

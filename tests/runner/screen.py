"""Pages on the screens that tests look at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from browser import Browser

DESKTOP, PHONE = (1280, 900), (390, 844)


def shown(browser: Browser, page: Path, size: tuple[int, int] = DESKTOP, **media: Any) -> Browser:
    """Opens a page on a screen; `media` is as of `Browser.media`."""
    browser.media(**media)
    browser.size(*size, phone=size == PHONE)
    browser.open(page)
    return browser

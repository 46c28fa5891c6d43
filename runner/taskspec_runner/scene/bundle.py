"""The script of the scene, three.js included, as it is built from `js`."""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
from functools import cache
from pathlib import Path

from markupsafe import Markup

from taskspec_runner.pages.html import element

_HERE = Path(__file__).parent
_STAMP = re.compile(r"taskspec scene of sources ([0-9a-f]{64})")


@cache
def bundle() -> str:
    """The script, which sets `taskspecScene`."""
    return (_HERE / "bundle.js").read_text(encoding="utf-8")


def stamp() -> str:
    """The hash of the sources that the bundle says it was built from; empty without one."""
    found = _STAMP.search(bundle()[:400])
    return found[1] if found else ""


def sources_stamp() -> str:
    """The hash of the sources that there are, as `js/build.mjs` makes it."""
    mark = hashlib.sha256()
    for path in sorted(p for p in (_HERE / "js").iterdir() if p.suffix in (".js", ".json", ".mjs")):
        mark.update(f"{path.name}\0".encode() + path.read_bytes().replace(b"\r\n", b"\n"))
    return mark.hexdigest()


@cache
def packed_bundle() -> Markup:
    """The script as an element that `pages/script/scene.js` unpacks."""
    return packed("scene-code", bundle())


def packed(name: str, content: str) -> Markup:
    """Text as an element of a page, compressed, by its name there."""
    small = gzip.compress(content.encode(), mtime=0)
    return element("script", Markup(base64.b64encode(small).decode()), type="text/plain", id=name)

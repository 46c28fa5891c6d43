"""Links of the pages to files of the repository that are not pages themselves."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping

_FENCE = re.compile(r"(^```.*?^```$)", re.M | re.S)
_LINK = re.compile(r"\]\((?P<target>[^)\s:#]+)(?P<anchor>#[^)]*)?\)")
DOCS = "docs"


def within_site(markdown: str, page: str, places: Mapping[str, str]) -> str:
    """The text of a page whose links beyond `docs/` lead to where the site has those files.

    Args:
        markdown: the page's text. page: its path in the site's sources.
        places: paths in the repository, to those in the site's sources.
    """

    def moved(match: re.Match[str]) -> str:
        here = posixpath.dirname(posixpath.join(DOCS, page))
        target = posixpath.normpath(posixpath.join(here, match["target"]))
        if target not in places:
            return match[0]
        to = posixpath.relpath(posixpath.join(DOCS, places[target]), here)
        return f"]({to}{match['anchor'] or ''})"

    parts = _FENCE.split(markdown)
    parts[::2] = (_LINK.sub(moved, part) for part in parts[::2])
    return "".join(parts)

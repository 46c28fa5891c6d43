"""What site.css needs to let blocks and tables fit the page: columns of a block, heads of cells."""

from __future__ import annotations

import html
import re

_BLOCK = re.compile(r"<pre>(?P<before>(?:<span></span>)?)<code>(?P<code>.*?)</code></pre>", re.S)
_TABLE = re.compile(r"<table>.*?</table>", re.S)
_HEAD, _ROW = re.compile(r"<th\b[^>]*>(.*?)</th>", re.S), re.compile(r"<tr>.*?</tr>", re.S)
_CELL = re.compile(r"<td\b")
_LINKED_NAME = re.compile(r"(?<=<code>)[\w.]+(?=</code></a>)")
_TAG = re.compile(r"<[^>]+>")


def fitted(content: str) -> str:
    """The content of a page; blocks say how many columns they have, cells what stands above them.

    Letters of a block shrink a little before its lines are broken. On a phone a row is a card. In
    tables, names that are links may be broken after underscores.
    """
    return _TABLE.sub(_with_heads, _BLOCK.sub(_with_columns, content))


def _with_heads(table: re.Match[str]) -> str:
    heads = [
        html.escape(html.unescape(_TAG.sub("", h)), quote=True) for h in _HEAD.findall(table[0])
    ]

    def row(found: re.Match[str]) -> str:
        left = iter(heads)
        return _CELL.sub(lambda _: f'<td data-head="{next(left, "")}"', found[0])

    broken = _LINKED_NAME.sub(lambda name: name[0].replace("_", "_<wbr>"), table[0])
    return _ROW.sub(row, broken)


def _with_columns(block: re.Match[str]) -> str:
    text = html.unescape(_TAG.sub("", block["code"]))
    columns = max((len(line.rstrip()) for line in text.splitlines()), default=0)
    return (
        f'<pre style="--columns:{max(columns, 1)}">{block["before"]}'
        f"<code>{block['code']}</code></pre>"
    )

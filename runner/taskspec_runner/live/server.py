"""A server of pages for who sits at this machine, and has been given the address."""

from __future__ import annotations

import contextlib
import hmac
import json
import secrets
import sys
import threading
import webbrowser
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Self
from urllib.parse import unquote, urlsplit

from taskspec.regular_file import open_regular
from taskspec_runner.errors import InputError
from taskspec_runner.headless import has_screen
from taskspec_runner.live.channel import Channel
from taskspec_runner.record.folder import parse_json

#: Nobody from another machine reaches it.
LOOPBACK = "127.0.0.1"
#: The name under which a page has the messages of the channel.
EVENTS = "events"
#: A reader without news gets a sign of life after so long, so that one who has gone is noticed [s].
_SILENCE = 1.0
#: A browser that takes nothing for so long is given up [s].
_PATIENCE = 10.0
#: Bytes of a request to set something, at most.
_LONGEST = 4096
#: Pages that are open get the last messages within so long [s].
_FAREWELL = 0.5
#: A page runs its own script and no other, and reaches nothing but this server.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class RefusedError(Exception):
    """What a page has requested cannot be; `conflict` where it is too late for it."""

    def __init__(self, text: str, *, conflict: bool = False) -> None:
        super().__init__(text)
        self.status = HTTPStatus.CONFLICT if conflict else HTTPStatus.UNPROCESSABLE_ENTITY


class PageServer:
    """Serves pages below a random path on loopback until it is closed.

    A page has the messages of the channel as server-sent events, and may have requests of its own
    taken, which are JSON. Whoever does not know the path is refused, and so is a request to another
    host name, with which a page of the web would come that has had its own name point here, and one
    that the page of another origin makes.

    Attributes:
        channel: messages to the pages.
        takes: what answers requests of pages, by their names.
        folder: pages in and below it are served, too; None for none.
        url: of the first page.
    """

    def __init__(
        self,
        pages: Mapping[str, Callable[[], str]],
        channel: Channel,
        *,
        takes: Mapping[str, Callable[[Any], Any]] | None = None,
        folder: Path | None = None,
        port: int = 0,
    ) -> None:
        """Begins to serve.

        Args:
            pages: what each page is, by its name below the path; the first page has an empty one.
            channel: messages to the pages.
            takes: what answers requests of pages, by their names below the path: of JSON by JSON,
                or a `RefusedError`; it is called in threads of the server.
            folder: as above.
            port: 0 for any that is free.

        Raises:
            InputError: the port cannot be had.
        """
        self.channel, self.folder, self._pages = channel, folder, dict(pages)
        self.takes = dict(takes or {})
        self._token = secrets.token_urlsafe(24)
        try:
            self._server = _Server((LOOPBACK, port), self)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(
                f"cannot serve a page at port {port}: {reason}; leave out --port for any port that "
                "is free"
            ) from error
        self.port = int(self._server.server_address[1])
        self.url = f"http://{LOOPBACK}:{self.port}/{self._token}/"
        # Ends are looked for often: `close` waits for it.
        serve = lambda: self._server.serve_forever(poll_interval=0.05)  # noqa: E731
        threading.Thread(target=serve, name="pages", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends; pages that are open have the messages that there are before."""
        self.channel.close(_FAREWELL)
        self._server.shutdown()
        self._server.server_close()

    def wait(self) -> None:
        """Serves until Ctrl-C."""
        with contextlib.suppress(KeyboardInterrupt):
            print("Ctrl-C ends the page", file=sys.stderr, flush=True)  # noqa: T201
            threading.Event().wait()

    def knows(self, host: str) -> bool:
        """Whether a request is to this server by its own name."""
        return host in (f"{LOOPBACK}:{self.port}", f"localhost:{self.port}")

    def within(self, path: str) -> str | None:
        """What a path names below that of the server; None of a path without its token."""
        _, token, *rest = [*path.split("/", 2), ""]
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return None
        return unquote(rest[0])

    def page(self, name: str) -> bytes | None:
        """A page; None where there is none of this name."""
        if name in self._pages:
            return self._pages[name]().encode()
        if self.folder is None:
            return None
        try:
            root = self.folder.resolve()
            path = (root / name).resolve()
            if path.suffix != ".html" or not path.is_relative_to(root):
                return None
            with open_regular(path) as file:
                return file.read()
        except (OSError, ValueError):
            return None


class _Server(ThreadingHTTPServer):
    """The server with what it serves; threads of who is slow do not keep the process."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, address: tuple[str, int], pages: PageServer) -> None:
        self.pages = pages
        super().__init__(address, _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Browsers go away at any time, which is no trouble of a run."""


class _Handler(BaseHTTPRequestHandler):
    """One request."""

    server: _Server
    timeout = _PATIENCE
    server_version, sys_version = "taskspec", ""

    def do_GET(self) -> None:
        pages, name = self.server.pages, self._named()
        if name is None:
            return
        if name == EVENTS:
            self._events(pages.channel)
        elif (content := pages.page(name)) is None:
            self.send_error(HTTPStatus.NOT_FOUND, "There is no such page")
        else:
            self._begin("text/html; charset=utf-8")
            self.wfile.write(content)

    def do_POST(self) -> None:
        pages = self.server.pages
        if not pages.takes:
            self.send_error(HTTPStatus.NOT_IMPLEMENTED, "These pages are read")
            return
        name = self._named()
        if name is None:
            return
        if name not in pages.takes:
            self.send_error(HTTPStatus.NOT_FOUND, "Nothing here takes a request")
            return
        body = self._body()
        if body is None:
            return
        try:
            answer = pages.takes[name](parse_json(body))
        except RefusedError as error:
            self._answer(error.status, {"error": str(error)})
        except (ValueError, RecursionError):
            self._answer(HTTPStatus.BAD_REQUEST, {"error": "this is no JSON"})
        else:
            self._answer(HTTPStatus.OK, answer)

    def _named(self) -> str | None:
        """What the request is to, below the path; None after refusing it."""
        pages = self.server.pages
        if not pages.knows(self.headers.get("Host", "")):
            self.send_error(HTTPStatus.FORBIDDEN, "This is another host")
            return None
        name = pages.within(urlsplit(self.path).path)
        if name is None:
            self.send_error(HTTPStatus.FORBIDDEN, "The address lacks its token")
        return name

    def _body(self) -> bytes | None:
        """The body of a request of our own page; None after refusing it."""
        scheme, _, host = self.headers.get("Origin", "").partition("://")
        length = self.headers.get("Content-Length", "")
        # Programs have no origin; browsers always name that of the page.
        if "Origin" in self.headers and not (scheme == "http" and self.server.pages.knows(host)):
            self.send_error(HTTPStatus.FORBIDDEN, "This is a page of another origin")
        elif self.headers.get_content_type() != "application/json":
            # Only for this type a browser asks before it sends what another origin has.
            self.send_error(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "A request is application/json")
        elif not (length.isascii() and length.isdecimal()):
            self.send_error(HTTPStatus.LENGTH_REQUIRED, "A request has a length")
        elif len(length) > len(str(_LONGEST)) or int(length) > _LONGEST:
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "The request is too long")
        else:
            return self.rfile.read(int(length))
        return None

    def _answer(self, status: HTTPStatus, data: Any) -> None:
        self._begin("application/json", status)
        self.wfile.write(json.dumps(data).encode())

    def _events(self, channel: Channel) -> None:
        """All messages as they come, from the one after that which the page had last."""
        self._begin("text/event-stream")
        last = self.headers.get("Last-Event-ID", "")
        number = int(last) if last.isdecimal() else 0
        with channel.reader():
            while messages := channel.after(number, _SILENCE) or not channel.closed:
                if messages is True:
                    self.wfile.write(b":\n\n")
                    continue
                number = messages[-1].number
                self.wfile.write(
                    "".join(
                        f"id: {m.number}\nevent: {m.kind}\ndata: {m.text}\n\n" for m in messages
                    ).encode()
                )

    def _begin(self, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Requests are not written to the terminal."""


def announce(url: str) -> bool:
    """Prints where a page is, on standard error; returns whether a browser opens it."""
    # By itself in its line, so that a terminal makes a link of it.
    print(url, file=sys.stderr, flush=True)  # noqa: T201
    if not has_screen():
        return False
    with contextlib.suppress(webbrowser.Error):
        browser = webbrowser.get()
        # A generic one would take the terminal.
        return type(browser) is not webbrowser.GenericBrowser and browser.open(url)
    return False

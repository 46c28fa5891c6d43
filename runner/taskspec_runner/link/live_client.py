"""Sets live params of a run that goes on in another process of this machine."""

from __future__ import annotations

import json
import socket
from typing import Any, Self
from urllib.parse import urlsplit

from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.record.folder import parse_json

#: A request without an answer is sent again after so long [s].
_AGAIN = 0.1
_LONGEST = 8192


class LiveClient:
    """Sends requests to a run that takes them: `taskspec run FILE --live udp://127.0.0.1:PORT`."""

    def __init__(self, url: str, *, patience: float = 2.0) -> None:
        """Takes the address that the run has printed, and how long an answer is waited for [s].

        Raises:
            InputError: it is no such address.
        """
        parts = urlsplit(url)
        self._url, self._token, self._patience = url, parts.path.strip("/"), patience
        if parts.scheme != "udp" or not parts.hostname or not parts.port or not self._token:
            raise InputError(f"a run says udp://127.0.0.1:PORT/TOKEN, not {url!r}")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(_AGAIN)
        self._socket.connect((parts.hostname, parts.port))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def set(self, **values: float | str) -> dict[str, dict[str, Any]]:
        """Sets params, all or none, from the next look of the run on.

        Args:
            values: by name, in SI units or as a text such as `8 N`.

        Returns:
            All live params: `value`, `target`, `low`, `high` [SI] and `unit`.

        Raises:
            InputError: the run does not take a value, and why.
            LinkError: nobody answers.
        """
        request = json.dumps({"token": self._token, "set": values}).encode()
        for _ in range(max(round(self._patience / _AGAIN), 1)):
            try:
                self._socket.send(request)
                answer = dict(parse_json(self._socket.recv(_LONGEST)))
            except (TimeoutError, ConnectionRefusedError, ValueError):
                continue
            if "error" in answer:
                raise InputError(str(answer["error"]))
            return dict(answer["params"])
        raise LinkError("no_answer", f"no run answers at {self._url}; is it still running?")

    def read(self) -> dict[str, dict[str, Any]]:
        """All live params, as `set` has them; nothing is set."""
        return self.set()

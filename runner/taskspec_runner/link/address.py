"""Address of a robot or a plant: `udp://HOST:PORT`."""

from __future__ import annotations

import ipaddress
from urllib.parse import urlsplit

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError

_FORM = "udp://HOST:PORT, such as udp://127.0.0.1:39017"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A host and a port; port 0 is any that is free."""

    host: str
    port: int

    @property
    def text(self) -> str:
        """The address as it is written."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"udp://{host}:{self.port}"

    @property
    def loopback(self) -> bool:
        """Whether nobody but this machine reaches it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False


def read_endpoint(text: str, option: str, *, any_port: bool = False) -> Endpoint:
    """An address `udp://HOST:PORT`.

    Args:
        text: as it was written.
        option: that it is of, for the message.
        any_port: whether port 0 stands for any that is free.

    Raises:
        InputError: it is none.
    """
    wrong = InputError(f"{option} needs {_FORM}, not {text!r}")
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError as error:
        raise wrong from error
    rest = parts.path.strip("/") or parts.query or parts.fragment or parts.username
    if parts.scheme != "udp" or not parts.hostname or rest or port is None:
        raise wrong
    if port == 0 and not any_port:
        raise wrong
    return Endpoint(parts.hostname, port)

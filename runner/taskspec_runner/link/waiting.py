"""Waiting for a datagram, to the microsecond."""

from __future__ import annotations

import select
import socket
from typing import Any

from taskspec_runner.link.packets import LONGEST


def received(listening: socket.socket, seconds: float) -> tuple[bytes, Any] | None:
    """The next datagram and who sent it; None if none comes in some seconds.

    One that is there already is taken also when there is no time to wait.

    Args:
        listening: that does not block.
        seconds: to wait at most.

    Raises:
        OSError: what was sent did not arrive, as nobody listens there.
    """
    # A socket's own timeout is rounded up to a millisecond: a whole period.
    if not select.select([listening], [], [], max(seconds, 0.0))[0]:
        return None
    try:
        return listening.recvfrom(LONGEST + 1)
    except BlockingIOError:
        return None

"""The robot that an address names: UDP, or whatever entry points know."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points

from taskspec.text.suggest import suggestion
from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.link.robot import CommandedRobot
from taskspec_runner.link.udp_robot import UdpRobot

#: Entry points: scheme to a function of the whole address that gives a `CommandedRobot`.
GROUP = "taskspec.robots"
_UDP = "udp"


def open_robot(url: str, say: Callable[[str], None] | None = None) -> CommandedRobot:
    """The robot of an address, connected.

    Args:
        url: `SCHEME://...`; `udp` is built in, others are entry points of `taskspec.robots`.
        say: reports that it is waited for.

    Raises:
        InputError: there is no such scheme, or no robot there.
    """
    scheme, separator, _ = url.partition("://")
    if scheme == _UDP or not separator:
        return UdpRobot(url, say=say)
    known = {point.name: point for point in entry_points(group=GROUP)}
    if scheme not in known:
        hint = suggestion(scheme, [_UDP, *known], "schemes")
        raise InputError(
            f"no robot is known as {scheme!r}; {hint}; a package adds one by an entry point of the "
            f"group {GROUP!r}"
        )
    try:
        robot: CommandedRobot = known[scheme].load()(url)
    except (InputError, KeyboardInterrupt):
        raise
    except LinkError as error:
        raise InputError(f"{url} cannot be reached: {error.text}") from error
    except Exception as error:
        value = known[scheme].value
        raise InputError(
            f"{url} cannot be opened: {value} of the entry point {scheme!r} failed with "
            f"{type(error).__name__}: {error}"
        ) from error
    return robot

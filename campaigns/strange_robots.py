"""Robots that send any value: what becomes of a run on one.

A robot is its seed. Nothing is sent but values that the packets and the JSON of docs/protocol.md
can have; what is promised is that a run refuses them, stops by name, or goes on.
"""

from __future__ import annotations

import json
import random
import shutil
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from meeting import TOUCH, ClockedRobot, drive, program_of

from taskspec_runner.errors import InputError
from taskspec_runner.link import packets
from taskspec_runner.link.packets import Packet
from taskspec_runner.link.robot import Sample
from taskspec_runner.link.server import ServerOptions, welcome
from taskspec_runner.link.udp_robot import UdpRobot

#: How long a robot may keep a run from its end [s]; how often one that takes longer is tried, as
#: a busy computer may be what took it.
PATIENCE, TRIES = 10.0, 3
_VALUES: tuple[Any, ...] = (
    *(10**400, -(10**400), 10**200, 1e308, 5e-324, -1.0, 0, 1, True, None),
    *("", "\ud800", "a\n\x07\x1b[2J", "x" * 3000, [], {}, [[1]], [10**400] * 2, [None] * 99),
)
_STAMPS = (0.0, -0.0, 1e-300, 1e308, -1e308, 1e15, -1.0, 0.01, 0.011, 1e3, float("inf"))


def _changed(dice: random.Random) -> bytes:
    """A welcome with other values in one to three places."""
    made = json.loads(json.dumps(welcome(program_of(TOUCH), ServerOptions())))
    for _ in range(dice.choice((1, 1, 2, 3))):
        holder = made
        while True:
            key = dice.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
            inner = holder[key]
            if not isinstance(inner, dict | list) or not inner or dice.random() < 0.4:
                break
            holder = inner
        holder[key] = dice.choice(_VALUES)
        if not isinstance(made, dict) or not made:
            break
    return json.dumps(made).encode()[: packets.LONGEST - 40]


def a_welcome(seed: int, _: Path) -> str:
    """What is wrong with what a controller makes of a welcome; empty if nothing is."""
    body = _changed(random.Random(seed))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plant:
        plant.bind(("127.0.0.1", 0))
        plant.settimeout(PATIENCE)

        def reply() -> None:
            _, peer = plant.recvfrom(65535)
            plant.sendto(Packet(packets.WELCOME, 1, 0, 0.0, body).to_bytes(), peer)

        thread = threading.Thread(target=reply)
        thread.start()
        try:
            robot = UdpRobot(f"udp://127.0.0.1:{plant.getsockname()[1]}", patience=0.2)
            texts = [robot.facts.name, *robot.facts.joints]
            robot._socket.close()
        except InputError as error:
            texts = str(error).splitlines()
        except Exception as error:
            return repr(error)
        finally:
            thread.join()
    return "" if all(map(str.isprintable, texts)) else f"not printable: {texts!r}"


class _Strange(ClockedRobot):
    """A robot whose stamps are others from some sample on, which come at a pace of its own."""

    def __init__(self, strange: Callable[[Sample], None], first: int) -> None:
        super().__init__(program_of(TOUCH))
        self._strange, self._first, self._read = strange, first, 0

    def read(self) -> Sample:
        sample = super().read()
        self._read += 1
        if self._read > self._first:
            self._strange(sample)
        return sample


def stamps(seed: int, folder: Path) -> str:
    """What is wrong with a run on a robot of other stamps; empty if nothing is."""
    took = 0.0
    for _ in range(TRIES):
        wrong, took = _stamped(seed, folder)
        if wrong or took <= PATIENCE:
            return wrong
    return f"it took {took:.1f} s, and no less in {TRIES} tries"


def _stamped(seed: int, folder: Path) -> tuple[str, float]:
    """What is wrong with a run by itself, and how long it took [s]."""
    dice = random.Random(seed)
    own = [dice.choice(_STAMPS) for _ in range(dice.choice((1, 2, 5)))]
    pace = dice.choice((0.0, 0.0, 0.01))

    def strange(sample: Sample) -> None:
        time.sleep(pace)
        sample.stamp = dice.choice(own) + dice.choice((0.0, sample.stamp))

    began = time.monotonic()
    try:
        run = drive(TOUCH, _Strange(strange, dice.randrange(200)), folder)
    except Exception as error:
        return repr(error), 0.0
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    took, reason = time.monotonic() - began, run.summary["ending"]["reason"]
    well = run.exit_code in (0, 1, 4, 6) and reason
    return "" if well else f"{run.exit_code} {reason!r}", took

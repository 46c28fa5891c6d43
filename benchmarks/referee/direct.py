"""A served plant and a law in one process: the samples and answers of the protocol, and no network.

What a run leaves is, byte for byte, what it leaves by UDP in lock-step.
"""

from __future__ import annotations

from pathlib import Path

from referee.session import Answers, Law
from taskspec.program.program import Program
from taskspec_runner.link import packets
from taskspec_runner.link.packets import Packet, StateBody
from taskspec_runner.link.server import PlantServer, Served, ServerOptions, welcome
from taskspec_runner.session import execute_program


class Direct(PlantServer):
    """The server of a plant whose controller is a law at hand.

    Attributes:
        answers: to what it has sent.
    """

    def __init__(self, law: Law, name: str, program: Program, options: ServerOptions) -> None:
        told = welcome(program, options)
        self.answers = Answers(law, told)
        # As a server has them that has welcomed somebody.
        self._takes, self._joints = (
            told["robot"].get("command", "torque"),
            len(told["robot"]["joints"]),
        )
        self._grips = told.get("grips", False)
        self.client, self.rejected = name, 0
        self._newest, self._answer, self._answered = -1, b"", True

    def send(self, number: int, stamp: float, state: StateBody) -> None:  # noqa: ARG002
        """Has a state answered."""
        if number > self._newest:
            self._newest, self._answer = number, self.answers.to(state.to_bytes())
        self._answered = False

    def receive(self, until: float) -> Packet | None:  # noqa: ARG002
        """The answer to what was sent last, once."""
        if self._answered:
            return None
        self._answered = True
        return Packet(packets.COMMAND, 0, self._newest, 0.0, self._answer)

    def say_stop(self, text: str) -> None:
        """Nobody is there to whom it matters."""

    def close(self) -> None:
        """It has no socket."""

    @property
    def client_came(self) -> bool:
        """A law at hand is there from the beginning."""
        return True

    @property
    def closed(self) -> bool:
        """It has nothing that closes."""
        return False


def driven(law: Law, name: str, program: Program, folder: Path) -> list[float]:
    """Has a law drive the plant of a task; the processor time of each of its answers [s].

    Args:
        law: that answers.
        name: for the summary.
        program: the task's.
        folder: of the run that it leaves.
    """
    options = ServerOptions()
    server = Direct(law, name, program, options)
    execute_program(program, folder, report=False, link=Served(server, options))
    return server.answers.taken

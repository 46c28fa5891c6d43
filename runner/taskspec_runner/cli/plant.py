"""`taskspec plant`: a task's plant as a server, and the verdict on who drove it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taskspec.deferred_methods import dataclass
from taskspec_runner.cli.formats import OutcomeFormat
from taskspec_runner.cli.run import run_task
from taskspec_runner.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from taskspec.program.program import Program
    from taskspec_runner.link.address import Endpoint
    from taskspec_runner.link.link import Link


@dataclass(frozen=True, slots=True)
class Listening:
    """Options of a served plant, as a command line has them.

    Attributes:
        url: where it listens.
        open: whether other machines may reach it.
        free_running: whether it goes on at the wall clock.
        stop_after: samples in a row that may go without an answer.
        wait, answer: how long a controller is waited for, and an answer of it in lock-step [s].
    """

    url: str
    open: bool
    free_running: bool
    stop_after: int
    wait: float
    answer: float

    def endpoint(self) -> Endpoint:
        """Where it listens.

        Raises:
            InputError: that is no address, or others reach it without leave.
        """
        from taskspec_runner.link.address import read_endpoint

        found = read_endpoint(self.url, "--listen", any_port=True)
        if not found.loopback and not self.open:
            raise InputError(
                f"{found.text} may be reached from other machines, and who answers first drives "
                "the plant; listen at udp://127.0.0.1:PORT, or add --open to mean it"
            )
        return found

    def check(self, **_: object) -> None:
        """Finds out what can be known before anything is read.

        Raises:
            InputError: the address is none.
        """
        self.endpoint()

    def link(self, program: Program, say: Callable[[str], None] | None) -> Link:
        """Listens, and waits for a controller.

        Raises:
            InputError: it cannot listen, or nobody comes.
        """
        from taskspec_runner.link.server import PlantServer, Served, ServerOptions, welcome

        options = ServerOptions(self.free_running, self.stop_after, self.wait, self.answer)
        server = PlantServer(self.endpoint())
        if say is not None:
            say(f"{program.context.loaded.task.name}: listening at {server.endpoint.text}")
        try:
            server.wait(welcome(program, options), self.wait, say)
        except BaseException:
            server.close()
            raise
        return Served(server, options)


def serve_plant(
    file: Path,
    sets: Sequence[str],
    law: str | None,
    listening: Listening,
    *,
    seed: int,
    world: str | None,
    out: Path | None,
    telemetry: str | None,
    quiet: bool,
    form: OutcomeFormat,
    force: bool,
) -> int:
    """Serves the plant of a task file for one run, and reports how the run went."""
    return run_task(
        file,
        sets,
        law,
        seed,
        out,
        telemetry,
        quiet=quiet,
        form=form,
        force=force,
        world=world,
        on=listening,
    )

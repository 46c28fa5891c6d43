"""`taskspec plant`: a task's plant as a server, for a run that somebody else drives."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from taskspec.deferred_methods import dataclass
from taskspec_runner.cli.options import PlantOptions
from taskspec_runner.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from taskspec.program.program import Program
    from taskspec_runner.link.address import Endpoint
    from taskspec_runner.link.link import Link


@dataclass(frozen=True, slots=True)
class Listening:
    """A served plant, and the controller that drives it."""

    served: PlantOptions

    def endpoint(self) -> Endpoint:
        """Where it listens.

        Raises:
            InputError: that is no address, or others reach it without leave.
        """
        from taskspec_runner.link.address import read_endpoint

        found = read_endpoint(self.served.listen, "--listen", any_port=True)
        if not found.loopback and not self.served.open:
            raise InputError(
                f"{found.text} may be reached from other machines, and who answers first drives "
                "the plant; listen at udp://127.0.0.1:PORT, or add --open to mean it"
            )
        return found

    def check(self, _: Mapping[str, object]) -> None:
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
        from taskspec_runner.link import server as link

        served = self.served
        options = link.ServerOptions(
            served.free_running, served.stop_after, served.wait, served.answer
        )
        server = link.PlantServer(self.endpoint())
        if not server.endpoint.loopback:
            typer.echo(
                f"taskspec: --open: whoever reaches {server.endpoint.text} over the network, "
                "without a password, may drive the simulated plant, and end its run",
                err=True,
            )
        if say is not None:
            say(f"{program.context.loaded.task.name}: listening at {server.endpoint.text}")
        try:
            server.wait(link.welcome(program, options), served.wait, say)
        except BaseException:
            server.close()
            raise
        return link.Served(server, options)

"""The command `taskspec` as processes of its own that need not load their libraries each time.

A server has loaded them, and forks for every call. The process of a call has the caller's
arguments, folder, environment and streams, and ends with the command's exit code.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Of the caller: hands everything over and waits for the exit code. It loads next to nothing.
_CLIENT = """\
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as ours:
    ours.connect({path!r})
    given = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(ours, [len(given).to_bytes(4, "big")], [0, 1, 2])
    ours.sendall(given)
    said = ours.recv(1)
sys.exit(said[0] if said else 70)
"""


@contextmanager
def command(folder: Path) -> Iterator[str]:
    """A shell's words for the command, as long as its server is there.

    Args:
        folder: an empty one, for the socket and the script.
    """
    path, script = folder / "socket", folder / "client.py"
    script.write_text(_CLIENT.format(path=str(path)), encoding="utf-8")
    server = subprocess.Popen([sys.executable, __file__, path], stdout=subprocess.PIPE)
    try:
        assert server.stdout is not None
        assert server.stdout.readline() == b"ready\n"
        yield f'"{sys.executable}" -I -S "{script}"'
    finally:
        server.kill()
        server.communicate()


def _serve(path: str) -> None:
    from taskspec import compiler  # noqa: F401
    from taskspec_runner import session  # noqa: F401
    from taskspec_runner.cli.entry import run

    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(path)
        listening.listen()
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        while True:
            theirs, _ = listening.accept()
            if os.fork() == 0:
                listening.close()
                _call(run, theirs)
            theirs.close()
            while _reaped():
                pass


def _reaped() -> bool:
    try:
        return os.waitpid(-1, os.WNOHANG)[0] != 0
    except ChildProcessError:
        return False


def _call(main: object, theirs: socket.socket) -> None:
    """Becomes the command that the caller wants; it does not return."""
    size, streams, _, _ = socket.recv_fds(theirs, 4, 3)
    given = b""
    while len(given) < int.from_bytes(size, "big"):
        given += theirs.recv(1 << 16)
    arguments, folder, environment = json.loads(given)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = ["taskspec", *arguments]
    code = 0
    try:
        main()  # type: ignore[operator]
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        theirs.sendall(bytes([code]))
        os._exit(code)


if __name__ == "__main__":
    _serve(sys.argv[1])

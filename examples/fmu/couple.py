"""A task's FMU and the plant that `taskspec plant` serves, coupled by FMPy.

    taskspec export tasks/wipe-table.yaml --fmu wipe_table.fmu
    taskspec plant tasks/wipe-table.yaml --listen udp://127.0.0.1:39017
    python examples/fmu/couple.py wipe_table.fmu 39017

Controller first, then plant: the commands of a sample are applied from its time on.
It knows nothing of taskspec: of the FMU what its modelDescription.xml says, of the plant what
docs/protocol.md says, as the client beside it.
"""

import json
import socket
import struct
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave

sys.path.append(str(Path(__file__).resolve().parents[1] / "plant"))
from client import BODY, COMMAND, HELLO, QUANTITIES, STATE, STOP, WELCOME, packet, read

START = 1  # flag of the first sample, whose answer is not applied


class Controller:
    """An instance of the FMU, which takes samples and answers them with commands."""

    def __init__(self, path, folder):
        """Instantiates it, extracted to a folder."""
        about = read_model_description(path)
        references = {v.name: v.valueReference for v in about.modelVariables}
        sample = ("position.", "velocity.", "wrench.", "reaction.", "gripper.force", "gripper.slip")
        self.inputs = [references[name] for name in references if name.startswith(sample)]
        commands = [name for name in references if name.startswith(("torque.", "command."))]
        jaws = [name for name in references if name == "gripper.command"]
        self.commands, self.grips = [references[name] for name in commands + jaws], len(jaws)
        # torque.JOINT, or command.velocity.JOINT, command.position.JOINT
        quantity = commands[0].removeprefix("command.").partition(".")[0]
        self.quantity = QUANTITIES.index(quantity)
        self.period, self.time = float(about.coSimulation.fixedInternalStepSize), 0
        identifier = about.coSimulation.modelIdentifier
        self.fmu = FMU3Slave(
            guid=about.instantiationToken,
            unzipDirectory=extract(path, folder),
            modelIdentifier=identifier,
            instanceName=identifier,
        )
        self.fmu.instantiate()

    def answer(self, sample, start):
        """(n,) commands for positions, velocities, wrench and reactions, one after the other.

        The last one is of the gripper where there is one.
        """
        if start:
            self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.setFloat64(self.inputs, sample)
        if start:
            self.fmu.exitInitializationMode()
        else:
            self.fmu.doStep(self.time * self.period, self.period)
            self.time += 1
        return np.array(self.fmu.getFloat64(self.commands))

    def close(self):
        """Ends it."""
        self.fmu.terminate()
        self.fmu.freeInstance()


def main(controller, port):
    """Couples a controller and the plant at a port of this machine until it says stop."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", port))
        link.settimeout(0.5)
        kind = session = 0
        while kind != WELCOME:
            link.send(packet(HELLO, 0, 0, json.dumps({"client": "couple.py"}).encode()))
            try:
                kind, session, _, body = read(link.recv(16384))
            except (TimeoutError, ConnectionRefusedError):
                continue
        link.settimeout(30.0)
        newest, answer = -1, b""
        while kind != STOP:
            kind, _, number, body = read(link.recv(16384))
            if kind == STATE and number > newest:
                flags, _, n, m, *_ = BODY.unpack_from(body)
                sample = np.frombuffer(body, "<f8", 2 * n + 6 + m, BODY.size)
                command = controller.answer(sample, flags & START)
                head = struct.pack("<HBBI", controller.quantity, n, controller.grips, 0)
                newest, answer = number, head + command.tobytes()
            if kind == STATE:  # one that comes again is answered again
                link.send(packet(COMMAND, session, number, answer))
        print("the plant says:", body.decode())


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        controller = Controller(sys.argv[1], folder)
        main(controller, int(sys.argv[2]))
        controller.close()

"""A controller of one's own for `taskspec plant`: a Cartesian spring with a force on top.

    taskspec plant tasks/wipe-table.yaml --listen udp://127.0.0.1:39017
    python examples/plant/client.py 39017

An arm that takes velocities or positions follows the set points, and yields to forces:

    taskspec plant tasks/wipe-table.yaml --set robot.command=velocity --set law=admittance

It knows nothing of taskspec: sockets, struct and NumPy. docs/protocol.md has every byte.
"""

import json
import socket
import struct
import sys
import zlib

import numpy as np

HELLO, WELCOME, STATE, COMMAND, STOP = 1, 2, 3, 4, 5
HEAD, BODY = struct.Struct("<4sBBHIId"), struct.Struct("<HHBBHIId")
SPRING = np.array([8000.0] * 3 + [40.0] * 3)  # N/m, N*m/rad, in the axes of the stage's frame
DAMPER = np.array([250.0] * 3 + [2.0] * 3)  # N*s/m, N*m*s/rad
INTEGRAL, JOINTS = 10.0, 0.3  # of the force, 1/s; damping of the joints, N*m*s/rad
FOLLOWING = 8.0  # how fast velocities take an error of position away, 1/s
YIELDING = np.array([8e-4] * 3 + [0.05] * 3)  # velocity by force, m/s/N, rad/s/(N*m)
QUANTITIES = ("torque", "velocity", "position")  # as a command's first number has them


def packet(kind, session, number, body):
    """The bytes of a packet."""
    data = HEAD.pack(b"TSPK", 1, kind, HEAD.size + len(body) + 4, session, number, 0.0) + body
    return data + struct.pack("<I", zlib.crc32(data))


def read(data):
    """Kind, session, number and body of a packet; kind 0 of what is none."""
    magic, version, kind, size, session, number, _ = HEAD.unpack_from(data)
    good = magic == b"TSPK" and version == 1 and size == len(data)
    good = good and zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
    return (kind, session, number, data[HEAD.size : -4]) if good else (0, 0, 0, b"")


def law(v, extras, memory, period):
    """(n,) joint torques Jt w + g: w is a spring to the reference, or the force that is wanted."""
    J, frame = (extras[name].reshape(-1, c).T for name, c in (("jacobian", 6), ("frame", 3)))
    off = np.nan_to_num(extras["position_ref"] - extras["position"])
    rate = np.nan_to_num(extras["velocity_ref"]) - np.nan_to_num(extras["velocity"])
    wanted, force = extras["force_ref"], np.nan_to_num(extras["force"])
    on_force = np.isfinite(wanted)
    memory[:] = np.where(on_force, memory + period * INTEGRAL * (wanted - force), 0.0)
    w = np.where(on_force, np.nan_to_num(wanted) + memory, SPRING * off) + DAMPER * rate
    w = np.concatenate([frame @ w[:3], frame @ w[3:]])
    return J.T @ w + extras["gravity"] - JOINTS * v


def rates(extras):
    """(n,) joint velocities that lead the tool along its references, and by the force it lacks."""
    J, frame = (extras[name].reshape(-1, c).T for name, c in (("jacobian", 6), ("frame", 3)))
    off = np.nan_to_num(extras["position_ref"] - extras["position"])
    wanted, force = extras["force_ref"], np.nan_to_num(extras["force"])
    led = np.nan_to_num(extras["velocity_ref"]) + FOLLOWING * off
    v = np.where(np.isfinite(wanted), YIELDING * (np.nan_to_num(wanted) - force), led)
    return np.linalg.pinv(J) @ np.concatenate([frame @ v[:3], frame @ v[3:]])


def main(port):
    """Drives the plant at a port of this machine until it says stop."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", port))
        link.settimeout(0.5)
        kind = session = told = 0
        while kind != WELCOME:
            link.send(packet(HELLO, 0, 0, json.dumps({"client": "client.py"}).encode()))
            try:
                kind, session, _, body = read(link.recv(16384))
            except (TimeoutError, ConnectionRefusedError):
                continue
        told, memory, newest, answer = json.loads(body), np.zeros(6), -1, b""
        link.settimeout(30.0)  # the plant may prepare its run before it sends
        takes, place = told["robot"].get("command", "torque"), None
        while kind != STOP:
            kind, _, number, body = read(link.recv(16384))
            if kind == STATE and number > newest:
                _, _, n, m, *_ = BODY.unpack_from(body)
                values = np.frombuffer(body, "<f8", offset=BODY.size)
                q, v, values = values[:n], values[n : 2 * n], values[2 * n + 6 + m :]
                ends = np.cumsum([length for _, length in told["extras"]])[:-1]
                names = [name for name, _ in told["extras"]]
                extras = dict(zip(names, np.split(values, ends), strict=True))
                if takes == "torque":
                    command = law(v, extras, memory, told["period"])
                else:
                    command = rates(extras)
                if takes == "position":  # the sum of the velocities, from where the arm starts
                    place = q if place is None else place + told["period"] * command
                    command = place
                head = struct.pack("<HBBI", QUANTITIES.index(takes), n, 0, 0)
                newest, answer = number, head + command.tobytes()
            if kind == STATE:  # one that comes again is answered again
                link.send(packet(COMMAND, session, number, answer))
        print("the plant says:", body.decode())


if __name__ == "__main__":
    main(int(sys.argv[1]))

"""Paths into a file: what no model has cannot be written."""

from __future__ import annotations

import copy
import pickle

import pytest

from taskspec.spec import FILE, KeyPath, below, key_of
from taskspec.spec.key_path import UnknownKeyError, is_key, steps_of

AXIS = FILE.stages["press"].axes["z"]


@pytest.mark.parametrize(
    ("path", "steps"),
    [
        (FILE, ()),
        (AXIS.force, ("stages", "press", "axes", "z", "force")),
        (AXIS["torque"], ("stages", "press", "axes", "z", "torque")),
        (FILE.robot.sensor.noise.force, ("robot", "sensor", "noise", "force")),
        (FILE.world["table"].xyz[2], ("world", "table", "xyz", 2)),
        (FILE.world["door"].knob, ("world", "door", "knob")),
        (FILE.world["rim"].equation, ("world", "rim", "equation")),
        (FILE.law.stiffness["angular"], ("law", "stiffness", "angular")),
        (FILE.law.force.integral.z, ("law", "force", "integral", "z")),
        (FILE.expect[1], ("expect", 1)),
        (FILE.vary["world.table.xyz"][0], ("vary", "world.table.xyz", 0)),
        (
            FILE.stages["press"].constraints["rim"].ramp,
            ("stages", "press", "constraints", "rim", "ramp"),
        ),
        (below(FILE.robot, "start", "xyz"), ("robot", "start", "xyz")),
    ],
    ids=str,
)
def test_a_key_of_the_language_makes_a_path(path: KeyPath, steps: tuple[str | int, ...]) -> None:
    assert steps_of(path) == steps
    assert not is_key(path)
    assert is_key(key_of(path))
    assert steps_of(key_of(path)) == steps


@pytest.mark.parametrize(
    ("path", "keys"),
    [
        (FILE, ["nothing"]),
        (FILE.stages["press"], ["axis"]),
        (AXIS, ["velocty"]),
        (FILE.stages, [0]),
        (FILE.expect, ["first"]),
        (FILE.stages["press"].time, ["seconds", 0]),
        (FILE.world["table"].xyz, ["z"]),
        (FILE.law.stiffness, ["up"]),
        (FILE.law, ["proportional"]),
        (FILE.world["table"], ["weight"]),
    ],
    ids=str,
)
def test_any_other_raises(path: KeyPath, keys: list[str | int]) -> None:
    for key in keys:
        with pytest.raises(UnknownKeyError, match=str(key)):
            path[key]


def test_the_message_names_the_keys() -> None:
    with pytest.raises(AttributeError, match="limits has no 'forces'; its keys: deviation, force,"):
        FILE.limits.forces  # noqa: B018


def test_paths_are_values() -> None:
    assert FILE.law == below(FILE, "law") != FILE.limits
    assert FILE.law != key_of(FILE.law)
    assert len({FILE.law, key_of(FILE.law), below(FILE, "law")}) == 2
    assert pickle.loads(pickle.dumps(AXIS)) == copy.deepcopy(AXIS) == AXIS

"""(4.24)-(4.27), (4.41) in six dimensions: laws at rest on a bushing whose stiffness couples all.

Predicted by matrices alone, the run's tip pose and wrench are what they are held against.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pose_spring
from taskspec.compiler import compile_unchecked
from taskspec.explain import rest_values
from taskspec.geometry.axis import AXES
from taskspec.spec import load_text

SECTION = "4.1 Impedance, PD and stiffness control"

K_E = np.array(
    [
        [3000, 200, 0, 0, 100, 5],
        [200, 2000, 0, -80, 0, 0],
        [0, 0, 6000, 0, 0, 20],
        [0, -80, 0, 30, 4, 0],
        [100, 0, 0, 4, 25, 0],
        [5, 0, 20, 0, 0, 15],
    ],
    dtype=float,
)
P_E, RPY_E = np.array([0.505, 0.003, 0.345]), np.deg2rad([178.0, 4.0, 5.0])
P_D, RPY_D = np.array([0.5, 0.0, 0.352]), np.deg2rad([180.0, 0.0, 10.0])
K_M = np.array([500.0, 700.0, 900.0, 40.0, 50.0, 60.0])
DAMPING = "[60 N*s/m, 60 N*s/m, 100 N*s/m, 1 N*m*s/rad, 1 N*m*s/rad, 0.6 N*m*s/rad]"
SPRING = (
    "stiffness: {x: 500 N/m, y: 700 N/m, z: 900 N/m, rx: 40 N*m/rad, ry: 50 N*m/rad, "
    "rz: 60 N*m/rad}"
)
LAWS = {
    "impedance": f"{{kind: impedance, {SPRING}}}",
    "impedance-natural": f"{{kind: impedance-natural, {SPRING}}}",
    "pd": f"{{kind: pd, {SPRING}}}",
    "pd-joint": f"{{kind: pd-joint, {SPRING}, damping: 6 N*m*s/rad}}",
    "stiffness": f"{{kind: stiffness, {SPRING}}}",
}
BALANCED = "balanced: true, joint_damping: 6 N*m*s/rad,"
PARALLEL = (
    f"{{kind: parallel, {SPRING}, force: {{proportional: 0.2, integral: {{z: 3 /s, rx: 8 /s}}}}}}"
)
FORCES = {"z": 12.0, "rx": 0.4}
EXACT = "the spring is exact at rest; the slowest mode leaves less than 1e-7 of what is pressed"


def task(law: str, axes: str) -> str:
    rows = ", ".join(f"[{', '.join(map(entry, *cells))}]" for cells in rows_of())
    return f"""
taskspec: 1
name: theory
robot: {{model: panda, {BALANCED if "kind: stiffness" in law else ""}
        start: {{xyz: [500 mm, 0, 352 mm], rpy: [180 deg, 0, 10 deg]}}}}
world:
  mount: {{bushing: tool, xyz: [505 mm, 3 mm, 345 mm], rpy: [178 deg, 4 deg, 5 deg],
           stiffness: [{rows}], damping: {DAMPING}}}
law: {law}
stages:
  hold: {{axes: {{{axes}}}, time: 8 s}}
"""


def rows_of():
    units = [["N/m"] * 3 + ["N/rad"] * 3] * 3 + [["N"] * 3 + ["N*m/rad"] * 3] * 3
    return [(K_E[i].tolist(), units[i]) for i in range(6)]


def entry(value: float, unit: str) -> str:
    return f"{value:g} {unit}"


def axes_of(rpy):
    return np.linalg.multi_dot([pose_spring.turned(rpy[i] * np.eye(3)[i]) for i in (2, 1, 0)])


@cache
def at_rest(forces: tuple[tuple[str, float], ...] = (), *, springs: bool = True):
    """(3,), (3, 3) of the tip, (6,) applied, of springs K_M or of stiff axes with forces."""
    R_d, R_e, wanted = axes_of(RPY_D), axes_of(RPY_E), dict(forces)

    def state(x):
        p, R = P_D + x[:3], pose_spring.turned(x[3:]) @ R_d
        applied = -pose_spring.wrench(p, R, P_E, R_e, K_E, np.zeros((6, 6)), np.zeros(6))
        return p, R, applied, np.concatenate([P_D - p, pose_spring.vector(R_d @ R.T)])

    def residual(x):
        _, _, applied, error = state(x)
        rows = K_M * error - applied if springs else error
        return np.array(
            [applied[i] - wanted[a] if a in wanted else rows[i] for i, a in enumerate(AXES)]
        )

    return state(pose_spring.roots(residual, 6))[:3]


@pytest.mark.parametrize("law", LAWS)
def test_equilibrium_in_six_dimensions(simulate, prediction, law):
    """(4.26), (4.27): x_E is where K_m e = -f_a(x_E), with a K_e that couples all axes."""
    _, _, applied = at_rest()
    run = simulate(task(LAWS[law], ""))
    case = f"{law}, panda, a bushing with a full K_e, 7 mm and 6° from its rest"
    for i, axis in enumerate(AXES):
        prediction(
            f"{'moment about' if i > 2 else 'force along'} {axis} [{'N·m' if i > 2 else 'N'}]",
            "(4.27)", case, applied[i], run[f"{axis.effort}.{axis}"][-1], rtol=1e-6, because=EXACT,
        )  # fmt: skip


def test_it_comes_to_rest_in_the_pose_of_4_26(simulate, prediction):
    p, R, _ = at_rest()
    run = simulate(task(LAWS["pd"], ""))
    case = "pd, panda, a bushing with a full K_e, 7 mm and 6° from its rest"
    turn = pose_spring.vector(R @ axes_of(RPY_D).T)
    for i, axis in enumerate(AXES):
        measured = run[f"position.{axis}"][-1]
        predicted = turn[i - 3] if i > 2 else p[i] - P_D[i]
        measured -= 0.0 if i > 2 else P_D[i]
        prediction(
            f"x_E - x_d along {axis} [{'mrad' if i > 2 else 'mm'}]", "(4.26)", case,
            1e3 * predicted, 1e3 * measured, rtol=1e-6, because=EXACT,
        )  # fmt: skip


def test_parallel_control_sets_two_forces_and_four_coordinates(simulate, prediction):
    """(4.41) on z and rx, x_E = x_d on the other axes, whose forces the coupled spring decides."""
    p, _, applied = at_rest(tuple(FORCES.items()), springs=False)
    run = simulate(task(PARALLEL, "z: {force: 12 N}, rx: {torque: 0.4 N*m}"))
    case = "parallel, panda, 12 N along z and 0.4 N·m about rx of a bushing with a full K_e"
    for i, axis in enumerate(AXES):
        prediction(
            f"{'moment about' if i > 2 else 'force along'} {axis} [{'N·m' if i > 2 else 'N'}]",
            "(4.41)", case, applied[i], run[f"{axis.effort}.{axis}"][-1], rtol=1e-6, because=EXACT,
        )  # fmt: skip
    assert abs(run["position.z"][-1] - p[2]) < 1e-8


@pytest.mark.parametrize("law", [*LAWS, "parallel"])
def test_explain_states_the_same_numbers(law):
    force = law == "parallel"
    text = LAWS.get(
        law,
        PARALLEL,
    )
    loaded = load_text(task(text, "z: {force: 12 N}, rx: {torque: 0.4 N*m}" if force else ""), "t")
    program = compile_unchecked(loaded)
    stated = rest_values(program, program.stages[0])
    given = tuple(FORCES.items()) if force else ()
    _, _, applied = at_rest(given, springs=not force)
    assert [*stated] == [f"{axis.effort}.{axis}" for axis in AXES]
    found = [stated[f"{axis.effort}.{axis}"].value for axis in AXES]
    np.testing.assert_allclose(found, applied, rtol=1e-8, atol=1e-9)

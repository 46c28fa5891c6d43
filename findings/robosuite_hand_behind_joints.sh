#!/usr/bin/env bash
# robosuite 1.5.2: in one observation the hand is where it was a step of physics before the joints.
#
# env.step returns robot0_joint_pos and robot0_eef_pos as one observation. One
# expects that the forward kinematics of the first give the second.
# A step ends with mj_step2, which moves the joints and works out no kinematics:
# positions of sites and bodies stay those of the step before. At 0.24 m/s and
# 2 ms the hand is 0.49 mm behind, at rest nothing. Poses and velocities of hand
# and objects are behind alike, with lite_physics or without; the joints are not.
# Whoever trains on both, calibrates one by the other or works out a contact's
# depth from the pose has an error that grows with the speed.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile --no-deps \
    robosuite==1.5.2 mujoco==3.3.0 numpy==1.26.4 numba==0.68.1 llvmlite==0.50.0 scipy==1.17.1 \
    opencv-python-headless==4.11.0.86 pillow==12.3.0 termcolor==3.3.0 absl-py==2.5.1 etils==1.15.0 \
    glfw==2.11.0 pyopengl==3.1.10 fsspec==2026.9.0 typing_extensions==4.16.0 zipp==4.1.2

NUMBA_DISABLE_JIT=1 "$work/venv/bin/python" - <<'PY' 2> "$work/messages" || { cat "$work/messages" >&2; exit 1; }
import mujoco
import numpy as np
import robosuite
from robosuite.controllers import load_composite_controller_config

controller = load_composite_controller_config(controller="BASIC", robot="Panda")
print("robosuite", robosuite.__version__, "mujoco", mujoco.__version__)
print("lite_physics  speed of the hand   robot0_eef_pos behind robot0_joint_pos")
for lite in (True, False):
    env = robosuite.make(
        "Lift", robots="Panda", controller_configs=controller, control_freq=20, horizon=10**6,
        has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False, lite_physics=lite,
    )
    env.reset()
    model, data = env.sim.model._model, env.sim.data._data
    site = env.robots[0].eef_site_id["right"]
    along = np.array([1.0, 0, 0, 0, 0, 0, 0])  # the hand goes along x, then stands still
    for action, moves in ((along, True), (0 * along, False)):
        for _ in range(10 if moves else 40):
            seen, *_ = env.step(action)
        assert np.array_equal(seen["robot0_joint_pos"], data.qpos[:7])
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, jacobian, None, site)
        speed = np.linalg.norm(jacobian @ data.qvel)
        here = mujoco.MjData(model)
        here.qpos[:] = data.qpos
        mujoco.mj_kinematics(model, here)
        behind = np.linalg.norm(here.site_xpos[site] - seen["robot0_eef_pos"])
        print(f"{lite!s:12} {speed:14.3f} m/s {1e3 * behind:27.3f} mm, of {1e3 * speed * 0.002:.3f} mm in 2 ms")
        assert abs(behind - speed * 0.002) < 0.02 * speed * 0.002 + 1e-6
        assert (behind > 3e-4) == moves
PY

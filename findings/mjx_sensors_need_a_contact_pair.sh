#!/usr/bin/env bash
# mujoco-mjx 3.17.0: force, torque and acceleration sensors stay at zero until some pair can touch.
#
# The model is a payload on a sprung slide with force sensor and accelerometer.
# Nothing in it can touch anything. A second model has a floor added five metres
# below that nothing ever reaches. Both are at rest at the same state.
# The MJX page lists these sensors as supported. So one expects the numbers of C
# MuJoCo from both: 19.62 N and 9.81 m/s2.
# With no constraint in the compiled model mjx.forward ends before the acceleration
# sensors, so they keep what they held before (here zero). The floor far away
# "repairs" them. No error, no warning, and the motion itself is right.
# A policy trained on such a model learns that the wrist force is always zero; a
# value that mjx.put_data brought along stays for the whole run.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile mujoco==4.0.0 mujoco-mjx==3.17.0 jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import logging
import os

os.environ["JAX_PLATFORMS"] = "cpu"
logging.disable(logging.WARNING)
import importlib.metadata as metadata

import jax

jax.config.update("jax_enable_x64", True)
import mujoco
import numpy as np
from mujoco import mjx

xml = """<mujoco><worldbody>
  <body pos="0 0 1"><geom size=".05" mass="1"/>
    <joint type="slide" axis="0 0 1" stiffness="1e4" damping="300"/>
    <body pos="0 0 .1"><site name="s"/><geom size=".05" mass="2"/></body></body>%s
</worldbody><sensor><force site="s"/><accelerometer site="s"/></sensor></mujoco>"""
floor = '<geom type="plane" size="1 1 .1" pos="0 0 -5"/>'
print("mujoco", mujoco.__version__, "mujoco-mjx", metadata.version("mujoco-mjx"))
for name, extra in (("without floor", ""), ("with a floor 5 m below", floor)):
    model = mujoco.MjModel.from_xml_string(xml % extra)
    data = mujoco.MjData(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    mx = mjx.put_model(model)
    dx = mjx.make_data(model).replace(qpos=jax.numpy.array(data.qpos))
    dx = jax.jit(mjx.forward)(mx, dx)
    got = np.array(dx.sensordata)
    stale = dx.replace(sensordata=jax.numpy.full(6, -7.0))
    stale = np.array(jax.jit(mjx.forward)(mx, stale).sensordata)
    print(f"{name}: expected {data.sensordata[[2, 5]].round(3)}, observed {got[[2, 5]].round(3)}")
    assert extra or (stale == -7).all()  # a value from elsewhere stays
    assert abs(data.sensordata[2] - 19.62) < 1e-3 and data.ncon == 0
    assert np.abs(np.array(dx.qacc) - data.qacc).max() < 1e-5
    assert np.allclose(got, data.sensordata, atol=1e-5) if extra else not got.any()
PY

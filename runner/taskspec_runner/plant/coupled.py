"""Joints that follow others, in MuJoCo: each is held to its ratio by a constraint.

MuJoCo has no coordinates but joints, so the plant has all of them, and equality constraints of
fixed tendons, one for each joint that follows. They are as hard as MuJoCo makes them: an impedance
of 0.9999, and a violation that decays critically damped within two steps, the least that its
`refsafe` allows. With A the constraint's inverse inertia they then have a stiffness of
1e4 / (4 h^2 A), against which a motor's 100 N m turn a link of 1 kg m^2 by 3e-9 rad at h = 0.25 ms.
"""

from __future__ import annotations

import mujoco

from taskspec_runner.plant.arm import SceneArm

#: The hardest that MuJoCo takes (mjMAXIMP).
_IMPEDANCE = 0.9999


def add_coupling(spec: mujoco.MjSpec, arm: SceneArm, period: float) -> None:
    """Has joints of an arm follow others, as its coupling says.

    Args:
        spec: The scene.
        arm: In it.
        period: A step of the plant [s].
    """
    coupling = arm.robot.coupling
    for j in coupling.followers:
        name = arm.element(f"follows/{coupling.names[j]}")
        tendon = spec.add_tendon(name=name)
        tendon.wrap_joint(coupling.names[j], 1.0)
        # A tendon's length counts from where the joints are at the model's zero.
        away = float(coupling.offsets[j]) - spec.joint(coupling.names[j]).ref
        for i, ratio in zip(coupling.free, coupling.ratios[j], strict=True):
            if ratio:
                tendon.wrap_joint(coupling.names[i], -float(ratio))
                away += float(ratio) * spec.joint(coupling.names[i]).ref
        held = spec.add_equality(
            name=name, type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON, name1=name
        )
        held.data[0] = away
        held.solref = [2.0 * period, 1.0]
        held.solimp = [_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 2.0]

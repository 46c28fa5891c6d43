/* Where bodies are at a row of positions, as MuJoCo's mj_kinematics has it. Quaternions of MuJoCo are w, x, y, z. */

import { Quaternion, Vector3 } from "three";

export const quaternion = ([w, x, y, z]) => new Quaternion(x, y, z, w);

export class Bodies {
  /** Of the bodies of a scene; the world is the first, and stays. */
  constructor(bodies) {
    this.all = [{ joints: [] }, ...bodies].map((b) => ({
      parent: b.parent,
      pos: new Vector3(...(b.pos ?? [0, 0, 0])),
      quat: quaternion(b.quat ?? [1, 0, 0, 0]),
      joints: b.joints.map((j) => ({ ...j, pos: new Vector3(...(j.pos ?? [])), axis: new Vector3(...(j.axis ?? [])) })),
      position: new Vector3(),
      rotation: new Quaternion(),
    }));
  }

  /** Puts all of them where they are at positions `q`. */
  move(q) {
    for (const body of this.all.slice(1)) {
      const parent = this.all[body.parent];
      body.position.copy(body.pos).applyQuaternion(parent.rotation).add(parent.position);
      body.rotation.multiplyQuaternions(parent.rotation, body.quat);
      for (const joint of body.joints) turn(body, joint, q);
      body.rotation.normalize();
    }
  }
}

const anchor = new Vector3(), arm = new Vector3(), by = new Quaternion();

function turn(body, { kind, at, pos, axis, zero }, q) {
  if (kind === "free") {
    body.position.set(q[at], q[at + 1], q[at + 2]);
    body.rotation.set(q[at + 4], q[at + 5], q[at + 6], q[at + 3]);
    return;
  }
  if (kind === "slide") {
    body.position.addScaledVector(arm.copy(axis).applyQuaternion(body.rotation), q[at] - zero);
    return;
  }
  if (kind === "hinge") by.setFromAxisAngle(axis, q[at] - zero);
  else by.set(q[at + 1], q[at + 2], q[at + 3], q[at]).normalize();
  anchor.copy(pos).applyQuaternion(body.rotation).add(body.position);
  body.rotation.multiply(by);
  body.position.copy(anchor).sub(arm.copy(pos).applyQuaternion(body.rotation));
}

/* Geoms of MuJoCo as meshes of three.js. */

import {
  BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, DoubleSide, GridHelper, Group, Mesh,
  MeshStandardMaterial, PlaneGeometry, ShadowMaterial, SphereGeometry, SRGBColorSpace, Vector3,
} from "three";
import { toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";
import { quaternion } from "./kinematics.js";

/** Edges between faces that are turned further than this are sharp [rad]. */
const CREASE = 0.6;
/** The floor: its edge, its tiles [m], how strong its shadows are. */
const FLOOR = 6, TILES = 24, SHADE = 0.16;
/** Radius of a link that has no shape of its own [m], and its colour. */
const LINK = 0.035, LINK_COLOR = [0.8, 0.82, 0.85, 1];

export const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
export const floats = (text) => new Float32Array(bytes(text).buffer);

function unpacked({ low, extent, vertices, faces }) {
  const steps = new Uint16Array(bytes(vertices).buffer), places = new Float32Array(steps.length);
  for (let i = 0; i < steps.length; i++) places[i] = low[i % 3] + (extent[i % 3] * steps[i]) / 65535;
  const made = new BufferGeometry();
  made.setAttribute("position", new BufferAttribute(places, 3));
  made.setIndex(new BufferAttribute(new Uint32Array(bytes(faces).buffer), 1));
  return toCreasedNormals(made, CREASE);
}

/** MuJoCo's capsules and cylinders stand along z, those of three.js along y. */
const upright = (geometry) => geometry.rotateX(Math.PI / 2);

const SHAPES = {
  plane: ([x, y]) => new PlaneGeometry(2 * x, 2 * y),
  sphere: ([r]) => new SphereGeometry(r, 32, 20),
  ellipsoid: ([x, y, z]) => upright(new SphereGeometry(1, 32, 20)).scale(x, y, z),
  capsule: ([r, half]) => upright(new CapsuleGeometry(r, 2 * half, 10, 32)),
  cylinder: ([r, half]) => upright(new CylinderGeometry(r, r, 2 * half, 48)),
  box: ([x, y, z]) => new BoxGeometry(2 * x, 2 * y, 2 * z),
};

function material([r, g, b, a], both) {
  const solid = a > 0.99;
  return new MeshStandardMaterial({
    color: new Color().setRGB(r, g, b, SRGBColorSpace), opacity: a, transparent: !solid, depthWrite: solid,
    roughness: 0.62, metalness: 0.05, side: both ? DoubleSide : undefined,
  });
}

/** A floor without an end: lines that fade, and shadows. */
function floor() {
  const ground = new Group(), lines = new GridHelper(FLOOR, TILES);
  lines.rotateX(Math.PI / 2);
  lines.name = "floor";
  lines.material.vertexColors = false;
  const shade = new Mesh(new PlaneGeometry(FLOOR, FLOOR), new ShadowMaterial({ opacity: SHADE, depthWrite: false }));
  shade.receiveShadow = true;
  ground.add(lines, shade);
  return ground;
}

/** Adds all geoms to the groups of their bodies. */
export function build(scene, groups) {
  const meshes = scene.meshes.map(unpacked);
  for (const { body, shape, size, pos, quat, color, mesh } of scene.geoms) {
    const endless = shape === "plane" && !(size[0] && size[1]);
    const made = endless ? floor() : new Mesh(shape === "mesh" ? meshes[mesh] : SHAPES[shape](size), material(color, shape === "plane"));
    made.position.set(...pos);
    made.quaternion.copy(quaternion(quat));
    if (!endless) {
      made.castShadow = color[3] > 0.5;
      made.receiveShadow = true;
    }
    groups[body].add(made);
  }
}

/** A link between two bodies that the robot's file draws nothing of. */
export class Link {
  constructor() {
    this.mesh = new Mesh(SHAPES.cylinder([LINK, 0.5]), material(LINK_COLOR));
    this.mesh.castShadow = this.mesh.receiveShadow = true;
  }

  between(a, b) {
    const along = new Vector3().subVectors(b, a), length = along.length();
    this.mesh.visible = length > 1e-6;
    this.mesh.position.addVectors(a, b).multiplyScalar(0.5);
    this.mesh.scale.z = length;
    if (this.mesh.visible) this.mesh.quaternion.setFromUnitVectors(new Vector3(0, 0, 1), along.divideScalar(length));
  }
}

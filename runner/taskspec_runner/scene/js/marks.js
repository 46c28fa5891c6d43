/* Arrows and paths: what is measured and wanted, drawn into the world. */

import { Color, ConeGeometry, CylinderGeometry, GreaterDepth, Group, LessEqualDepth, Mesh, MeshBasicMaterial, Vector3 } from "three";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";

/** How much of a mark shines through what hides it. */
const SHINE = 0.4;
const UP = new Vector3(0, 0, 1);
/** Points of a path that are further apart than this are a jump [m]. */
const JUMP = 0.03;

const upright = (geometry, up) => geometry.rotateX(Math.PI / 2).translate(0, 0, up);
const SHAFT = upright(new CylinderGeometry(1, 1, 1, 20), 0.5), HEAD = upright(new ConeGeometry(1, 1, 24), -0.5);

/** A thing twice: as it is, and paler where something hides it. */
function shining(make, kind, options) {
  const both = [[LessEqualDepth, 1], [GreaterDepth, SHINE]].map(([depthFunc, opacity]) =>
    make(new kind({ ...options, depthFunc, opacity, transparent: opacity < 1, depthWrite: opacity === 1 })));
  both[1].renderOrder = 3;
  return both;
}

export class Arrow {
  constructor(radius) {
    this.group = new Group();
    this.radius = radius;
    this.shafts = shining((m) => new Mesh(SHAFT, m), MeshBasicMaterial, {});
    this.heads = shining((m) => new Mesh(HEAD, m), MeshBasicMaterial, {});
    this.group.add(...this.shafts, ...this.heads);
    this.end = new Vector3();
  }

  /** Draws it from a place along a direction of some length [m]; nothing of no length. */
  set(start, direction, length, color) {
    this.group.visible = length > 1e-4 && Number.isFinite(length);
    if (!this.group.visible) return;
    const head = Math.min(5 * this.radius, 0.6 * length);
    this.group.position.copy(start);
    this.group.quaternion.setFromUnitVectors(UP, direction);
    this.end.copy(start).addScaledVector(direction, length);
    for (const each of this.shafts) each.scale.set(this.radius, this.radius, length - head * 0.9);
    for (const each of this.heads) {
      each.scale.set(2.2 * this.radius, 2.2 * this.radius, head);
      each.position.z = length;
    }
    for (const each of [...this.shafts, ...this.heads]) each.material.color.set(color);
  }
}

/** A path of points that may grow, of which the first so many are drawn. */
export class Path {
  /** Of a width [px], above paths of a lower rank. */
  constructor(width, rank) {
    this.group = new Group();
    Object.assign(this, { width, rank });
    this.points = [];
    this.ends = [0];
    this.lines = [];
  }

  /** Its points, as x, y and z one after another. */
  set(flat) {
    const pieces = [];
    this.ends = [0];
    for (let i = 3; i < flat.length; i += 3) {
      const away = Math.hypot(flat[i] - flat[i - 3], flat[i + 1] - flat[i - 2], flat[i + 2] - flat[i - 1]);
      if (away <= JUMP) for (let k = i - 3; k < i + 3; k++) pieces.push(flat[k]);
      this.ends.push(pieces.length / 6);
    }
    for (const line of this.lines) line.geometry.dispose();
    this.group.clear();
    const color = this.lines[0]?.material.color ?? new Color();
    this.lines = [];
    if (!pieces.length) return;
    const geometry = new LineSegmentsGeometry().setPositions(pieces);
    this.lines = shining((m) => new LineSegments2(geometry, m), LineMaterial, {
      color, linewidth: this.width, polygonOffset: true, polygonOffsetFactor: -4 * this.rank, polygonOffsetUnits: -8 * this.rank,
    });
    for (const line of this.lines) {
      line.frustumCulled = false;
      line.renderOrder = this.rank;
    }
    this.group.add(...this.lines);
  }

  color(color) { for (const line of this.lines) line.material.color.set(color); }

  /** Draws it up to its point of a number. */
  until(number) {
    const count = this.ends[Math.min(number, this.ends.length - 1)];
    for (const line of this.lines) {
      line.visible = count > 0;
      line.geometry.instanceCount = count;
    }
  }
}

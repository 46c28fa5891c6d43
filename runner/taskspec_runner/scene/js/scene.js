/* An arm in its world, in an element of a page. */

import {
  Color, DirectionalLight, Fog, Group, HemisphereLight, PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { build, Link } from "./build.js";
import { Bodies } from "./kinematics.js";
import { Arrow, Path } from "./marks.js";

export { track } from "./track.js";

/** Of arrows: length of a frame's axes, radii, the longest for a force, all [m]; below this force [N] none is drawn. */
const AXIS = 0.085, AXIS_RADIUS = 0.0035, FORCE_RADIUS = 0.0075, LONGEST = 0.24, LEAST = 0.2;
/** Of paths [px]. */
const ACTUAL = 2, WANTED = 4.5;
/** Share of the picture that what is shown fills; distance when the tool is followed [m]; a step of a key [rad]. */
const FILL = 0.92, NEAR = 0.6, STEP = 0.12;
const NAMES = ["x", "y", "z"];
/** Colours of marks by what they are, where the style sheet of the page does not say: `--force` and so on. */
const COLORS = {
  force: "#db2626", motion: "#2f6bf0", free: "#7b8794", applied: "#b97a00", wanted: "#3f97e8", ink: "#161b22", line: "#e1e5ea", card: "#ffffff",
};

/**
 * Draws a scene in an element, which keeps its size; throws where there is no WebGL.
 *
 * @param element in which the canvas is put. After each drawing `element.dataset.camera` has eye, target [m] and vertical
 *   angle [deg], `element.dataset.tip` where the tip of the tool is in the element [CSS px].
 * @param scene as `scene.model.model_scene` of Python states it.
 * @returns an object with
 *   `show(state)`: draws a state, of which only `q` is needed:
 *     `q` a row of positions; `point` (3) where the frame's axes and the force begin; `axes` (4) quaternion w, x, y, z of
 *     the frame; `kinds` what controls its axes, such as { x: "force", y: "motion", z: "free" }: those named are drawn;
 *     `force` (3) in the world [N]; `row` up to which point the path `actual` is drawn.
 *   `path(name, flat)`: gives the path `actual` or `wanted` its points, x, y, z one after another [m];
 *   `scale(value)`: length of the arrow of a force [m/N];
 *   `ghost(other)`: adds a second arm, a scene of the same kind, translucent in a colour: { scene, color }; returns its
 *     `show(q)`;
 *   `follow(on)`: whether the camera goes with `point`; `reset()`: the view from the beginning; `turn(right, up)` [rad];
 *   `zoom(factor)`; `project([x, y, z])`: where a place is in the element [CSS px]; `dispose()`.
 */
export function create(element, scene) {
  const canvas = document.createElement("canvas"), context = canvas.getContext("webgl2", { antialias: true, alpha: true });
  if (!context) throw new Error("this browser has no WebGL");
  const renderer = new WebGLRenderer({ canvas, context, alpha: true });
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.shadowMap.enabled = true;
  const labels = Object.fromEntries(["applied", ...NAMES].map((name) => [name, label(element)]));
  element.prepend(canvas);

  const world = new Scene(), camera = new PerspectiveCamera(scene.view.fovy, 1, 0.01, 60);
  camera.up.set(0, 0, 1);
  lit(world, scene.view);
  const arm = new Arm(world, scene), paths = { wanted: new Path(WANTED, 1), actual: new Path(ACTUAL, 2) };
  const axes = NAMES.map(() => new Arrow(AXIS_RADIUS)), force = new Arrow(FORCE_RADIUS);
  world.add(...[...axes, force, ...Object.values(paths)].map((each) => each.group));

  const controls = new OrbitControls(camera, canvas);
  controls.minDistance = 0.05;
  controls.maxDistance = 12;
  // A finger that goes up or down scrolls the page; the wheel does, too, unless the scene has the focus.
  canvas.style.touchAction = "pan-y";
  element.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey && !element.contains(document.activeElement)) event.stopImmediatePropagation();
  }, { capture: true });

  let colors = COLORS, scale = scene.scale ?? 0, state = null, following = false, wait = 0, gone = false;
  const at = new Vector3(), before = new Vector3(), frame = new Quaternion();

  /** The view from the beginning, as near as all of it fits in. */
  function home() {
    const { azimuth, elevation, middle, half, fovy } = scene.view, [right, up, deep] = half.map((h) => Math.max(h, 0.05));
    const a = (azimuth * Math.PI) / 180, e = (elevation * Math.PI) / 180, room = Math.tan((fovy * Math.PI) / 360) * FILL;
    const distance = Math.max(right / (room * camera.aspect), up / room) + 0.6 * deep;
    controls.target.set(...middle);
    camera.position.set(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)).multiplyScalar(-distance).add(controls.target);
    controls.update();
  }

  function marked() {
    at.set(...(state.point ?? [NaN, NaN, NaN]));
    const known = Number.isFinite(at.x);
    const [w, x, y, z] = state.axes ?? [NaN];
    frame.set(x, y, z, w);
    NAMES.forEach((name, i) => {
      const kind = known && Number.isFinite(w) ? state.kinds?.[name] : undefined;
      axes[i].set(at, new Vector3().setComponent(i, 1).applyQuaternion(frame), kind ? AXIS : 0, colors[kind]);
      axes[i].kind = kind;
    });
    const [fx, fy, fz] = state.force ?? [0, 0, 0], size = Math.hypot(fx, fy, fz);
    const shown = known && size > LEAST ? Math.min(scale * size, LONGEST) : 0;
    force.set(at, new Vector3(fx, fy, fz).divideScalar(size || 1), shown, colors.applied);
    labels.applied.textContent = `${size.toFixed(1)} N`;
  }

  function project(place) {
    const p = new Vector3(...place).project(camera);
    return [((1 + p.x) / 2) * element.clientWidth, ((1 - p.y) / 2) * element.clientHeight];
  }

  function draw() {
    wait = 0;
    if (gone || !element.clientWidth) return;
    renderer.render(world, camera);
    NAMES.forEach((name, i) => place(labels[name], axes[i], name, axes[i].kind));
    place(labels.applied, force, labels.applied.textContent, "applied");
    element.dataset.camera = JSON.stringify([camera.position.toArray(), controls.target.toArray(), camera.fov]);
    element.dataset.tip = JSON.stringify(project(arm.bodies.all[scene.tip].position.toArray()));
  }

  /** Puts the name of an arrow beyond its end. */
  function place(made, arrow, text, kind) {
    made.hidden = !arrow.group.visible;
    if (made.hidden) return;
    const [x0, y0] = project(arrow.group.position.toArray()), [x1, y1] = project(arrow.end.toArray());
    const long = Math.max(Math.hypot(x1 - x0, y1 - y0), 1), beyond = kind === "applied" ? 20 : 10;
    made.textContent = text;
    made.style.color = colors[kind];
    made.style.transform = `translate(${x1 + (beyond * (x1 - x0)) / long}px, ${y1 + (beyond * (y1 - y0)) / long}px) translate(-50%, -50%)`;
  }

  const soon = () => { wait ||= requestAnimationFrame(draw); };

  function size() {
    const { clientWidth: width, clientHeight: height } = element;
    if (!width || !height) return;
    const untouched = camera.aspect !== width / height && !moved;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    if (untouched) home();
    draw();
  }

  function dress() {
    const style = getComputedStyle(element);
    colors = Object.fromEntries(Object.entries(COLORS).map(([name, usual]) => [name, style.getPropertyValue(`--${name}`).trim() || usual]));
    const lines = world.getObjectByName("floor");
    lines?.material.color.set(colors.line);
    world.fog = new Fog(new Color(colors.card), 1.5, 6);
    paths.wanted.color(colors.wanted);
    paths.actual.color(colors.ink);
    if (state) marked();
    soon();
  }

  let moved = false;
  controls.addEventListener("start", () => { moved = true; });
  controls.addEventListener("change", soon);
  const sizes = new ResizeObserver(size), dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", dress);
  sizes.observe(element);
  size();
  home();
  dress();

  return {
    project,
    show(next) {
      state = next;
      arm.move(next.q);
      before.copy(at);
      marked();
      paths.actual.until(next.row ?? Infinity);
      if (following && Number.isFinite(at.x)) {
        camera.position.add(at).sub(Number.isFinite(before.x) ? before : at);
        controls.target.copy(at);
        controls.update();
      }
      soon();
    },
    path(name, flat) {
      paths[name].set(flat);
      paths[name].color(name === "actual" ? colors.ink : colors.wanted);
      if (name === "actual" && state) paths.actual.until(state.row ?? Infinity);
      soon();
    },
    scale(value) { scale = value; if (state) marked(); soon(); },
    ghost(other) {
      const second = new Arm(world, other.scene, other.color);
      return { show(q) { second.move(q); soon(); } };
    },
    follow(on) {
      following = on;
      if (on && Number.isFinite(at.x)) {
        const away = camera.position.clone().sub(controls.target).setLength(Math.min(camera.position.distanceTo(controls.target), NEAR));
        controls.target.copy(at);
        camera.position.copy(at).add(away);
        controls.update();
      } else home();
      soon();
    },
    reset() { moved = following = false; home(); soon(); },
    turn(right, up) {
      moved = true;
      controls.rotateLeft(right * STEP);
      controls.rotateUp(up * STEP);
      controls.update();
    },
    zoom(factor) {
      moved = true;
      camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
      controls.update();
    },
    dispose() {
      gone = true;
      sizes.disconnect();
      dark.removeEventListener("change", dress);
      controls.dispose();
      renderer.dispose();
      canvas.remove();
      for (const each of Object.values(labels)) each.remove();
    },
  };
}

function label(element) {
  const made = document.createElement("span");
  made.className = "scene-label";
  made.hidden = true;
  element.append(made);
  return made;
}

function lit(world, { middle }) {
  world.add(new HemisphereLight(0xffffff, 0x9aa3ad, 2.1));
  const sun = new DirectionalLight(0xffffff, 1.9);
  sun.position.set(middle[0] + 0.5, middle[1] - 1.1, middle[2] + 2.4);
  sun.target.position.set(...middle);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  sun.shadow.bias = -0.0004;
  sun.shadow.normalBias = 0.01;
  Object.assign(sun.shadow.camera, { left: -1.6, right: 1.6, top: 1.6, bottom: -1.6, near: 0.1, far: 6 });
  world.add(sun, sun.target);
}

/** Bodies with what is drawn of them. */
class Arm {
  constructor(world, scene, color = null) {
    this.bodies = new Bodies(scene.bodies);
    this.groups = this.bodies.all.map(() => new Group());
    this.pairs = scene.links.map((pair) => [new Link(), ...pair]);
    build(scene, this.groups);
    const all = [...this.groups, ...this.pairs.map(([link]) => link.mesh)];
    if (color) {
      this.groups[0].clear();
      for (const each of all) each.traverse((o) => o.isMesh && pale(o, color));
    }
    world.add(...all);
  }

  move(q) {
    this.bodies.move(q);
    this.bodies.all.forEach((body, i) => {
      this.groups[i].position.copy(body.position);
      this.groups[i].quaternion.copy(body.rotation);
    });
    for (const [link, a, b] of this.pairs) link.between(this.bodies.all[a].position, this.bodies.all[b].position);
  }
}

function pale(mesh, color) {
  mesh.material.color.set(color);
  Object.assign(mesh.material, { transparent: true, opacity: 0.38, depthWrite: false });
  mesh.castShadow = false;
}

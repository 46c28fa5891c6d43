/* The arm in 3D at the cursor of all charts. Where a browser cannot draw it, its picture stays. */

/** Text of an element that holds it compressed. */
async function unpacked(id) {
  const small = bytes(document.getElementById(id).textContent);
  return new Response(new Blob([small]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

/** Shows a scene in its figure: moved by the cursor of the page, by a slider, and played. Times are of the page [s]. */
function played(figure, scene, lib) {
  const find = (name) => figure.querySelector(name), stage = find(".view"), player = find(".player");
  const [play, seek, speed, follow, reset, said] = [".play", ".seek", ".speed", ".follow", ".reset", ".clock"].map(find);
  const rows = lib.track(scene), arm = lib.create(stage, scene);
  const { begin, other } = scene, whole = cursor.whole ?? [begin + rows.start, begin + rows.end], shown = cursor.window ?? (() => whole);
  const second = other && {
    rows: lib.track({ ...scene, track: other.track }),
    arm: arm.ghost({ scene, color: getComputedStyle(figure).getPropertyValue(`--${other.role}`).trim() }),
  };
  let now = begin + scene.clock, last = null;
  arm.path("wanted", rows.paths.wanted);
  arm.path("actual", rows.paths.actual);

  function showAt(time) {
    now = time;
    arm.show(rows.at(time - begin));
    second?.arm.show(second.rows.at(time - other.begin).q);
    seek.value = time;
    seek.setAttribute("aria-valuetext", `${time.toFixed(2)} s`);
    said.textContent = ` at ${minus(time.toFixed(2))} s`;
  }

  function run_(on) {
    last = null;
    play.setAttribute("aria-pressed", on);
    play.textContent = on ? "Pause" : "Play";
    if (!on) return;
    // What the charts show is played, from its beginning if the cursor is not within it.
    const [from, to] = shown();
    if (now < from || now >= to - 1e-6) now = from;
    requestAnimationFrame(step);
  }

  const running = () => play.getAttribute("aria-pressed") === "true";

  function step(stamp) {
    if (!running()) return;
    const passed = last === null ? 0 : (stamp - last) / 1000;
    last = stamp;
    const end = shown()[1], next = Math.min(now + passed * Number(speed.value), end);
    cursor.point(next);
    if (next >= end) run_(false);
    else requestAnimationFrame(step);
  }

  cursor.follow(showAt);
  seek.min = whole[0];
  seek.max = whole[1];
  seek.addEventListener("input", () => cursor.point(Number(seek.value)));
  play.addEventListener("click", () => run_(!running()));
  const toggle = () => {
    const on = follow.getAttribute("aria-pressed") !== "true";
    follow.setAttribute("aria-pressed", on);
    arm.follow(on);
  };
  const home = () => { follow.setAttribute("aria-pressed", "false"); arm.reset(); };
  follow.addEventListener("click", toggle);
  reset.addEventListener("click", home);

  const away = (way) => cursor.point(Math.min(Math.max(now + (way * (shown()[1] - shown()[0])) / 200, whole[0]), whole[1]));
  const KEYS = {
    " ": () => run_(!running()), f: toggle, 0: home, Home: home, ArrowLeft: () => away(-1), ArrowRight: () => away(1),
    ArrowUp: () => arm.turn(0, 1), ArrowDown: () => arm.turn(0, -1), "+": () => arm.zoom(0.8), "=": () => arm.zoom(0.8), "-": () => arm.zoom(1.25),
  };
  const TURNS = { ArrowLeft: () => arm.turn(1, 0), ArrowRight: () => arm.turn(-1, 0) };
  stage.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const action = (event.shiftKey && TURNS[event.key]) || KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    action();
    event.preventDefault();
  });
  const keys = "space plays, left and right move the cursor, with shift they turn the view, up and down tilt it, + and - zoom, F follows the tool, 0 resets the view";
  Object.entries({ tabindex: 0, role: "group", "aria-label": `The arm in 3D; ${keys}` }).forEach(([k, v]) => stage.setAttribute(k, v));
  player.hidden = false;
  figure.classList.add("live");
  showAt(now);
  // An address with `#play=2&from=1.5` has it play at once, twice as fast, from 1.5 s on.
  const asked = new URLSearchParams(location.hash.slice(1)), fast = Number(asked.get("play"));
  if (fast > 0) {
    if (![...speed.options].some((o) => Number(o.value) === fast)) speed.add(new Option(`${fast} ×`, fast));
    speed.value = fast;
    open(Number(asked.get("from") ?? whole[0]), Number(asked.get("to") ?? whole[1]));
    point(view[0]);
    run_(true);
  }
}

const armFigure = document.querySelector(".arm");
if (armFigure && document.getElementById("scene-data")) {
  const bare = armFigure.hidden;
  Promise.all([unpacked("scene-data"), unpacked("scene-code")])
    .then(([data, code]) => {
      armFigure.hidden = false;
      played(armFigure, JSON.parse(data), new Function(`${code};return taskspecScene;`)());
    })
    // Without WebGL the picture stays, if there is one.
    .catch((error) => { armFigure.hidden = bare; armFigure.dataset.without = error.message; });
}

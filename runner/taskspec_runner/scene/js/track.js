/* The rows of a recorded run, and its state at any time. */

import { floats } from "./build.js";

/** Columns behind those of positions: point, frame, force, reference. */
const POINT = 3, FRAME = 4, FORCE = 3, WANTED = 3;

/**
 * The run of a scene.
 *
 * `at(time)` is a state as `show` takes it, interpolated between rows; `start` and `end` are of its clock [s]; `paths` has
 * the points of the path that was gone and of its reference.
 */
export function track(scene) {
  const clock = floats(scene.track.clock), values = floats(scene.track.values), count = clock.length;
  const column = (c, row) => values[c * count + row];
  const { width } = scene;
  const points = (first) => {
    const flat = new Float32Array(3 * count);
    for (let row = 0; row < count; row++) for (let i = 0; i < 3; i++) flat[3 * row + i] = column(first + i, row);
    return flat;
  };
  const rowAt = (time) => {
    let low = 0, high = count - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (clock[middle] <= time) low = middle; else high = middle - 1;
    }
    return low;
  };
  const wantedAt = width + POINT + FRAME + FORCE;
  return {
    start: clock[0],
    end: clock[count - 1],
    paths: { actual: points(width), wanted: points(wantedAt) },
    at(time) {
      const row = rowAt(time), next = Math.min(row + 1, count - 1);
      const share = next > row ? Math.min(Math.max((time - clock[row]) / (clock[next] - clock[row]), 0), 1) : 0;
      const mixed = (first, length) => Float64Array.from({ length }, (_, i) => {
        const a = column(first + i, row);
        return a + share * (column(first + i, next) - a);
      });
      const visit = scene.visits.findLast((v) => v.start <= time + 1e-9) ?? scene.visits[0];
      // A frame may change from stage to stage; between two rows it is that of the first.
      const axes = Float64Array.from({ length: FRAME }, (_, i) => column(width + POINT + i, row));
      return {
        time, row,
        q: mixed(0, width),
        point: mixed(width, POINT),
        axes,
        kinds: visit?.axes ?? {},
        force: mixed(width + POINT + FRAME, FORCE),
      };
    },
  };
}

// The run: what the page was given, and what follows from it at once.

import { unpacked } from "report/arrays";

const read = (id) => JSON.parse(document.getElementById(id).textContent);

export const run = unpacked(read("run"));
export const stages = read("stages");
export const nScans = run.trajectory.length / 3;
export const nKeys = run.keys.scans.length;
export const nBeams = run.laser.directions.length / 2;
export const nClosures = run.closures.reasons.length;
export const nWalls = run.walls.ends.length / 4;
export const nLandmarks = run.landmarks.kinds.length;

/** Index of the last number in a sorted array that is not above a value; 0 where all are. */
export function lastAtOrBefore(sorted, value) {
  let low = 0;
  let high = sorted.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (sorted[middle] <= value) low = middle;
    else high = middle - 1;
  }
  return low;
}

export const keyOfScan = (scan) => lastAtOrBefore(run.keys.scans, scan);
export const poseOfScan = (scan) => run.trajectory.subarray(3 * scan, 3 * scan + 3);
export const poseOfKey = (key) => run.keys.poses.subarray(3 * key, 3 * key + 3);

/** Row of the scan in the page's ranges; of the one before, where the scan was left out. */
export const rowOfScan = (scan) => lastAtOrBefore(run.laser.scans, scan);

/** Ends of the beams of a row that returned, x, y after x, y, in the frame of the robot. */
export function endsOfRow(row) {
  const { ranges, directions, origin, unit_m: unit } = run.laser;
  const ends = new Float32Array(2 * nBeams);
  let n = 0;
  for (let beam = 0; beam < nBeams; beam++) {
    const reach = ranges[row * nBeams + beam] * unit;
    if (reach === 0) continue;
    ends[n++] = origin[0] + reach * directions[2 * beam];
    ends[n++] = origin[1] + reach * directions[2 * beam + 1];
  }
  return ends.subarray(0, n);
}

/** A pose after another: T_a_c of T_a_b and T_b_c. */
export function compose(ab, bc) {
  const [c, s] = [Math.cos(ab[2]), Math.sin(ab[2])];
  return [ab[0] + c * bc[0] - s * bc[1], ab[1] + s * bc[0] + c * bc[1], ab[2] + bc[2]];
}

/** The pose of c in the frame of b, of T_a_b and T_a_c. */
export function between(ab, ac) {
  const [c, s] = [Math.cos(ab[2]), Math.sin(ab[2])];
  const [x, y] = [ac[0] - ab[0], ac[1] - ab[1]];
  const turn = ac[2] - ab[2];
  return [c * x + s * y, c * y - s * x, Math.atan2(Math.sin(turn), Math.cos(turn))];
}

/** Box around the map but for the few cells that stray beams have seen far off: [x_min, y_min, x_max, y_max]. */
export function extent() {
  const { origin, columns, rows, resolution, shades } = run.grid;
  const [byColumn, byRow] = [new Float64Array(columns), new Float64Array(rows)];
  for (let cell = 0; cell < columns * rows; cell++) {
    if (((shades[cell >> 1] >> (4 * (cell & 1))) & 15) === 0) continue;
    byColumn[cell % columns]++;
    byRow[Math.floor(cell / columns)]++;
  }
  const [x, y] = [middle(byColumn), middle(byRow)].map((ends, axis) => ends.map((cells) => origin[axis] + cells * resolution));
  return [x[0], y[0], x[1], y[1]];
}

const STRAY = 0.006; // share of the known cells at each end that the box may leave out

function middle(counts) {
  const total = counts.reduce((sum, n) => sum + n, 0);
  const end = (order) => {
    let left = STRAY * total;
    return order.find((i) => (left -= counts[i]) < 0) ?? order[0];
  };
  const order = [...counts.keys()];
  return [end(order), end([...order].reverse()) + 1];
}

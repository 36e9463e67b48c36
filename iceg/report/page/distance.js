// Distances between points of the map with their standard deviation, as iceg/run_result/distance.py works them out.

import { between, nBeams, nKeys, poseOfKey, rowOfScan, run } from "report/run";

/** The place (x, y) as the key scan saw it from closest: {key, scan, x, y, beam}, or null where none looked. */
export function sightingAt(x, y) {
  const { origin } = run.laser;
  let [wall, free] = [null, null];
  for (let key = 0; key < nKeys; key++) {
    const [px, py] = between(poseOfKey(key), [x, y, 0]);
    const away = Math.hypot(px - origin[0], py - origin[1]);
    if (wall !== null && away >= wall.away) continue;
    const hit = nearestEnd(key, px, py);
    if (hit !== null) wall = { key, away, ...hit };
    else if ((free === null || away < free.away) && away > 0 && reachTowards(key, px, py, away) >= away) free = { key, away };
  }
  const seen = wall ?? free;
  if (seen === null) return null;
  const at = wall === null ? [x, y] : onMap(seen.key, wall.end);
  return { key: seen.key, scan: run.keys.scans[seen.key], x: at[0], y: at[1], reach: wall === null ? null : wall.reach };
}

/** {length, deviation} between two sightings [m]. */
export function distance(a, b) {
  const [dx, dy] = [b.x - a.x, b.y - a.y];
  const length = Math.hypot(dx, dy);
  if (length === 0) return { length, deviation: 0 };
  const along = [dx / length, dy / length];
  const gradients = new Map();
  for (const [seen, sign] of [[a, -1], [b, 1]]) {
    const sum = gradients.get(seen.key) ?? [0, 0, 0];
    const added = gradient(poseOfKey(seen.key), seen, along);
    gradients.set(seen.key, sum.map((value, i) => value + sign * added[i]));
  }
  const variance = ofPoses(gradients) + ofLaser(a, along) + ofLaser(b, along);
  return { length, deviation: Math.sqrt(Math.max(0, variance)) };
}

function nearestEnd(key, px, py) {
  const { ranges, directions, origin, unit_m: unit } = run.laser;
  const row = rowOfScan(run.keys.scans[key]);
  let [nearest, best] = [run.joint.snap_m ** 2, null];
  for (let beam = 0; beam < nBeams; beam++) {
    const reach = ranges[row * nBeams + beam] * unit;
    if (reach === 0) continue;
    const [ex, ey] = [origin[0] + reach * directions[2 * beam], origin[1] + reach * directions[2 * beam + 1]];
    const off = (ex - px) ** 2 + (ey - py) ** 2;
    if (off <= nearest) [nearest, best] = [off, { end: [ex, ey], reach }];
  }
  return best;
}

function reachTowards(key, px, py, away) {
  const { ranges, directions, origin, unit_m: unit } = run.laser;
  const [ux, uy] = [(px - origin[0]) / away, (py - origin[1]) / away];
  let [most, best] = [-1, 0];
  for (let beam = 0; beam < nBeams; beam++) {
    const cosine = ux * directions[2 * beam] + uy * directions[2 * beam + 1];
    if (cosine > most) [most, best] = [cosine, beam];
  }
  const step = nBeams > 1 ? directions[0] * directions[2] + directions[1] * directions[3] : 0.99995;
  return most >= step ? ranges[rowOfScan(run.keys.scans[key]) * nBeams + best] * unit : 0;
}

function onMap(key, [x, y]) {
  const [px, py, heading] = poseOfKey(key);
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  return [px + c * x - s * y, py + s * x + c * y];
}

/** How fast a point that hangs on a pose moves along a direction, by the pose's own x, y and heading. */
function gradient([px, py, heading], seen, along) {
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  const [x, y] = [seen.x - px, seen.y - py];
  return [c * along[0] + s * along[1], c * along[1] - s * along[0], x * along[1] - y * along[0]];
}

function ofLaser(seen, along) {
  if (seen.reach === null) return 0;
  const [ox, oy] = onMap(seen.key, run.laser.origin);
  const share = ((seen.x - ox) * along[0] + (seen.y - oy) * along[1]) / seen.reach;
  const { noise_m: noise, noise_per_metre: slope } = run.joint.laser;
  return share ** 2 * (noise ** 2 + (slope * seen.reach) ** 2);
}

/** Variance of a figure with these gradients by key poses: gᵀ Σ g = |L⁻¹ g|², and what else is known of each. */
function ofPoses(gradients) {
  const { anchors, anchor_of: anchorOf, row_of: rowOf, placements, excess, roots } = run.joint;
  const right = new Float64Array(roots.length / 3);
  let [own, most] = [0, 0];
  for (const [key, g] of gradients) {
    const anchor = anchorOf[key];
    const at = 3 * rowOf[anchor];
    carriedTo(anchors[anchor], key, g).forEach((part, axis) => (right[at + axis] += part));
    own += quadratic(placements.subarray(6 * key, 6 * key + 6), g);
    most = Math.max(most, excess[key]);
  }
  return (squaredNormWhitened(right) + own) * most + ofDisplacements(gradients);
}

/** What it adds that the robot may have been carried: all that follows moves together, nothing among it changes. */
function ofDisplacements(gradients) {
  let added = 0;
  for (const { key: first, variances } of run.joint.displacements) {
    const moved = [0, 0, 0];
    for (const [key, g] of gradients) {
      if (key >= first) carriedTo(first, key, g).forEach((part, axis) => (moved[axis] += part));
    }
    added += moved.reduce((sum, part, axis) => sum + variances[axis] * part ** 2, 0);
  }
  return added;
}

/** A gradient by a key pose as one by another that moves along with it. */
function carriedTo(other, key, g) {
  const [x, y, turn] = between(poseOfKey(key), poseOfKey(other));
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  return [c * g[0] + s * g[1], c * g[1] - s * g[0], y * g[0] - x * g[1] + g[2]];
}

const quadratic = ([xx, xy, xt, yy, yt, tt], [a, b, c]) =>
  xx * a * a + yy * b * b + tt * c * c + 2 * (xy * a * b + xt * a * c + yt * b * c);

function squaredNormWhitened(x) {
  const { starts, rows, blocks, roots } = run.joint;
  let total = 0;
  for (let j = 0; j < starts.length - 1; j++) {
    const [d, at] = [9 * j, 3 * j];
    const a = x[at] / roots[d];
    const b = (x[at + 1] - roots[d + 3] * a) / roots[d + 4];
    const c = (x[at + 2] - roots[d + 6] * a - roots[d + 7] * b) / roots[d + 8];
    total += a * a + b * b + c * c;
    if (a === 0 && b === 0 && c === 0) continue;
    for (let q = starts[j]; q < starts[j + 1]; q++) {
      const [r, v] = [3 * rows[q], 9 * q];
      x[r] -= blocks[v] * a + blocks[v + 1] * b + blocks[v + 2] * c;
      x[r + 1] -= blocks[v + 3] * a + blocks[v + 4] * b + blocks[v + 5] * c;
      x[r + 2] -= blocks[v + 6] * a + blocks[v + 7] * b + blocks[v + 8] * c;
    }
  }
  return total;
}


// What is drawn on the map, layer by layer. Each function gets a canvas, its view and the state.

import { drawGrid } from "report/grid";
import { sureBounds } from "report/layers";
import { isRevealed, revealed } from "report/revealed";
import { endsOfRow, keyOfScan, nClosures, nKeys, nLandmarks, nScans, nWalls, poseOfKey, poseOfScan, rowOfScan, run } from "report/run";
import { colour, onScale } from "report/theme";

const BINS = 96;
const MOST_STEPS = 20_000; // of a path that is drawn; of longer ones only every so many scans are
const isOver = (state) => state.scan >= nScans - 1;

export function ground(context, view, state) {
  if (state.visible.has("grid")) drawGrid(context, view, isOver(state) ? undefined : revealed(keyOfScan(state.scan)));
  if (state.visible.has("metres")) metreLines(context, view);
  if (state.visible.has("walls")) walls(context, view, state);
  if (state.visible.has("returns")) returns(context, view, state);
}

function metreLines(context, view) {
  const step = [0.1, 0.5, 1, 5, 10, 50, 100, 500].find((metres) => metres * view.scale >= 34) ?? 1000;
  const [x0, y0, x1, y1] = view.box();
  context.strokeStyle = colour("map-grid");
  context.lineWidth = 1;
  context.beginPath();
  for (let x = Math.ceil(x0 / step); x * step <= x1; x++) {
    context.moveTo(Math.round(view.x(x * step)) + 0.5, 0);
    context.lineTo(Math.round(view.x(x * step)) + 0.5, view.height);
  }
  for (let y = Math.ceil(y0 / step); y * step <= y1; y++) {
    context.moveTo(0, Math.round(view.y(y * step)) + 0.5);
    context.lineTo(view.width, Math.round(view.y(y * step)) + 0.5);
  }
  context.stroke();
}

/** The pieces of wall that poses and map were refined with; in the replay those looked at so far. */
function walls(context, view, state) {
  const { ends } = run.walls;
  const isKnown = isOver(state) ? () => true : isRevealed(keyOfScan(state.scan));
  context.strokeStyle = colour("wall");
  context.lineWidth = Math.max(1.4, Math.min(3, 0.03 * view.scale));
  context.lineCap = "butt";
  context.beginPath();
  for (let i = 0; i < nWalls; i++) {
    const [ax, ay, bx, by] = ends.subarray(4 * i, 4 * i + 4);
    if (!isKnown((ax + bx) / 2, (ay + by) / 2)) continue;
    context.moveTo(view.x(ax), view.y(ay));
    context.lineTo(view.x(bx), view.y(by));
  }
  context.stroke();
}

const MOST_RETURNS = 250_000;

function returns(context, view, state) {
  const last = keyOfScan(state.scan);
  const every = Math.max(1, Math.ceil(((last + 1) * run.laser.directions.length) / 2 / MOST_RETURNS));
  context.fillStyle = colour("scan");
  context.globalAlpha = 0.5;
  const size = Math.max(1, Math.min(2.5, 0.02 * view.scale));
  for (let key = 0; key <= last; key += every) points(context, view, poseOfKey(key), endsOfRow(rowOfScan(run.keys.scans[key])), size);
  context.globalAlpha = 1;
}

/** The ends of beams, in the frame of a pose, as dots. */
export function points(context, view, [px, py, heading], ends, size) {
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  for (let i = 0; i < ends.length; i += 2) {
    const x = view.x(px + c * ends[i] - s * ends[i + 1]);
    const y = view.y(py + s * ends[i] + c * ends[i + 1]);
    if (view.holds(x, y, 0)) context.fillRect(x - size / 2, y - size / 2, size, size);
  }
}

export function path(context, view, state) {
  context.lineJoin = context.lineCap = "round";
  if (state.visible.has("odometry") && run.curves.odometry_path) {
    line(context, view, run.curves.odometry_path, keyOfScan(state.scan) + 1, colour("odometry"), [2, 5]);
  }
  if (state.visible.has("truth") && run.truth) line(context, view, run.truth.path, state.scan + 1, colour("truth"), [6, 5]);
  if (state.visible.has("path")) colouredPath(context, view, state);
  if (state.visible.has("poses")) poses(context, view, state);
}

function line(context, view, places, n, stroke, dashes) {
  context.strokeStyle = stroke;
  context.lineWidth = 1.6;
  context.setLineDash(dashes);
  context.beginPath();
  for (let i = 0; i < n; i++) context.lineTo(view.x(places[2 * i]), view.y(places[2 * i + 1]));
  context.stroke();
  context.setLineDash([]);
}

const shareOf = {
  time: (scan) => scan / Math.max(1, nScans - 1),
  sure: (scan) => (run.curves.position_sigma[keyOfScan(scan)] - sureBounds[0]) / (sureBounds[1] - sureBounds[0] || 1),
};

function colouredPath(context, view, state) {
  const bin = (scan) => Math.round(BINS * Math.min(1, Math.max(0, shareOf[state.colourBy](scan))));
  context.lineWidth = 2.2;
  let [current, x, y] = [-1, 0, 0];
  const every = Math.ceil(nScans / MOST_STEPS);
  for (let scan = 0; scan <= state.scan; scan += scan < state.scan && scan + every > state.scan ? state.scan - scan : every) {
    const [nx, ny] = [view.x(run.trajectory[3 * scan]), view.y(run.trajectory[3 * scan + 1])];
    if (scan && scan < state.scan && Math.abs(nx - x) + Math.abs(ny - y) < 1) continue;
    const next = bin(scan);
    if (next !== current) {
      if (current >= 0) context.stroke();
      current = next;
      context.strokeStyle = onScale(state.colourBy, next / BINS);
      context.beginPath();
      context.moveTo(scan ? x : nx, scan ? y : ny);
    }
    context.lineTo(nx, ny);
    [x, y] = [nx, ny];
  }
  context.stroke();
}

function poses(context, view, state) {
  const last = keyOfScan(state.scan);
  const size = Math.max(1.2, Math.min(3.5, 0.06 * view.scale));
  context.fillStyle = colour("ink");
  context.beginPath();
  for (let key = 0; key <= last; key++) {
    const [px, py] = poseOfKey(key);
    const [x, y] = [view.x(px), view.y(py)];
    if (!view.holds(x, y)) continue;
    context.moveTo(x + size, y);
    context.arc(x, y, size, 0, 2 * Math.PI);
  }
  context.fill();
}

/** How many times the 3σ ellipses are enlarged, so that one sees them; scale in pixels a metre. */
export function magnification(scale) {
  const widest = 3 * sureBounds[1] * scale;
  return [1, 2, 5, 10, 20, 50, 100, 200, 500].find((times) => widest * times >= 9) ?? 1000;
}

export function ellipses(context, view, state) {
  if (!state.visible.has("ellipses")) return;
  const [last, times] = [keyOfScan(state.scan), magnification(view.scale)];
  context.strokeStyle = colour("accent");
  context.fillStyle = colour("accent");
  context.lineWidth = 1;
  let before = [-Infinity, -Infinity];
  for (let key = 0; key <= last; key++) {
    const [px, py, heading] = poseOfKey(key);
    const [x, y] = [view.x(px), view.y(py)];
    if (!view.holds(x, y)) continue;
    const { major, minor, turn } = ellipseOf(key);
    if (Math.hypot(x - before[0], y - before[1]) < Math.max(6, 3 * times * major * view.scale)) continue;
    before = [x, y];
    context.beginPath();
    context.ellipse(x, y, 3 * times * major * view.scale, 3 * times * minor * view.scale, -(heading + turn), 0, 2 * Math.PI);
    context.globalAlpha = 0.9;
    context.stroke();
    context.globalAlpha = 0.06;
    context.fill();
  }
  context.globalAlpha = 1;
}

/** Standard deviations along the axes of a key pose's position [m], and how they are turned against the robot. */
export function ellipseOf(key) {
  const [xx, xy, , yy] = run.keys.covariances.subarray(6 * key, 6 * key + 6);
  const [mean, apart] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
  return { major: Math.sqrt(Math.max(0, mean + apart)), minor: Math.sqrt(Math.max(0, mean - apart)), turn: Math.atan2(2 * xy, xx - yy) / 2 };
}

export const CLOSURE_COLOURS = { accepted: "accepted", rejected: "rejected", removed: "removed", "by hand": "by-hand" };
const ORDER = ["rejected", "accepted", "by hand", "removed"];

export function closures(context, view, state) {
  const { scans, verdicts, names } = run.closures;
  for (const name of ORDER) {
    if (!state.visible.has(name)) continue;
    const code = names.indexOf(name);
    context.strokeStyle = colour(CLOSURE_COLOURS[name]);
    context.lineWidth = name === "accepted" || name === "rejected" ? 1.1 : 2.2;
    context.globalAlpha = name === "rejected" || name === "accepted" ? 0.6 : 0.95;
    context.setLineDash(name === "rejected" ? [3, 4] : name === "removed" ? [7, 4] : []);
    context.beginPath();
    for (let i = 0; i < nClosures; i++) {
      if (verdicts[i] !== code || Math.max(scans[2 * i], scans[2 * i + 1]) > state.scan) continue;
      const [a, b] = [poseOfScan(scans[2 * i]), poseOfScan(scans[2 * i + 1])];
      context.moveTo(view.x(a[0]), view.y(a[1]));
      context.lineTo(view.x(b[0]), view.y(b[1]));
    }
    context.stroke();
  }
  context.setLineDash([]);
  context.globalAlpha = 1;
}

const KINDS = { corner: "corner", end_of_wall: "end", intersection: "intersection" };
const STROKE = 0.3; // metres of wall beside a landmark

export function landmarks(context, view, state) {
  const { kinds, names, positions, directions, first_seen: first, expired_at: expired } = run.landmarks;
  const key = keyOfScan(state.scan);
  const size = Math.max(1.6, Math.min(3.2, 0.05 * view.scale));
  for (const [code, name] of names.entries()) {
    if (!state.visible.has(name)) continue;
    context.fillStyle = context.strokeStyle = colour(KINDS[name]);
    context.lineWidth = 1.4;
    context.beginPath();
    for (let i = 0; i < nLandmarks; i++) {
      if (kinds[i] !== code || first[i] > key || (expired[i] >= 0 && expired[i] <= key)) continue;
      const [x, y] = [view.x(positions[2 * i]), view.y(positions[2 * i + 1])];
      if (!view.holds(x, y)) continue;
      context.fillRect(x - size, y - size, 2 * size, 2 * size);
      for (const heading of directions.subarray(2 * i, 2 * i + 2)) {
        if (Number.isNaN(heading)) continue;
        context.moveTo(x, y);
        context.lineTo(x + STROKE * view.scale * Math.cos(heading), y - STROKE * view.scale * Math.sin(heading));
      }
    }
    context.stroke();
  }
}

/** Where tracking was lost, and other warnings that have a place: triangles. */
export function warned(context, view, state) {
  if (!state.visible.has("lost")) return;
  const scans = new Set([...run.lost, ...run.warnings.map((warning) => warning.scan).filter((scan) => scan !== null)]);
  for (const scan of scans) {
    if (scan > state.scan) continue;
    const [px, py] = poseOfScan(scan);
    const [x, y] = [view.x(px), view.y(py)];
    context.fillStyle = colour("lost");
    context.strokeStyle = colour("card");
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x, y - 19);
    context.lineTo(x + 9, y - 3);
    context.lineTo(x - 9, y - 3);
    context.closePath();
    context.fill();
    context.stroke();
    context.fillStyle = colour("card");
    context.fillRect(x - 1, y - 13.5, 2, 5);
    context.fillRect(x - 1, y - 7, 2, 2);
  }
}

// What moves or comes and goes on the map: the robot and its scan, what is selected, pointed at or measured.

import { CLOSURE_COLOURS, points } from "report/draw";
import { endsOfRow, lastAtOrBefore, nKeys, poseOfKey, poseOfScan, run } from "report/run";
import { colour } from "report/theme";

/** The robot and its scan at the slider, what is selected, what is pointed at, and what is measured. */
export function moving(context, view, state) {
  if (state.selection?.type === "closure") selectedClosure(context, view, state.selection.index);
  const key = state.selection?.type === "pose" ? state.selection.index : null;
  if (key !== null) {
    if (!isAt(state, key)) scanAt(context, view, run.keys.scans[key], "accent");
    ring(context, view, poseOfKey(key), colour("accent"), 9, 2.5);
  }
  if (state.visible.has("scan")) scanAt(context, view, state.scan, "scan");
  robot(context, view, poseOfScan(state.scan));
  if (state.cursor !== null && state.cursor < nKeys) ring(context, view, poseOfKey(state.cursor), colour("ink"), 6, 2);
  measured(context, view, state.measured);
}

const isAt = (state, key) => state.visible.has("scan") && state.scan === run.keys.scans[key];

function selectedClosure(context, view, index) {
  const [i, j] = run.closures.scans.subarray(2 * index, 2 * index + 2);
  const [a, b] = [poseOfScan(i), poseOfScan(j)];
  context.strokeStyle = colour(CLOSURE_COLOURS[run.closures.names[run.closures.verdicts[index]]]);
  context.lineWidth = 4;
  context.beginPath();
  context.moveTo(view.x(a[0]), view.y(a[1]));
  context.lineTo(view.x(b[0]), view.y(b[1]));
  context.stroke();
  ring(context, view, a, colour("a"), 7, 3);
  ring(context, view, b, colour("b"), 7, 3);
}

function scanAt(context, view, scan, name) {
  const row = lastAtOrBefore(run.laser.scans, scan);
  context.fillStyle = colour(name);
  points(context, view, poseOfScan(run.laser.scans[row]), endsOfRow(row), 2.6);
}

function ring(context, view, [px, py], stroke, radius, width) {
  context.lineWidth = width + 2;
  context.strokeStyle = colour("card");
  context.beginPath();
  context.arc(view.x(px), view.y(py), radius, 0, 2 * Math.PI);
  context.stroke();
  context.lineWidth = width;
  context.strokeStyle = stroke;
  context.stroke();
}

function robot(context, view, [px, py, heading]) {
  context.save();
  context.translate(view.x(px), view.y(py));
  context.rotate(-heading);
  context.beginPath();
  context.moveTo(13, 0);
  context.lineTo(-8, 8);
  context.lineTo(-4, 0);
  context.lineTo(-8, -8);
  context.closePath();
  context.fillStyle = colour("robot");
  context.strokeStyle = colour("card");
  context.lineWidth = 2;
  context.stroke();
  context.fill();
  context.restore();
}

function measured(context, view, sightings) {
  if (!sightings.length) return;
  const places = sightings.map(({ x, y }) => [view.x(x), view.y(y)]);
  context.strokeStyle = colour("ink");
  context.lineWidth = 2;
  context.setLineDash([]);
  context.beginPath();
  for (const [x, y] of places) context.lineTo(x, y);
  context.stroke();
  for (const [x, y] of places) {
    context.fillStyle = colour("card");
    context.beginPath();
    context.arc(x, y, 5, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  }
}

// The map known so far: the grid, where a key scan has looked up to the time of the replay.

import { on } from "report/bus";
import { picture } from "report/grid";
import { compose, endsOfRow, nKeys, poseOfKey, rowOfScan, run } from "report/run";

const MOST = 900; // pixels of the mask's longer side
const BEYOND = 0.15; // metres that the view reaches into what it ends at
const MOST_VIEWS = 4000;
const every = Math.ceil(nKeys / MOST_VIEWS);
const { origin, columns, rows, resolution } = run.grid;
const shrink = Math.min(1, MOST / Math.max(columns, rows));
const blank = () => Object.assign(document.createElement("canvas"), { width: Math.ceil(shrink * columns), height: Math.ceil(shrink * rows) });
const [mask, shown] = [blank(), blank()];
let done = -1; // the last key scan that is in the mask
let stale = true;

on("theme", () => (stale = true));

/** A canvas of the grid as known after a key scan. */
export function revealed(key) {
  const context = mask.getContext("2d");
  if (key < done) {
    context.clearRect(0, 0, mask.width, mask.height);
    done = -1;
  }
  if (key > done) {
    stale = true;
    for (let next = done + 1; next <= key; next++) if (next % every === 0) addView(context, next);
    done = key;
  }
  if (stale) {
    stale = false;
    const over = shown.getContext("2d");
    over.globalCompositeOperation = "copy";
    over.drawImage(mask, 0, 0);
    over.globalCompositeOperation = "source-in";
    over.drawImage(picture, 0, 0, shown.width, shown.height);
  }
  return shown;
}

/** Tells of places [m] whether they were in view after a key scan. */
export function isRevealed(key) {
  revealed(key);
  const { data } = mask.getContext("2d").getImageData(0, 0, mask.width, mask.height);
  const scale = shrink / resolution;
  return (x, y) => {
    const column = Math.floor((x - origin[0]) * scale);
    const row = Math.floor(mask.height - (y - origin[1]) * scale);
    return data[4 * (row * mask.width + column) + 3] > 0;
  };
}

function addView(context, key) {
  const pose = poseOfKey(key);
  const [c, s] = [Math.cos(pose[2]), Math.sin(pose[2])];
  const laser = compose(pose, [...run.laser.origin, 0]);
  const scale = shrink / resolution;
  const x = (metres) => (metres - origin[0]) * scale;
  const y = (metres) => mask.height - (metres - origin[1]) * scale;
  const ends = endsOfRow(rowOfScan(run.keys.scans[key]));
  context.beginPath();
  context.moveTo(x(laser[0]), y(laser[1]));
  for (let i = 0; i < ends.length; i += 2) {
    const [ex, ey] = [pose[0] + c * ends[i] - s * ends[i + 1], pose[1] + s * ends[i] + c * ends[i + 1]];
    const farther = 1 + BEYOND / Math.hypot(ex - laser[0], ey - laser[1]);
    context.lineTo(x(laser[0] + farther * (ex - laser[0])), y(laser[1] + farther * (ey - laser[1])));
  }
  context.fill();
}

// Laying one scan on another by hand: drag it, turn it, and say that this is how they lie.

import { degrees, metres } from "report/format";
import { between, compose, endsOfRow, poseOfScan, rowOfScan } from "report/run";
import { colour } from "report/theme";

const MARGIN = 18; // pixels
const LEAST_REACH = 3; // metres shown to each side of the middle, at least …
const MOST_REACH = 25; // … and at most
const STRAY = 0.05; // share of the beams at each end that need not be in view
const NUDGES = { ArrowLeft: [-0.02, 0, 0], ArrowRight: [0.02, 0, 0], ArrowUp: [0, 0.02, 0], ArrowDown: [0, -0.02, 0] };
const TURNS = { "[": Math.PI / 360, "]": -Math.PI / 360 };

/** Fill the panel; `done(edit)` is called with what was chosen, or null. */
export function startDragging(panel, scanI, scanJ, done) {
  const clouds = [scanI, scanJ].map((scan) => endsOfRow(rowOfScan(scan)));
  let pose = [...between(poseOfScan(scanI), poseOfScan(scanJ))];
  if (Math.hypot(pose[0], pose[1]) > MOST_REACH) pose = [0, 0, pose[2]];
  panel.innerHTML = text(scanI, scanJ);
  panel.scrollTop = 0;
  const canvas = panel.querySelector("canvas");
  const readout = panel.querySelector("output");
  const view = viewOf([clouds[0], moved(pose, clouds[1])]);
  const paint = () => {
    draw(canvas, clouds, pose, view);
    readout.textContent = `${metres(pose[0])}, ${metres(pose[1])}, ${degrees(pose[2], 1)}`;
  };
  const move = (dx, dy, turn) => {
    pose = [pose[0] + dx, pose[1] + dy, pose[2] + turn];
    paint();
  };
  listen(canvas, view, move);
  panel.querySelector("[data-drag=left]").addEventListener("click", () => move(0, 0, Math.PI / 36));
  panel.querySelector("[data-drag=right]").addEventListener("click", () => move(0, 0, -Math.PI / 36));
  panel.querySelector("[data-drag=use]").addEventListener("click", () => done({ kind: "drag", scans: [scanI, scanJ], pose: wrapped(pose) }));
  panel.querySelector("[data-drag=match]").addEventListener("click", () => done({ kind: "add", scans: [scanI, scanJ] }));
  panel.querySelector("[data-drag=cancel]").addEventListener("click", () => done(null));
  paint();
  canvas.focus();
}

const wrapped = ([x, y, heading]) => [x, y, Math.atan2(Math.sin(heading), Math.cos(heading))];

const text = (i, j) => `<div class="head"><h2>Lay scan ${j} on scan ${i}</h2><button type="button" data-drag="cancel" aria-label="Close">✕</button></div>
  <p class="soft">Drag scan ${j} to where it belongs; turn it with the buttons, the wheel or [ and ]; arrow keys move it by 2 cm.</p>
  <p class="legend"><span><i style="background:var(--a)"></i>scan ${i}</span><span><i style="background:var(--b)"></i>scan ${j}</span></p>
  <canvas class="drag" tabindex="0" role="application" aria-label="Scan ${j} over scan ${i}: drag to move, brackets to turn"></canvas>
  <p><output></output></p>
  <div class="actions"><button type="button" data-drag="left">↺ 5°</button><button type="button" data-drag="right">↻ 5°</button></div>
  <div class="actions"><button type="button" class="main" data-drag="use">Close the loop like this</button><button type="button" data-drag="match" title="Search for how they fit, wherever that is">Let the matcher find it</button></div>`;

function listen(canvas, { reach }, move) {
  let last = null;
  const scale = () => (canvas.clientWidth - 2 * MARGIN) / (2 * reach);
  canvas.addEventListener("pointerdown", (event) => {
    last = event;
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (last === null) return;
    move((event.clientX - last.clientX) / scale(), -(event.clientY - last.clientY) / scale(), 0);
    last = event;
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (last = null));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    move(0, 0, -Math.sign(event.deltaY) * (Math.PI / 180));
  });
  canvas.addEventListener("keydown", (event) => {
    if (!(event.key in NUDGES) && !(event.key in TURNS)) return;
    event.preventDefault();
    event.stopPropagation(); // the replay has these keys, too
    move(...(NUDGES[event.key] ?? [0, 0, TURNS[event.key]]));
  });
}

/** The middle of two clouds and how far to each side of it is shown [m], with room to move one of them. */
function viewOf(clouds) {
  const [x, y] = [0, 1].map((axis) => {
    const sorted = clouds.flatMap((ends) => [...ends.filter((_, i) => i % 2 === axis)]).sort((a, b) => a - b);
    const at = (share) => sorted[Math.round(share * (sorted.length - 1))] ?? 0;
    return [Math.min(0, at(STRAY)), Math.max(0, at(1 - STRAY))];
  });
  const reach = 0.65 * Math.max(x[1] - x[0], y[1] - y[0]);
  return { x: (x[0] + x[1]) / 2, y: (y[0] + y[1]) / 2, reach: Math.min(MOST_REACH, Math.max(LEAST_REACH, reach)) };
}

function moved(pose, ends) {
  const out = new Float32Array(ends.length);
  for (let i = 0; i < ends.length; i += 2) [out[i], out[i + 1]] = compose(pose, [ends[i], ends[i + 1], 0]);
  return out;
}

function draw(canvas, clouds, pose, view) {
  const ratio = Math.min(2, window.devicePixelRatio || 1);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  [canvas.width, canvas.height] = [width * ratio, height * ratio];
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const scale = (width - 2 * MARGIN) / (2 * view.reach);
  const place = (x, y) => [width / 2 + scale * (x - view.x), height / 2 - scale * (y - view.y)];
  context.globalAlpha = 0.85;
  for (const [ends, at, name, size] of [[clouds[0], [0, 0, 0], "a", 4], [moved(pose, clouds[1]), pose, "b", 2.6]]) {
    context.fillStyle = colour(name);
    for (let i = 0; i < ends.length; i += 2) {
      const [x, y] = place(ends[i], ends[i + 1]);
      context.fillRect(x - size / 2, y - size / 2, size, size);
    }
    const [x, y] = place(at[0], at[1]);
    context.beginPath();
    context.arc(x, y, 5, 0, 2 * Math.PI);
    context.fill();
  }
}

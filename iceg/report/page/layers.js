// Which layers of the map there are, and the panel that switches them.

import { emit, on, set, state } from "report/bus";
import { count, length } from "report/format";
import { nKeys, nWalls, run } from "report/run";
import { onScale } from "report/theme";

const { closures, landmarks } = run;
const tally = (codes, code) => codes.reduce((n, value) => n + (value === code), 0);
const verdict = (name) => tally(closures.verdicts, closures.names.indexOf(name));
const kind = (name) => tally(landmarks.kinds, landmarks.names.indexOf(name));

function nReturns() {
  let n = 0;
  for (const range of run.laser.ranges) if (range > 0) n++;
  return n;
}

/** Colour bar of the path: what its ends mean. */
const SCALES = {
  time: () => ["start", "end"],
  sure: () => [length(sureBounds[0]), length(sureBounds[1])],
};

const sigmas = run.curves.position_sigma;
const sorted = Float32Array.from(sigmas).sort();
export const sureBounds = [sorted[0], Math.max(sorted[Math.floor(0.98 * (nKeys - 1))], 1e-4)];

export const GROUPS = [
  {
    title: "Map",
    layers: [
      { name: "grid", label: "Occupancy grid", swatch: ["", "map-wall"], shown: true },
      { name: "walls", label: "Walls", swatch: ["stroke", "wall"], n: nWalls },
      { name: "returns", label: "Laser returns", swatch: ["dot", "scan"], n: nReturns() },
      { name: "metres", label: "Grid in metres", swatch: ["stroke", "line"], shown: true },
    ],
  },
  {
    title: "Landmarks",
    layers: [
      { name: "corner", label: "Corners", swatch: ["dot", "corner"], n: kind("corner") },
      { name: "end_of_wall", label: "Ends of walls", swatch: ["dot", "end"], n: kind("end_of_wall") },
      { name: "intersection", label: "Intersections", swatch: ["dot", "intersection"], n: kind("intersection") },
    ],
  },
  {
    title: "Robot",
    layers: [
      { name: "path", label: "Path", swatch: ["stroke", "time-1"], shown: true },
      { name: "poses", label: "Key poses", swatch: ["dot", "ink"], n: nKeys },
      { name: "ellipses", label: "Their covariances", swatch: ["dot", "accent"] },
      { name: "scan", label: "Scan at the slider", swatch: ["dot", "scan"], shown: true },
      { name: "odometry", label: "Odometry alone", swatch: ["stroke", "odometry"], n: run.curves.odometry_path ? undefined : 0 },
      { name: "truth", label: "True path", swatch: ["stroke", "truth"], n: run.truth ? undefined : 0, shown: true },
    ],
  },
  {
    title: "Loop closures",
    layers: [
      { name: "accepted", label: "Accepted", swatch: ["stroke", "accepted"], n: verdict("accepted"), shown: true },
      { name: "by hand", label: "By hand", swatch: ["stroke", "by-hand"], n: verdict("by hand"), shown: true },
      { name: "removed", label: "Removed again", swatch: ["stroke", "removed"], n: verdict("removed"), shown: true },
      { name: "rejected", label: "Refused", swatch: ["stroke", "rejected"], n: verdict("rejected") },
      { name: "lost", label: "Tracking lost, warnings", swatch: ["dot", "lost"], n: run.lost.length + run.warnings.filter((w) => w.scan !== null).length, shown: true },
    ],
  },
];

const isThere = (layer) => layer.n !== 0;

/** Fill the panel and keep it right. */
export function showLayerPanel(element, key, isOpen) {
  for (const { layers } of GROUPS) for (const layer of layers) if (layer.shown && isThere(layer)) state.visible.add(layer.name);
  element.innerHTML = `<details ${isOpen ? "open" : ""}><summary>Layers</summary>${GROUPS.map(group).join("")}</details>`;
  const radios = element.querySelectorAll('input[type="radio"]');
  element.addEventListener("change", ({ target }) => {
    if (target.type === "radio") set("layers", { colourBy: target.value });
    else {
      state.visible[target.checked ? "add" : "delete"](target.name);
      emit("layers");
    }
  });
  const paint = () => {
    for (const radio of radios) radio.checked = radio.value === state.colourBy;
    const stops = [0, 0.25, 0.5, 0.75, 1].map((share) => onScale(state.colourBy, share));
    const [low, high] = SCALES[state.colourBy]();
    key.hidden = !state.visible.has("path");
    key.innerHTML = `<span>${low}</span><i style="background:linear-gradient(90deg, ${stops.join(",")})"></i><span>${high}</span>`;
    if (state.visible.has("ellipses")) key.innerHTML += `<span id="enlarged"></span>`;
    key.setAttribute("aria-label", `Colours of the path: from ${low} to ${high}`);
  };
  on("layers theme", paint);
  paint();
}

function group({ title, layers }) {
  const there = layers.filter(isThere);
  if (!there.length) return "";
  return `<div class="group"><b>${title}</b>${there.map(row).join("")}${title === "Robot" ? pathKey : ""}</div>`;
}

function row({ name, label, swatch, n, shown }) {
  const tallied = n === undefined ? "" : `<small aria-label="${count(n, "item")}">${n > 99999 ? `${Math.round(n / 1000)}k` : n}</small>`;
  return `<label><input type="checkbox" name="${name}" ${shown ? "checked" : ""}><i class="${swatch[0]}" style="background:var(--${swatch[1]})"></i>${label}${tallied}</label>`;
}

const pathKey = `<div class="key" role="radiogroup" aria-label="Colour of the path">
  <label><input type="radio" name="colour" value="time" checked>Path by time</label>
  <label><input type="radio" name="colour" value="sure">Path by uncertainty, 1σ</label>
</div>`;

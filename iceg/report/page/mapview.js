// The map: what lies on it, and what a click or the pointer finds.

import { on, set, state } from "report/bus";
import * as draw from "report/draw";
import { moving } from "report/moving";
import { extent, keyOfScan, nClosures, nKeys, poseOfKey, poseOfScan, run } from "report/run";
import { addSheet } from "report/sheet";

const L = window.L;
const NEAR_POSE = 13; // pixels
const NEAR_CLOSURE = 7;
const FIRST_ZOOM = 5;

export const map = L.map("map", {
  crs: L.CRS.Simple,
  minZoom: -6,
  maxZoom: 10,
  zoomSnap: 0,
  zoomDelta: 0.75,
  wheelPxPerZoomLevel: 90,
  zoomControl: false,
  attributionControl: false,
  keyboard: false,
  doubleClickZoom: false,
  maxBoundsViscosity: 0,
});

/** Show the whole map. */
export function fit() {
  const [x0, y0, x1, y1] = extent();
  const panel = document.getElementById("layers");
  const isOpen = panel.querySelector("details")?.open && map.getSize().x > 3 * panel.offsetWidth;
  map.fitBounds([[y0, x0], [y1, x1]], { paddingTopLeft: [60, 8], paddingBottomRight: [isOpen ? panel.offsetWidth + 20 : 8, 8], animate: false });
}

/** Bring a place into view, if it is not. */
export function show([x, y]) {
  if (!map.getBounds().pad(-0.12).contains([y, x])) map.panTo([y, x]);
}

export function startMap() {
  map.setView([0, 0], FIRST_ZOOM);
  const sheets = [draw.ground, draw.landmarks, draw.closures, draw.path, draw.ellipses, draw.warned, moving].map((paint, i) =>
    addSheet(map, (context, view) => paint(context, view, state), i),
  );
  const top = sheets.at(-1);
  on("layers theme scan", () => sheets.forEach((sheet) => sheet.touch()));
  on("cursor selection measured", () => top.touch());
  new ResizeObserver(() => map.invalidateSize({ animate: false })).observe(map.getContainer());
  fit();
  showCoordinates();
  showScale();
  map.on("click", clicked);
  document.getElementById("fit").addEventListener("click", fit);
  document.getElementById("zoom-in").addEventListener("click", () => map.zoomIn());
  document.getElementById("zoom-out").addEventListener("click", () => map.zoomOut());
}

function clicked({ latlng, containerPoint }) {
  if (state.measuring) return;
  const pose = nearestPose(containerPoint);
  const closure = nearestClosure(containerPoint);
  if (pose !== null && (closure === null || pose.off <= 0.7 * closure.off + 3)) set("selection", { selection: { type: "pose", index: pose.index } });
  else if (closure !== null) set("selection", { selection: { type: "closure", index: closure.index } });
  else if (state.selection !== null) set("selection", { selection: null });
  map.fire("picked", { latlng });
}

const at = ([x, y]) => map.latLngToContainerPoint([y, x]);

/** The key pose closest to a point of the screen: {index, off}, or null. */
export function nearestPose(point, near = NEAR_POSE) {
  let best = null;
  const last = keyOfScan(state.scan);
  for (let index = 0; index <= last && index < nKeys; index++) {
    const off = at(poseOfKey(index)).distanceTo(point);
    if (off <= (best?.off ?? near)) best = { index, off };
  }
  return best;
}

/** The closure in view whose line is closest to a point of the screen: {index, off}, or null. */
export function nearestClosure(point) {
  const { scans, verdicts, names } = run.closures;
  let best = null;
  for (let index = 0; index < nClosures; index++) {
    const [i, j] = scans.subarray(2 * index, 2 * index + 2);
    if (!state.visible.has(names[verdicts[index]]) || Math.max(i, j) > state.scan) continue;
    const off = L.LineUtil.pointToSegmentDistance(point, at(poseOfScan(i)), at(poseOfScan(j)));
    if (off <= (best?.off ?? NEAR_CLOSURE)) best = { index, off };
  }
  return best;
}

function showCoordinates() {
  const readout = document.getElementById("readout");
  const container = map.getContainer();
  let waiting = null;
  map.on("mousemove", (event) => {
    if (waiting === null) requestAnimationFrame(update);
    waiting = event;
  });
  map.on("mouseout", () => {
    readout.textContent = "";
    set("cursor", { cursor: null });
  });
  function update() {
    const { latlng, containerPoint } = waiting;
    waiting = null;
    readout.textContent = `x ${latlng.lng.toFixed(2)} m   y ${latlng.lat.toFixed(2)} m`;
    if (state.measuring || map.dragging?.moving()) return;
    const pose = nearestPose(containerPoint);
    container.style.cursor = pose !== null || nearestClosure(containerPoint) !== null ? "pointer" : "";
    set("cursor", { cursor: pose?.index ?? null });
  }
}

function showScale() {
  const bar = document.querySelector("#scale span");
  const update = () => {
    const pixels = map.getZoomScale(map.getZoom(), 0);
    const steps = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
    const metres = steps.findLast((step) => step * pixels <= 110) ?? steps[0];
    bar.style.width = `${metres * pixels}px`;
    const enlarged = document.getElementById("enlarged");
    if (enlarged) enlarged.textContent = `ellipses: 3σ${draw.magnification(pixels) > 1 ? `, ${draw.magnification(pixels)}× enlarged` : ""}`;
    bar.textContent = metres < 1 ? `${Math.round(100 * metres)} cm` : `${metres} m`;
  };
  map.on("zoom move", update);
  on("layers theme", update);
  update();
}

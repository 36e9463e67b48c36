// The replay: slider, buttons, keys.

import { on, set, state } from "report/bus";
import { duration } from "report/format";
import { fit, map } from "report/mapview";
import { toggleMeasuring } from "report/measure";
import { keyOfScan, nKeys, nScans, run } from "report/run";

const slider = document.getElementById("time");
const play = document.getElementById("play");
const now = document.getElementById("now");
const speed = document.getElementById("speed");
const ICONS = {
  play: '<svg viewBox="0 0 24 24" aria-hidden="true"><path d="M8 5l11 7-11 7z" fill="currentColor"/></svg>',
  pause: '<svg viewBox="0 0 24 24" aria-hidden="true"><path d="M8 5v14M16 5v14"/></svg>',
};
const SECONDS = [120, 60, 30, 15]; // what a replay of the whole run takes
const PAGE = 10; // key poses a larger step

/** Go so many key poses on. */
export function stepBy(keys) {
  const key = keyOfScan(state.scan);
  const isBetween = state.scan > run.keys.scans[key];
  const next = Math.min(nKeys, Math.max(0, key + keys + (isBetween && keys < 0 ? 1 : 0)));
  goTo(next === nKeys ? nScans - 1 : run.keys.scans[next]);
}

export const goTo = (scan) => set("scan", { scan: Math.min(nScans - 1, Math.max(0, Math.round(scan))) });

let [started, from] = [0, 0];

export function togglePlaying(wanted = !state.playing) {
  if (wanted && state.scan >= nScans - 1) goTo(0);
  set("play", { playing: wanted });
  [started, from] = [performance.now(), state.scan];
  if (wanted) requestAnimationFrame(tick);
}

function tick(time) {
  if (!state.playing) return;
  goTo(from + ((time - started) / 1000 / Number(speed.value)) * nScans);
  if (state.scan >= nScans - 1) togglePlaying(false);
  else requestAnimationFrame(tick);
}

export function startPlayer() {
  slider.max = nScans - 1;
  speed.innerHTML = SECONDS.map((seconds, i) => `<option value="${seconds}" ${i === 2 ? "selected" : ""}>${2 ** i / 4}×</option>`).join("");
  speed.addEventListener("change", () => togglePlaying(state.playing));
  slider.addEventListener("input", () => {
    togglePlaying(false);
    goTo(slider.valueAsNumber);
  });
  play.addEventListener("click", () => togglePlaying());
  document.getElementById("back").addEventListener("click", () => stepBy(-1));
  document.getElementById("forward").addEventListener("click", () => stepBy(1));
  document.addEventListener("keydown", pressed);
  document.addEventListener("click", unfocus);
  on("scan play", show);
  document.getElementById("ticks").innerHTML = warnedScans().map((scan) => `<i style="left:${(100 * scan) / Math.max(1, nScans - 1)}%"></i>`).join("");
  goTo(nScans - 1);
  show();
}

const warnedScans = () => [...new Set([...run.lost, ...run.warnings.map((warning) => warning.scan).filter((scan) => scan !== null)])];

function show() {
  slider.value = state.scan;
  const time = duration(run.stamps[state.scan]);
  now.innerHTML = `<b>scan ${state.scan}</b> of ${nScans - 1} · ${time}`;
  slider.setAttribute("aria-valuetext", `scan ${state.scan} of ${nScans - 1}, ${time}`);
  play.innerHTML = state.playing ? ICONS.pause : ICONS.play;
  play.setAttribute("aria-label", state.playing ? "Pause" : "Play");
}

/** After a click with the mouse or a finger, keys are the replay's again; who tabs keeps the focus. */
function unfocus({ target, detail }) {
  if (detail > 0) target.closest("button, summary, input:not([type=range])")?.blur();
}

const KEYS = {
  " ": () => togglePlaying(),
  ArrowLeft: (event) => stepBy(event.shiftKey ? -PAGE : -1),
  ArrowRight: (event) => stepBy(event.shiftKey ? PAGE : 1),
  Home: () => goTo(0),
  End: () => goTo(nScans - 1),
  "+": () => map.zoomIn(),
  "-": () => map.zoomOut(),
  0: () => fit(),
  m: () => toggleMeasuring(),
  Escape: () => {
    if (state.measuring) toggleMeasuring(false);
    set("selection", { selection: null });
  },
};

function pressed(event) {
  const { target, key } = event;
  if (event.ctrlKey || event.metaKey || event.altKey || target.matches("select, textarea, input:not([type=range])")) return;
  if (key === " " && target.matches("button, summary, a")) return; // a space presses what has the focus
  if (!(key in KEYS)) return;
  event.preventDefault();
  if (key.startsWith("Arrow")) togglePlaying(false);
  KEYS[key](event);
}

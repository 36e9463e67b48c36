// Measuring: two points are clicked, their distance is told with its standard deviation.

import { emit, on, set, state } from "report/bus";
import { distance, sightingAt } from "report/distance";
import { length, metres } from "report/format";
import { map } from "report/mapview";

const button = document.getElementById("measure");
const hint = document.getElementById("hint");

/** Measure, or stop measuring. */
export function toggleMeasuring(wanted = !state.measuring) {
  set("measured", { measuring: wanted, measured: [] });
  if (wanted) set("selection", { selection: null });
  say(wanted ? "Click two points of the map. Close to a wall, the wall is measured." : "");
}

/** What was measured so far: {length, deviation} in metres, or null before two points are there. */
export const measurement = () => (state.measured.length === 2 ? distance(...state.measured) : null);

function say(text) {
  hint.textContent = text;
  hint.hidden = text === "";
}

function clicked({ latlng }) {
  if (!state.measuring) return;
  const seen = sightingAt(latlng.lng, latlng.lat);
  if (seen === null) {
    say("No key scan has looked there: choose a point that is on the map.");
    return;
  }
  state.measured = state.measured.length === 2 ? [seen] : [...state.measured, seen];
  const found = measurement();
  say(found === null ? "Now the second point." : `${metres(found.length)} ± ${length(found.deviation)}`);
  emit("measured");
}

export function startMeasuring() {
  button.addEventListener("click", () => toggleMeasuring());
  map.on("click", clicked);
  on("measured", () => {
    button.setAttribute("aria-pressed", String(state.measuring));
    map.getContainer().classList.toggle("measuring", state.measuring);
  });
}

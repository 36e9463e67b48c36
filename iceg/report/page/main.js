// Starts the page, and says so to whatever wants to build on it.

import * as bus from "report/bus";
import { plots, startCurves } from "report/curves";
import * as distances from "report/distance";
import { asText, restoreView } from "report/corrections";
import { startEdits } from "report/edits";
import { startInspector } from "report/inspector";
import { showLayerPanel } from "report/layers";
import { map, show, startMap } from "report/mapview";
import { measurement, startMeasuring, toggleMeasuring } from "report/measure";
import { goTo, startPlayer } from "report/player";
import { run } from "report/run";
import { startTables } from "report/tables";
import "report/theme";

const isWide = matchMedia("(min-width: 1500px)").matches;

showLayerPanel(document.getElementById("layers"), document.getElementById("key"), isWide);
startPlayer();
startMap();
startMeasuring();
startInspector();
startTables();
startEdits();
restoreView();
// Curves are below the map: the first picture does not wait for them.
requestAnimationFrame(() =>
  setTimeout(() => {
    startCurves(document.getElementById("curves"), goTo);
    window.iceg = { ...bus, run, map, show, goTo, plots, measurement, toggleMeasuring, asText, ...distances };
    document.documentElement.dataset.ready = "true";
    window.dispatchEvent(new CustomEvent("iceg:ready", { detail: window.iceg }));
  }),
);

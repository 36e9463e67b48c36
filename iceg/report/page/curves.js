// Curves along the path, one value a key pose, with one cursor that the map shares.

import { on, set, state } from "report/bus";
import { duration } from "report/format";
import { nKeys, run, stages } from "report/run";
import { colour } from "report/theme";

const uPlot = window.uPlot;
const HEIGHT = 190;
const { curves, keys, factors, truth } = run;
const scans = Array.from(keys.scans);
const numbers = (array, factor = 1) => Array.from(array, (value) => (Number.isFinite(value) ? factor * value : null));
const milli = (name) => numbers(curves[name], 1000);

const PLOTS = nKeys < 2 ? [] : [ // one key pose makes no curve
  {
    title: "How well the position is known",
    note: "One standard deviation along the worst direction, relative to the first pose. Dots: loop closures in force, which pull it down.",
    unit: "mm",
    series: () => [{ label: "position", values: milli("position_sigma"), colour: "accent" }, { label: "closure", values: atClosures(milli("position_sigma")), colour: "accepted", dots: 5 }],
  },
  {
    title: "How well the heading is known",
    note: "One standard deviation.",
    unit: "°",
    series: () => [{ label: "heading", values: numbers(curves.heading_sigma), colour: "accent" }, { label: "closure", values: atClosures(numbers(curves.heading_sigma)), colour: "accepted", dots: 5 }],
  },
  curves.odometry_off && {
    title: "Odometry alone against the path",
    note: "How far off the recorded odometry would be by then.",
    unit: "m",
    series: () => [{ label: "position", values: numbers(curves.odometry_off), colour: "odometry" }, { label: "heading", values: numbers(curves.odometry_turn), colour: "removed", scale: "°" }],
  },
  {
    title: "Residuals of the factors",
    note: "How far the final path is from what was measured, in the measurement's own standard deviations. Three in a hundred beyond 3 is no wonder.",
    unit: "σ",
    series: () => ["odometry", "ice", "closure"].map((kind) => ({ label: kind === "ice" ? "matches" : kind, values: residuals(kind), colour: `kind-${kind}`, dots: 3.5 })),
  },
  {
    title: "Share of each scan that the map explains",
    note: "Returns that end at a wall of the finished map. It dips where people, glass or a wrong pose are.",
    unit: "%",
    range: [0, 100],
    series: () => [{ label: "explained", values: numbers(curves.explained, 100), colour: "kind-ice" }],
  },
  truth && {
    title: "Error against the truth",
    note: "Distance from the true path laid over this one, with what is claimed.",
    unit: "mm",
    series: () => [{ label: "error", values: numbers(truth.error, 1000), colour: "poor" }, { label: "claimed, 1σ", values: milli("position_sigma"), colour: "accent" }],
  },
  truth && {
    title: "NEES: the error in units of what is claimed",
    note: `Three on average is right; 95 in 100 lie below ${truth.nees_bounds[1].toFixed(1)} and above ${truth.nees_bounds[0].toFixed(1)}.`,
    unit: "",
    series: () => [{ label: "NEES", values: numbers(truth.nees), colour: "kind-ice" }],
  },
].filter(Boolean);

function atClosures(values) {
  const marked = new Array(nKeys).fill(null);
  const code = factors.names.indexOf("closure");
  factors.kinds.forEach((kind, m) => {
    if (kind === code) marked[factors.j[m]] = values[factors.j[m]];
  });
  return marked;
}

function residuals(kind) {
  const worst = new Array(nKeys).fill(null);
  const code = factors.names.indexOf(kind);
  factors.kinds.forEach((found, m) => {
    if (found === code) worst[factors.j[m]] = Math.max(worst[factors.j[m]] ?? 0, factors.sigmas[m]);
  });
  return worst;
}

export const plots = [];

export function startCurves(element, goTo) {
  for (const plot of PLOTS) element.append(card(plot));
  element.append(stageCard());
  const build = () => {
    for (const made of plots.splice(0)) made.destroy();
    for (const [i, plot] of PLOTS.entries()) plots.push(made(plot, element.children[i].querySelector(".canvas"), goTo));
  };
  build();
  on("theme", build);
  on("scan", () => plots.forEach(markNow));
  on("cursor", follow);
  new ResizeObserver(() => plots.forEach((plot) => plot.setSize({ width: plot.root.parentElement.clientWidth, height: HEIGHT }))).observe(element);
}

function card({ title, note }) {
  const element = document.createElement("div");
  element.className = "card plot";
  element.innerHTML = `<h3>${title}</h3><p class="note">${note}</p><div class="canvas" role="img" aria-label="${title}"></div>`;
  return element;
}

let isFollowing = false;

/** The cursor of all curves goes where the map is pointed at. */
function follow() {
  if (isFollowing) return;
  isFollowing = true;
  for (const plot of plots) {
    if (state.cursor === null) plot.setCursor({ left: -10, top: -10 }, false);
    else plot.setCursor({ left: plot.valToPos(scans[state.cursor], "x"), top: plot.over.clientHeight / 2 }, false);
  }
  isFollowing = false;
}

function pointed(plot) {
  if (isFollowing) return;
  set("cursor", { cursor: plot.cursor.idx ?? null });
}

function made(plot, holder, goTo) {
  const series = plot.series();
  const units = [...new Set(series.map(({ scale }) => scale ?? "y"))];
  const value = (unit) => (_, v) => (v === null || v === undefined ? "–" : `${v.toPrecision(3)} ${unit}`.trim());
  const axis = (extra) => ({ stroke: colour("soft"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), width: 1 }, font: "11.5px system-ui", ...extra });
  const options = {
    width: holder.clientWidth,
    height: HEIGHT,
    cursor: { drag: { x: true, y: false }, points: { size: 7 }, y: false },
    scales: { x: { time: false }, y: { range: plot.range ?? ((_, low, high) => [Math.min(0, low), high * 1.06 || 1]) } },
    axes: [
      axis({ size: 34 }),
      ...units.map((unit, i) => axis({ scale: unit, side: i ? 1 : 3, size: 60, grid: { show: i === 0, stroke: colour("line"), width: 1 }, values: (_, ticks) => ticks.map((tick) => `${tick} ${unit === "y" ? plot.unit : unit}`.trim()) })),
    ],
    series: [
      { label: "scan", value: (_, scan) => (scan === null ? "–" : `${scan} · ${duration(run.stamps[scan])}`) },
      ...series.map((one) => ({
        label: one.label,
        scale: one.scale ?? "y",
        stroke: colour(one.colour),
        width: one.dots ? 0 : 1.5,
        spanGaps: !one.dots,
        points: one.dots ? { show: true, size: one.dots, fill: colour(one.colour), width: 0 } : { show: false },
        paths: one.dots ? () => null : undefined,
        value: value(one.scale ?? plot.unit),
      })),
    ],
    legend: { markers: { width: 0, fill: (_, i) => (i ? colour(series[i - 1].colour) : "transparent") } },
    hooks: { setCursor: [pointed], ready: [addMark], draw: [markNow] },
  };
  const chart = new uPlot(options, [scans, ...series.map(({ values }) => values)], holder);
  chart.over.addEventListener("click", () => chart.cursor.idx !== null && chart.cursor.idx !== undefined && goTo(scans[chart.cursor.idx]));
  chart.over.addEventListener("mouseleave", () => set("cursor", { cursor: null }));
  return chart;
}

/** A line at the time of the replay. */
function addMark(chart) {
  chart.mark = Object.assign(document.createElement("div"), { className: "now" });
  chart.over.append(chart.mark);
  markNow(chart);
}

function markNow(chart) {
  if (!chart.mark) return;
  const x = chart.valToPos(state.scan, "x");
  chart.mark.hidden = !(x >= 0 && x <= chart.over.clientWidth);
  chart.mark.style.transform = `translateX(${x - 1}px)`;
}

const STAGES = { front_end: "Tracking", sweep: "Sweep of the laser", graph: "Graph and closures", finish: "Finish", covariances: "Covariances", feature_map: "Landmarks", grid: "Grid" };

function stageCard() {
  const element = document.createElement("div");
  element.className = "card";
  const most = Math.max(...Object.values(stages));
  const rows = Object.entries(stages).map(([name, seconds]) => `<span>${STAGES[name] ?? name}</span><div style="width:${(100 * seconds) / most}%"></div><span class="seconds">${seconds.toFixed(2)} s</span>`);
  element.innerHTML = `<h3>Time a stage</h3><div class="bars">${rows.join("")}</div>`;
  return element;
}

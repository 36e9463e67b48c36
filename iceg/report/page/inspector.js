// The panel beside the map: what was clicked, a measurement, or else what the run is.

import { emit, on, set, state } from "report/bus";
import { drawPair } from "report/closureview";
import { CLOSURE_COLOURS, ellipseOf } from "report/draw";
import { count, degrees, duration, escaped, facts, length, metres, percent } from "report/format";
import { show } from "report/mapview";
import { measurement, toggleMeasuring } from "report/measure";
import { between, keyOfScan, nClosures, nKeys, nLandmarks, poseOfKey, poseOfScan, run } from "report/run";

const panel = document.getElementById("inspector");
const { closures, factors, keys } = run;
const KIND_LABELS = { prior: "Anchor", odometry: "Odometry", ice: "Match", closure: "Loop closure" };

export function startInspector() {
  on("selection measured", render);
  on("theme", render);
  panel.addEventListener("click", ({ target }) => {
    const button = target.closest("[data-do]");
    if (button) act(button.dataset.do, Number(button.dataset.at));
  });
  render();
}

function act(what, at) {
  if (what === "close") {
    if (state.measuring) toggleMeasuring(false);
    set("selection", { selection: null });
  } else if (what === "scan") set("scan", { scan: at, playing: false });
  else {
    set("selection", { selection: { type: what, index: at } });
    show(what === "pose" ? poseOfKey(at) : poseOfScan(closures.scans[2 * at + 1]));
  }
}

function render() {
  const { selection } = state;
  if (state.measuring) panel.innerHTML = ofMeasurement();
  else if (selection === null) panel.innerHTML = overview();
  else if (selection.type === "pose") panel.innerHTML = ofPose(selection.index);
  else showClosure(selection.index);
  panel.scrollTop = 0;
  emit("inspected");
}

const head = (title, before = "") =>
  `<div class="head"><h2>${title}</h2>${before}<button type="button" data-do="close" aria-label="Close">✕</button></div>`;
const step = (type, at, sign, label) => `<button type="button" data-do="${type}" data-at="${at}" aria-label="${label}">${sign}</button>`;
const link = (type, at, text) => `<button type="button" class="link" data-do="${type}" data-at="${at}">${text}</button>`;

function overview() {
  const accepted = closures.verdicts.filter((code) => closures.names[code] === "accepted" || closures.names[code] === "by hand").length;
  const places = run.warnings.filter((warning) => warning.scan !== null).slice(0, 6);
  const list = places.map((warning) => `<p>${link("scan", warning.scan, `Scan ${warning.scan}`)} ${escaped(warning.sentence)}</p>`).join("");
  return `<h2>What you see</h2>
    <p>The map of <b>${escaped(run.name)}</b>: ${count(nKeys, "key pose")}, ${count(accepted, "loop closure")} in force, ${count(run.landmarks.settled, "landmark")} (${nLandmarks.toLocaleString("en")} with those seen rarely or expired).</p>
    <p class="soft">Click a <b>pose</b> of the path for its scan, its covariance and what holds it; click a <b>loop closure</b> for the two scans it joins. The slider replays the run: space plays, ← and → step, Shift makes larger steps.</p>
    <p class="soft">The ruler measures between two points and says how well the distance is known.</p>
    ${list ? `<h3>Look here</h3>${list}` : ""}${leastAgreed()}
    <div class="actions" data-for="overview"></div>`;
}

const MOST_DOUBTED = 8;

/** The closures in force that the final path agrees with least. */
function leastAgreed() {
  const held = [...closures.factors.keys()].filter((index) => closures.factors[index] >= 0);
  if (!held.length) return "";
  const sigma = (index) => factors.sigmas[closures.factors[index]];
  const worst = held.sort((a, b) => sigma(b) - sigma(a) || a - b).slice(0, MOST_DOUBTED);
  const rows = worst.map((index) => {
    const [i, j] = closures.scans.subarray(2 * index, 2 * index + 2);
    return `<tr><td>${link("closure", index, `Closure ${index}`)}</td><td>${i} – ${j}</td><td>${sigma(index).toFixed(1)} σ</td></tr>`;
  });
  return `<h3>Closures the path agrees with least</h3><table class="list"><thead><tr><th>Closure</th><th>scans</th><th>residual</th></tr></thead><tbody>${rows.join("")}</tbody></table>`;
}

function ofMeasurement() {
  const found = measurement();
  const seen = state.measured.map(({ scan, reach, x, y }, i) => [`Point ${i + 1}`, `${reach === null ? "free space" : "wall"} at ${x.toFixed(2)}, ${y.toFixed(2)}, scan ${scan}`]);
  const value = found === null ? "–" : `<span id="measured-length">${metres(found.length)}</span> <small>± <span id="measured-deviation">${length(found.deviation)}</span></small>`;
  return `${head("Distance")}<p class="big">${value}</p><dl class="facts">${facts(seen)}</dl>
    <p class="soft">One standard deviation, from the joint covariance of the two poses that saw the points: what moves both together does not count. On walls, the noise of the laser is in it.</p>`;
}

function ofPose(key) {
  const scan = keys.scans[key];
  const [x, y, heading] = poseOfKey(key);
  const { major, minor } = ellipseOf(key);
  const rows = [
    ["Position", `${x.toFixed(3)}, ${y.toFixed(3)} m`],
    ["Heading", degrees(heading, 1)],
    ["Known to, widest (1σ)", length(major)],
    ["Known to, narrowest", length(minor)],
    ["Heading known to", degrees(Math.sqrt(Math.max(0, keys.covariances[6 * key + 5])), 3)],
    ["Scan explained by the map", percent(run.curves.explained[key])],
    ["Time", duration(run.stamps[scan])],
  ];
  const walk = step("pose", Math.max(0, key - 1), "‹", "Key pose before") + step("pose", Math.min(nKeys - 1, key + 1), "›", "Next key pose");
  return `${head(`Key pose ${key}`, walk)}<p class="soft">Scan ${scan}. ${link("scan", scan, "Go there")}</p>
    <dl class="facts">${facts(rows)}</dl><h3>Held by</h3>${heldBy(key)}<div class="actions" data-for="pose" data-index="${key}"></div>`;
}

function heldBy(key) {
  const held = [];
  for (let m = 0; m < factors.kinds.length; m++) if (factors.i[m] === key || factors.j[m] === key) held.push(m);
  const body = held.map((m) => {
    const other = factors.i[m] === key ? factors.j[m] : factors.i[m];
    const label = KIND_LABELS[factors.names[factors.kinds[m]]];
    const named = closureOf(m) === null ? label : link("closure", closureOf(m), label);
    return `<tr><td>${named}</td><td>${other < 0 ? "map" : link("pose", other, `pose ${other}`)}</td><td>${factors.sigmas[m].toFixed(1)} σ</td></tr>`;
  });
  return `<table class="list"><thead><tr><th>Factor</th><th>with</th><th>residual</th></tr></thead><tbody>${body.join("")}</tbody></table>`;
}

const closureOfFactor = new Map([...closures.factors].map((factor, index) => [factor, index]));
const closureOf = (factor) => closureOfFactor.get(factor) ?? null;

function showClosure(index) {
  const [i, j] = closures.scans.subarray(2 * index, 2 * index + 2);
  const matched = closures.matched.subarray(3 * index, 3 * index + 3);
  const onPath = between(poseOfScan(i), poseOfScan(j));
  const isMatched = !Number.isNaN(matched[0]);
  panel.innerHTML = closureText(index, i, j, isMatched ? matched : null, onPath);
  for (const canvas of panel.querySelectorAll("canvas")) drawPair(canvas, i, j, canvas.dataset.as === "matched" ? matched : onPath);
}

function closureText(index, i, j, matched, onPath) {
  const verdict = closures.names[closures.verdicts[index]];
  const walk = step("closure", (index + nClosures - 1) % nClosures, "‹", "Closure before") + step("closure", (index + 1) % nClosures, "›", "Next closure");
  const picture = (as, caption) =>
    `<figure><canvas data-as="${as}" role="img" aria-label="Scans ${i} and ${j} laid on each other, ${as === "matched" ? "as matched" : "as on the path"}"></canvas><figcaption>${caption}</figcaption></figure>`;
  return `${head(`Closure ${index}`, walk)}
    <p><span class="badge" style="background:var(--${CLOSURE_COLOURS[verdict]})">${verdict === "rejected" ? "refused" : verdict}</span> ${escaped(inWords(closures.reasons[index]))}</p>
    <p class="legend"><span><i style="background:var(--a)"></i>${link("scan", i, `scan ${i}`)}</span><span><i style="background:var(--b)"></i>${link("scan", j, `scan ${j}`)}</span></p>
    <div class="actions" data-for="closure" data-index="${index}"></div>
    <dl class="facts">${facts(closureFacts(index, matched, onPath))}</dl>
    ${matched === null ? '<p class="soft">The matcher found no place where the scans agree.</p>' : picture("matched", closures.inliers[index] > 0 ? "As matched" : "As given by hand")}
    ${picture("path", "As the final path has them")}
    <p class="soft">Joins ${link("pose", keyOfScan(i), `key pose ${keyOfScan(i)}`)} and ${link("pose", keyOfScan(j), `key pose ${keyOfScan(j)}`)}.</p>`;
}

function closureFacts(index, matched, onPath) {
  const factor = closures.factors[index];
  const rows = [];
  if (factor >= 0) {
    rows.push(["Residual", `${factors.sigmas[factor].toFixed(2)} σ`]);
    if (factors.weights[factor] < 0.995) rows.push(["Weight left by the robust kernel", percent(factors.weights[factor])]);
  }
  if (!Number.isNaN(closures.off_path[index])) rows.push(["Off the path when it was found", `${closures.off_path[index].toFixed(1)} σ at most`]);
  const rival = closures.rivals[index];
  if (rival) {
    rows.push(["Other place that fits", `${length(rival.apart)} away`], ["Misfit there, and here", `${rival.misfit.toFixed(2)}, ${rival.own.toFixed(2)}`]);
  }
  if (matched !== null) {
    const [dx, dy, turn] = between(matched, onPath);
    rows.push([closures.inliers[index] > 0 ? "Path against match" : "Path against what was given", `${length(Math.hypot(dx, dy))}, ${degrees(turn)}`]);
    if (closures.inliers[index] > 0) {
      rows.push(["Score", closures.scores[index].toFixed(3)], ["Beams that agree", String(closures.inliers[index])], ["Overlap", percent(closures.overlaps[index])]);
    }
  }
  return rows;
}

/** What the three figures of a verdict mean, written out. */
function inWords(reason) {
  const words = reason
    .replace(/overlap (\d\.\d+)/, (_, share) => `${percent(Number(share))} of the beams fall on the earlier pass`)
    .replace(/fit (\d\.\d+)/, (_, share) => `${percent(Number(share))} of those agree with it`)
    .replace(/view (\d\.\d+)/, (_, share) => `${percent(Number(share))} of what should be in view is seen`);
  return `${words.charAt(0).toUpperCase()}${words.slice(1)}.`;
}

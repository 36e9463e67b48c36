// Corrections made in the page: buttons beside what was clicked, and a bar that says what was corrected.

import { emit, on, state } from "report/bus";
import { apply, corrections, download, isLive, onCorrected, undo } from "report/corrections";
import { startDragging } from "report/dragging";
import { count, escaped } from "report/format";
import { map } from "report/mapview";
import { keyOfScan, nKeys, run } from "report/run";

const AROUND = 10; // key poses to either side of a closure, whose neighbours go with it

const panel = document.getElementById("inspector");
const bar = document.createElement("div");
let laidOn = null; // scan that waits for the place it belongs to

export function startEdits() {
  bar.id = "edits";
  bar.className = "floating";
  bar.setAttribute("role", "status");
  map.getContainer().parentElement.append(bar);
  bar.addEventListener("click", ({ target }) => {
    const what = target.closest("[data-edit]")?.dataset.edit;
    if (what === "undo") undo();
    else if (what === "download") download();
    else if (what === "stop") stopLaying();
  });
  panel.addEventListener("click", ({ target }) => {
    const button = target.closest("[data-edit]");
    if (button) chosen(button.dataset.edit, Number(button.dataset.at));
  });
  on("inspected", offer);
  on("selection", laid);
  onCorrected(showBar);
  showBar();
  offer();
}

const button = (edit, at, label, title) => `<button type="button" data-edit="${edit}" data-at="${at}" title="${title}">${label}</button>`;

/** Put the buttons where the inspector leaves room for them. */
function offer() {
  for (const room of panel.querySelectorAll(".actions")) {
    const at = Number(room.dataset.index);
    if (room.dataset.for === "closure") room.innerHTML = forClosure(at);
    else if (room.dataset.for === "pose") room.innerHTML = button("lay", at, "Lay on another scan…", "This scan sees the same place as another");
  }
}

function forClosure(index) {
  const verdict = run.closures.names[run.closures.verdicts[index]];
  const isMatched = !Number.isNaN(run.closures.matched[3 * index]);
  const isByHand = run.closures.reasons[index].startsWith("by hand");
  const offers = [];
  if (verdict === "accepted") {
    offers.push(button("forbid", index, "Forbid", "This closure is wrong"));
    offers.push(button("around", index, "Forbid all around", `None between the ${2 * AROUND} key poses around its ends`));
  }
  if (verdict === "accepted") offers.push(button("pin", index, "Pin", "Believe it whatever contradicts it"));
  else if (!isByHand && isMatched) offers.push(button("accept", index, "Accept", "Add it as it was matched"));
  if (isByHand && isLive) offers.push(button("withdraw", index, "Take out", "This closure by hand is wrong"));
  offers.push(button("drag", index, "Drag…", "Lay one scan on the other by hand"));
  return offers.join("");
}

function chosen(edit, at) {
  if (edit === "lay") return layOnAnother(run.keys.scans[at]);
  const scans = [...run.closures.scans.subarray(2 * at, 2 * at + 2)];
  if (edit === "forbid") apply({ kind: "forbid", scans });
  else if (edit === "around") apply({ kind: "forbid", between: scans.map(intervalAround) });
  else if (edit === "withdraw") apply({ kind: "withdraw", scans });
  else if (edit === "pin") apply({ kind: "pin", scans });
  else if (edit === "accept") apply({ kind: "add", scans, pose: [...run.closures.matched.subarray(3 * at, 3 * at + 3)] });
  else if (edit === "drag") startDragging(panel, scans[0], scans[1], finish);
}

function intervalAround(scan) {
  const key = keyOfScan(scan);
  return [run.keys.scans[Math.max(0, key - AROUND)], run.keys.scans[Math.min(nKeys - 1, key + AROUND)]];
}

/** What came of dragging: null where it was given up. */
function finish(edit) {
  if (edit === null) emit("selection");
  else apply(edit);
}

function layOnAnother(scan) {
  laidOn = scan;
  showBar();
}

function stopLaying() {
  laidOn = null;
  showBar();
}

function laid() {
  if (laidOn === null || state.selection?.type !== "pose") return;
  const other = run.keys.scans[state.selection.index];
  if (other === laidOn) return;
  const [first, second] = [Math.min(laidOn, other), Math.max(laidOn, other)];
  stopLaying();
  startDragging(panel, first, second, finish);
}

function showBar() {
  const { n, busy, error, warnings } = corrections;
  const parts = [];
  if (busy) parts.push("<b>Solving…</b>");
  else if (laidOn !== null) parts.push(`Click the pose that scan ${laidOn} belongs to. <button type="button" data-edit="stop">Stop</button>`);
  else if (n > 0) {
    parts.push(`<b>${count(n, "correction")}</b>${isLive ? ", saved" : ""} <button type="button" data-edit="undo">Undo</button>`);
    if (!isLive) parts.push('<button type="button" class="main" data-edit="download">Download corrections</button>');
  }
  if (error) parts.push(`<span class="wrong">${escaped(error)}</span>`);
  for (const warning of busy ? [] : warnings) parts.push(`<span class="soft">${escaped(warning)}</span>`);
  bar.innerHTML = parts.map((part) => `<div>${part}</div>`).join("");
  bar.hidden = parts.length === 0;
}

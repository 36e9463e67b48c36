// What was corrected: kept by the server that serves the page, or else in the page, to be downloaded.

import { map } from "report/mapview";
import { run } from "report/run";

const served = window.icegServed ?? null;
const VIEW = "iceg-view";
const listeners = [];
const edits = [];

/** Whether edits are solved at once. */
export const isLive = served !== null;

export const corrections = { n: served?.state.undo ?? 0, busy: false, error: "", warnings: served?.state.warnings ?? [] };

/** Call `listener()` whenever anything about the corrections changes. */
export const onCorrected = (listener) => listeners.push(listener);

/** Make an edit: {kind: "forbid" | "add" | "drag" | "pin" | "withdraw", scans or between, pose}, scans as the page counts them. */
export function apply(edit) {
  const asked = inRecordedScans(edit);
  if (isLive) ask(asked.kind, asked);
  else change(() => edits.push(asked));
}

/** Take the last edit back. */
export function undo() {
  if (isLive) ask("undo", {});
  else change(() => edits.pop());
}

/** Save the edits as a file. */
export function download() {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([asText()], { type: "application/toml" }));
  link.download = "corrections.toml";
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** The edits as the text of `corrections.toml`. */
export function asText() {
  const head = run.is_corrected
    ? "# This run was corrected already: add these lines to the corrections that it was given."
    : "# For: iceg resolve DIR --corrections corrections.toml";
  return `${[head, ...edits.map(block)].join("\n\n")}\n`;
}

function block({ kind, scans, between, pose }) {
  const lines = [`[[${kind === "drag" ? "add" : kind}]]`];
  lines.push(between ? `between = [[${between[0].join(", ")}], [${between[1].join(", ")}]]` : `scans = [${scans.join(", ")}]`);
  if (pose) lines.push(`pose = [${pose.map((number) => number.toFixed(6)).join(", ")}]`);
  return lines.join("\n");
}

/** Corrections count scans as recorded, the page only those that are left. */
function inRecordedScans(edit) {
  const recorded = (scan) => {
    let before = 0;
    for (const [first, last] of run.kept) {
      if (scan < before + last - first + 1) return first + scan - before;
      before += last - first + 1;
    }
    return scan;
  };
  const found = { ...edit };
  if (edit.scans) found.scans = edit.scans.map(recorded);
  if (edit.between) found.between = edit.between.map((interval) => interval.map(recorded));
  return found;
}

function change(how) {
  how();
  Object.assign(corrections, { n: edits.length });
  tell();
}

function tell(changes = {}) {
  Object.assign(corrections, changes);
  for (const listener of listeners) listener();
}

async function ask(kind, edit) {
  if (corrections.busy) return;
  tell({ busy: true, error: "" });
  try {
    const answer = await fetch(`/${kind}`, {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Iceg-Token": served.token },
      body: JSON.stringify({ ...edit, revision: served.state.revision }),
    });
    const found = await answer.json();
    if (!answer.ok) throw new Error(found.error);
    keepView();
    location.reload();
  } catch (error) {
    const isGone = error instanceof TypeError;
    tell({ busy: false, error: isGone ? "iceg view has ended: start it again and load this page anew." : error.message });
  }
}

function keepView() {
  const { lat, lng } = map.getCenter();
  sessionStorage.setItem(VIEW, JSON.stringify([lat, lng, map.getZoom()]));
}

/** After an edit the map is shown as it was before. */
export function restoreView() {
  const kept = isLive ? sessionStorage.getItem(VIEW) : null;
  if (kept === null) return;
  sessionStorage.removeItem(VIEW);
  const [lat, lng, zoom] = JSON.parse(kept);
  map.setView([lat, lng], zoom, { animate: false });
}

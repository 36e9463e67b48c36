// Numbers, warnings, what was learned and what was set.

import { set } from "report/bus";
import { count, duration, escaped, facts, length } from "report/format";
import { show } from "report/mapview";
import { nKeys, nScans, poseOfScan, run } from "report/run";

const by = (id) => document.getElementById(id);
const GRADES = { good: "good", fair: "look", poor: "bad" };

export function startTables() {
  by("subtitle").textContent = [count(nScans, "scan"), count(nKeys, "key pose"), duration(run.stamps[nScans - 1]), ...sizes()].join(" · ");
  by("figures").innerHTML = [...figuresOfTruth(), ...run.figures].map(figure).join("");
  by("learned").innerHTML = facts(run.learned.map(({ name, value }) => [name, value]));
  by("settings").innerHTML = run.settings.length
    ? `<table class="list"><thead><tr><th>Setting</th><th>default</th><th>here</th></tr></thead><tbody>${run.settings.map(setting).join("")}</tbody></table>`
    : "<p>None: everything is as it comes.</p>";
  by("warnings").innerHTML = run.warnings.length ? `<ul>${run.warnings.map(warning).join("")}</ul>` : "<p>None.</p>";
  by("warnings").addEventListener("click", ({ target }) => {
    if (target.dataset.scan === undefined) return;
    const scan = Number(target.dataset.scan);
    set("scan", { scan });
    show(poseOfScan(scan));
    by("map-section").scrollIntoView();
  });
  by("footer").textContent = `Drawn by iceg. ${leftOut()}This file is complete: it needs no network and can be sent as it is.`;
}

function sizes() {
  const { columns, rows, resolution } = run.grid;
  return [`${(columns * resolution).toFixed(1)} × ${(rows * resolution).toFixed(1)} m`];
}

function figuresOfTruth() {
  const { truth } = run;
  if (!truth) return [];
  const nees = truth.nees_mean;
  return [
    { name: "Error against the truth", value: length(truth.rmse_m), meaning: `Root mean square distance from the true path laid over this one; ${length(truth.max_m)} at most, heading ${truth.heading_rmse_deg.toFixed(2)}°.`, grade: "none" },
    { name: "NEES", value: nees.toFixed(2), meaning: "Squared error in units of what is claimed: 3 is right, more is too sure, less too cautious.", grade: nees < 6 ? "good" : nees < 15 ? "fair" : "poor" },
  ];
}

const figure = ({ name, value, meaning, grade }) =>
  `<div class="card"><div class="name">${escaped(name)}${grade === "none" ? "" : `<span class="grade ${grade}">${GRADES[grade]}</span>`}</div><div class="value">${escaped(value)}</div><p>${escaped(meaning)}</p></div>`;
const setting = ({ name, value, default: usual }) => `<tr><td>${escaped(name)}</td><td>${escaped(usual)}</td><td>${escaped(value)}</td></tr>`;
const warning = ({ sentence, scan }) =>
  `<li>${escaped(sentence)}${scan === null ? "" : ` <button type="button" class="link" data-scan="${scan}">Show scan ${scan}</button>`}</li>`;

function leftOut() {
  const { scans, every_beam: every } = run.laser.left_out;
  const parts = [];
  if (scans) parts.push(`${count(scans, "scan")} of ${nScans.toLocaleString("en")} were left out, so that it stays small enough to be sent; key scans are all there`);
  if (every > 1) parts.push(`one beam in ${every} is shown`);
  if (run.grid.coarser > 1) parts.push(`cells are ${run.grid.coarser} times as wide as those of map.pgm`);
  return parts.length ? `${parts.join("; ")}. ` : "";
}

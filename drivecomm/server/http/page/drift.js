// What differs in a drive from its approved set: one line, and the list for whoever unfolds it.

import { get } from "./api.js";
import { el, hide, mark, put } from "./elements.js";
import { clock, number, unit } from "./format.js";

const SHOWN = new Set(["changed", "replaced", "not comparable"]);
const COLUMNS = ["Parameter", "Approved", "Now", "Since"];

/** The words for how far a drive is set as approved. */
export function driftWord(drift) {
  if (!drift) return "–";
  return drift.state === "changed" ? `${drift.changed} not as approved` : drift.state;
}

/** Return the line of a drive, with its list, and what shows it. */
export function driftLine(name) {
  const summary = el("summary");
  const list = el("div");
  const element = el("details", { class: "lines drift", hidden: true, toggle: load }, summary, list);
  let known = "";
  let loaded = "";

  async function load() {
    if (!element.open || loaded === known) return;
    const wanted = (loaded = known);
    try {
      const drift = await get(`drives/${encodeURIComponent(name)}/drift`);
      if (wanted === known) list.replaceChildren(...contentOf(drift));
    } catch (error) {
      loaded = "";
      list.replaceChildren(el("p", {}, `The list cannot be loaded: ${error.message}`));
    }
  }

  function show(drive) {
    const drift = drive.drift;
    hide(element, !SHOWN.has(drift?.state));
    if (element.hidden) return;
    known = JSON.stringify(drift);
    mark(element, "data-any", drift.state === "not comparable" ? null : "yes");
    put(summary, lineOf(drift));
    load();
  }
  return { element, show };
}

function lineOf({ state, changed, since_s: since }) {
  if (state === "not comparable") return "Not all parameters could be compared with the approved set";
  const count = changed === 1 ? "1 parameter differs from the approved set" : `${changed} parameters differ from the approved set`;
  if (state === "replaced") return `Replaced by another drive, seen since ${clock(since)}; ${count}`;
  return `${count}${changed === 1 ? "" : ", the first"} since ${clock(since)}`;
}

function contentOf(drift) {
  const value = (given, of) => el("td", {}, el("span", { class: "number" }, number(given)), el("span", { class: "unit" }, unit(of)));
  const rows = drift.changes.map((each) =>
    el("tr", {}, el("th", { scope: "row" }, `${each.address} ${each.name.replaceAll("_", " ")}`.trim()),
      value(each.approved, each.unit), value(each.now, each.unit), el("td", { class: "number" }, clock(each.since_s))));
  return [
    drift.replaced ? el("p", {}, drift.replaced) : null,
    drift.restore ? el("p", {}, "To give it the approved set: ", el("code", {}, drift.restore)) : null,
    rows.length ? el("table", { class: "values" },
      el("thead", {}, el("tr", {}, ...COLUMNS.map((text) => el("th", { scope: "col" }, text)))), el("tbody", {}, ...rows)) : null,
    ...drift.not_comparable.map((each) => el("p", {}, `${each.address} could not be compared: ${each.reason}`)),
    drift.untold.length ? el("p", {}, `It may be another drive, since it does not identify itself: ${drift.untold.join(", ")}`) : null,
    el("p", { class: "quiet" }, `Approved by ${drift.approved_by}: ${clock(drift.approved_s)}. Read last: ${clock(drift.compared_s)}.`),
  ].filter(Boolean);
}

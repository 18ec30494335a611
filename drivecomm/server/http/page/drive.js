// One drive: its state, values, trends, events and communication, and the way to command it.

import { get } from "./api.js";
import { stop } from "./commands.js";
import { controls } from "./controls.js";
import { driftLine, driftWord } from "./drift.js";
import { el, hide, mark, put, reshape, shape } from "./elements.js";
import { eventRows, newest } from "./events.js";
import { age, atMachine, clock, number, title, unit } from "./format.js";
import { askAgain } from "./link.js";
import { holderOf } from "./overview.js";
import { ageOf, isLive, isOld, may, onChange, plant, shownState, stateOf, wordOf } from "./plant.js";
import { showTrends } from "./trends.js";

const COUNTERS = {
  requests: "requests", replies: "good replies", retries: "retries", timeouts: "timeouts", damaged: "damaged replies",
  strays: "stray telegrams", "checksum errors": "checksum errors",
};
const FIRST = ["output_frequency", "motor_speed", "output_current", "output_power"];
const ASK_MS = 2000;
const EVENTS = 30;

export function drivePage(main, name) {
  if (!plant.drives.has(name)) {
    main.append(el("h1", { tabindex: "-1" }, name),
      el("p", {}, isLive() ? "The plant has no drive of this name." : "Not loaded yet."), el("a", { href: "#/" }, "All drives"));
    return onChange((changed) => { if (changed.reloaded && plant.drives.has(name)) dispatchEvent(new Event("hashchange")); });
  }
  const drawing = shape("asking");
  const state = el("span", { class: "state" });
  const holder = el("span", { class: "holder" });
  const heading = el("span", { class: "quiet" }, plant.drives.get(name).title ?? "");
  const stopButton = el("button", { type: "button", class: "stop", "aria-label": `Stop ${name}`, click: () => stop(name) }, "Stop");
  const bar = el("div", { class: "drive-bar" },
    el("a", { href: "#/", class: "back", "aria-label": "Back to the plant" }, "‹"),
    el("div", { class: "drive-head" }, drawing, el("h1", { tabindex: "-1" }, name), state, heading, holder), stopButton);
  const fault = el("div", { class: "fault-box", role: "status", hidden: true });
  const drift = driftLine(name);
  const values = valuesTable();
  const control = controls(name);
  const remembered = faultLog();
  const quality = el("dl", { class: "facts" });
  const facts = el("dl", { class: "facts" });
  const events = el("div", { class: "events" });
  const trends = el("section", { class: "panel later" }, el("h2", {}, "Trends"));
  main.append(bar, fault, drift.element, el("div", { class: "drive-columns" },
    el("div", {},
      el("section", { class: "panel" }, el("h2", {}, "Values"), values.element),
      trends),
    el("div", {},
      el("section", { class: "panel" }, el("h2", {}, "Control"), control.element),
      el("section", { class: "panel" }, el("h2", {}, "What happened"), events),
      remembered.element,
      el("section", { class: "panel later" }, el("h2", {}, "Communication"), quality),
      el("section", { class: "panel later" }, el("h2", {}, "The drive"), facts))));

  let past = [];
  let log = [];

  function show() {
    const drive = plant.drives.get(name);
    if (!drive) return;
    const now = stateOf(drive);
    mark(bar, "data-state", now);
    mark(bar, "data-old", isLive() && now !== "silent" && !drive.late ? null : "yes");
    reshape(drawing, now);
    put(state, shownState(now, drive.late));
    put(holder, holderOf(drive));
    hide(stopButton, !may(drive, "stop"));
    showFault(fault, drive, now, log);
    drift.show(drive);
    values.show(drive);
    remembered.show(drive);
    control.show(drive);
    fill(quality, qualityOf(drive));
    fill(facts, factsOf(drive));
  }

  function showEvents() {
    const rows = newest([...plant.events.filter((event) => event.drive === name), ...past]).slice(0, EVENTS);
    log = rows.filter((event) => event.kind === "fault");
    events.replaceChildren(rows.length ? eventRows(rows, () => null) : el("p", { class: "quiet" }, "Nothing yet."));
  }

  showEvents();
  show();
  get(`history/events?drive=${encodeURIComponent(name)}&limit=${EVENTS}`).then((found) => {
    past = found;
    showEvents();
    show();
  }).catch(() => {});
  const endTrends = showTrends(trends, name);
  const leave = onChange((changed) => {
    if (changed.events || changed.reloaded) showEvents();
    if (changed.reloaded || changed.link || changed.drives.has(name)) show();
  });
  const ages = setInterval(show, 1000);
  const asking = setInterval(() => { if (isLive()) askAgain(name); }, ASK_MS);
  return () => {
    leave();
    endTrends();
    control.end();
    clearInterval(ages);
    clearInterval(asking);
  };
}

function showFault(box, drive, state, log) {
  hide(box, state !== "fault" && state !== "silent");
  if (box.hidden) return;
  const lines = [];
  if (state === "silent") {
    const since = drive.answered_s ? `No answer since ${clock(drive.answered_s)}.` : "It has not answered yet.";
    lines.push(since, drive.error || "");
  } else {
    const code = drive.status?.fault_code;
    const text = drive.fault || drive.status?.fault_text || "The drive does not report which.";
    lines.push(text, code !== null && code !== undefined && !text.includes(code) ? `Code ${code}` : "");
    if (log[0]) lines.push(`Since ${clock(log[0].time_s)}`);
  }
  const shown = lines.filter(Boolean);
  if (box.dataset.shown === shown.join()) return;
  box.dataset.shown = shown.join();
  box.replaceChildren(shape(state), el("div", {},
    el("strong", {}, state === "fault" ? `Fault: ${shown[0]}` : shown[0]), ...shown.slice(1).map((line) => el("p", {}, line))));
}

/** What people look for first, then what else is polled, then what cannot be had. */
function inOrder(values) {
  const place = ({ name, reading }) => (reading ? (name === "status" ? 0 : FIRST.indexOf(name) + 1 || FIRST.length + 1) : FIRST.length + 2);
  return [...values.values()].sort((one, other) => place(one) - place(other));
}

/** What the drive itself remembers, the newest first: without empty places, and with equal neighbours as one row. */
function faultLog() {
  const caption = el("caption", { class: "unseen" }, "The drive's own fault log");
  const body = el("tbody");
  const read = el("p", { class: "quiet" });
  const table = el("table", { class: "fault-log" }, caption,
    el("thead", {}, el("tr", {}, ...["Fault", "Code", "Times in a row"].map((text) => el("th", { scope: "col" }, text)))), body);
  const element = el("section", { class: "panel later", hidden: true }, el("h2", {}, "The drive's own fault log"), table, read);

  function show(drive) {
    const entries = (drive.fault_log ?? []).filter((entry) => Number(entry.value) !== 0);
    hide(element, !entries.length);
    const rows = [];
    for (const { value, text } of entries) {
      if (rows.at(-1)?.value === value) rows.at(-1).times += 1;
      else rows.push({ value, text, times: 1 });
    }
    const key = JSON.stringify(rows);
    if (element.dataset.shown !== key) {
      element.dataset.shown = key;
      body.replaceChildren(...rows.map(({ value, text, times }) => el("tr", {},
        el("td", {}, text || "–"), el("td", { class: "number" }, String(value)), el("td", { class: "number" }, String(times)))));
    }
    if (entries.length) put(read, `Newest first, read at ${clock(entries[0].time_s)}.`);
  }
  return { element, show };
}

function valuesTable() {
  const body = el("tbody");
  const rows = new Map();
  const element = el("table", { class: "values" },
    el("thead", {}, el("tr", {}, ...["Name", "Value", "Quality", "Age"].map((text) => el("th", { scope: "col" }, text)))), body);

  function row(value) {
    const cells = { value: el("b", { class: "number" }), unit: el("span", { class: "unit" }),
      machine: el("span", { class: "unit machine" }), text: el("span", { class: "quiet" }),
      quality: el("td"), age: el("td", { class: "number" }) };
    cells.row = el("tr", {}, el("th", { scope: "row" }, title(value.name)),
      el("td", {}, cells.value, cells.unit, cells.machine, cells.text), cells.quality, cells.age);
    rows.set(value.name, cells);
    body.append(cells.row);
    return cells;
  }

  function show(drive) {
    for (const value of inOrder(drive.values)) {
      const cells = rows.get(value.name) ?? row(value);
      const reading = value.reading;
      const isState = value.name === "status" && reading;
      mark(cells.row, "data-old", isOld(value) ? "yes" : null);
      put(cells.value, isState ? wordOf(reading.value) : reading ? number(reading.value) : "–");
      put(cells.unit, reading ? unit(reading.unit) : "");
      put(cells.machine, atMachine(value));
      put(cells.text, reading?.text || [reading?.doubt, reading?.note].filter(Boolean).join("; "));
      put(cells.quality, isLive() ? value.quality + (value.cause ? `: ${value.cause}` : "") : "not current");
      const seconds = ageOf(value);
      put(cells.age, seconds === null ? "–" : age(seconds));
    }
  }
  return { element, show };
}

function qualityOf(drive) {
  const counters = drive.counters ?? {};
  const found = Object.entries(COUNTERS).map(([name, words]) => [words, String(counters[name] ?? 0)]);
  if (counters.requests) found.unshift(["answered", `${Math.min(100, (100 * (counters.replies ?? 0)) / counters.requests).toFixed(1)} %`]);
  found.push(["mean reply time", drive.reply_s ? `${(drive.reply_s * 1000).toFixed(1)} ms` : "–"]);
  found.push(["last answer", drive.answered_s ? clock(drive.answered_s) : "none yet"]);
  return found;
}

function factsOf(drive) {
  return [
    ["title", drive.title || "–"],
    ...(drive.groups?.length ? [["groups", drive.groups.join(", ")]] : []),
    ["drive", drive.drive],
    ["model", drive.model || "not named"],
    ["line", drive.line],
    ["parameters", driftWord(drive.drift)],
    ["armed", drive.monitoring_only ? "no, monitoring only" : drive.armed ? "yes" : "no"],
    ...(drive.status ? [["status word", `0x${Number(drive.status.word).toString(16).toUpperCase().padStart(4, "0")}`],
      ["status bits", (drive.status.flags ?? []).join(", ") || "none"]] : []),
  ];
}

function fill(list, facts) {
  facts.forEach(([name, value], place) => {
    const group = list.children[place] ?? list.appendChild(el("div", {}, el("dt"), el("dd")));
    put(group.firstChild, name);
    put(group.lastChild, value);
  });
  while (list.children.length > facts.length) list.lastChild.remove();
}

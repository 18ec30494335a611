// The plant at a glance: a tile for each drive, by area, and the health of the lines.

import { stop } from "./commands.js";
import { el, hide, mark, put, reshape, shape } from "./elements.js";
import { age, atMachine, clock, number, unit } from "./format.js";
import { ageOf, counts, isLive, isOld, may, onChange, plant, shownState, stateOf } from "./plant.js";

const FILTERS = { all: "drives", running: "running", fault: "fault", silent: "silent" };
const FEW = 12;
const SOME = 60;
/** What a tile shows besides its large number: the first two of these that are polled. */
const SMALL = {
  output_current: "Current", reference_frequency: "Reference", reference_percent: "Reference", output_power: "Power",
  torque: "Torque", torque_percent: "Torque", motor_speed: "Speed", heat_sink_temperature: "Heat sink",
};
const SMALL_PLACES = 2;

let chosen = "all";
let searched = "";

export function plantPage(main) {
  const summary = Object.fromEntries(Object.keys(FILTERS).map((name) => [name, filterButton(name, () => filter(name))]));
  const search = el("input", { type: "search", placeholder: "Find a drive", "aria-label": "Find a drive", value: searched,
    input: (event) => { searched = event.target.value; sift(); } });
  const trouble = el("p", { class: "trouble" });
  const areas = el("div", { class: "areas" });
  const lines = el("details", { class: "lines" }, el("summary"), el("ul"));
  const none = el("p", { class: "quiet", hidden: true }, "No matching drive.");
  const waiting = el("p", { class: "quiet" }, "Waiting for the server.");
  const tiles = new Map();
  // Tiles that nobody sees are drawn when they come into sight.
  const sight = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const tile = tiles.get(target.dataset.drive);
      const drive = plant.drives.get(target.dataset.drive);
      if (!tile || !drive) continue;
      tile.isSeen = isIntersecting;
      if (isIntersecting) tile.show(drive);
    }
  }, { rootMargin: "200px" });
  main.append(
    el("h1", { class: "unseen", tabindex: "-1" }, "The plant at a glance"),
    el("div", { class: "summary" }, ...Object.values(summary).map((button) => button.element), search),
    trouble, waiting, areas, none, lines,
  );

  function build() {
    hide(waiting, Boolean(plant.info));
    tiles.clear();
    sight.disconnect();
    const room = plant.drives.size <= FEW ? "few" : plant.drives.size <= SOME ? "some" : "many";
    const found = drivesByArea();
    areas.replaceChildren(...[...found].map(([area, drives]) => {
      const heading = found.size > 1 ? el("h2", {}, area) : null;
      const grid = el("ul", { class: "tiles", "data-room": room, "aria-label": heading ? area : "Drives" });
      for (const drive of drives) {
        const tile = makeTile(drive, heading ? "h3" : "h2");
        tiles.set(drive.name, tile);
        grid.append(tile.element);
        tile.show(drive);
        sight.observe(tile.element);
      }
      return el("section", { class: "area" }, heading, grid);
    }));
    lines.open = plant.lines.length <= 8 && matchMedia("(min-width: 700px)").matches;
    summarise();
    sift();
    showLines(lines);
  }

  function summarise() {
    const found = counts();
    for (const [name, button] of Object.entries(summary)) {
      put(button.count, String(found[name]));
      put(button.word, name === "fault" && found.fault !== 1 ? "faults" : FILTERS[name]);
      mark(button.element, "data-any", found[name] > 0);
    }
    showTrouble(trouble);
  }

  function filter(name) {
    chosen = chosen === name ? "all" : name;
    sift();
  }

  function sift() {
    for (const [name, button] of Object.entries(summary)) mark(button.element, "aria-pressed", String(name === chosen));
    let any = false;
    for (const [name, tile] of tiles) {
      const drive = plant.drives.get(name);
      const fits = isWanted(drive);
      hide(tile.element, !fits);
      any ||= fits;
    }
    for (const area of areas.children) hide(area, !area.querySelector(".tile:not([hidden])"));
    hide(none, any || !tiles.size);
  }

  build();
  const leave = onChange((changed) => {
    if (changed.reloaded) return build();
    const names = changed.link ? plant.drives.keys() : changed.drives;
    let moved = changed.link;
    for (const name of names) {
      const tile = tiles.get(name);
      const drive = plant.drives.get(name);
      if (tile?.isMoved(drive)) moved = true;
      if (tile?.isSeen || changed.link) tile.show(drive);
    }
    if (moved) {
      summarise();
      if (chosen !== "all") sift();
    }
    if (changed.lines || changed.link) showLines(lines);
  });
  const ages = setInterval(() => {
    for (const [name, tile] of tiles) if (tile.isOld && tile.isSeen) tile.show(plant.drives.get(name));
    showTrouble(trouble);
  }, 1000);
  return () => {
    leave();
    sight.disconnect();
    clearInterval(ages);
  };
}

/** The drives by area: the first group of a drive, or its line where no drive has a group. */
function drivesByArea() {
  const drives = [...plant.drives.values()];
  const hasGroups = drives.some((drive) => drive.groups?.length);
  const found = new Map();
  for (const drive of drives) {
    const area = hasGroups ? drive.groups?.[0] ?? "Without a group" : drive.line;
    found.set(area, [...(found.get(area) ?? []), drive]);
  }
  return found;
}

function isWanted(drive) {
  const state = stateOf(drive);
  const fits = chosen === "all" || state === chosen || (chosen === "running" && state === "reverse");
  const groups = (drive.groups ?? []).join(" ");
  const text = `${drive.name} ${drive.title ?? ""} ${groups} ${drive.line} ${drive.drive}`.toLowerCase();
  return fits && text.includes(searched.trim().toLowerCase());
}

function filterButton(name, click) {
  const count = el("b", { class: "number" });
  const word = el("span", {}, FILTERS[name]);
  return { count, word, element: el("button", { type: "button", class: "filter", "data-filter": name, click }, count, word) };
}

export const driveLink = (name) => `#/drive/${encodeURIComponent(name)}`;

function makeTile(first, level) {
  const name = first.name;
  const drawing = shape("asking");
  const state = el("span", { class: "state" });
  const large = { value: el("b", { class: "number" }), unit: el("span", { class: "unit" }), machine: el("span", { class: "unit machine" }) };
  const small = Array.from({ length: SMALL_PLACES }, () => el("div", {}, el("dt"), el("dd", { class: "number" })));
  const note = el("p", { class: "note" });
  const holder = el("span", { class: "holder" });
  const button = el("button", { type: "button", class: "stop", "aria-label": `Stop ${name}`, click: () => stop(name) }, "Stop");
  const heading = el(level, {}, el("a", { href: driveLink(name) }, name));
  const element = el("li", { class: "tile", "aria-label": name, "data-drive": name },
    el("div", { class: "tile-head" }, drawing, heading, state),
    el("p", { class: "title" }, first.title ?? ""),
    el("p", { class: "large" }, large.value, large.unit, large.machine),
    el("dl", { class: "small" }, ...small),
    el("div", { class: "tile-foot" }, el("div", {}, note, holder), button));
  let before = "";
  const tile = { element, isOld: false, isSeen: true, isMoved, show };

  /** Whether the state is another one than when this was last asked. */
  function isMoved(drive) {
    const now = `${stateOf(drive)}${drive.fault}`;
    const moved = now !== before;
    before = now;
    return moved;
  }

  function show(drive) {
    const now = stateOf(drive);
    const main = mainValue(drive);
    const late = age(ageOf(main) ?? 0);
    tile.isOld = !isLive() || now === "silent" || drive.late || main.old;
    mark(element, "data-state", now);
    mark(element, "data-old", tile.isOld ? "yes" : null);
    reshape(drawing, now);
    put(state, shownState(now, drive.late));
    put(large.value, main.text);
    put(large.unit, unit(main.unit));
    put(large.machine, atMachine(main));
    const further = smallValues(drive);
    small.forEach((place, number) => {
      hide(place, !further[number]);
      if (further[number]) place.childNodes.forEach((cell, column) => put(cell, further[number][column]));
    });
    put(note, noteOf(drive, now, tile.isOld && main.heard ? late : ""));
    put(holder, holderOf(drive));
    hide(button, !may(drive, "stop"));
  }
  return tile;
}

/** The output frequency, or what comes nearest to it of what is known of a drive. */
function mainValue(drive) {
  for (const name of ["output_frequency", "motor_speed"]) {
    const value = drive.values.get(name);
    if (value) return { ...value, text: value.reading ? number(value.reading.value) : "–", unit: value.reading?.unit, old: isOld(value) };
  }
  const status = drive.status;
  const of = { ...drive.values.get("status"), old: !isLive() };
  if (status?.actual_hz !== null && status?.actual_hz !== undefined) {
    return { ...of, text: number(status.actual_hz), unit: "Hz", machine_value: drive.actual_machine, machine_unit: drive.machine_unit };
  }
  if (status?.actual_percent !== null && status?.actual_percent !== undefined) {
    return { ...of, text: number(status.actual_percent), unit: "%" };
  }
  return { ...of, text: "–", unit: "" };
}

/** Return names and texts of what else is known of a drive. */
function smallValues(drive) {
  const polled = Object.keys(SMALL).map((name) => drive.values.get(name)).filter(Boolean);
  const known = polled.filter((value) => value.reading);
  return (known.length ? known : polled).slice(0, SMALL_PLACES).map((value) =>
    [SMALL[value.name], value.reading ? beside(`${number(value.reading.value)} ${unit(value.reading.unit)}`, atMachine(value)) : "–"]);
}

function beside(text, machine) {
  return machine ? `${text} = ${machine}` : text;
}

function noteOf(drive, state, late) {
  if (state === "fault") return drive.fault || drive.status?.fault_text || "fault";
  if (state === "silent") return drive.answered_s ? `no answer since ${clock(drive.answered_s)}` : drive.error || "no answer yet";
  if (drive.late) return "late: its line is too busy to poll it";
  if (late) return `value is ${late} old`;
  if (drive.status?.warning) return "warning";
  if (drive.status?.remote === false) return "local control";
  return drive.status?.at_reference && (state === "running" || state === "reverse") ? "at reference" : "";
}

export function holderOf(drive) {
  if (drive.standing_stop) return drive.standing_stop.text;
  if (!drive.lease) return drive.kept ? `kept by the server (${drive.kept})` : "";
  return drive.lease.yours ? "you command it" : `${drive.lease.holder} commands it`;
}

function showTrouble(element) {
  const found = [...plant.drives.values()].map((drive) => [drive, stateOf(drive)])
    .filter(([, state]) => state === "fault" || state === "silent")
    .sort(([, one], [, other]) => one.localeCompare(other));
  const key = found.map(([drive, state]) => `${drive.name}${state}${drive.fault}`).join() + isLive();
  if (element.dataset.shown === key) return;
  element.dataset.shown = key;
  mark(element, "data-any", found.length > 0);
  if (!plant.drives.size) return element.replaceChildren();
  if (!found.length) return element.replaceChildren(isLive() ? "No faults; all drives answer." : "No faults at the last contact.");
  const links = found.slice(0, 4).map(([drive, state]) =>
    el("a", { href: driveLink(drive.name) }, shape(state),
      el("span", {}, `${drive.name}: ${state === "fault" ? noteOf(drive, state, "") : "no answer"}`)));
  if (found.length > links.length) links.push(el("span", {}, `and ${found.length - links.length} more`));
  element.replaceChildren(...links);
}

function showLines(element) {
  const closed = plant.lines.filter((line) => !line.up);
  const [summary, list] = element.children;
  const what = plant.lines.length === 1 ? "1 line" : `${plant.lines.length} lines`;
  mark(element, "data-any", closed.length > 0);
  put(summary, closed.length ? `${what}, not open: ${closed.map((line) => line.name).join(", ")}` : `${what}, all open`);
  list.replaceChildren(...plant.lines.map((line) =>
    el("li", { "data-up": String(Boolean(line.up)) }, shape(line.up ? "open" : "closed"), el("strong", {}, line.name),
      el("span", { class: "quiet" }, line.port),
      el("span", {}, line.up ? `${line.late ? "late" : "open"}; ${line.polls ?? 0} polls, ${line.missed ?? 0} missed` : line.error || "not open"))));
}

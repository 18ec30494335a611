// What this page knows of the plant: only what the server has said, never what was asked of it.

export const plant = {
  info: null,
  drives: new Map(),
  lines: [],
  events: [],
  alarms: [],
  /** connecting, live, lost, paused or locked; lost: nothing shown is current. */
  link: "connecting",
  /** When the server was last heard, in seconds since 1970 by this machine's clock. */
  heardAt: Date.now() / 1000,
};

const KEPT_EVENTS = 500;

// What changed since the page was last drawn.
const changed = { drives: new Set(), lines: false, events: false, alarms: false, link: false, reloaded: false };
let drawing = 0;
let drawnAt = 0;
/** Values are drawn at most so often. */
const DRAW_MS = 250;
const views = new Set();
const samplers = new Set();

/** Call a function before the next picture of the page, with what has changed until then. */
export function onChange(view) {
  views.add(view);
  return () => views.delete(view);
}

/** Call a function with each value as it comes. */
export function onValue(sampler) {
  samplers.add(sampler);
  return () => samplers.delete(sampler);
}

export function touch(what, drive) {
  if (what === "drives") changed.drives.add(drive);
  else changed[what] = true;
  if (drawing) return;
  const wait = what === "drives" ? drawnAt + DRAW_MS - performance.now() : 0;
  drawing = 1;
  if (wait <= 0) requestAnimationFrame(draw);
  else setTimeout(() => requestAnimationFrame(draw), wait);
}

function draw() {
  drawing = 0;
  drawnAt = performance.now();
  const now = { ...changed, drives: new Set(changed.drives) };
  changed.drives.clear();
  for (const name of ["lines", "events", "alarms", "link", "reloaded"]) changed[name] = false;
  for (const view of [...views]) view(now);
}

export function setLink(state) {
  if (plant.link === state) return;
  plant.link = state;
  touch("link");
}

export const isLive = () => plant.link === "live";

let clockAt = 0;

export function setInfo(info) {
  plant.info = info;
  plant.lines = info.lines ?? [];
  clockAt = performance.now();
  touch("lines");
}

/** The server's clock, in seconds since 1970; this machine's may be wrong. */
export function serverTime() {
  if (!plant.info?.time_s) return Date.now() / 1000;
  return plant.info.time_s + (performance.now() - clockAt) / 1000;
}

/** Take over everything anew. */
export function setDrives(drives) {
  plant.drives = new Map(drives.map((drive) => [drive.name, withValues(drive)]));
  touch("reloaded");
}

/** Take over what the server says of a drive besides its values, of which the stream knows later ones. */
export function setDrive(content) {
  const known = plant.drives.get(content.name);
  if (!known) return;
  plant.drives.set(content.name, withValues(content, known.values));
  touch("drives", content.name);
}

function withValues(drive, known) {
  const values = known ?? new Map((drive.values ?? []).map((value) => [value.name, heard(value)]));
  return { ...drive, values, heard: performance.now(), shown: drive.status?.state ?? drive.state ?? null };
}

function heard(value) {
  value.heard = performance.now();
  return value;
}

/** Take over values; returns the names of drives of which more is to be asked. */
export function setValues(values) {
  const unclear = new Set();
  for (const value of values) {
    const drive = plant.drives.get(value.drive);
    if (!drive) continue;
    drive.values.set(value.name, heard(value));
    if (value.name === "status") {
      const state = value.reading?.value;
      if (isSound(value) && state !== drive.shown) {
        drive.shown = state;
        drive.fault = state === "fault" ? value.reading.text || drive.fault : "";
        unclear.add(value.drive);
      } else if (isSound(value) !== (drive.reachability === "answers" && !drive.late)) unclear.add(value.drive);
    }
    touch("drives", value.drive);
    for (const sampler of samplers) sampler(value);
  }
  return unclear;
}

/** Add events; returns those that are new here. */
export function addEvents(events) {
  const newest = plant.events[0]?.number ?? -1;
  const added = events.filter((event) => event.number > newest).sort((one, other) => other.number - one.number);
  if (added.length) {
    plant.events = [...added, ...plant.events].slice(0, KEPT_EVENTS);
    touch("events");
  }
  return added;
}

export function isSound(value) {
  return Boolean(value?.reading) && (value.quality === "good" || value.quality === "uncertain");
}

/** Whether nobody shall take a value for current. */
export function isOld(value) {
  return !isLive() || !isSound(value);
}

/** How old a value is, in seconds, null without one. */
export function ageOf(value) {
  if (!value?.reading) return null;
  const atArrival = value.age_s ?? Math.max(0, serverTime() - value.source_s);
  return atArrival + (performance.now() - value.heard) / 1000;
}

const WORDS = {
  running: "running",
  reverse: "backwards",
  ready: "ready",
  not_ready: "not ready",
  stopping: "stopping",
  fault: "fault",
  silent: "no answer",
  asking: "asking",
};

/** The name of a drive's state. */
export function stateOf(drive) {
  if (drive.reachability === "silent") return "silent";
  if (drive.reachability === "asking" || !drive.shown) return "asking";
  if (drive.shown === "running" && drive.status?.reverse) return "reverse";
  return drive.shown;
}

export const wordOf = (state) => WORDS[state] ?? state;

/** The text of a state: what it was, while nothing is heard of it or its line is late. */
export const shownState = (state, late) =>
  ((isLive() && !late) || state === "silent" ? wordOf(state) : `was ${wordOf(state)}`);

/** The number of drives by state, and of those with trouble. */
export function counts() {
  const found = { all: plant.drives.size, running: 0, fault: 0, silent: 0 };
  for (const drive of plant.drives.values()) {
    const state = stateOf(drive);
    if (state === "reverse") found.running += 1;
    else if (state in found) found[state] += 1;
  }
  return found;
}

const ROLES = ["nobody", "view", "operate", "commission"];

export function roleName() {
  const role = plant.info?.you?.role;
  return typeof role === "string" ? role.toLowerCase() : (ROLES[role] ?? "nobody");
}

export const may = (drive, verb) => (drive.may ?? []).includes(verb);
export const mayStop = () => [...plant.drives.values()].some((drive) => may(drive, "stop"));

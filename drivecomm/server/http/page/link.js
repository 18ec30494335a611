// The connection to the server: loads everything, follows the stream, notices within three seconds when nothing is
// heard any more, and comes back by itself.

import { Refusal, get, reach, stream, token } from "./api.js";
import { addEvents, plant, setDrive, setDrives, setInfo, setLink, setValues, touch } from "./plant.js";

const PROBE_AFTER_MS = 1000;
const PROBE_MS = 1500;
const LOST_AFTER_MS = 2600;
/** The server sends something each 15 s; a stream that is silent for longer is dead, even if the server is not. */
const STREAM_DEAD_MS = 35000;
const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5000;
const HIDDEN_MS = 30000;
const REFRESH_MS = 20000;
const EVENTS = "events?limit=200";

let heardAt = performance.now();
let streamAt = performance.now();
let current = null;
let probing = false;
let hiddenSince = 0;
let refreshedAt = 0;
let wake = () => {};
const unclear = new Set();
let clearing = 0;

/** Told of new events, of each tick, and of another run of the server; set by those who want to know. */
export const told = { events: () => {}, tick: () => {}, restarted: () => {}, holdsLease: () => false };

export function begin() {
  const worker = new Worker(new URL("ticks.js", import.meta.url));
  worker.onmessage = tick;
  document.addEventListener("visibilitychange", () => {
    hiddenSince = document.hidden ? performance.now() : 0;
    wake();
  });
  run();
}

/** Connect again, at once, with the token that is there now. */
export function reconnect() {
  current?.abort();
  wake();
}

function heard() {
  heardAt = performance.now();
  plant.heardAt = Date.now() / 1000;
}

async function run() {
  let wait = FIRST_WAIT_MS;
  for (;;) {
    const mine = (current = new AbortController());
    heardAt = streamAt = performance.now();
    let opened = false;
    try {
      await follow(mine.signal, () => {
        opened = true;
        wait = FIRST_WAIT_MS;
      });
    } catch (error) {
      if (error instanceof Refusal && error.status === 401) {
        if (token.get()) token.set("");
        else setLink("locked");
      }
    }
    mine.abort();
    if (document.hidden && hiddenSince && !told.holdsLease()) setLink("paused");
    else if (plant.link !== "locked") setLink("lost");
    await new Promise((resolve) => {
      wake = resolve;
      if (plant.link !== "locked" && plant.link !== "paused") setTimeout(resolve, opened ? 200 : wait * (0.8 + Math.random() * 0.4));
    });
    wait = Math.min(LONGEST_WAIT_MS, wait * 1.7);
  }
}

/** Follow the stream. What it says while everything is loaded comes after that. */
async function follow(signal, opened) {
  let early = [];
  const take = (name, content) => {
    if (early) early.push([name, content]);
    else apply(name, content);
  };
  const reading = stream("stream?every=0.5", {
    signal,
    heard: () => {
      streamAt = performance.now();
      heard();
    },
    told: take,
  });
  const ended = reading.then(() => {
    throw new Error("the stream has ended");
  });
  ended.catch(() => {});
  await Promise.race([load(signal), ended]);
  const waiting = early;
  early = null;
  for (const [name, content] of waiting) apply(name, content);
  if (signal.aborted) return;
  opened();
  setLink("live");
  await reading;
}

async function load(signal) {
  const info = await get("plant");
  const [drives, events, alarms] = await Promise.all([
    get("drives", { timeoutMs: 20000 }),
    get(EVENTS),
    get("alarms").catch(() => []),
  ]);
  if (signal.aborted) return;
  newRun(info);
  setInfo(info);
  setDrives(drives);
  addEvents(events);
  setAlarms(alarms);
  refreshedAt = performance.now();
  heard();
}

function newRun(info) {
  if (plant.info && plant.info.session !== info.session) {
    plant.events = [];
    told.restarted();
  }
}

function setAlarms(alarms) {
  plant.alarms = Array.isArray(alarms) ? alarms : (alarms?.alarms ?? []);
  touch("alarms");
}

function apply(name, content) {
  if (name === "values") for (const drive of setValues(content)) askAgain(drive);
  else if (name === "events") {
    const added = addEvents(content);
    for (const event of added) {
      if (event.drive) askAgain(event.drive);
      if (event.kind === "line" || event.kind === "server") askAgain("");
      if (event.kind === "alarm") refreshAlarms();
    }
    told.events(added);
  } else if (name === "lost") readEvents();
  else if (name === "hello") {
    if (plant.info && plant.info.session !== content.session) reconnect();
    else setInfo(content);
  }
}

async function readEvents() {
  const events = await get(EVENTS).catch(() => null);
  if (!events) return;
  plant.events = [];
  addEvents(events);
}

export async function refreshAlarms() {
  setAlarms(await get("alarms").catch(() => plant.alarms));
}

/** Ask for a drive's state anew, or by an empty name for that of the lines; many at once are asked for together. */
export function askAgain(drive) {
  unclear.add(drive);
  clearing ||= setTimeout(clear, 60);
}

async function clear() {
  const names = [...unclear];
  unclear.clear();
  try {
    if (names.includes("")) {
      const info = await get("plant");
      setInfo(info);
      if (info.drives.join("\n") !== [...plant.drives.keys()].join("\n")) setDrives(await get("drives"));
    }
    const drives = names.filter(Boolean);
    if (drives.length > 8) for (const drive of await get("drives")) setDrive(drive);
    else for (const one of await Promise.all(drives.map((each) => get(`drives/${encodeURIComponent(each)}`)))) setDrive(one);
  } catch {
    // The stream says whether the server is there.
  }
  clearing = unclear.size ? setTimeout(clear, 200) : 0;
}

function tick() {
  const now = performance.now();
  told.tick();
  if (document.hidden && hiddenSince && now - hiddenSince > HIDDEN_MS && !told.holdsLease() && plant.link === "live") {
    // Browsers allow six connections to a server; tabs that nobody sees leave them to the others.
    current?.abort();
    return;
  }
  if (plant.link !== "live") return;
  if (now - heardAt > LOST_AFTER_MS) {
    setLink("lost");
    current?.abort();
  } else if (now - streamAt > STREAM_DEAD_MS) current?.abort();
  else if (now - heardAt > PROBE_AFTER_MS && !probing) probe();
  if (now - refreshedAt > REFRESH_MS) {
    refreshedAt = now;
    for (const name of plant.drives.keys()) unclear.add(name);
    askAgain("");
  }
}

async function probe() {
  probing = true;
  try {
    await reach(PROBE_MS);
    heard();
  } catch {
    // Nothing is heard.
  }
  probing = false;
}

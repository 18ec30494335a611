// What happened in the plant, with clock times; and the alarms, which people acknowledge.

import { ask, get } from "./api.js";
import { showAnswer } from "./answers.js";
import { el, hide, put } from "./elements.js";
import { clock } from "./format.js";
import { refreshAlarms } from "./link.js";
import { isLive, onChange, plant, roleName } from "./plant.js";

const KINDS = ["fault", "fault over", "warning", "silent", "answers", "state", "command", "lease", "link loss", "line", "door",
  "alarm", "server"];
const PAGE = 200;
let chosen = { drive: "", kind: "" };

/** The journal keeps times to the millisecond. */
const SAME_S = 0.002;

/** Return events of this run and of the journal, each once, the newest first. */
export function newest(events) {
  const kept = [];
  const last = new Map();
  for (const event of [...events].sort((one, other) => other.time_s - one.time_s)) {
    const key = `${event.kind} ${event.drive} ${event.line} ${event.text}`;
    if (last.has(key) && last.get(key) - event.time_s < SAME_S) continue;
    last.set(key, event.time_s);
    kept.push(event);
  }
  return kept;
}

const subject = (event) =>
  event.drive ? el("a", { href: `#/drive/${encodeURIComponent(event.drive)}` }, event.drive) : el("span", {}, event.line ?? "");

/** Return a list of events. about: what shows which drive or line it was. */
export function eventRows(events, about = subject) {
  return el("ol", { class: "event-list" }, ...events.map((event) =>
    el("li", { "data-kind": event.kind },
      el("time", { class: "number" }, clock(event.time_s)),
      el("span", { class: "kind" }, event.kind),
      about(event),
      el("span", { class: "event-text" }, event.text, event.who ? el("span", { class: "quiet" }, ` by ${event.who}`) : null))));
}

export function eventsPage(main) {
  let past = [];
  const choice = (label, key, names) => {
    const select = el("select", { change: (event) => { chosen[key] = event.target.value; past = []; more(); } },
      el("option", { value: "" }, "all"), ...names.map((name) => el("option", { value: name }, name)));
    select.value = chosen[key];
    return el("label", {}, label, select);
  };
  const list = el("div", { class: "events" });
  const older = el("button", { type: "button", click: () => more() }, "Older");
  const note = el("p", { class: "quiet", role: "status" });
  main.append(el("h1", { tabindex: "-1" }, "Events"),
    el("div", { class: "row filters" }, choice("Drive ", "drive", [...plant.drives.keys()]), choice("Kind ", "kind", KINDS)),
    list, note, el("div", { class: "row" }, older));

  function rows() {
    const live = plant.events.filter((event) =>
      (!chosen.drive || event.drive === chosen.drive) && (!chosen.kind || event.kind === chosen.kind));
    return newest([...live, ...past]);
  }

  function show() {
    const found = rows();
    list.replaceChildren(found.length ? eventRows(found) : el("p", { class: "quiet" }, "Nothing of this kind yet."));
  }

  async function more() {
    const oldest = rows().at(-1)?.time_s;
    const asked = new URLSearchParams({ limit: PAGE });
    for (const key of ["drive", "kind"]) if (chosen[key]) asked.set(key, chosen[key]);
    if (oldest) asked.set("to", oldest);
    try {
      const found = await get(`history/events?${asked}`);
      past.push(...found);
      hide(older, found.length < PAGE);
      put(note, "");
    } catch (error) {
      put(note, `Older events cannot be loaded: ${error.message}.`);
    }
    show();
  }

  show();
  more();
  return onChange((changed) => { if (changed.events || changed.reloaded) show(); });
}

const isUp = (role) => role === "operate" || role === "commission";

export function alarmsPage(main) {
  const list = el("ul", { class: "alarms" });
  main.append(el("h1", { tabindex: "-1" }, "Alarms"), list);

  async function acknowledge(alarm) {
    try {
      await ask("POST", `alarms/${encodeURIComponent(alarm.id)}/acknowledge`, {});
    } catch (error) {
      showAnswer({ number: -Date.now(), drive: alarm.drive, words: "acknowledge the alarm", outcome: "refused", text: error.message, at: Date.now() / 1000 });
    }
    refreshAlarms();
  }

  function show() {
    const rows = plant.alarms.map((alarm) => {
      const said = [
        `${alarm.drive}, since ${clock(alarm.since_s)}`,
        alarm.times > 1 && `${alarm.times} times`,
        alarm.over_s ? `over at ${clock(alarm.over_s)}` : alarm.present === false && "not there now",
        alarm.gone && `now ${alarm.gone}`,
        alarm.acknowledged_by && `acknowledged by ${alarm.acknowledged_by}`,
      ];
      const button = !alarm.acknowledged_by && isUp(roleName())
        && el("button", { type: "button", disabled: !isLive(), click: () => acknowledge(alarm) }, "Acknowledge");
      return el("li", { "data-over": alarm.over_s ? "yes" : null },
        el("div", {}, el("strong", {}, `${alarm.rule}: ${alarm.text}`), el("p", { class: "quiet" }, said.filter(Boolean).join("; "))), button);
    });
    list.replaceChildren(...(rows.length ? rows : [el("li", { class: "quiet" }, "No alarms.")]));
  }

  show();
  refreshAlarms();
  return onChange((changed) => { if (changed.alarms || changed.link || changed.reloaded) show(); });
}

// The controls of one drive: who commands it, its reference, start in two steps, reset.

import { command, leases, start } from "./commands.js";
import { el, hide, mark, put } from "./elements.js";
import { clock } from "./format.js";
import { isLive, may, roleName, serverTime } from "./plant.js";

const POLICIES = {
  ramp: "the motor stops along its ramp",
  coast: "the drive switches its output off, and the motor coasts",
  trip: "the drive stops the motor with a fault that must be reset",
  hold: "the motor keeps running as commanded, and nothing stops it",
};
const COMMANDS = ["start", "set_reference", "reset"];
const CONFIRM_AFTER_MS = 600;
const CONFIRM_WITHIN_MS = 15000;

export function controls(name) {
  const why = el("p", { class: "quiet" });
  const holder = el("p", { class: "lease" });
  const take = el("button", { type: "button", click: () => leases.take(name) }, "Take control");
  const give = el("button", { type: "button", click: () => leases.give(name) }, "Release control");
  const reference = referenceForm(name);
  const starting = startForm(name);
  const reset = el("button", { type: "button", click: () => command(name, "reset", {}, "reset the fault") }, "Reset the fault");
  const element = el("div", { class: "controls" }, holder, why, el("div", { class: "row" }, take, give, reset),
    reference.element, starting.element);

  function show(drive) {
    const mine = Boolean(leases.key(name) && drive.lease?.yours);
    const other = drive.lease && !mine;
    const allowed = COMMANDS.some((verb) => may(drive, verb));
    put(holder, whoCommands(drive, mine));
    mark(holder, "data-mine", mine ? "yes" : null);
    put(why, reasons(drive, allowed, mine));
    hide(why, !why.textContent);
    hide(take, !allowed || mine);
    take.disabled = !isLive() || Boolean(other);
    hide(give, !mine);
    const ready = mine && isLive();
    hide(reset, !may(drive, "reset"));
    reset.disabled = !ready;
    reference.show(may(drive, "set_reference"), ready, drive.machine_unit ?? "");
    starting.show(may(drive, "start"), ready, drive);
  }
  return { element, show, end: starting.cancel };
}

function whoCommands(drive, mine) {
  if (mine) return "You have control of this drive, for as long as this page is open.";
  if (!drive.lease) return drive.kept ? `No user has control; the server keeps the motor running (${drive.kept}).` : "No user has control of this drive.";
  const who = drive.lease.yours ? "You have control in another window" : `${drive.lease.holder} has control`;
  const left = Math.max(0, Math.round(drive.lease.until_s - serverTime()));
  return `${who}${drive.lease.door ? ` (${drive.lease.door})` : ""} until ${clock(drive.lease.until_s)}, ${left} s from now unless it is renewed.`;
}

function reasons(drive, allowed, mine) {
  if (!isLive()) return "Nothing can be commanded from here: there is no connection to the server.";
  if (allowed) return mine || drive.lease ? "" : "Take control to command it; other users see it.";
  if (drive.monitoring_only) return "This drive is monitoring only: its model has no commands, so it can only be read.";
  if (drive.read_only_reason) return drive.read_only_reason;
  if (!drive.armed) return "The plant file does not arm this drive: it can only be watched and stopped.";
  if (["nobody", "view"].includes(roleName())) return "You may only watch. Sign in as a user who may operate the plant.";
  return "The plant file does not allow this drive to be commanded over the network.";
}

function referenceForm(name) {
  const value = el("input", { type: "text", inputmode: "decimal", id: "reference", autocomplete: "off", size: 6 });
  const unit = el("select", { "aria-label": "Unit of the reference" }, el("option", { value: "percent" }, "%"), el("option", { value: "hz" }, "Hz"));
  const machine = el("option", { value: "machine" });
  const set = el("button", { type: "submit" }, "Set");
  const wrong = el("p", { class: "wrong", role: "alert" });
  const element = el("form", { class: "row", submit: (event) => {
    event.preventDefault();
    const text = value.value.trim().replace(",", ".");
    const good = /^[-+]?\d+(\.\d+)?$/.test(text);
    put(wrong, good ? "" : "Write a number, such as 50 or 32.5.");
    const shown = `${text} ${unit.selectedOptions[0].text}`;
    // With its unit, which the server refuses if the plant file has another one by now.
    const given = unit.value === "machine" ? `${text} ${machine.textContent}` : Number(text);
    if (good) command(name, "set_reference", { [unit.value]: given }, `reference ${shown}`);
  } }, el("label", { for: "reference" }, "Reference"), value, unit, set, wrong);
  function offer(own) {
    if (machine.textContent === own) return;
    // A number that was written for one unit is never set in another.
    if (machine.selected) value.value = "";
    put(machine, own);
    if (own) unit.append(machine);
    else machine.remove();
  }

  return { element, show: (allowed, ready, own) => {
    hide(element, !allowed);
    offer(own);
    for (const each of [value, unit, set]) each.disabled = !ready;
  } };
}

/** Start in two steps: the first asks what the motor does when the connection is lost, the second starts it. */
function startForm(name) {
  const first = el("button", { type: "button", "aria-expanded": "false", click: ask }, "Start…");
  const policies = Object.entries(POLICIES).map(([policy, words]) => {
    const radio = el("input", { type: "radio", name: "policy", value: policy, required: true });
    return { policy, radio, element: el("label", {}, radio, el("span", {}, el("strong", {}, policy), `: ${words}`)) };
  });
  const seconds = el("input", { type: "number", min: 1, max: 60, step: 1, value: 5, id: "watchdog" });
  const watchdog = el("div", { class: "row" }, el("label", { for: "watchdog" }, "after"), seconds, el("span", {}, "s"));
  const reverse = el("input", { type: "checkbox" });
  const backwards = el("label", { class: "row" }, reverse, "backwards");
  const now = el("button", { type: "submit", class: "start" }, `Start ${name} now`);
  const form = el("form", { class: "confirm", hidden: true, "aria-label": `Start ${name}`, submit },
    el("fieldset", {}, el("legend", {}, "When this page, the server or the line is lost,"), ...policies.map((each) => each.element)),
    watchdog,
    backwards,
    el("p", { class: "quiet" }, "This is not a safety function. Unless you choose hold, the motor runs only while you have control."),
    el("div", { class: "row" }, now, el("button", { type: "button", click: cancel }, "Cancel")));
  const none = el("p", { class: "quiet" });
  const element = el("div", {}, first, none, form);
  let timer;
  let isReady = false;

  function ask() {
    if (!form.hidden) return cancel();
    hide(form, false);
    first.setAttribute("aria-expanded", "true");
    // A second press of the same key or a double tap shall not start a motor.
    now.disabled = true;
    setTimeout(() => { now.disabled = !isReady; }, CONFIRM_AFTER_MS);
    timer = setTimeout(cancel, CONFIRM_WITHIN_MS);
    (policies.find(({ radio }) => radio.checked) ?? policies.find(({ radio }) => !radio.disabled))?.radio.focus();
    form.scrollIntoView({ block: "nearest" });
  }

  function submit(event) {
    event.preventDefault();
    const chosen = policies.find(({ radio }) => radio.checked);
    if (!chosen || now.disabled) return;
    start(name, { policy: chosen.policy, watchdogS: Number(seconds.value), reverse: reverse.checked && !backwards.hidden });
    cancel();
  }

  function cancel() {
    clearTimeout(timer);
    if (form.contains(document.activeElement)) first.focus();
    hide(form, true);
    first.setAttribute("aria-expanded", "false");
  }

  form.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    cancel();
  });
  form.addEventListener("input", () => {
    clearTimeout(timer);
    timer = setTimeout(cancel, CONFIRM_WITHIN_MS);
  });
  let isPreset = false;
  /** What the drive can do, and the plant file lets a network choose: nothing looser than it says. */
  const offered = (drive) => {
    const said = drive.link_loss?.policy ?? drive.link_loss;
    const isAllowed = (policy) => (said ? said === "hold" || policy === said : policy !== "hold");
    return policies.filter(({ policy }) => (drive.policies ?? Object.keys(POLICIES)).includes(policy) && isAllowed(policy));
  };
  return { element, cancel, show: (allowed, ready, drive) => {
    isReady = ready;
    hide(element, !allowed);
    hide(backwards, !may(drive, "reverse"));
    const able = offered(drive);
    first.disabled = !ready || !able.length;
    put(none, able.length ? "" : "It cannot be started from here: the plant file allows no link_loss policy that this drive supports.");
    if (first.disabled && !form.hidden) cancel();
    for (const { element: choice, radio } of policies) {
      const isAble = able.some((each) => each.radio === radio);
      hide(choice, !isAble);
      radio.disabled = !isAble;
      if (!isAble) radio.checked = false;
    }
    hide(watchdog, able.every(({ policy }) => policy === "hold"));
    if (isPreset) return;
    isPreset = true;
    const wished = drive.link_loss?.policy ?? drive.link_loss;
    const preset = able.find(({ policy }) => policy === wished) ?? (able.length === 1 ? able[0] : null);
    if (preset) preset.radio.checked = true;
    // A longer watchdog is refused, too.
    const longest = drive.link_loss?.watchdog_s ?? Number(seconds.value);
    seconds.max = seconds.value = longest;
  } };
}

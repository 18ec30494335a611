// The list of what was asked of drives, and what came of it, at the lower edge of the page.

import { el, hide, put } from "./elements.js";
import { clock } from "./format.js";

const SHOWN = 5;
const DONE_MS = 6000;
const TITLES = {
  asked: "Asked",
  done: "Done",
  refused: "Refused",
  failed: "Failed",
  open: "Unknown whether the drive acted",
  ended: "Over",
};

const list = document.getElementById("answer-list");
const section = document.getElementById("answers");
const shown = new Map();

export function showAnswer({ number, drive, words, outcome, text, at }) {
  let item = shown.get(number);
  if (!item) {
    item = {
      outcome: el("strong"),
      what: el("span", { class: "answer-what" }),
      text: el("span", { class: "answer-text" }),
      time: el("time"),
    };
    item.close = el("button", { type: "button", class: "plain", "aria-label": "Dismiss", click: () => remove(number) }, "×");
    item.row = el("li", {}, item.outcome, item.what, item.text, item.time, item.close);
    shown.set(number, item);
    list.prepend(item.row);
  }
  item.row.dataset.outcome = outcome;
  put(item.outcome, TITLES[outcome] ?? outcome);
  put(item.what, drive ? `${drive}: ${words}` : words);
  put(item.text, text ?? "");
  put(item.time, clock(at));
  clearTimeout(item.timer);
  if (outcome === "done") item.timer = setTimeout(() => remove(number), DONE_MS);
  for (const [other, { row }] of shown) {
    if (shown.size > SHOWN && row.dataset.outcome !== "open" && other !== number) remove(other);
  }
  hide(section, false);
}

function remove(number) {
  shown.get(number)?.row.remove();
  shown.delete(number);
  hide(section, !shown.size);
}

/** Dismiss the latest answer; returns whether there was one. */
export function dismiss() {
  const newest = Math.max(...shown.keys());
  if (!shown.has(newest)) return false;
  remove(newest);
  return true;
}

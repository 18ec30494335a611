// Trends of a drive's values: from the history, then live.

import { get } from "./api.js";
import { el, put } from "./elements.js";
import { isNumber, number, rounded, title, unit } from "./format.js";
import { isSound, onChange, onValue, plant, serverTime } from "./plant.js";

export const SPANS = { "10 min": 600, "1 h": 3600, "6 h": 21600, "24 h": 86400 };
const AT_ONCE = 4;
const POINTS = 600;
/** Points of a page that has been open for the whole span. */
const MOST_LIVE = 3000;
const HEIGHT = 150;

/** Show the trends of a drive within an element; returns what ends it. */
export function showTrends(place, drive) {
  let span = "10 min";
  const charts = new Map();
  const numbers = [...plant.drives.get(drive).values.values()].filter(
    (value) => value.name !== "status" && isNumber(value.reading?.value));
  const chosen = new Set(numbers.slice(0, AT_ONCE).map((value) => value.name));
  const area = el("div", { class: "charts" });
  const spans = el("div", { class: "choice", role: "group", "aria-label": "Time span" },
    ...Object.keys(SPANS).map((name) => el("button", { type: "button", "aria-pressed": String(name === span),
      click: (event) => { span = name; press(event.currentTarget); reload(); } }, name)));
  const which = el("div", { class: "choice", role: "group", "aria-label": "Values shown" },
    ...numbers.map(({ name }) => el("button", { type: "button", "aria-pressed": String(chosen.has(name)),
      click: (event) => { toggle(name, event.currentTarget); } }, title(name))));
  place.append(el("div", { class: "trend-bar" }, spans, numbers.length > 1 ? which : null), area);
  if (!numbers.length) place.append(el("p", { class: "quiet" }, "No numeric values of this drive are polled."));

  function toggle(name, button) {
    if (!chosen.delete(name)) chosen.add(name);
    button.setAttribute("aria-pressed", String(chosen.has(name)));
    reload();
  }

  function reload() {
    for (const chart of charts.values()) chart.end();
    charts.clear();
    area.replaceChildren();
    for (const { name, reading } of numbers) {
      if (chosen.has(name)) charts.set(name, makeChart(area, drive, name, unit(reading.unit), SPANS[span]));
    }
  }

  const sampled = onValue((value) => {
    if (value.drive === drive) charts.get(value.name)?.add(value);
  });
  const drawn = setInterval(() => { for (const chart of charts.values()) chart.draw(); }, 1000);
  const fit = new ResizeObserver(() => { for (const chart of charts.values()) chart.fit(); });
  fit.observe(area);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", reload);
  // What came while there was no connection is in the history.
  const leave = onChange((changed) => { if (changed.reloaded) reload(); });
  document.addEventListener("theme", reload);
  reload();
  return () => {
    sampled();
    leave();
    clearInterval(drawn);
    fit.disconnect();
    dark.removeEventListener("change", reload);
    document.removeEventListener("theme", reload);
    for (const chart of charts.values()) chart.end();
  };
}

export function press(button) {
  for (const each of button.parentElement.children) each.setAttribute("aria-pressed", String(each === button));
}

function makeChart(area, drive, name, unitText, seconds) {
  const latest = el("b", { class: "number" });
  const range = el("span", { class: "quiet number" });
  const canvas = el("div", { class: "chart", role: "img" });
  area.append(el("figure", {}, el("figcaption", {}, el("span", {}, title(name)), latest, range), canvas));
  let times = [];
  let values = [];
  let isOver = false;
  const colour = (which) => getComputedStyle(document.documentElement).getPropertyValue(which).trim();
  const axis = { stroke: colour("--text-quiet"), grid: { stroke: colour("--grid"), width: 1 }, ticks: { show: false },
    font: "12px system-ui, sans-serif" };
  const plot = new globalThis.uPlot({
    width: Math.max(200, canvas.clientWidth),
    height: HEIGHT,
    legend: { show: false },
    cursor: { sync: { key: `drive-${drive}` }, drag: { x: false, y: false }, points: { show: false } },
    scales: { x: { time: true, range: () => [serverTime() - seconds, serverTime()] },
      y: { range: (_, low, high) => limits(low, high) } },
    axes: [{ ...axis, size: 24, values: (_, marks) => marks.map((each) => timeOfDay(each)), space: 70 }, { ...axis, size: 52 }],
    series: [{}, { stroke: colour("--trend"), width: 2, spanGaps: false, points: { show: false } }],
  }, [times, values], canvas);

  get(`history?drive=${encodeURIComponent(drive)}&name=${encodeURIComponent(name)}&from=${serverTime() - seconds}&to=${serverTime()}&points=${POINTS}`)
    .then(({ points }) => {
      if (isOver) return;
      const until = times[0] ?? Infinity;
      const old = points.filter(([time]) => time < until);
      times = [...old.map(([time]) => time), ...times];
      values = [...old.map(([, value]) => (isNumber(value) ? Number(value) : null)), ...values];
      draw();
    })
    .catch(() => put(range, "no history"));

  function add(value) {
    const shown = isSound(value) && isNumber(value.reading.value) ? Number(value.reading.value) : null;
    const isGap = (each) => each === null;
    // Of values that come close together the latest is shown; where a gap begins or ends is always shown.
    const isClose = times.length > 1 && value.time_s - times.at(-2) < seconds / MOST_LIVE
      && isGap(values.at(-2)) === isGap(shown) && isGap(values.at(-1)) === isGap(shown);
    if (isClose) {
      times.pop();
      values.pop();
    }
    times.push(value.time_s);
    values.push(shown);
  }

  function draw() {
    const first = serverTime() - seconds;
    let gone = 0;
    while (gone < times.length && times[gone] < first) gone += 1;
    if (gone > 60) {
      times = times.slice(gone);
      values = values.slice(gone);
    }
    plot.setData([times, values]);
    const known = values.filter((value) => value !== null);
    const last = values.at(-1);
    put(latest, last === null || last === undefined ? "–" : `${number(plant.drives.get(drive)?.values.get(name)?.reading?.value ?? last)} ${unitText}`);
    if (!known.length) return;
    const low = known.reduce((one, other) => Math.min(one, other));
    const high = known.reduce((one, other) => Math.max(one, other));
    put(range, `${rounded(low)} to ${rounded(high)} ${unitText}`);
    canvas.setAttribute("aria-label", `Trend of ${title(name).toLowerCase()}: ${range.textContent}`);
  }

  return {
    add,
    draw,
    fit: () => plot.setSize({ width: Math.max(200, canvas.clientWidth), height: HEIGHT }),
    end: () => {
      isOver = true;
      plot.destroy();
    },
  };
}

/** A scale with zero in it where the values come near it, and never one of noise alone. */
export function limits(low, high) {
  if (low === null || high === null) return [0, 1];
  const room = Math.max(high - low, Math.abs(high) * 0.05, 0.1) * 0.1;
  const bottom = low >= 0 && low < high * 0.5 ? 0 : low - room;
  return [bottom, Math.max(high + room, bottom + 0.1)];
}

const TIME = new Intl.DateTimeFormat("en-GB", { hour: "2-digit", minute: "2-digit" });
export const timeOfDay = (seconds) => TIME.format(new Date(seconds * 1000));

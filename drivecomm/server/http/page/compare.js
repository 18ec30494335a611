// Trends of one quantity on several drives, in one chart.

import { get } from "./api.js";
import { el, put } from "./elements.js";
import { isNumber, number, title, unit } from "./format.js";
import { isSound, onChange, onValue, plant, serverTime } from "./plant.js";
import { limits, press, SPANS, timeOfDay } from "./trends.js";

/** Lines that can still be told apart: by colour, and by their dashes where colours cannot be seen. */
const LINES = [
  ["--trend", []], ["--trend-2", [8, 4]], ["--trend-3", [2, 3]], ["--trend-4", [12, 4, 2, 4]], ["--trend-5", [5, 5]], ["--text", [1, 2]],
];
const AT_FIRST = 4;
const POINTS = 400;
const HEIGHT = 320;
const FIRST = ["output_frequency", "motor_speed", "output_current", "output_power"];

let quantity = "";
let span = "10 min";
const chosen = new Set();

export function comparePage(main) {
  const select = el("select", { id: "quantity", change: () => { quantity = select.value; chosen.clear(); reload(); } });
  const spans = el("div", { class: "choice", role: "group", "aria-label": "Time span" },
    ...Object.keys(SPANS).map((name) => el("button", { type: "button", "aria-pressed": String(name === span),
      click: (event) => { span = name; press(event.currentTarget); draw(); } }, name)));
  const drives = el("fieldset", {}, el("legend", {}, "Drives"), el("div", { class: "drive-choice" }));
  const canvas = el("div", { class: "chart", role: "img" });
  const note = el("p", { class: "quiet" });
  main.append(el("h1", { tabindex: "-1" }, "Trends"),
    el("section", { class: "panel" },
      el("div", { class: "trend-bar" }, el("div", { class: "row" }, el("label", { for: "quantity" }, "Value"), select), spans), canvas, note, drives));
  let plot = null;
  let series = new Map();
  let latest = new Map();
  let drawing = 0;

  function reload() {
    const names = quantities();
    if (!names.includes(quantity)) quantity = names[0] ?? "";
    select.replaceChildren(...names.map((name) => el("option", { value: name, selected: name === quantity }, title(name))));
    const having = drivesWith(quantity);
    for (const name of chosen) if (!having.includes(name)) chosen.delete(name);
    if (!chosen.size) having.slice(0, AT_FIRST).forEach((name) => chosen.add(name));
    choices(having);
    draw();
  }

  function choices(having) {
    latest = new Map();
    const order = having.filter((name) => chosen.has(name));
    drives.lastChild.replaceChildren(...having.map((name) => {
      const value = el("b", { class: "number" });
      latest.set(name, value);
      const box = el("input", { type: "checkbox", checked: chosen.has(name), disabled: !chosen.has(name) && chosen.size >= LINES.length,
        change: () => {
          if (!chosen.delete(name)) chosen.add(name);
          choices(having);
          draw();
          drives.querySelectorAll("input")[having.indexOf(name)]?.focus();
        } });
      return el("label", {}, box, chosen.has(name) ? sample(order.indexOf(name)) : null, el("span", {}, name), value);
    }));
    put(note, having.length ? (having.length > LINES.length ? `Up to ${LINES.length} drives.` : "") : "No numeric values are polled.");
  }

  async function draw() {
    const turn = ++drawing;
    plot?.destroy();
    plot = null;
    const names = drivesWith(quantity).filter((name) => chosen.has(name));
    series = new Map(names.map((name) => [name, { times: [], values: [] }]));
    const seconds = SPANS[span];
    const found = await Promise.all(names.map((name) => past(name, seconds)));
    if (turn !== drawing) return;
    names.forEach((name, place) => {
      const one = series.get(name);
      const until = one.times[0] ?? Infinity;
      const old = found[place].filter(([time]) => time < until);
      one.times.unshift(...old.map(([time]) => time));
      one.values.unshift(...old.map(([, value]) => (isNumber(value) ? Number(value) : null)));
    });
    if (names.length) plot = makePlot(canvas, names, seconds);
    show();
  }

  function show() {
    const names = [...series.keys()];
    for (const [name, element] of latest) put(element, textOf(name));
    if (!plot) return;
    plot.setData(globalThis.uPlot.join(names.map((name) => [series.get(name).times, series.get(name).values])));
    canvas.setAttribute("aria-label", `Trend of ${title(quantity).toLowerCase()}: ${names.map((name) => `${name} ${textOf(name)}`).join(", ")}`);
  }

  const sampled = onValue((value) => {
    const one = value.name === quantity ? series.get(value.drive) : null;
    if (!one || one.times.at(-1) >= value.time_s) return;
    one.times.push(value.time_s);
    one.values.push(isSound(value) && isNumber(value.reading.value) ? Number(value.reading.value) : null);
    const gone = one.times.findIndex((time) => time >= serverTime() - SPANS[span]);
    if (gone > 60) {
      one.times.splice(0, gone);
      one.values.splice(0, gone);
    }
  });
  const drawn = setInterval(show, 1000);
  const fit = new ResizeObserver(() => plot?.setSize({ width: Math.max(200, canvas.clientWidth), height: HEIGHT }));
  fit.observe(canvas);
  const leave = onChange((changed) => { if (changed.reloaded) reload(); });
  document.addEventListener("theme", draw);
  reload();
  return () => {
    drawing += 1;
    sampled();
    leave();
    clearInterval(drawn);
    fit.disconnect();
    document.removeEventListener("theme", draw);
    plot?.destroy();
  };
}

const numeric = (value) => value.name !== "status" && isNumber(value.reading?.value);

/** The names of all numbers that are polled, what people look for first. */
function quantities() {
  const names = new Set([...plant.drives.values()].flatMap((drive) => [...drive.values.values()].filter(numeric).map(({ name }) => name)));
  const place = (name) => FIRST.indexOf(name) + 1 || FIRST.length + 1;
  return [...names].sort((one, other) => place(one) - place(other) || one.localeCompare(other));
}

function drivesWith(name) {
  return [...plant.drives.values()].filter((drive) => drive.values.has(name) && numeric(drive.values.get(name))).map((drive) => drive.name);
}

function textOf(name) {
  const reading = plant.drives.get(name)?.values.get(quantity)?.reading;
  return reading ? `${number(reading.value)} ${unit(reading.unit)}` : "–";
}

async function past(drive, seconds) {
  const from = serverTime() - seconds;
  try {
    return (await get(`history?drive=${encodeURIComponent(drive)}&name=${encodeURIComponent(quantity)}&from=${from}&to=${serverTime()}&points=${POINTS}`)).points;
  } catch {
    // Without a history, the chart begins now.
    return [];
  }
}

const colour = (which) => getComputedStyle(document.documentElement).getPropertyValue(which).trim();

/** A piece of a drive's line, beside its name. */
function sample(place) {
  const drawing = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  drawing.setAttribute("viewBox", "0 0 32 12");
  drawing.setAttribute("aria-hidden", "true");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
  line.setAttribute("d", "M0 6H32");
  line.setAttribute("stroke-width", "3");
  line.setAttribute("stroke", colour(LINES[place][0]));
  line.setAttribute("stroke-dasharray", LINES[place][1].join(" "));
  drawing.append(line);
  return drawing;
}

function makePlot(canvas, names, seconds) {
  const axis = { stroke: colour("--text-quiet"), grid: { stroke: colour("--grid"), width: 1 }, ticks: { show: false },
    font: "12px system-ui, sans-serif" };
  return new globalThis.uPlot({
    width: Math.max(200, canvas.clientWidth),
    height: HEIGHT,
    legend: { show: false },
    cursor: { drag: { x: false, y: false }, points: { show: false } },
    scales: { x: { time: true, range: () => [serverTime() - seconds, serverTime()] },
      y: { range: (_, low, high) => limits(low, high) } },
    axes: [{ ...axis, size: 24, values: (_, marks) => marks.map((each) => timeOfDay(each)), space: 70 }, { ...axis, size: 52 }],
    series: [{}, ...names.map((name, place) => ({ label: name, stroke: colour(LINES[place][0]), dash: LINES[place][1], width: 2,
      spanGaps: false, points: { show: false } }))],
  }, [[], ...names.map(() => [])], canvas);
}

// The fleet: plants at a glance, and the drives of one. It asks its server once a second and commands nothing.

import { el, hide, mark, put } from "../page/elements.js";
import { age, number, parsed, unit } from "../page/format.js";
import { nextTheme, showTheme } from "../page/themes.js";

const EVERY_MS = 1000;
const SILENT_MS = 5000;
const SHOWN = { output_frequency: "Output", output_current: "Current", reference_frequency: "Reference" };

const main = document.getElementById("main");
const banner = document.getElementById("banner");
let shown = "";
let show = () => {};
let answeredAt = 0;

async function asked(path) {
  const answer = await fetch(path, { cache: "no-store", signal: AbortSignal.timeout(SILENT_MS) });
  if (!answer.ok) throw new Error(await answer.text());
  return parsed(await answer.text());
}

function plantsPage() {
  const count = el("p", { class: "quiet" });
  const none = el("p", { class: "quiet" }, "No plant has published anything on this broker yet.");
  const grid = el("ul", { class: "plants", "aria-label": "Plants" });
  const tiles = new Map();
  main.replaceChildren(el("h1", { class: "unseen" }, "Plants"), count, none, grid);

  function tileOf(name) {
    const parts = { state: el("span", { class: "state" }), drives: el("span", { class: "number" }), read: el("p", { class: "quiet" }) };
    const numbers = Object.fromEntries(["running", "faults", "silent"].map((each) => [each, el("dd")]));
    const element = el("li", { class: "tile" },
      el("div", { class: "tile-head" }, el("h2", {}, el("a", { href: `#/${encodeURIComponent(name)}` }, name)), parts.state),
      el("p", { class: "large" }, parts.drives),
      el("dl", {}, ...Object.entries(numbers).map(([each, value]) => el("div", {}, el("dt", {}, each), value))),
      parts.read);
    return { element, ...parts, ...numbers };
  }

  return ["plants", (content) => {
    hide(none, content.plants.length > 0);
    const online = content.plants.filter((plant) => plant.gateway === "online").length;
    put(count, content.plants.length ? `${online} of ${content.plants.length} plants are connected` : "");
    const names = new Set(content.plants.map((plant) => plant.name));
    for (const [name, tile] of tiles) {
      if (!names.has(name)) { tile.element.remove(); tiles.delete(name); }
    }
    for (const plant of content.plants) {
      const tile = tiles.get(plant.name) ?? tileOf(plant.name);
      tiles.set(plant.name, tile);
      if (!tile.element.isConnected) grid.append(tile.element);
      const live = plant.gateway === "online";
      mark(tile.element, "data-gateway", plant.gateway);
      mark(tile.element, "data-state", live && plant.faults ? "fault" : null);
      put(tile.state, live ? "connected" : plant.gateway === "offline" ? "not connected" : "not known");
      put(tile.drives, live ? `${plant.answering} of ${plant.drives} answer` : `${plant.drives} drives`);
      for (const each of ["running", "faults", "silent"]) put(tile[each], live ? String(plant[each]) : "–");
      mark(tile.faults, "data-any", live && plant.faults ? "fault" : null);
      mark(tile.silent, "data-any", live && plant.silent ? "silent" : null);
      put(tile.read, plant.read_s === null ? "nothing read yet" : `read ${age(Date.now() / 1000 - Number(plant.read_s))} ago`);
    }
  }];
}

const at = (time) => (time === null ? "–" : new Date(1000 * Number(time)).toLocaleString());

function alarmTable(head) {
  const rows = el("tbody");
  const table = el("div", { class: "wide" }, el("table", { class: "values drives" },
    el("thead", {}, el("tr", {}, ...head.map((each) => el("th", { scope: "col" }, each)))), rows));
  return [table, (cells) => rows.replaceChildren(
    ...cells.map((each) => el("tr", {}, ...each.map((text) => el("td", {}, text)))))];
}

function alarmsPage() {
  const [table, fill] = alarmTable(["Plant", "Drive", "Alarm", "Since", "Stood until", "Acknowledged by", "Id"]);
  main.replaceChildren(el("h1", {}, "Alarms"), table);
  return ["alarms", (content) => fill(content.alarms.map((each) => [
    each.plant, each.drive, `${each.rule}: ${each.text}`, at(each.since_s), at(each.ended_s), each.acknowledged_by, each.id]))];
}

function plantPage(name) {
  const state = el("p", { class: "quiet" });
  const rows = el("tbody");
  const head = ["Drive", "Model", "State", ...Object.values(SHOWN), "Read"];
  const runs = el("p", { class: "quiet" });
  const [standing, fill] = alarmTable(["Drive", "Alarm", "Since", "Acknowledged by", "Id"]);
  const trends = el("div", { class: "trends" });
  let told = "";
  main.replaceChildren(
    el("h1", {}, el("a", { href: "#/", "aria-label": "Back to all plants" }, "‹ "), name), state,
    el("div", { class: "wide" }, el("table", { class: "values drives" },
      el("thead", {}, el("tr", {}, ...head.map((each) => el("th", { scope: "col" }, each)))), rows)),
    standing, trends, runs);

  function showTrends(content) {
    const drives = content.has_record ? content.list.map((drive) => drive.name) : [];
    if (told === drives.join("\n")) return;
    told = drives.join("\n");
    trends.replaceChildren(...drives.map((drive) => el("img", {
      src: `plants/${encodeURIComponent(name)}/${encodeURIComponent(drive)}/output_frequency/trend.svg`,
      alt: `Output of ${drive} in the last day`, loading: "lazy" })));
  }

  function cells(drive, live) {
    const known = live && drive.answers !== false;
    const words = !live ? "not known" : drive.answers === false ? "does not answer" : drive.state.replaceAll("_", " ") || "not known";
    const status = drive.values.status;
    return [
      drive.title ? `${drive.name} (${drive.title})` : drive.name, drive.model || drive.drive,
      drive.fault ? `${words}: ${drive.fault}` : words,
      ...Object.keys(SHOWN).map((each) => {
        const seen = drive.values[each];
        const fresh = known && seen && (seen.quality === "good" || seen.quality === "uncertain");
        return fresh ? `${number(seen.value)} ${unit(seen.unit)}` : "–";
      }),
      status ? `${age(Date.now() / 1000 - Number(status.time_s))} ago` : "–",
    ];
  }

  return [`plants/${encodeURIComponent(name)}`, (content) => {
    const live = content.gateway === "online";
    put(state, live ? `connected, ${content.answering} of ${content.drives} drives answer` : "Its server is not connected: what the drives do is not known.");
    while (rows.children.length > content.list.length) rows.lastChild.remove();
    content.list.forEach((drive, place) => {
      const row = rows.children[place] ?? rows.appendChild(el("tr", {}, ...head.map(() => el("td"))));
      mark(row, "data-state", !live || drive.answers === false ? "silent" : drive.state || null);
      cells(drive, live).forEach((text, column) => put(row.children[column], text));
    });
    hide(standing, content.standing.length === 0);
    fill(content.standing.map((each) => [
      each.drive, `${each.rule}: ${each.text}`, at(each.since_s), each.acknowledged_by, each.id]));
    put(runs, content.version ? `drivecomm ${content.version}; ${content.file} ${content.file_sha256.slice(0, 8)}, read ${at(content.file_read_s)}` : "");
    showTrends(content);
  }];
}

function route() {
  const name = decodeURIComponent(location.hash.replace(/^#\/?/, ""));
  const [path, draw] = location.hash === "#alarms" ? alarmsPage() : name ? plantPage(name) : plantsPage();
  shown = path;
  show = draw;
  look();
}

function complain(text) {
  put(banner, text);
  hide(banner, !text);
  mark(document.documentElement, "data-link", text ? "lost" : null);
}

async function look() {
  const path = shown;
  try {
    const content = await asked(path);
    if (path !== shown) return;
    answeredAt = Date.now();
    if ("has_record" in content) hide(document.getElementById("alarms"), !content.has_record);
    show(content);
    complain(content.problem ? `What is shown is old: ${content.problem}` : "");
  } catch (error) {
    if (path !== shown) return;
    const since = answeredAt ? `, since ${age((Date.now() - answeredAt) / 1000)}` : "";
    complain(`What is shown is old: the fleet view does not answer${since}. ${error.name === "TypeError" ? "" : error.message}`);
  }
}

const theme = document.getElementById("theme");
showTheme(theme);
theme.addEventListener("click", () => nextTheme(theme));
addEventListener("hashchange", route);
route();
setInterval(look, EVERY_MS);

// The frame of the page: which part is shown, the connection, the keys, the announcements.

import { accountPage } from "./account.js";
import { dismiss, showAnswer } from "./answers.js";
import { token } from "./api.js";
import { leases, onAnswer, stopAll } from "./commands.js";
import { comparePage } from "./compare.js";
import { drivePage } from "./drive.js";
import { hide, mark, put } from "./elements.js";
import { alarmsPage, eventsPage } from "./events.js";
import { clock } from "./format.js";
import { begin, told } from "./link.js";
import { plantPage } from "./overview.js";
import { counts, mayStop, onChange, plant, serverTime } from "./plant.js";
import { nextTheme, showTheme } from "./themes.js";

const PAGES = { "": plantPage, trends: comparePage, events: eventsPage, alarms: alarmsPage, account: accountPage };
const SPOKEN = new Set(["fault", "fault over", "silent", "answers", "link loss"]);
const CLOCK_OFF_S = 5;

const main = document.getElementById("main");
const part = Object.fromEntries(["plant-name", "link", "banner", "announce", "alarm-count", "account", "theme", "stop-all"]
  .map((id) => [id, document.getElementById(id)]));
let leave = () => {};

function route(event) {
  const [, name = "", drive = ""] = location.hash.split("/");
  leave();
  main.replaceChildren();
  main.scrollTo(0, 0);
  leave = name === "drive" ? drivePage(main, driveNamed(drive)) : (PAGES[name] ?? plantPage)(main);
  for (const link of document.querySelectorAll("nav a")) {
    mark(link, "aria-current", link.dataset.page === (name || "plant") ? "page" : null);
  }
  showFrame();
  if (event) main.querySelector("h1")?.focus({ preventScroll: true });
}

function driveNamed(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

function showFrame() {
  const info = plant.info;
  put(part["plant-name"], info?.name ?? "drivecomm");
  const found = counts();
  const trouble = found.fault + found.silent;
  document.title = `${plant.link === "live" ? (trouble ? `(${trouble}) ` : "") : "(no connection) "}${info?.name ?? "drivecomm"}`;
  put(part.account, token.get() && info?.you?.name ? info.you.name : "Sign in");
  hide(part["stop-all"], !mayStop());
  const open = plant.alarms.length;
  put(part["alarm-count"], String(open));
  hide(part["alarm-count"], !open);
  showLink();
}

function showLink() {
  const since = clock(plant.heardAt);
  mark(document.documentElement, "data-link", plant.link);
  const texts = {
    connecting: "connecting", live: `live ${clock(Date.now() / 1000)}`, lost: `lost ${since}`, paused: `paused ${since}`, locked: "sign in",
  };
  put(part.link, texts[plant.link]);
  const banners = {
    lost: `No connection since ${since}. Nothing shown here is current. A stop cannot go out from here: use the drive's own panel or the emergency stop.`,
    paused: `Paused since ${since}, because this page was hidden. Nothing shown here is current.`,
    locked: "Sign in to see this plant.",
  };
  const off = plant.info?.time_s ? Math.round(Date.now() / 1000 - serverTime()) : 0;
  const text = banners[plant.link] ?? (Math.abs(off) > CLOCK_OFF_S ? `The clock of this device is ${Math.abs(off)} s ${off > 0 ? "ahead of" : "behind"} the server's.` : "");
  put(part.banner, text);
  mark(part.banner, "data-grave", plant.link === "lost" ? "yes" : null);
  hide(part.banner, !text);
}

const SCROLL_KEYS = new Set(["PageDown", "PageUp", "ArrowDown", "ArrowUp", "Home", "End", " "]);

function keys(event) {
  // Only the content scrolls: these keys are for it unless something else has the focus.
  if (SCROLL_KEYS.has(event.key) && document.activeElement === document.body) main.focus({ preventScroll: true });
  if (event.key !== "Escape" || event.defaultPrevented) return;
  if (event.target.matches?.("input[type=search]") && event.target.value) return;
  if (dismiss()) return;
  if (location.hash.startsWith("#/drive/")) location.hash = "#/";
}

function spoken(events) {
  const texts = events.filter((event) => SPOKEN.has(event.kind)).map((event) => `${event.drive || event.line}: ${event.kind}, ${event.text}`);
  if (texts.length) part.announce.textContent = texts.slice(0, 3).join(". ");
}

part["stop-all"].addEventListener("click", stopAll);
part.theme.addEventListener("click", () => nextTheme(part.theme));
document.getElementById("skip").addEventListener("click", (event) => {
  event.preventDefault();
  main.focus();
});
addEventListener("hashchange", route);
addEventListener("keydown", keys);
addEventListener("pagehide", leases.leave);
onAnswer(showAnswer);
onChange((changed) => {
  if (plant.link === "locked" && changed.link && location.hash !== "#/account") location.hash = "#/account";
  showFrame();
});
Object.assign(told, { events: spoken, tick: () => { leases.renew(); showLink(); }, restarted: leases.forget, holdsLease: () => leases.held.size > 0 });
showTheme(part.theme);
route();
begin();

// What this page asks of drives, and what came of it. Nothing here changes what the page shows of a drive.

import { NoAnswer, Refusal, ask, identity } from "./api.js";
import { askAgain } from "./link.js";
import { plant, serverTime } from "./plant.js";

const STOP_TRIES = 3;
const STOP_TIMEOUT_MS = 4000;
const VALID_S = 2;
const NOT_KNOWN = "no response from the server; whether the drive acted is unknown";

let listener = () => {};

/** Tell what is asked and what came of it. */
export function onAnswer(told) {
  listener = told;
}

let asked = 0;

function tell(answer) {
  listener({ at: Date.now() / 1000, ...answer });
}

const path = (drive, rest) => `drives/${encodeURIComponent(drive)}/${rest}`;

/** Send a command under the lease that this tab has. words: what it is, for people. */
export function command(drive, verb, args, words) {
  return send(drive, words, () => ask("POST", path(drive, verb), fresh({ arguments: args, lease: leases.key(drive) })));
}

/** Start under the drive's watchdog, for as long as this tab keeps its lease. */
export function start(drive, { policy, watchdogS, reverse }) {
  const body = fresh({ lease: leases.key(drive), policy, reverse });
  if (policy !== "hold") body.watchdog_s = watchdogS;
  return send(drive, "start", () => ask("POST", path(drive, "keep"), body, { timeoutMs: 15000 }));
}

function fresh(content) {
  return { id: identity(), session: plant.info?.session ?? "", issued_s: serverTime(), valid_s: VALID_S, ...content };
}

/** Stop: at once, without a lease, by the same identity again while the server does not answer. */
export function stop(drive) {
  const body = { id: identity(), arguments: { how: "ramp" } };
  return send(drive, "stop", () => persistently(() => ask("POST", path(drive, "stop"), body, { timeoutMs: STOP_TIMEOUT_MS })));
}

export async function stopAll() {
  const number = ++asked;
  tell({ number, drive: "", words: "stop all", outcome: "asked" });
  try {
    const all = await persistently(() => ask("POST", "stop", { how: "ramp" }, { timeoutMs: 15000 }));
    // Nobody confirms a broadcast.
    const answers = all.filter((answer) => !answer.drive.endsWith(":*"));
    const bad = answers.filter((answer) => answer.outcome !== "done");
    for (const answer of bad) {
      tell({ number: ++asked, drive: answer.drive, words: "stop", outcome: answer.outcome, text: answer.error?.text ?? "" });
    }
    const text = `${answers.length - bad.length} of ${answers.length} drives have confirmed it`;
    const worst = bad.some((answer) => answer.outcome === "open") ? "open" : "failed";
    tell({ number, drive: "", words: "stop all", outcome: bad.length ? worst : "done", text });
    return bad.length ? worst : "done";
  } catch (error) {
    const open = !(error instanceof Refusal);
    tell({ number, drive: "", words: "stop all", outcome: open ? "open" : "refused", text: open ? NOT_KNOWN : error.message });
    return open ? "open" : "refused";
  }
}

async function persistently(request) {
  for (let tries = 1; ; tries += 1) {
    try {
      return await request();
    } catch (error) {
      if (!(error instanceof NoAnswer) || tries === STOP_TRIES) throw error;
      await new Promise((resolve) => setTimeout(resolve, 300));
    }
  }
}

async function send(drive, words, request) {
  const number = ++asked;
  tell({ number, drive, words, outcome: "asked" });
  let outcome, text;
  try {
    const answer = await request();
    outcome = answer.outcome;
    text = answer.error?.text ?? "";
  } catch (error) {
    outcome = error instanceof Refusal ? "refused" : "open";
    text = error instanceof Refusal ? error.message : NOT_KNOWN;
  }
  tell({ number, drive, words, outcome, text });
  askAgain(drive);
  return outcome;
}

const LEASE_S = 15;
/** A lease is renewed when so much of its time is over. */
const RENEW_AFTER = 1 / 3;

/** The leases of this tab: renewed while it lives, given back when it goes. */
export const leases = {
  held: new Map(),

  key: (drive) => leases.held.get(drive)?.key,

  async take(drive) {
    const number = ++asked;
    try {
      const lease = await ask("POST", path(drive, "lease"), { seconds: LEASE_S });
      leases.held.set(drive, { key: lease.key, granted: grantedS(lease), renewedAt: performance.now(), renewing: false });
      tell({ number, drive, words: "take control", outcome: "done", text: "renewed for as long as this page is open" });
    } catch (error) {
      tell({ number, drive, words: "take control", outcome: "refused", text: error.message });
    }
    askAgain(drive);
  },

  async give(drive) {
    const key = leases.key(drive);
    leases.held.delete(drive);
    if (key) await ask("DELETE", path(drive, "lease"), { key }).catch(() => {});
    askAgain(drive);
  },

  renew() {
    for (const [drive, lease] of leases.held) {
      if (lease.renewing || performance.now() - lease.renewedAt < lease.granted * RENEW_AFTER * 1000) continue;
      renewOne(drive, lease);
    }
  },

  /** Another run of the server knows none of them. */
  forget() {
    for (const drive of leases.held.keys()) over(drive, "the server was restarted");
    leases.held.clear();
  },

  /** The page goes away. */
  leave() {
    for (const [drive, lease] of leases.held) {
      ask("DELETE", path(drive, "lease"), { key: lease.key }, { keepalive: true }).catch(() => {});
    }
    leases.held.clear();
  },
};

const grantedS = (lease) => Math.max(1, lease.until_s - serverTime());

async function renewOne(drive, lease) {
  lease.renewing = true;
  const since = performance.now();
  try {
    const renewed = await ask("PUT", path(drive, "lease"), { key: lease.key, seconds: LEASE_S }, { timeoutMs: 3000 });
    lease.granted = grantedS(renewed);
    lease.renewedAt = since;
  } catch (error) {
    const tooLate = performance.now() - lease.renewedAt > lease.granted * 1000;
    if ((error instanceof Refusal || tooLate) && leases.held.get(drive) === lease) {
      leases.held.delete(drive);
      over(drive, error instanceof Refusal ? error.message : "it could not be renewed in time");
    }
  }
  lease.renewing = false;
}

function over(drive, why) {
  tell({ number: ++asked, drive, words: "your control has ended", outcome: "ended", text: why });
  askAgain(drive);
}

// The server's API: requests with the token of this tab, and the stream of what changes.

import { parsed } from "./format.js";

const ROOT = new URL("../", import.meta.url);
const TOKEN = "drivecomm-token";

/** The server has answered that it will not. */
export class Refusal extends Error {
  constructor(status, error) {
    super(error?.text || `the server answers with HTTP status ${status}`);
    this.status = status;
  }
}

/** No answer: the request may have arrived, or not. */
export class NoAnswer extends Error {}

export const token = {
  get: () => sessionStorage.getItem(TOKEN) ?? "",
  set: (value) => (value ? sessionStorage.setItem(TOKEN, value) : sessionStorage.removeItem(TOKEN)),
};

function address(path) {
  return new URL(`api/v1/${path}`, ROOT);
}

/** Return when the server answers, whatever it says. */
export async function reach(timeoutMs) {
  await fetch(new URL("healthz", ROOT), { cache: "no-store", credentials: "omit", signal: AbortSignal.timeout(timeoutMs) });
}

function headers(more = {}) {
  const given = token.get();
  return given ? { ...more, Authorization: `Bearer ${given}` } : more;
}

/** Ask the server; returns what it answers. Throws Refusal or NoAnswer. */
export async function ask(method, path, body, { timeoutMs = 8000, keepalive = false } = {}) {
  const init = { method, headers: headers(), cache: "no-store", credentials: "omit", keepalive };
  if (body !== undefined) {
    init.headers["Content-Type"] = "application/json";
    init.body = JSON.stringify(body);
  }
  if (!keepalive) init.signal = AbortSignal.timeout(timeoutMs);
  let response, text;
  try {
    response = await fetch(address(path), init);
    text = await response.text();
  } catch {
    throw new NoAnswer("the server did not answer");
  }
  let content = null;
  try {
    content = text ? parsed(text) : null;
  } catch {
    if (response.ok) throw new NoAnswer("the server's answer cannot be read");
  }
  // A command that was not done has an outcome, too.
  if (!response.ok && !content?.outcome) throw new Refusal(response.status, content?.error);
  return content;
}

export const get = (path, options) => ask("GET", path, undefined, options);

/** Read the stream until it ends. heard: called for all that comes. told: called with an event's name and content. */
export async function stream(path, { signal, heard, told }) {
  let response;
  try {
    response = await fetch(address(path), { headers: headers(), cache: "no-store", credentials: "omit", signal });
  } catch {
    throw new NoAnswer("the server did not answer");
  }
  if (!response.ok) throw new Refusal(response.status, (await response.json().catch(() => null))?.error);
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    heard();
    const parts = (rest + value.replaceAll("\r\n", "\n")).split("\n\n");
    rest = parts.pop();
    for (const part of parts) tell(part, told);
  }
}

function tell(part, told) {
  let name = "message";
  const data = [];
  for (const line of part.split("\n")) {
    if (line.startsWith("event:")) name = line.slice(6).trim();
    else if (line.startsWith("data:")) data.push(line.slice(5).trimStart());
  }
  if (data.length) told(name, parsed(data.join("\n")));
}

/** Return a random identity; pages that came by plain HTTP have no randomUUID. */
export function identity() {
  if (crypto.randomUUID) return crypto.randomUUID();
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (each) => each.toString(16).padStart(2, "0")).join("");
}

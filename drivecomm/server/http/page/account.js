// Who uses this page: signing in and out.

import { ask, token } from "./api.js";
import { el, put } from "./elements.js";
import { reconnect } from "./link.js";
import { onChange, plant, roleName } from "./plant.js";

const ROLES = {
  nobody: "You may see nothing.",
  view: "You may watch.",
  operate: "You may watch, start, stop and reset motors, and set references.",
  commission: "You may watch, and start, stop and reset motors; parameters are written by other programs.",
};

export function accountPage(main) {
  const who = el("p");
  const wrong = el("p", { class: "wrong", role: "alert" });
  const name = el("input", { id: "user", name: "username", autocomplete: "username", autocapitalize: "off", required: true });
  const password = el("input", { id: "password", type: "password", autocomplete: "current-password", required: true });
  const given = el("input", { id: "token", type: "password", autocomplete: "off", required: true });
  const out = el("button", { type: "button", click: () => use("") }, "Sign out");
  const form = (label, submit, ...parts) => el("form", { class: "panel account", "aria-label": label, submit: (event) => { event.preventDefault(); submit(); } }, ...parts);
  main.append(el("div", { class: "sign-in" }, el("h1", { tabindex: "-1" }, "Sign in"), who, wrong, out,
    el("div", { class: "account-forms" },
      form("Sign in with a password", signIn, el("label", { for: "user" }, "Name"), name,
        el("label", { for: "password" }, "Password"), password, el("button", {}, "Sign in")),
      form("Sign in with a token", () => use(given.value.trim()), el("label", { for: "token" }, "Or the token of a user"), given, el("button", {}, "Use it"))),
    el("p", { class: "quiet" }, "It is kept for this tab only, and deleted when the tab is closed.")));

  async function signIn() {
    put(wrong, "");
    try {
      use((await ask("POST", "login", { name: name.value, password: password.value })).token);
    } catch (error) {
      put(wrong, `Not signed in: ${error.message}.`);
    }
  }

  function use(value) {
    token.set(value);
    given.value = password.value = "";
    reconnect();
    if (value) location.hash = "#/";
  }

  function show() {
    const you = plant.info?.you;
    put(who, plant.link === "locked" ? "This plant is shown to its users only." : you ? `You are ${you.name || "not signed in"}. ${ROLES[roleName()]}` : "");
    out.hidden = !token.get();
  }
  show();
  return onChange((changed) => { if (changed.link || changed.reloaded || changed.lines) show(); });
}

// How the page looks: as the device says, light, dark, or with the strongest contrast for sunlight.

const NAMES = { auto: "Auto", light: "Light", dark: "Dark", sun: "Sunlight" };
const KEY = "drivecomm-theme";

function stored() {
  try {
    return localStorage.getItem(KEY) in NAMES ? localStorage.getItem(KEY) : "auto";
  } catch {
    return "auto";
  }
}

let now = stored();

export function showTheme(button) {
  document.documentElement.dataset.theme = now;
  button.textContent = `◐ ${NAMES[now]}`;
  button.setAttribute("aria-label", `Display: ${NAMES[now]}; change it`);
  document.dispatchEvent(new Event("theme"));
}

export function nextTheme(button) {
  const names = Object.keys(NAMES);
  now = names[(names.indexOf(now) + 1) % names.length];
  try {
    localStorage.setItem(KEY, now);
  } catch {
    // Kept until the page is closed.
  }
  showTheme(button);
}

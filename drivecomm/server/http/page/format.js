// Numbers, times and names as people read them.

const EXACT_DIGITS = 8;
const EXACT_PLACES = 4;

/** Parse JSON whose values keep the digits that the drive gave: `"value":10.00` becomes the text 10.00. */
export function parsed(text) {
  // Within a text, a quotation mark is escaped, so this finds keys only.
  return JSON.parse(text.replace(/"(value|machine_value|approved|now)": *(-?\d[\d.]*(?:[eE][+-]?\d+)?)/g, '"$1":"$2"'));
}

export function isNumber(value) {
  return typeof value === "number" || /^-?\d+(\.\d+)?([eE][+-]?\d+)?$/.test(value ?? "");
}

/** Return a number as its drive gave it; one with more digits than any drive has is rounded. */
export function number(value) {
  const text = String(value);
  if (!isNumber(text)) return text.replaceAll("_", " ");
  const exponent = /[eE]/.test(text);
  const places = text.split(".")[1]?.length ?? 0;
  if (!exponent && places <= EXACT_PLACES && text.replace(/\D/g, "").length <= EXACT_DIGITS + EXACT_PLACES) {
    return sign(text);
  }
  return sign(Number(text).toLocaleString("en", { useGrouping: false, maximumSignificantDigits: 6 }));
}

function sign(text) {
  return text.replace("-", "\u2212");
}

/** Return a number of a calculation, such as the mean of a trend. */
export function rounded(value, digits = 4) {
  return number(Number(value.toPrecision(digits)));
}

const UNITS = { degC: "°C", C: "°C", percent: "%", ohm: "Ω", rpm: "min⁻¹", "1/min": "min⁻¹", "r/min": "min⁻¹" };

export function unit(text) {
  return UNITS[text] ?? text ?? "";
}

/** Return the speed of a drive's machine that stands beside a frequency, empty for any other value. */
export function atMachine({ machine_value: value, machine_unit: of }) {
  return of && value !== undefined && value !== null ? `${number(value)} ${unit(of)}` : "";
}

/** Return "Output frequency" for output_frequency. */
export function title(name) {
  const words = name.replaceAll("_", " ");
  return words === "dc link voltage" ? "DC link voltage" : words.charAt(0).toUpperCase() + words.slice(1);
}

const CLOCK = new Intl.DateTimeFormat("en-GB", { hour: "2-digit", minute: "2-digit", second: "2-digit" });
const DAY = new Intl.DateTimeFormat("en-GB", { day: "numeric", month: "short", year: "numeric" });

/** Return the local clock time, with its date unless it is today. */
export function clock(seconds) {
  const time = new Date(seconds * 1000);
  const day = time.toDateString() === new Date().toDateString() ? "" : `${DAY.format(time)} `;
  return day + CLOCK.format(time);
}

export function age(seconds) {
  if (seconds < 10) return `${Math.max(0, seconds).toFixed(1)} s`;
  if (seconds < 120) return `${Math.round(seconds)} s`;
  if (seconds < 7200) return `${Math.round(seconds / 60)} min`;
  if (seconds < 172800) return `${Math.round(seconds / 3600)} h`;
  return `${Math.round(seconds / 86400)} days`;
}

// Numbers and words as they are shown. Digits are grouped by a thin space that does not break.

const THIN = "\u202f";
const MINUS = "\u2212";

/** A whole number in groups of three. */
export function whole(value) {
  if (!Number.isFinite(value)) return "–";
  const digits = String(Math.abs(Math.round(value)));
  let grouped = "";
  for (let i = 0; i < digits.length; i++) {
    if (i > 0 && (digits.length - i) % 3 === 0) grouped += THIN;
    grouped += digits[i];
  }
  return (value < 0 && digits !== "0" ? MINUS : "") + grouped;
}

/** A number with so many places. */
export function fixed(value, places) {
  if (!Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(places);
  const negative = value < 0 && Number(text) !== 0;
  const [front, back] = text.split(".");
  return (negative ? MINUS : "") + whole(Number(front)) + (back ? `.${back}` : "");
}

/** Seconds as 1:02.3 or 12.3 s. */
export function seconds(value, places = 1) {
  if (!Number.isFinite(value)) return "–";
  if (value < 60) return `${value.toFixed(places)} s`;
  const hours = Math.floor(value / 3600);
  const minutes = Math.floor(value / 60) % 60;
  const rest = (value % 60).toFixed(places).padStart(places ? 3 + places : 2, "0");
  return hours ? `${hours}:${String(minutes).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}

/** An address as it is read on the switches and in a project: 05h is 5. */
export function hex2(value) {
  return value.toString(16).toUpperCase().padStart(2, "0");
}

/** A rate in the words of PROFIBUS. */
export function rate(bits) {
  if (!bits) return "no rate yet";
  return bits >= 1e6 ? `${bits / 1e6} Mbit/s` : `${bits / 1000} kbit/s`;
}

/** Octets in a unit that reads well. */
export function size(octets) {
  if (octets < 1000) return `${octets} B`;
  return octets < 1e6 ? `${(octets / 1000).toFixed(1)} kB` : `${(octets / 1e6).toFixed(1)} MB`;
}

export const STATES = {
  wait_prm: "waits for parameters",
  wait_cfg: "waits for its configuration",
  data_exchange: "exchanges data",
  off: "no power",
};

export const FUNCTIONALITIES = { class_1: "Class 1", class_2: "Class 2", scancon_2: "Scancon 2.0" };

/** What one unit of velocity is. */
export function velocityUnit(device) {
  return { "10_ms": "units / 10 ms", "100_ms": "units / 100 ms", "1000_ms": "units / s", rpm: "RPM" }[device?.time_base]
    ?? "units / time base";
}

/** The unit of acceleration beside it. */
export function accelerationUnit(device) {
  return { "10_ms": "units / (10 ms)²", "100_ms": "units / (100 ms)²", "1000_ms": "units / s²", rpm: "RPM / s" }[device?.time_base]
    ?? "units / time base²";
}

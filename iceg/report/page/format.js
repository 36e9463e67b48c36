// Numbers for people.

const few = (value, digits) => value.toFixed(digits);

export const count = (n, what) => `${n.toLocaleString("en")} ${what}${n === 1 ? "" : "s"}`;

/** A small length, in the unit that suits it. */
export function length(metres) {
  if (!Number.isFinite(metres)) return "–";
  const size = Math.abs(metres);
  if (size < 0.0995) return `${few(1000 * metres, size < 0.00995 ? 1 : 0)} mm`;
  return size < 0.995 ? `${few(100 * metres, 1)} cm` : `${few(metres, 2)} m`;
}

export const metres = (value) => `${few(value, 3)} m`;
export const degrees = (radians, digits = 2) => `${few((180 / Math.PI) * radians, digits)}°`;
export const percent = (share) => (Number.isFinite(share) ? `${few(100 * share, 0)} %` : "–");

export function duration(seconds) {
  const whole = Math.round(Math.abs(seconds));
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (n) => String(n).padStart(2, "0");
  return `${seconds < 0 ? "−" : ""}${h ? `${h}:${two(m)}` : m}:${two(s)}`;
}

const ESCAPES = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };

/** Text as HTML. */
export const escaped = (text) => String(text).replace(/[&<>"]/g, (sign) => ESCAPES[sign]);

/** Terms and their values as the rows of a definition list. */
export const facts = (rows) => rows.map(([term, value]) => `<dt>${escaped(term)}</dt><dd>${escaped(value)}</dd>`).join("");

// Light and dark: what the system asks for, until the button says otherwise.

import { emit } from "report/bus";

const root = document.documentElement;
const asked = matchMedia("(prefers-color-scheme: dark)");
const cache = new Map();

function apply(theme) {
  root.dataset.theme = theme;
  cache.clear();
  emit("theme");
}

apply(asked.matches ? "dark" : "light");
asked.addEventListener("change", () => apply(asked.matches ? "dark" : "light"));
document.getElementById("theme").addEventListener("click", () => apply(root.dataset.theme === "dark" ? "light" : "dark"));

/** A colour of the style sheet by its name, such as "accent". */
export function colour(name) {
  if (!cache.has(name)) cache.set(name, getComputedStyle(root).getPropertyValue(`--${name}`).trim());
  return cache.get(name);
}

const channels = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

/** Colour at a share of a scale of four colours, such as "time". */
export function onScale(scale, share) {
  const at = 3 * Math.min(1, Math.max(0, share));
  const low = Math.min(2, Math.floor(at));
  const [a, b] = [channels(colour(`${scale}-${low}`)), channels(colour(`${scale}-${low + 1}`))];
  return `rgb(${a.map((value, i) => Math.round(value + (at - low) * (b[i] - value))).join(",")})`;
}

/** Red, green and blue of a colour, 0 to 255. */
export const rgb = (name) => channels(colour(name));

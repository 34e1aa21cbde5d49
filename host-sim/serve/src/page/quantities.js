// Quantities in the units that the user chose: one state for the page and its parts.
import table from "./units.js";

/** Units by SI symbol: name, SI value of one, SI value of zero. A torque is no key's and no column's quantity. */
export const units = { ...table, "N m": [["N m", 1, 0]] };
/** The displayed units by SI symbol; the user chooses those of pressure and temperature. */
export const chosen = { Pa: "kPa", K: "K", "": "%", "kg/s": "g/s", s: "s", m: "mm", rad: "deg", "N m/rad": "N m/rad", "N m": "N m" };
const DIGITS = { kPa: 1, bar: 3, psi: 2, mm: 1, K: 2, degC: 2, "N m/rad": 1 };

export const unit = (si) => units[si].find(([name]) => name === chosen[si]);
export const symbol = (si) => chosen[si].replace("deg", "°");
export const digits = (si) => DIGITS[chosen[si]] ?? 2;
export const shownIn = (si, value) => { const [, one, zero] = unit(si); return (value - zero) / one; };
export const format = (si, value) => shownIn(si, value).toFixed(digits(si));
export const withUnit = (si, value) => `${format(si, value)} ${symbol(si)}`;

/** SI value of a typed number, in the displayed unit or with its own; a comma is accepted as a decimal point. */
export function parse(text, si) {
  const [, number, name] = /^([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(.*)$/i.exec(text.trim().replace(",", ".")) ?? [];
  const typed = name ? units[si].find(([known]) => known === name.replace("°", "deg")) : unit(si);
  const value = typed && Number(number) * typed[1] + typed[2];
  return Number.isFinite(value) ? value : null;
}

/** Shows a reading with its unit. */
export function put(id, value, unit) {
  const small = document.createElement("span");
  small.textContent = ` ${unit}`;
  document.getElementById(id).replaceChildren(value, small);
}

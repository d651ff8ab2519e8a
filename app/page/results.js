// The table of results, with units, and the price in large.

import { element } from "./form.js";
import { short, written, writtenError } from "./numbers.js";

// Name in the answer, words, unit; a second unit where Greeks are per day and per point.
export const RESULTS = [
  ["european_price", "European value", "money"],
  ["early_exercise_premium", "Early exercise premium", "money"],
  ["intrinsic_value", "Intrinsic value", "money"],
  ["exercise_boundary", "Exercise boundary now", "money"],
  ["delta", "Delta", ""],
  ["delta_sticky_moneyness", "Delta, smile moves with the spot", ""],
  ["gamma", "Gamma", "1/money"],
  ["theta", "Theta", "money/year", "money/day"],
  ["vega", "Vega", "money per 1.00 of volatility", "money per 0.01 of volatility"],
  ["rho", "Rho", "money per 1.00 of rate", "money per 0.01 of rate"],
  ["dividend_rho", "Rho of the yield", "money per 1.00 of dividend yield", "money per 0.01 of dividend yield"],
  ["dividend_sensitivities", "Per cash dividend", "money per 1.00 of an amount"],
  ["vanna", "Vanna", "1 per 1.00 of volatility", "1 per 0.01 of volatility"],
  ["volga", "Volga", "money per 1.00 of volatility, squared", "money per 0.01 of volatility, squared"],
  ["charm", "Charm", "1/year", "1/day"],
  ["rate_buckets", "Rate, by value", "money per 1.00 of a value", "money per 0.01 of a value"],
  ["dividend_yield_buckets", "Yield, by value", "money per 1.00 of a value", "money per 0.01 of a value"],
  ["volatility_buckets", "Volatility, by value", "money per 1.00 of a value", "money per 0.01 of a value"],
];

const place = (id) => document.getElementById(id);

// Write a number with the digits that its error leaves; the whole number stands in the value.
function write(data, value, error) {
  data.value = value ?? "";
  data.textContent = written(value, error);
}

export function showPrice(answer, implied, optionType) {
  place("headline-label").textContent = implied ? "Implied volatility" : "Value now";
  const [value, error] = implied ? [implied.volatility, implied.volatility_error] : [answer.price, answer.error_estimate];
  write(place("price"), value, error);
  place("error").value = error ?? "";
  place("error").textContent = error === null || error === undefined ? "" : writtenError(error);
  place("price").closest(".price").classList.toggle("none", value === null);
  if (answer) showTable(answer);
  place("advice").textContent = answer ? adviceOn(answer, optionType) : "";
}

function adviceOn(answer, optionType) {
  if (answer.exercise_now) return "Exercise now: holding on is worth no more.";
  if (answer.exercise_boundary === null) return "Hold: early exercise is not best at any spot within reach now.";
  return `Hold: exercise is best once the spot ${optionType === "call" ? "rises" : "falls"} to ${short(answer.exercise_boundary)}.`;
}

// How the number was found and how long it took from the key, in milliseconds.
export function showHow(answer, milliseconds) {
  const status = answer.status === "ok" ? "" : ` · ${answer.status.replaceAll("_", " ")}`;
  place("how").textContent = `${answer.method ?? `${answer.iterations ?? 0} iterations`}${status} · ${Math.max(Math.round(milliseconds), 1)} ms`;
  place("how").dataset.milliseconds = milliseconds.toFixed(1);
}

function showTable(answer) {
  const rows = RESULTS.flatMap(([name, words, unit, unitPerDay]) => {
    const value = answer[name];
    if (value === undefined || (value === null && name !== "exercise_boundary")) return [];
    const shownUnit = answer.greeks_units === "per_day_per_point" ? unitPerDay ?? unit : unit;
    const error = answer[name === "exercise_boundary" ? "boundary_error" : `${name}_error`];
    if (!Array.isArray(value)) return [row(name, words, value, error, shownUnit)];
    return value.map((entry, i) => row(`${name}.${i}`, `${words} ${i + 1}`, entry, error?.[i], shownUnit));
  });
  place("numbers").tBodies[0].replaceChildren(...rows);
}

function row(name, words, value, error, unit) {
  const number = element("data", { "data-name": name, value: value ?? "" }, written(value, error));
  return element("tr", {}, element("th", { scope: "row" }, words), element("td", { class: "number" }, number),
    element("td", { class: "number error-of" }, writtenError(error)), element("td", { class: "unit" }, unit));
}

// The page: what is typed becomes a question, its answer numbers and pictures, and all of it a link.

import { asCommand, asCurl, asPython } from "./copies.js";
import { save } from "./charts.js";
import { Form, FIELDS } from "./form.js";
import { short } from "./numbers.js";
import { Pictures } from "./pictures.js";
import { RESULTS, showHow, showPrice } from "./results.js";
import { ProblemError, Service } from "./service.js";

const PAUSE = 60; // ms without a key before the pictures are asked for
const place = (id) => document.getElementById(id);

let current = new AbortController();
let last = null; // what was answered last: { mode, body, price, implied, found }
const service = new Service(tell, () => place("api-key").value);
const pictures = new Pictures(place("charts"));
const form = new Form(place("form"), (event) => ask(event?.timeStamp));

function tell(words, canTryNow = false) {
  place("trouble").hidden = words === "";
  place("trouble-text").textContent = words;
  place("again").hidden = !canTryNow;
  if (words === "" || document.body.dataset.advice === "waiting") return; // all but the advice is answered
  mark("old");
  if (document.body.dataset.numbers) document.body.dataset.numbers = "old";
}

// Say of the pictures whether they belong to the numbers: "current", "waiting" or "old".
function mark(state, why = "") {
  document.body.dataset.charts = state === "current" || last?.found ? state : "none";
  place("charts-old").hidden = state !== "old" || (!last?.found && !why);
  place("charts-old").textContent = why || "These charts are of the last contract that was answered, not of what is typed now.";
}

async function ask(since = performance.now()) {
  current.abort();
  current = new AbortController();
  document.body.dataset.advice = "none";
  const { signal } = current;
  const { mode, body } = form.question();
  remember(mode, body);
  mark("waiting");
  try {
    const { price, implied } = await answers(mode, body, signal);
    form.clearErrors();
    showPrice(price, implied, body.option_type);
    showHow({ ...price, ...(implied ? { iterations: implied.iterations, status: implied.status } : {}) }, performance.now() - since);
    if (!price) return mark("old", `There is no such volatility: ${implied.status.replaceAll("_", " ")}.`);
    document.body.dataset.numbers = "current";
    await new Promise((resolve) => { setTimeout(resolve, PAUSE); });
    signal.throwIfAborted();
    await draw({ mode, body, price, implied }, signal);
  } catch (error) {
    if (signal.aborted) return;
    refuse(error);
  }
}

// Ask for the pictures of what was priced, and draw them; where the service refuses, the numbers stay.
async function draw(answered, signal) {
  const { body, implied } = answered;
  try {
    const found = await pictures.ask(service, implied ? atVolatility(body, implied.volatility) : body, signal);
    last = { ...answered, found };
    mark("current"); // from now on there are charts, and room for them
    pictures.show(found);
    followSpot(found);
    await advise(found.body, signal);
  } catch (error) {
    if (!(error instanceof ProblemError)) throw error;
    last = { ...answered, found: last?.found };
    mark("old", `The charts of this contract cannot be drawn: ${error.message}.`);
  }
}

// Advice on exercise comes last: it takes longer, and everything else stands without it.
async function advise(body, signal) {
  document.body.dataset.advice = "waiting";
  try {
    last.advice = await pictures.advise(service, body, signal);
  } catch (error) {
    if (!(error instanceof ProblemError)) throw error;
    pictures.withoutAdvice(`There is no advice on this contract: ${error.message}.`);
  }
  document.body.dataset.advice = "current";
}

// The contract at a volatility, in the place of a quote.
function atVolatility(body, volatility) {
  const quotes = ["option_price", "bid", "ask"];
  return { ...Object.fromEntries(Object.entries(body).filter(([name]) => !quotes.includes(name))), volatility };
}

async function answers(mode, body, signal) {
  if (mode === "price") return { price: await service.ask("v1/price", body, signal) };
  const implied = await service.ask("v1/implied-volatility", Form.withoutGreeks(body), signal);
  if (implied.volatility === null) return { implied };
  return { implied, price: await service.ask("v1/price", atVolatility(body, implied.volatility), signal) };
}

function refuse(error) {
  if (!(error instanceof ProblemError)) throw error;
  tell("");
  if (document.body.dataset.numbers) document.body.dataset.numbers = "old";
  else place("how").textContent = "There will be numbers and charts once the marked fields are right.";
  form.showErrors(error.problem);
  if (error.status === 401) {
    place("key-field").hidden = false;
    form.showErrors({ title: "The service wants an API key" });
  }
  mark("old");
}

// The link to this contract: everything that is not a default, in the address behind the #.
function remember(mode, body) {
  const told = Object.entries({ ...(mode === "price" ? {} : { mode }), ...body }).filter(([name, value]) => name !== "greek_errors" || !value);
  const text = told.map(([name, value]) => `${name}=${encodeURIComponent(typeof value === "string" ? value : JSON.stringify(value)).replaceAll("%3A", ":").replaceAll("%2C", ",")}`);
  history.replaceState(null, "", `#${text.join("&")}`);
}

function remembered() {
  const told = new URLSearchParams(location.hash.slice(1).replaceAll("+", "%2B"));
  const known = [...told].filter(([name]) => FIELDS.some((field) => field.name === name));
  return Object.fromEntries(known.map(([name, text]) => {
    try { return [name, JSON.parse(text)]; } catch { return [name, text]; }
  }));
}

// The slider under the numbers moves the cross-hair, which follows the spot of the contract at first.
function followSpot({ spots, body }) {
  const at = place("at");
  at.max = String(spots.length - 1);
  at.value = String(Math.max(spots.indexOf(body.spot), 0));
  pointAtSpot();
}

function pointAtSpot() {
  const spot = last.found.spots[Number(place("at").value)];
  place("at-value").textContent = short(spot);
  place("at").setAttribute("aria-valuetext", short(spot));
  pictures.point(spot);
}

function snippet(kind, { mode, body }) {
  const path = mode === "price" ? "v1/price" : "v1/implied-volatility";
  const asked = mode === "price" ? body : Form.withoutGreeks(body);
  if (kind === "curl") return asCurl(path, asked);
  return kind === "python" ? asPython(mode, asked) : asCommand(mode, asked);
}

// Without a secure context there is no clipboard: the text then stands selected.
async function copy(text, words) {
  const shown = place("snippet");
  shown.hidden = false;
  shown.textContent = text;
  try {
    await navigator.clipboard.writeText(text);
    place("copied").textContent = `${words} copied.`;
  } catch {
    getSelection().selectAllChildren(shown);
    place("copied").textContent = `${words}: selected below, copy it from there.`;
  }
}

function resultsAsCsv() {
  const cell = (value) => (/[",\n]/.test(String(value)) ? `"${String(value).replaceAll('"', '""')}"` : String(value ?? ""));
  const perDay = last.price.greeks_units === "per_day_per_point";
  const head = ["price", "value", "money"];
  const rows = [head, ["error_estimate", "", "money"], ...RESULTS].flatMap(([name, , unit, unitPerDay]) => {
    const value = last.price[name];
    if (value === null || value === undefined) return [];
    return [value].flat().map((one, i) => [Array.isArray(value) ? `${name}[${i}]` : name, one, perDay ? unitPerDay ?? unit : unit].map(cell).join(","));
  });
  return ["quantity,value,unit", ...rows].join("\r\n") + "\r\n";
}

function listen() {
  place("again").addEventListener("click", () => service.wake());
  place("at").addEventListener("input", () => last?.found && pointAtSpot());
  place("skip").addEventListener("click", (event) => { event.preventDefault(); place("headline").focus(); });
  place("api-key").addEventListener("change", () => ask());
  place("link").addEventListener("click", () => copy(location.href, "Link"));
  for (const button of document.querySelectorAll("[data-copy]")) {
    button.addEventListener("click", () => copy(snippet(button.dataset.copy, form.question()), button.textContent.replace("Copy as ", "")));
  }
  place("download-csv").addEventListener("click", () => last && save("option.csv", "text/csv", resultsAsCsv()));
  place("download-json").addEventListener("click", () => last && save("option.json", "application/json", JSON.stringify(last, null, 1)));
  addEventListener("hashchange", () => { form.fill(remembered()); ask(); });
  const system = matchMedia("(prefers-color-scheme: dark)");
  system.addEventListener("change", () => scheme(""));
  place("scheme").addEventListener("click", () => scheme(isDark() ? "light" : "dark"));
}

const isDark = () => getComputedStyle(document.documentElement).getPropertyValue("--is-dark").trim() === "1";

// Light or dark; an empty name follows the system. What was chosen is kept in the browser.
function scheme(name) {
  if (name) document.documentElement.dataset.scheme = name;
  else delete document.documentElement.dataset.scheme;
  try { localStorage.setItem("scheme", name); } catch { /* a browser that keeps nothing */ }
  place("scheme").textContent = isDark() ? "Light" : "Dark";
  pictures.redraw();
}

let kept = "";
try { kept = localStorage.getItem("scheme") ?? ""; } catch { /* as above */ }
scheme(kept);
listen();
form.fill(remembered());
ask();

// The form: which fields there are, how they are drawn, read into a question of the service, and filled from one.

const YEARS_OR_DATE = "years or date";

// name: as the service has it; kind: choice, number, text, flag, curve, rows; columns of rows: [key, label, unit].
// show: when the field is asked for, of the form's other values.
export const FIELDS = [
  { group: "ask", name: "mode", kind: "choice", label: "Find", hiddenLabel: true, start: "price",
    choices: [["price", "Price"], ["volatility", "Implied volatility"]] },
  { group: "contract", name: "option_type", kind: "choice", label: "Type", start: "put",
    choices: [["put", "Put"], ["call", "Call"]] },
  { group: "contract", name: "exercise", kind: "choice", label: "Exercise", start: "american",
    choices: [["american", "American"], ["european", "European"], ["bermudan", "Bermudan"]] },
  { group: "contract", name: "strike", kind: "number", label: "Strike", unit: "money", start: "100" },
  { group: "contract", name: "time", kind: "choice", label: "Time", start: "years",
    choices: [["years", "Years"], ["dates", "Dates"]] },
  { group: "contract", name: "expiry", kind: "number", label: "Expiry", unit: "years", start: "1",
    show: (values) => values.time === "years" },
  { group: "contract", name: "valuation_date", kind: "text", label: "Valuation", unit: "ISO date",
    show: (values) => values.time === "dates" },
  { group: "contract", name: "expiration_date", kind: "text", label: "Expiration", unit: "ISO date",
    show: (values) => values.time === "dates" },
  { group: "contract", name: "exercise_times", kind: "rows", label: "Exercise dates", add: "exercise date",
    columns: [["", "time", YEARS_OR_DATE]], show: (values) => values.exercise === "bermudan" },
  { group: "contract", name: "exercise_start", kind: "timing", label: "Exercise from", unit: YEARS_OR_DATE,
    show: (values) => values.exercise === "american" },
  { group: "market", name: "spot", kind: "number", label: "Spot", unit: "money", start: "100" },
  { group: "market", name: "volatility", kind: "curve", label: "Volatility", unit: "1/√year; by spot as JSON", start: "0.2",
    show: (values) => values.mode === "price" },
  { group: "market", name: "option_price", kind: "number", label: "Option price", unit: "money", start: "6.09",
    show: (values) => values.mode === "volatility" },
  { group: "market", name: "bid", kind: "number", label: "or bid", unit: "money",
    show: (values) => values.mode === "volatility" },
  { group: "market", name: "ask", kind: "number", label: "and ask", unit: "money",
    show: (values) => values.mode === "volatility" },
  { group: "market", name: "rate", kind: "curve", label: "Rate", unit: "1/year", start: "0.05" },
  { group: "market", name: "dividend_yield", kind: "curve", label: "Yield", unit: "1/year", start: "0", show: isOnSpot },
  { group: "dividends", name: "cash_dividends", kind: "rows", label: "Cash", add: "cash dividend",
    columns: [["time", "ex-time", YEARS_OR_DATE], ["amount", "amount", "money"]], show: isOnSpot },
  { group: "dividends", name: "proportional_dividends", kind: "rows", label: "Proportional", add: "proportional dividend",
    columns: [["time", "ex-time", YEARS_OR_DATE], ["fraction", "fraction", "of the spot"]], show: isOnSpot },
  { group: "dividends", name: "dividend_model", kind: "choice", label: "Model", start: "spot",
    choices: [["spot", "Spot drops"], ["escrowed", "Escrowed"]], show: isOnSpot },
  { group: "carry", name: "underlying", kind: "choice", label: "The spot is", start: "spot",
    choices: [["spot", "A spot"], ["future", "A future"]] },
  { group: "carry", name: "borrow_rate", kind: "number", label: "Borrow rate", unit: "1/year", show: isOnSpot },
  { group: "carry", name: "foreign_rate", kind: "number", label: "Foreign rate", unit: "1/year, quanto", show: isOnSpot },
  { group: "carry", name: "quanto_covariance", kind: "number", label: "Covariance", unit: "1/year, quanto" },
  { group: "carry", name: "settlement_lag", kind: "number", label: "Paid after", unit: "days" },
  { group: "answer", name: "tolerance", kind: "number", label: "Tolerance", unit: "of the strike", start: "1e-6" },
  { group: "answer", name: "greeks", kind: "choice", label: "Greeks", start: "standard",
    choices: [["none", "None"], ["standard", "Standard"], ["extended", "Extended"]] },
  { group: "answer", name: "greeks_units", kind: "choice", label: "Units", start: "per_year_per_unit",
    choices: [["per_year_per_unit", "Year, 1.00"], ["per_day_per_point", "Day, 0.01"]] },
  { group: "answer", name: "greek_errors", kind: "flag", label: "Errors of Greeks", start: true },
];
function isOnSpot(values) {
  return values.underlying !== "future"; // a futures price has no yield and no dividends
}
const CURVE_COLUMNS = [["times", "up to", "years"], ["values", "value", ""]];
// What the service does not take as a field, and what it takes for prices alone.
const OF_THE_PAGE = ["mode", "time"];
const OF_PRICES = ["greeks", "greeks_units", "greek_errors"];

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// A text as the service is asked: a number where it is one, as typed where it is none, undefined where it is empty.
export function typed(text) {
  const trimmed = text.trim();
  if (trimmed === "") return undefined;
  const isNumber = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(trimmed) && Number.isFinite(Number(trimmed));
  return isNumber ? Number(trimmed) : trimmed;
}

const shown = (value) => (value === undefined || value === null ? "" : String(value));

// A volatility by spot and time is typed as JSON: {"times": [..], "spots": [..], "values": [[..], ..]}.
function typedOrSurface(text) {
  if (!text.trim().startsWith("{")) return typed(text);
  try { return JSON.parse(text); } catch { return text.trim(); }
}

const isSurface = (value) => typeof value === "object" && value !== null && "spots" in value;

export class Form {
  constructor(root, changed) {
    this.root = root;
    this.changed = changed;
    this.count = 0;
    for (const field of FIELDS) this.draw(field);
    root.addEventListener("input", (event) => this.refresh(event));
    root.addEventListener("submit", (event) => event.preventDefault());
    this.fill({});
  }

  field(name) {
    return this.root.querySelector(`[data-field="${name}"]`);
  }

  draw(field) {
    const box = element("div", { class: `field ${field.kind}`, "data-field": field.name });
    const error = element("p", { class: "error", id: `${field.name}-error` });
    const label = [field.label, ...(field.unit ? [" ", element("span", { class: "unit" }, field.unit)] : [])];
    const many = ["choice", "curve", "rows"].includes(field.kind);
    if (many) {
      const hidden = field.hiddenLabel ? " sr-only" : "";
      const title = element("span", { class: `label${hidden}`, id: `${field.name}-label` }, ...label);
      box.setAttribute("role", "group");
      box.setAttribute("aria-labelledby", `${field.name}-label`);
      box.append(title);
    } else {
      box.append(element("label", { for: field.name }, ...label));
    }
    if (field.kind === "choice") box.append(this.choices(field));
    else if (field.kind === "flag") box.append(element("input", { type: "checkbox", id: field.name }));
    else if (field.kind === "rows") box.append(...this.rowsAndButton(field, field.columns, "add", field.add));
    else box.append(this.input(field.name, field.label, `${field.name}-error`));
    if (field.kind === "curve") {
      const name = field.label.toLowerCase();
      box.append(...this.rowsAndButton(field, CURVE_COLUMNS, `${name} by time`, ""));
    }
    box.append(error);
    this.root.querySelector(`[data-fields="${field.group}"]`).append(box);
  }

  input(id, label, error) {
    const mode = id.includes("date") ? "text" : "decimal";
    return element("input", { id, type: "text", inputmode: mode, spellcheck: "false", autocapitalize: "off",
      "aria-label": label, "aria-describedby": error, placeholder: id.includes("_date") ? "2026-03-20" : "" });
  }

  choices(field) {
    const box = element("div", { class: "segments" });
    for (const [value, words] of field.choices) {
      const id = `${field.name}-${value}`;
      box.append(element("input", { type: "radio", name: field.name, id, value }), element("label", { for: id }, words));
    }
    return box;
  }

  rowsAndButton(field, columns, words, unseen) {
    const rows = element("div", { class: "rows" });
    const add = element("button", { type: "button", class: "quiet add" }, `+ ${words}`, element("span", { class: "sr-only" }, ` ${unseen}`));
    add.addEventListener("click", () => {
      this.addRow(field, columns, rows).querySelector("input").focus();
      this.refresh();
    });
    return [rows, add];
  }

  addRow(field, columns, rows, values = []) {
    const row = element("div", { class: "row" });
    this.count += 1;
    columns.forEach(([key, label, unit], i) => {
      const cell = element("input", { id: `cell-${this.count}-${i}`, type: "text", spellcheck: "false",
        autocapitalize: "off", "data-key": key, "aria-describedby": `${field.name}-error`,
        "aria-label": `${field.label}, ${label}${unit ? ` (${unit})` : ""}`, placeholder: unit || field.unit });
      cell.value = shown(values[i]);
      row.append(element("span", { class: "cell-label", "aria-hidden": "true" }, label), cell);
    });
    const remove = element("button", { type: "button", class: "quiet remove", "aria-label": `Remove this row of ${field.label}` }, "×");
    remove.addEventListener("click", () => {
      row.remove();
      this.field(field.name).querySelector(".add").focus();
      this.refresh();
      this.changed();
    });
    row.append(remove);
    rows.append(row);
    return row;
  }

  rows(name) {
    const all = [...this.field(name).querySelectorAll(".row")];
    const cells = all.map((row) => [...row.querySelectorAll("input")]);
    return cells.filter((row) => row.some((cell) => cell.value.trim() !== ""));
  }

  value(field) {
    const box = this.field(field.name);
    if (field.kind === "choice") return box.querySelector("input:checked")?.value;
    if (field.kind === "flag") return box.querySelector("input").checked;
    if (field.kind === "text") return box.querySelector("input").value.trim() || undefined;
    if (field.kind === "number" || field.kind === "timing") return typed(box.querySelector("input").value);
    const rows = this.rows(field.name).map((cells) => cells.map((cell) => typed(cell.value) ?? null));
    if (field.kind === "curve") {
      const curve = { times: rows.map((row) => row[0]), values: rows.map((row) => row[1]) };
      return box.classList.contains("by-time") ? curve : typedOrSurface(box.querySelector("input").value);
    }
    if (field.columns.length === 1) return rows.map(([time]) => time);
    return rows.map(([time, size]) => ({
      [typeof time === "string" ? "ex_date" : "time"]: time, [field.columns[1][0]]: size }));
  }

  values() {
    return Object.fromEntries(FIELDS.map((field) => [field.name, this.value(field)]));
  }

  // What is asked: the fields that are shown, without those that are as the service takes them anyway.
  question() {
    const values = this.values();
    const asked = FIELDS.filter((field) => !OF_THE_PAGE.includes(field.name) && (!field.show || field.show(values)));
    const told = asked.filter((field) => values[field.name] !== undefined && !isDefault(field.name, values[field.name]));
    return { mode: values.mode, body: Object.fromEntries(told.map((field) => [field.name, values[field.name]])) };
  }

  // What the service is asked to find an implied volatility: it has no Greeks.
  static withoutGreeks(body) {
    return Object.fromEntries(Object.entries(body).filter(([name]) => !OF_PRICES.includes(name)));
  }

  fill(question) {
    for (const field of FIELDS) {
      this.fillField(field, field.name in question ? question[field.name] : this.start(field, question));
      if (field.name in question) this.field(field.name).closest("details")?.setAttribute("open", "");
    }
    this.refresh();
  }

  start(field, question) {
    if (field.name === "time") return question.valuation_date === undefined ? "years" : "dates";
    if (Object.keys(question).length === 0) return field.start;
    return isEmptyWhenAbsent(field.name, question) ? undefined : field.start;
  }

  fillField(field, value) {
    const box = this.field(field.name);
    const rows = box.querySelector(".rows");
    rows?.replaceChildren();
    if (field.kind === "choice") {
      const chosen = [...box.querySelectorAll("input")].find((input) => input.value === value);
      (chosen ?? box.querySelector("input")).checked = true;
    } else if (field.kind === "flag") box.querySelector("input").checked = value === true;
    else if (field.kind === "rows") {
      for (const entry of Array.isArray(value) ? value : []) {
        const cells = field.columns.length === 1 ? [entry] : [entry?.time ?? entry?.ex_date, entry?.[field.columns[1][0]]];
        this.addRow(field, field.columns, rows, cells);
      }
    } else if (field.kind === "curve" && isSurface(value)) {
      box.querySelector("input").value = JSON.stringify(value);
    } else if (field.kind === "curve" && typeof value === "object" && value !== null) {
      const times = Array.isArray(value.times) ? value.times : [];
      times.forEach((time, i) => this.addRow(field, CURVE_COLUMNS, rows, [time, value.values?.[i]]));
    } else box.querySelector("input").value = shown(value);
  }

  // Show what the choices ask for; a curve takes the place of its number as soon as it has a row.
  refresh(event) {
    for (const field of FIELDS.filter(({ kind }) => kind === "curve")) {
      const box = this.field(field.name);
      const byTime = box.querySelector(".row") !== null;
      box.classList.toggle("by-time", byTime);
      box.querySelector("input").hidden = byTime;
    }
    const values = this.values();
    for (const field of FIELDS) this.field(field.name).hidden = field.show !== undefined && !field.show(values);
    if (event) this.changed(event);
  }

  clearErrors() {
    for (const place of this.root.querySelectorAll(".error")) place.textContent = "";
    for (const input of this.root.querySelectorAll("[aria-invalid]")) input.removeAttribute("aria-invalid");
  }

  // Write each error of a problem at its field, in the words of the service; what has no field stands above the form.
  showErrors(problem) {
    this.clearErrors();
    const errors = problem.errors?.length ? problem.errors : [{ field: "", allowed: problem.detail ?? problem.title }];
    for (const { field, allowed } of errors) {
      const name = field.split(/[.[]/)[0];
      const box = FIELDS.some((one) => one.name === name) ? this.field(name) : null;
      if (!box || box.hidden) {
        this.root.querySelector("#form-error").textContent = field ? `${field} must be ${allowed}` : allowed;
        continue;
      }
      box.closest("details")?.setAttribute("open", "");
      const place = box.querySelector(":scope > .error");
      place.textContent = `${place.textContent ? `${place.textContent}; ` : ""}must be ${allowed}`;
      this.cellOf(name, field, box)?.setAttribute("aria-invalid", "true");
    }
  }

  // The input that a path such as cash_dividends[1].amount, rate.values[0] or spot names.
  cellOf(name, path, box) {
    const index = path.match(/\[(\d+)\]/)?.[1];
    if (index === undefined) return box.querySelector("input:not([hidden]):not([type=radio])");
    const row = this.rows(name)[Number(index)];
    if (!row) return box.querySelector("input:not([hidden]):not([type=radio])"); // a surface is one text
    const key = path.match(/\.(\w+)/)?.[1].replace("ex_date", "time");
    return row?.find((cell) => cell.dataset.key === key) ?? row?.[0];
  }
}

const DEFAULTS = { exercise: "american", dividend_yield: 0, dividend_model: "spot", underlying: "spot", exercise_start: 0, tolerance: 1e-6,
  greeks: "standard", greeks_units: "per_year_per_unit" };

function isDefault(name, value) {
  return DEFAULTS[name] === value || (Array.isArray(value) && value.length === 0 && name !== "exercise_times");
}

// A link holds all that is not a default: what it leaves out and has no default was empty.
function isEmptyWhenAbsent(name, question) {
  if (name === "volatility") return question.mode !== "volatility";
  if (name === "option_price") return question.mode === "volatility";
  return ["strike", "expiry", "spot", "rate", "bid", "ask"].includes(name);
}

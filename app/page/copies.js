// The question as Python, as a curl command and as a command of `pricing`.

const CONTRACT = ["option_type", "strike", "expiry", "rate", "dividend_yield", "volatility", "spot", "valuation_date",
  "expiration_date", "cash_dividends", "proportional_dividends", "dividend_model", "underlying", "borrow_rate",
  "foreign_rate", "quanto_covariance", "settlement_lag", "exercise", "exercise_times", "exercise_start"];
const LISTS = { cash_dividends: ["cash-dividend", "amount"], proportional_dividends: ["proportional-dividend", "fraction"] };

export function asCurl(path, body) {
  const address = new URL(path, document.baseURI.split("#")[0]);
  return `curl -s ${address} -H 'Content-Type: application/json' \\\n  -d ${quoted(JSON.stringify(body))}`;
}

// In single quotes of a shell.
const quoted = (text) => `'${text.replaceAll("'", "'\\''")}'`;

export function asCommand(mode, body) {
  const words = ["pricing", mode === "price" ? "price" : "implied-volatility"];
  for (const [name, value] of Object.entries(body)) {
    const option = `--${name.replaceAll("_", "-")}`;
    if (name in LISTS) {
      const [single, size] = LISTS[name];
      for (const entry of value) words.push(`--${single}`, `${entry.time ?? entry.ex_date}:${entry[size]}`);
    } else if (name === "exercise_times") for (const time of value) words.push("--exercise-time", String(time));
    else if (value === true) words.push(option);
    else if (value !== false) words.push(option, typeof value === "object" ? quoted(JSON.stringify(value)) : plain(value));
  }
  return words.join(" ");
}

const plain = (value) => (/^[\w.+:-]+$/.test(String(value)) ? String(value) : quoted(String(value)));

// A value as Python writes it.
function inPython(value) {
  if (value === true || value === false) return value ? "True" : "False";
  if (value === null) return "None";
  if (Array.isArray(value)) return `[${value.map(inPython).join(", ")}]`;
  if (typeof value === "object") return `{${Object.entries(value).map(([key, one]) => `${JSON.stringify(key)}: ${inPython(one)}`).join(", ")}}`;
  return JSON.stringify(value);
}

export function asPython(mode, body) {
  const contract = Object.entries(body).filter(([name]) => CONTRACT.includes(name));
  if (mode !== "price") contract.push(["volatility", 1]); // not used, and Market wants one
  const lines = contract.map(([name, value]) => `    ${JSON.stringify(name)}: ${inPython(value)},`);
  const names = mode === "price" ? ["tolerance", "greeks"] : ["option_price", "bid", "ask", "tolerance"];
  const given = names.filter((name) => name in body).map((name) => `, ${name}=${inPython(body[name])}`).join("");
  const call = mode === "price" ? "price" : "implied_volatility";
  return `from pricing_core.american import contract_from, ${call}\n\noption, market = contract_from({\n${lines.join("\n")}\n})\nprint(${call}(option, market${given}))`;
}

// The pictures of one option: value, Greeks and multiplier against the spot, the exercise boundary against time.

import { Chart } from "./charts.js";
import { element } from "./form.js";
import { short } from "./numbers.js";

const POINTS = 81; // spots
const LATER = [0.5, 0.9]; // further times at which the value is drawn, as shares of the time to expiry
const COARSEST = 1e-4; // tolerance of the pictures, a fraction of the strike
const MOST_POINTS = 40_000; // spots x times x pieces between events that the service is asked for at most
const ROOM_OF_NAME = 58; // px between ex-dates that are each named on the picture
const MOST_NAMED = 8; // single dates whose boundary is written beside its dot
const BESIDE = 1e-3; // how far beside an end of exercise a spot is put on either side, for what jumps there
const GREEKS = [
  ["delta", "Delta", "value per money of spot", "blue"], ["gamma", "Gamma", "delta per money of spot", "green"],
  ["theta", "Theta", "money per year", "violet"], ["vega", "Vega", "money per 1.00 of volatility", "amber"],
];
const TIMES = [{ name: "now", colour: "blue", width: 2.5 }, { name: "later", colour: "green", width: 1.75 },
  { name: "close to expiry", colour: "amber", width: 1.75 }];

export class Pictures {
  constructor(root) {
    const value = { title: "Value against spot", x: "spot (money)", y: "value (money)", height: 380,
      lines: [...TIMES, { name: "at expiry: the payoff", colour: "muted", dash: [5, 4], width: 1.5 }] };
    const multiplier = { title: "What holding on loses", x: "spot (money)", y: "multiplier u (money/year)", height: 260,
      lines: TIMES };
    const boundary = { title: "Exercise boundary against time", x: "time from now (years)", y: "spot (money)", height: 320,
      isOverSpots: false, lines: [{ name: "exercise boundary", colour: "red" }, { name: "other boundary", colour: "red", dash: [8, 4] }] };
    this.value = new Chart(root, { id: "value-chart", ...value });
    this.multiplier = new Chart(root, { id: "multiplier-chart", ...multiplier });
    this.boundary = new Chart(root, { id: "boundary-chart", ...boundary });
    this.exercised = new Chart(root, { id: "exercised-chart", title: "When it will be exercised", x: "time from now (years)",
      y: "risk-neutral probability", height: 260, isOverSpots: false,
      lines: [{ name: "exercised early by then", colour: "blue" }, { name: "assigned by then, at expiry included", colour: "amber", dash: [5, 4] }] });
    this.waiting = new Chart(root, { id: "waiting-chart", title: "What waiting costs", x: "not exercised before (years from now)",
      y: "loss (money today)", height: 240, isOverSpots: false, lines: [{ name: "cost of waiting", colour: "red" }] });
    const panel = element("section", { class: "greeks", id: "greek-charts", "aria-labelledby": "greeks-title" },
      element("h2", { id: "greeks-title" }, "Greeks against spot, now"));
    const grid = element("div", { class: "small-charts" });
    panel.append(grid);
    root.append(panel);
    this.greeks = GREEKS.map(([name, title, unit, ink]) => new Chart(grid,
      { id: `${name}-chart`, title, x: "spot (money)", y: unit, height: 170, lines: [{ name: title.toLowerCase(), colour: ink }], small: true }));
  }

  get all() {
    return [this.value, this.boundary, this.exercised, this.waiting, ...this.greeks, this.multiplier];
  }

  // Ask for the advice on exercise of what is shown, and draw it; where there is none the charts say why.
  async advise(service, body, signal) {
    const asked = { ...body, tolerance: Math.max(body.tolerance ?? 0, COARSEST / 10) };
    for (const name of ["greeks", "greek_errors", "greeks_units"]) delete asked[name];
    const advice = await service.ask("v1/exercise-advice", asked, signal);
    this.showAdvice(advice, body);
    return advice;
  }

  withoutAdvice(why) {
    for (const chart of [this.exercised, this.waiting]) chart.show([[0, 1], ...chart.lines.map(() => [null, null])], { says: why });
  }

  showAdvice(advice, body) {
    const percent = (share) => `${share < 5e-6 ? 0 : (100 * share).toFixed(share < 0.001 ? 3 : 1)} %`;
    const rough = (number) => short(Number(number.toPrecision(3)));
    const expiry = advice.time.at(-1);
    const events = eventsOf(body, expiry, advice.time);
    const marked = (pen) => events.forEach(({ time }) => pen.upright(time, "amber", [3, 3]));
    const when = advice.probability > 0 ? `, on average after ${rough(advice.expected_time)} years` : "";
    const says = advice.exercise_now ? "It is best exercised now."
      : `Exercised before expiry with probability ${percent(advice.probability)} (± ${percent(advice.probability_error)})${when}; at expiry ${percent(advice.exercised_at_expiry)}; never ${percent(advice.expires_worthless)}.`;
    this.exercised.show([advice.time, advice.cumulative_probability, advice.assignment_probability],
      { says, limits: [0, 1.02], annotate: marked });
    const cost = advice.cost_of_waiting.at(-1);
    this.waiting.show([advice.time, advice.cost_of_waiting],
      { says: cost > 0 ? `Who waits until expiry loses ${rough(cost)}, the early exercise premium.` : "Waiting costs nothing.", annotate: marked });
  }

  // Ask for what the pictures show; body: a question for a price that has its answer.
  async ask(service, body, signal) {
    const asked = { ...body, tolerance: Math.max(body.tolerance ?? 0, COARSEST) };
    for (const name of ["greeks", "greek_errors", "greeks_units"]) delete asked[name];
    const boundary = await service.ask("v1/boundary", asked, signal);
    const expiry = boundary.time.at(-1);
    const times = LATER.map((share) => share * expiry);
    const contacts = await service.ask("v1/boundary", { ...asked, times: [0, ...times] }, signal);
    const ends = contacts.boundary.map((end, i) => [end, contacts.other_boundary?.[i] ?? null]);
    const spots = spotsFor(body, boundary, ends);
    const [now, later] = await Promise.all([
      service.ask("v1/surface", { ...asked, spots, times: [0], greeks_units: body.greeks_units ?? "per_year_per_unit" }, signal),
      service.ask("v1/surface", { ...asked, spots, times, greeks: "none" }, signal),
    ]);
    return { body, boundary, ends, spots, times, expiry, now, later };
  }

  show(found) {
    const { body, ends, spots, times, now, later, expiry } = found;
    const names = ["now", ...times.map((time) => `${short(time)} years from now`)];
    const isPut = body.option_type === "put";
    const payoff = spots.map((spot) => Math.max(isPut ? body.strike - spot : spot - body.strike, 0));
    const region = regionInWords(ends[0], isPut);
    this.value.show([spots, now.value[0], ...later.value, payoff], {
      says: region ? `Now the value touches the payoff ${region}: exercise is best there.` : "Now the value is above what exercise brings at every spot shown.",
      names, annotate: (pen) => this.drawContacts(pen, found, isPut) });
    this.multiplier.show([spots, now.multiplier[0], ...later.multiplier], {
      says: now.multiplier[0].some((number) => number > 0) ? `Who holds on ${region} loses this much a year.` : "Holding on loses nothing now at the spots shown.",
      names, annotate: (pen) => this.drawEnds(pen, ends[0], spots) });
    this.showBoundary(found, expiry);
    const perDay = now.greeks_units === "per_day_per_point";
    GREEKS.forEach(([name, , unit], i) => {
      const words = perDay ? unit.replace("per year", "per day").replace("1.00", "0.01") : unit;
      this.greeks[i].show([spots, now[name][0]], { says: words, annotate: (pen) => {
        this.drawEnds(pen, ends[0], spots, "");
        if (typeof body.spot === "number") pen.dot(body.spot, now[name][0][spots.indexOf(body.spot)], GREEKS[i][3]);
      } });
    });
  }

  drawContacts(pen, { body, ends, spots, now, later }, isPut) {
    const values = [now.value[0], ...later.value];
    ends.forEach((pair, i) => pair.forEach((spot, end) => {
      if (spot === null || spot < spots[0] || spot > spots.at(-1)) return;
      const height = Math.max(isPut ? body.strike - spot : spot - body.strike, 0);
      pen.dot(spot, height, TIMES[i].colour);
      if (i > 0) return;
      const name = end === 0 ? "contact point" : "other contact point";
      pen.words(`${name} ${short(spot)}`, pen.x(spot) + (isPut ? 10 : -10) * pen.ratio, pen.y(height) - 12 * pen.ratio, "ink", isPut ? "left" : "right");
    }));
    if (typeof body.spot !== "number" || !spots.includes(body.spot)) return;
    const price = values[0][spots.indexOf(body.spot)];
    pen.upright(body.spot, "muted", [2, 4]);
    pen.dot(body.spot, price, "ink", 4);
    pen.words(`spot ${short(body.spot)}`, pen.x(body.spot) + 6 * pen.ratio, pen.box.top + 12 * pen.ratio, "muted");
  }

  drawEnds(pen, ends, spots, words = "exercise boundary") {
    ends.forEach((spot, line) => {
      if (spot === null || spot < spots[0] || spot > spots.at(-1)) return;
      pen.upright(spot, "red", [4, 4]);
      if (words) pen.words(`${words} ${short(spot)}`, pen.x(spot) + 6 * pen.ratio, pen.box.top + (12 + 15 * line) * pen.ratio, "red");
    });
  }

  showBoundary({ body, boundary, now, expiry }) {
    const x = boundary.time;
    const near = boundary.boundary;
    const far = boundary.other_boundary ?? x.map(() => null);
    const isDated = body.exercise === "bermudan";
    const dots = [near, far].flatMap((column) => x.flatMap((time, i) => (isAlone(column, i) || (isDated && column[i] !== null) ? [[time, column[i]]] : [])));
    const known = [...near, ...far].filter((value) => value !== null);
    const perpetual = now.perpetual_boundary;
    const levels = [...known, body.strike, ...(perpetual === null ? [] : [perpetual]), ...(typeof body.spot === "number" ? [body.spot] : [])];
    const [least, most] = [Math.min(...levels), Math.max(...levels)];
    const room = Math.max(0.12 * (most - least), 0.04 * most);
    const limits = [Math.max(least - room, 0), most + room];
    const isPut = body.option_type === "put";
    const atExpiry = [boundary.boundary.at(-1), boundary.other_boundary?.at(-1) ?? null].filter((value) => value !== null);
    const events = eventsOf(body, expiry, boundary.time);
    const limit = atExpiry.length ? `, whose limit at expiry is ${atExpiry.map(short).join(" and ")}` : "";
    const side = isPut ? "up to" : "from";
    const areDots = isDated || (dots.length > 0 && dots.length >= known.length - 1);
    const says = known.length === 0 ? "Early exercise is never best."
      : areDots ? `Exercise is best ${isDated ? "on the dates" : "just before the ex-dates"} that have a dot, at spots ${side} it.`
        : `Exercise is best in the shaded region${limit}.`;
    this.boundary.show([x, near, far], { says, limits, hiddenLines: boundary.other_boundary ? [] : [1], isDotted: isDated,
      under: (pen) => !isDated && pen.area(x, boundary.other_boundary ? far : near.map(() => (isPut ? limits[0] : limits[1])), near, "region"),
      annotate: (pen) => {
        const isAtStrike = body.spot === body.strike;
        pen.across(body.strike, "muted", [6, 4]);
        pen.words(`strike${isAtStrike ? " and spot now" : ""} ${short(body.strike)}`, pen.box.left + 8 * pen.ratio, pen.y(body.strike) - 10 * pen.ratio, "muted");
        if (perpetual !== null) {
          pen.across(perpetual, "blue", [2, 3]);
          pen.words(`without expiry ${short(perpetual)}`, pen.box.left, pen.y(perpetual) + 10 * pen.ratio, "blue");
        }
        let named = -Infinity; // where a name stood last
        for (const { time, name } of events) {
          pen.upright(time, "amber", [3, 3]);
          if (pen.x(time) - named < ROOM_OF_NAME * pen.ratio) continue;
          named = pen.x(time);
          pen.words(name, named - 4 * pen.ratio, pen.box.top + pen.box.height - 10 * pen.ratio, "amber", "right");
        }
        for (const [time, level] of dots) {
          pen.dot(time, level, "red");
          if (areDots && dots.length <= MOST_NAMED && time < expiry) {
            const isLate = time > 0.8 * expiry;
            pen.words(short(level), pen.x(time) + (isLate ? -8 : 8) * pen.ratio, pen.y(level), "red", isLate ? "right" : "left");
          }
        }
        for (const [i, level] of atExpiry.entries()) {
          pen.dot(expiry, level, "red");
          pen.words(`limit at expiry ${short(level)}`, pen.x(expiry) - 8 * pen.ratio, pen.y(level) + (i === 0 && isPut ? 14 : -12) * pen.ratio, "red", "right");
        }
        if (typeof body.spot === "number") {
          pen.dot(0, body.spot, "ink", 4);
          if (!isAtStrike) pen.words(`spot now ${short(body.spot)}`, pen.x(0) + 8 * pen.ratio, pen.y(body.spot), "ink");
        }
      } });
  }

  // Put the cross-hair of all pictures over spots at one of them.
  point(spot) {
    for (const chart of [this.value, this.multiplier, ...this.greeks]) chart.point(spot);
  }

  redraw() {
    for (const chart of this.all) chart.redraw();
  }
}

// The spots that the pictures show: around strike and spot as far as the spot is likely to go, with the ends of exercise.
function spotsFor(body, boundary, contacts) {
  const volatility = typeof body.volatility === "number" ? body.volatility : levelOf(body);
  const reach = Math.min(Math.max(2 * volatility * Math.sqrt(boundary.time.at(-1)), 0.2), 1);
  const centre = [body.strike, body.spot].filter((value) => value > 0);
  let least = Math.min(...centre) * Math.exp(-reach);
  let most = Math.max(...centre) * Math.exp(reach);
  for (const end of [boundary.boundary[0], boundary.other_boundary?.[0]]) {
    if (end > 0.15 * body.strike && end < 4 * body.strike) [least, most] = [Math.min(least, 0.85 * end), Math.max(most, 1.1 * end)];
  }
  if (body.dividend_model === "escrowed") least = Math.max(least, 1.1 * (body.cash_dividends ?? []).reduce((sum, { amount }) => sum + amount, 0));
  const pieces = 1 + eventsOf(body, Infinity, []).length + curveKnots(body) + (body.exercise_times?.length ?? 0);
  const count = Math.max(Math.min(POINTS, Math.floor(MOST_POINTS / (LATER.length * pieces))), 5);
  const even = Array.from({ length: count }, (_, i) => least + ((most - least) * i) / (count - 1));
  const besides = contacts.flat().filter((end) => end !== null).flatMap((end) => [end * (1 - BESIDE), end * (1 + BESIDE)]);
  const exact = [...centre, ...besides].filter((spot) => spot > least && spot < most);
  return [...new Set([...even, ...exact])].sort((a, b) => a - b);
}

// The largest volatility of a curve; of a surface that of the spot nearest to the contract's.
function levelOf({ volatility, spot, strike }) {
  if (!volatility?.spots) return Math.max(...(volatility?.values ?? [0.2]));
  const away = volatility.spots.map((place) => Math.abs(Math.log(place / (spot > 0 ? spot : strike))));
  const nearest = away.indexOf(Math.min(...away));
  return Math.max(...volatility.values.map((row) => row[nearest]));
}

// The pieces that curves cut the life of the contract into; a surface cuts nothing.
function curveKnots(body) {
  return ["rate", "dividend_yield", "volatility"].reduce((sum, name) => sum + (body[name]?.spots ? 0 : body[name]?.times?.length ?? 0), 0);
}

// A value without neighbours: a line cannot show it.
function isAlone(column, i) {
  return column[i] !== null && (column[i - 1] ?? null) === null && (column[i + 1] ?? null) === null;
}

// Ex-dates before expiry, in years; a date is found among the times of the boundary by its share of the life.
function eventsOf(body, expiry, times) {
  const all = [...(body.cash_dividends ?? []), ...(body.proportional_dividends ?? [])];
  const start = Date.parse(body.valuation_date);
  const years = ({ time, ex_date: date }) => time ?? (Date.parse(date) - start) / (365 * 86_400_000);
  const found = [...new Set(all.map(years))].filter((time) => time > 0 && time <= expiry).sort((a, b) => a - b);
  return found.map((time) => ({ time: times.find((other) => Math.abs(other - time) < 1e-3) ?? time, name: "ex-date" }));
}

function regionInWords([near, far], isPut) {
  if (near === null) return "";
  if (far !== null) return `between ${short(Math.min(near, far))} and ${short(Math.max(near, far))}`;
  return isPut ? `at spots up to ${short(near)}` : `at spots from ${short(near)}`;
}

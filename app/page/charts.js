// Charts by uPlot: lines over a shared axis, names written on the picture, a legend that reads the cross-hair.

import { element } from "./form.js";
import { short, written } from "./numbers.js";

const AXIS_WIDTH = 58; // px, the same for all, so that charts above one another share their spots
const FONT = "12px system-ui, sans-serif";
const STRAIGHT = uPlot.paths.linear();
const SPOTS = "spots"; // what charts with a shared cross-hair are synchronised by

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

function axis(label, extra = {}) {
  return {
    stroke: () => colour("muted"), font: FONT, labelFont: FONT, label, labelSize: 18, labelGap: 0, gap: 4,
    grid: { stroke: () => colour("grid"), width: 1 }, ticks: { show: false },
    values: (_, splits) => splits.map((value) => (value === null ? "" : short(value))), ...extra,
  };
}

// lines: [{ name, colour, dash, width }]; x, y: axis labels; annotate(pen): what is written on the picture.
export class Chart {
  constructor(parent, { id, title, x, y, lines, height, isOverSpots = true, small = false }) {
    this.lines = lines;
    this.height = height;
    this.says = element("p", { class: "says" });
    this.plotBox = element("div", { class: "plot", role: "img", "aria-labelledby": `${id}-title` });
    this.legend = element("ul", { class: "legend" });
    this.readings = lines.map(({ name, colour: ink, dash }) => {
      const reading = element("output", {});
      const swatch = element("span", { class: `swatch ${ink}${dash ? " dashed" : ""}`, "aria-hidden": "true" });
      const words = element("span", {}, name);
      this.legend.append(element("li", {}, swatch, words, " ", reading));
      return { reading, words };
    });
    const heading = element(small ? "h3" : "h2", { id: `${id}-title` }, title);
    this.table = new DataTable(title, id);
    this.figure = element("figure", { class: `chart${small ? " small" : ""}`, id });
    this.figure.append(element("figcaption", {}, heading, this.says), this.plotBox, this.legend, this.table.details);
    parent.append(this.figure);
    this.names = { x, y };
    this.small = small;
    this.annotate = () => {};
    this.plot = new uPlot(this.options(isOverSpots), [[0, 1], ...lines.map(() => [null, null])], this.plotBox);
    new ResizeObserver(() => this.resize()).observe(this.plotBox);
  }

  options(isOverSpots) {
    return {
      width: this.width(), height: this.height, padding: [14, 12, 0, 0], legend: { show: false }, scales: { x: { time: false },
        y: { range: (_, least, most) => this.range(least, most) } },
      axes: [axis(this.names.x, { size: 34, space: this.small ? 44 : 60 }),
        axis(this.small ? undefined : this.names.y, { size: AXIS_WIDTH - (this.small ? 0 : 18), space: 34 })],
      cursor: { y: false, drag: { x: false, y: false }, points: { size: 7 },
        ...(isOverSpots ? { sync: { key: SPOTS, setSeries: false } } : {}) },
      series: [{}, ...this.lines.map((line) => ({
        stroke: () => colour(line.colour), width: line.width ?? 2, dash: line.dash, spanGaps: false, pxAlign: 0,
        paths: (...about) => (this.isDotted ? null : STRAIGHT(...about)), points: { show: false } }))],
      hooks: { drawClear: [(plot) => this.under?.(new Pen(plot))], draw: [(plot) => this.annotate(new Pen(plot))],
        setCursor: [() => this.read()] },
    };
  }

  width() {
    return Math.max(this.plotBox.clientWidth, 200);
  }

  resize() {
    if (this.plot && this.width() !== this.plot.width) this.plot.setSize({ width: this.width(), height: this.height });
  }

  range(least, most) {
    if (!Number.isFinite(least ?? NaN) || (least === 0 && most === 0)) return this.limits ?? [0, 1];
    const room = (most - least) * 0.06 || Math.abs(least) * 0.1 || 1;
    return this.limits ?? [least < 0 || least - room > 0 ? least - room : Math.min(least, -room * 0.3), most + room];
  }

  // data: columns, the first the axis; says: the picture in a sentence; names: of the lines, where they change.
  show(data, { says, annotate = () => {}, under, names = [], limits, hiddenLines = [], isDotted = false }) {
    this.isDotted = isDotted; // no line: what is annotated alone
    this.annotate = annotate;
    this.under = under;
    this.limits = limits;
    this.says.textContent = says;
    this.plotBox.setAttribute("aria-label", says);
    this.plotBox.removeAttribute("aria-labelledby");
    names.forEach((name, i) => { if (name !== undefined) this.readings[i].words.textContent = name; });
    this.readings.forEach(({ reading }, i) => { reading.closest("li").hidden = hiddenLines.includes(i); });
    this.plot.batch(() => this.plot.setData(data));
    this.table.show([this.names.x, ...this.readings.map(({ words }) => words.textContent)], data, hiddenLines);
    this.read();
  }

  read() {
    const index = this.plot?.cursor.idx ?? null;
    const { min, max } = this.plot?.scales.y ?? { min: 0, max: 1 };
    this.readings.forEach(({ reading }, i) => {
      const value = index === null ? null : this.plot.data[i + 1][index];
      reading.textContent = value === null || value === undefined ? "" : written(value, (max - min) * 1e-4);
    });
  }

  // Put the cross-hair at a value of the axis; the charts that share it follow.
  point(at) {
    this.plot.setCursor({ left: this.plot.valToPos(at, "x"), top: this.height / 2 });
  }

  redraw() {
    this.plot.redraw(false);
  }
}

// What annotations draw with, in the units of the axes.
class Pen {
  constructor(plot) {
    this.plot = plot;
    this.ink = plot.ctx;
    this.ratio = devicePixelRatio;
    this.box = plot.bbox;
  }

  x(value) { return this.plot.valToPos(value, "x", true); }

  y(value) { return this.plot.valToPos(value, "y", true); }

  inside(work) {
    this.ink.save();
    this.ink.beginPath();
    this.ink.rect(this.box.left, this.box.top, this.box.width, this.box.height);
    this.ink.clip();
    work();
    this.ink.restore();
  }

  line(from, to, name, dash = [4, 4], width = 1) {
    this.inside(() => {
      this.ink.beginPath();
      this.ink.setLineDash(dash.map((length) => length * this.ratio));
      this.ink.lineWidth = width * this.ratio;
      this.ink.strokeStyle = colour(name);
      this.ink.moveTo(...from);
      this.ink.lineTo(...to);
      this.ink.stroke();
    });
  }

  across(y, name, dash) {
    this.line([this.box.left, this.y(y)], [this.box.left + this.box.width, this.y(y)], name, dash);
  }

  upright(x, name, dash) {
    this.line([this.x(x), this.box.top], [this.x(x), this.box.top + this.box.height], name, dash);
  }

  dot(x, y, name, radius = 4.5) {
    this.ink.save();
    this.ink.beginPath();
    this.ink.arc(this.x(x), this.y(y), radius * this.ratio, 0, 2 * Math.PI);
    this.ink.fillStyle = colour(name);
    this.ink.fill();
    this.ink.lineWidth = 1.5 * this.ratio;
    this.ink.strokeStyle = colour("paper");
    this.ink.stroke();
    this.ink.restore();
  }

  // Words beside a point of the canvas, kept inside the picture, readable over lines.
  words(text, left, top, name, align = "left") {
    const ink = this.ink;
    ink.save();
    ink.font = `${12 * this.ratio}px system-ui, sans-serif`;
    ink.textBaseline = "middle";
    ink.textAlign = "left";
    const width = ink.measureText(text).width;
    const start = align === "left" ? left : align === "right" ? left - width : left - width / 2;
    const room = 4 * this.ratio;
    const least = this.box.left + room;
    const most = this.box.left + this.box.width - width - room;
    const x = Math.min(Math.max(start, least), Math.max(most, least));
    const y = Math.min(Math.max(top, this.box.top + 9 * this.ratio), this.box.top + this.box.height - 9 * this.ratio);
    ink.lineJoin = "round";
    ink.lineWidth = 4 * this.ratio;
    ink.strokeStyle = colour("paper");
    ink.strokeText(text, x, y);
    ink.fillStyle = colour(name);
    ink.fillText(text, x, y);
    ink.restore();
  }

  // The area between two lines over the axis, in pieces where one of them is not known.
  area(x, low, high, name) {
    this.inside(() => {
      this.ink.fillStyle = colour(name);
      let piece = [];
      const fill = () => {
        this.ink.beginPath();
        for (const i of piece) this.ink.lineTo(this.x(x[i]), this.y(low[i]));
        for (const i of piece.reverse()) this.ink.lineTo(this.x(x[i]), this.y(high[i]));
        this.ink.fill();
        piece = [];
      };
      x.forEach((_, i) => {
        if (low[i] === null || high[i] === null) fill();
        else piece.push(i);
      });
      fill();
    });
  }
}

// The data of a chart as a table and as a file; the table is made when it is opened.
class DataTable {
  constructor(title, id) {
    this.title = title;
    this.id = id;
    this.table = element("table", {});
    const scroll = element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `${title}: data` }, this.table);
    const save = element("button", { type: "button", class: "quiet" }, "Download as CSV");
    save.addEventListener("click", () => this.save());
    this.details = element("details", { class: "data" }, element("summary", {}, "Data as a table", element("span", { class: "sr-only" }, ` of: ${title}`)), save, scroll);
    this.details.addEventListener("toggle", () => this.draw());
  }

  show(names, columns, hiddenLines) {
    const kept = (_, i) => !hiddenLines.includes(i - 1);
    this.names = names.filter(kept);
    this.columns = columns.filter(kept);
    this.draw();
  }

  draw() {
    if (!this.details.open || !this.columns) return;
    const head = element("tr", {}, ...this.names.map((name) => element("th", { scope: "col" }, name)));
    const rows = this.columns[0].map((x, i) => element("tr", {}, element("th", { scope: "row" }, short(x)),
      ...this.columns.slice(1).map((column) => element("td", {}, short(column[i] ?? null)))));
    this.table.replaceChildren(element("caption", { class: "sr-only" }, this.title), element("thead", {}, head), element("tbody", {}, ...rows));
  }

  save() {
    const quoted = this.names.map((name) => `"${name.replaceAll('"', '""')}"`).join(",");
    const rows = this.columns[0].map((_, i) => this.columns.map((column) => column[i] ?? "").join(","));
    save(`${this.id}.csv`, "text/csv", [quoted, ...rows].join("\r\n") + "\r\n");
  }
}

export function save(name, type, text) {
  const address = URL.createObjectURL(new Blob([text], { type }));
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

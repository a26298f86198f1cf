// The scope: captures around a trigger, zoomed without losing a peak, two cursors, and the values under them.

import { KIND, save } from "./link.js";
import { Layouts } from "./layouts.js";
import { axisLook, css, look, missing, si, tick, ticking, veils } from "./plot.js";
import { VIEWS } from "./views.js";

const at = (id) => document.getElementById(id);
const FIRST = ["error", "measured_current"];
const READ = 4000;  // ms to read why something was refused
const MOST = 16, POINTS = 1200, WHOLE = 20000;  // points of a curve over time, and of a view that needs every row

const SAID = { A: "current", place: "position", x: "position below" };

const STILL = 0.3, STEP = 0.12;  // of the height of the plot: curves within are at rest; they are so far apart

// Channels that are compared share a scale; each other has its own.
function family(name, unit) {
  if (unit === "A") return "A";
  const own = name.split(".").pop();  // of an axis: "y.error"
  return ["reference", "target", "measured"].includes(own) ? "place" : own;
}

export class Scope {
  constructor(link) {
    this.link = link;
    this.number = 0;
    this.wantsCsv = null;  // number of the answer that becomes a file
    this.chosen = null;
    this.running = true;
    this.mode = "auto";
    this.shownPart = null;  // [start, end] s where it is zoomed
    this.readUntil = 0;  // ms, of the page's clock, that what was refused still stands there
    at("scope-run").onclick = () => this.run(!this.running, false);
    at("scope-single").onclick = () => this.run(true, true);
    at("scope-form").onsubmit = (event) => event.preventDefault();
    at("scope-form").onchange = (event) => (event.target.id === "scope-lanes" ? this.build() : this.run(true, false));
    for (const id of ["cursor-a", "cursor-b"]) at(id).oninput = () => this.cursors();
    at("zoom").onclick = () => this.closer(...this.places().sort((a, b) => a - b));
    at("whole").onclick = () => this.closer(...this.extent);
    at("save-csv").onclick = () => this.csv();
    new Layouts(this);
    new ResizeObserver(() => this.plot && this.fit()).observe(at("scope-plot"));
  }

  show(axis, about) {
    const fresh = this.axis !== axis;
    this.axis = axis;
    this.about = about;
    const names = Object.keys(about.channels);
    if (!this.chosen || this.chosen.some((name) => !names.includes(name))) this.chosen = FIRST.filter((name) => names.includes(name));
    if (fresh) {
      this.picks();
      at("scope-source").replaceChildren(...["none", ...names].map((name) => new Option(name === "none" ? "none" : title(name), name)));
    }
    this.run(this.running, false);
  }

  picks() {
    at("scope-channels").replaceChildren(...Object.entries(this.about.channels).map(([name, about]) => this.pick(name, about)));
  }

  // These channels, as far as this axis has them.
  choose(names) {
    this.chosen = names.filter((name) => name in this.about.channels);
    this.picks();
    this.run(true, false);
  }

  get view() { return VIEWS[at("scope-view").value]; }

  pick(name, { meaning }) {
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox";
    box.checked = this.chosen.includes(name);
    box.onchange = () => {
      if (box.checked && this.chosen.length >= MOST) { box.checked = false; return this.refused(`${MOST} channels at most`); }
      this.chosen = box.checked ? [...this.chosen, name] : this.chosen.filter((one) => one !== name);
      if (this.chosen.length) this.run(true, false);
      else this.refused("choose at least one channel");
    };
    label.title = meaning;
    label.append(box, title(name));
    return label;
  }

  // Ask for captures; or hold the last one.
  run(running, single) {
    this.running = running;
    at("scope-run").setAttribute("aria-pressed", running);
    at("scope-run").textContent = running ? "Running" : "Run";
    at("scope-count").textContent = this.chosen.length;
    if (!running) {
      this.link.ask("hold", { held: true });
      return;
    }
    if (!this.chosen.length) return this.refused("choose at least one channel");
    const source = at("scope-source").value || "none";
    const unit = source === "none" ? "" : this.about.channels[source].unit;
    const level = at("scope-level").value.trim();
    const trigger = source === "none" ? null
      : { channel: source, level: /^[-+.\de]+$/i.test(level) && unit ? `${level} ${unit}` : level, edge: at("scope-edge").value };
    this.single = single;
    this.shownPart = null;
    const names = [...new Set([...this.chosen, ...this.view.needs])].slice(0, MOST), curves = [this.axis, ...names].join();
    if (curves !== this.curves) this.last = null;  // a capture of other curves must not appear under these names
    [this.names, this.curves] = [names, curves];
    this.build();
    this.readUntil = 0;
    this.tell(trigger ? "waiting for the trigger" : "");
    this.link.ask("scope", { axis: this.axis, channels: this.names, span: Number(at("scope-span").value), before: Number(at("scope-before").value) / 100,
      points: this.view === VIEWS.time ? POINTS : WHOLE, trigger, mode: single ? "single" : at("scope-mode").value, number: ++this.number });
  }

  tell(words) {
    if (performance.now() < this.readUntil) return;
    if (at("scope-state").textContent !== words) at("scope-state").textContent = words;
    at("scope-state").style.color = "";
  }

  // A refusal stays to be read: captures that come meanwhile do not wipe it away.
  refused(words) {
    this.readUntil = 0;
    this.tell(words);
    at("scope-state").style.color = "var(--bad)";
    this.readUntil = performance.now() + READ;
  }

  // Of a trigger that does not come: between what its channel has stayed.
  waiting({ low, high }) {
    const name = at("scope-source").value, unit = this.about.channels[name]?.unit;
    if (!this.running || unit === undefined) return;
    this.tell(`waiting for the trigger; so far ${title(name)} lies between ${si(low, unit)} and ${si(high, unit)}`);
  }

  take(found) {
    if (found.kind === KIND.detail) return this.detail(found);
    if (found.number !== this.number || !this.running) return;
    this.last = found;
    const first = found.start - found.at;
    this.extent = [first, first + found.buckets * found.size * found.period];
    this.waits = found;
    if (this.single) {
      this.running = false;
      at("scope-run").setAttribute("aria-pressed", false);
      at("scope-run").textContent = "Run";
    }
    this.tell(found.kind === KIND.free && at("scope-source").value !== "none" ? "no trigger: free run" : this.single ? "captured" : "");
  }

  detail(found) {
    if (found.number === this.wantsCsv) return this.store(found);
    if (this.running) return;
    this.last = this.waits = found;
  }

  closer(start, end) {
    if (!this.last || !(end > start) || this.view !== VIEWS.time) return;
    if (this.running) this.run(false, false);
    this.shownPart = [start, end];
    this.link.ask("closer", { start, end, points: POINTS, number: 0 });
  }

  csv() {
    if (!this.last) return this.refused("nothing has been captured yet: there is nothing to save");
    if (this.running) this.run(false, false);
    this.wantsCsv = 1 + Math.floor(performance.now());
    const [start, end] = this.shownPart || this.extent;
    this.link.ask("closer", { start, end, points: 100000, number: this.wantsCsv });
  }

  store(found) {
    const units = this.names.map((name) => this.about.channels[name].unit);
    const head = ["time_s", ...this.names.map((name, k) => (units[k] ? `${name}_${units[k].replace("/", "_per_")}` : name))];
    const lines = [head.join(",")];
    for (let k = 0; k < found.buckets; k++) lines.push([found.start - found.at + k * found.period, ...found.low.map((values) => values[k])].join(","));
    save(new Blob([`${lines.join("\n")}\n`], { type: "text/csv" }), "scope.csv");
  }

  draw() {
    if (!this.waits || !this.plot || this.waits.channels !== this.names.length) return;
    const found = this.waits;
    this.waits = null;
    const data = this.view.data(found, this.names);
    if (!data[0].length) return;  // too few rows for a spectrum
    this.data = data;
    const ranges = this.ranges();
    this.plot.setData(this.data, false);
    this.plot.batch(() => {
      this.plot.setScale("x", { min: this.data[0][0], max: Math.max(this.data[0].at(-1), this.data[0][0] + 1e-9) });
      for (const [scale, range] of Object.entries(ranges)) this.plot.setScale(scale, { min: range[0], max: range[1] });
    });
    this.cursors();
  }

  // One range a scale; in lanes each range is so wide that its curve has its own lane.
  ranges() {
    const bounds = {};
    this.names.forEach((name, index) => {
      const scale = this.scaleOf(name), found = bounds[scale] || (bounds[scale] = [Infinity, -Infinity]);
      for (const value of this.data[3 * index + 2]) if (value < found[0]) found[0] = value;
      for (const value of this.data[3 * index + 3]) if (value > found[1]) found[1] = value;
    });
    return this.view === VIEWS.frequency ? this.fitted(bounds) : this.apart(bounds, this.fitted(bounds));
  }

  fitted(bounds) {
    return Object.fromEntries(Object.entries(bounds).map(([scale, [low, high]]) => [scale, this.view.range(low, high, this.unitOf(scale))]));
  }

  // In lanes; or overlaid, where curves at rest would lie on each other: each a little above the next.
  apart(bounds, ranges) {
    const scales = Object.keys(ranges), lanes = at("scope-lanes").value === "lanes", wide = (ends) => ends[1] - ends[0];
    const still = scales.filter((scale) => wide(bounds[scale]) < STILL * wide(ranges[scale]));
    return Object.fromEntries(scales.map((scale, lane) => {
      const [low, high] = ranges[scale], height = (high - low) * 1.08;
      if (lanes) return [scale, [high - height * (scales.length - lane), high + height * lane]];
      const shift = still.includes(scale) ? (still.indexOf(scale) - (still.length - 1) / 2) * STEP * height : 0;
      return [scale, [low + shift, high + shift]];
    }));
  }

  scaleOf(name) {
    return family(name, this.about.channels[name].unit);
  }

  unitOf(scale) {
    return this.about.channels[this.names.find((name) => this.scaleOf(name) === scale)].unit;
  }

  build() {
    this.plot?.destroy();
    this.plot = this.data = null;
    const place = at("scope-plot");
    if (!window.uPlot) return missing(place);
    place.innerHTML = "";
    const view = this.view;
    for (const id of ["zoom", "whole"]) at(id).hidden = view !== VIEWS.time;
    this.from = {};
    const scales = [...new Set(this.names.map((name) => this.scaleOf(name)))];
    const lanes = at("scope-lanes").value === "lanes";
    const axes = scales.slice(0, 2).map((scale, index) => this.scaleAxis(scale, index));
    this.plot = new uPlot({
      width: place.clientWidth || 300, height: 340, pxAlign: 0, legend: { show: false },
      cursor: { y: false, points: { show: false }, drag: { x: true, y: false, setScale: false } },
      select: { show: true },
      scales: { x: view.x, ...Object.fromEntries(scales.map((scale) => [scale, { ...view.y }])) },
      series: [{}, ...this.names.flatMap((name) => view.curves(name, this.names, this.scaleOf(name)))],
      bands: view === VIEWS.time ? veils(this.names) : [],
      axes: [{ ...axisLook(), values: (u, values) => this.told("x", u.scales.x, values, view.unit(this.about)) }, ...(lanes ? [] : axes)],
      hooks: { draw: [(u) => this.lines(u)], setSelect: [(u) => this.selected(u)], ready: [(u) => this.mouse(u)] },
    }, [[], ...this.names.flatMap(() => [[], [], []])], place);
    this.waits = this.last?.channels === this.names.length ? this.last : null;
  }

  scaleAxis(scale, index) {
    const name = this.names.find((one) => this.scaleOf(one) === scale), unit = this.about.channels[name].unit;
    return { ...axisLook(), scale, side: index ? 1 : 3, size: innerWidth < 600 ? 62 : 78, grid: { show: !index, stroke: css("--grid"), width: 1 },
      stroke: look(name, this.names).stroke,
      values: (u, values) => this.told(scale, u.scales[scale], values, unit) };
  }

  // The ticks of a scale; what they count from stands below the plot.
  told(scale, { min, max, distr }, values, unit) {
    if (distr === 3) return values.map((value) => (value === null ? "" : si(value, unit, 2)));
    const how = ticking(min, max, unit);
    this.from[scale] = how.from ? `${SAID[scale] || title(scale)} ${how.from}` : "";
    const words = Object.values(this.from).filter(Boolean).join("; ");
    if (at("scope-from").textContent !== words) at("scope-from").textContent = words;
    return values.map((value) => `${tick(value, how)} ${how.name}`);
  }

  mouse(u) {
    u.over.addEventListener("dblclick", () => this.closer(...this.extent));
    u.over.addEventListener("click", (event) => {
      if (u.select.width > 3) return;
      const slider = at(event.shiftKey ? "cursor-b" : "cursor-a");
      slider.value = (1000 * event.offsetX) / u.over.clientWidth;
      this.cursors();
    });
  }

  selected(u) {
    if (u.select.width <= 3) return;
    const start = u.posToVal(u.select.left, "x"), end = u.posToVal(u.select.left + u.select.width, "x");
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.closer(start, end);
  }

  places() {
    return ["cursor-a", "cursor-b"].map((id) => this.plot.posToVal((this.plot.over.clientWidth * at(id).value) / 1000, "x"));
  }

  // Cursors, and the trigger at 0.
  lines(u) {
    const marks = this.places().map((t, k) => [t, "AB"[k], css("--soft")]);
    if (this.view === VIEWS.time) marks.push([0, "", css("--error")]);
    const context = u.ctx, { left, top, width, height } = u.bbox;
    context.save();
    context.lineWidth = devicePixelRatio;
    context.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    for (const [t, name, colour] of marks) {
      const x = u.valToPos(t, "x", true);
      if (x < left || x > left + width) continue;
      context.strokeStyle = context.fillStyle = colour;
      context.setLineDash(name ? [] : [3 * devicePixelRatio, 3 * devicePixelRatio]);
      context.beginPath();
      context.moveTo(x, top);
      context.lineTo(x, top + height);
      context.stroke();
      context.fillText(name, x + 4 * devicePixelRatio, top + 12 * devicePixelRatio);
    }
    context.restore();
  }

  cursors() {
    if (!this.plot || !this.data?.[0].length) return;
    const times = this.places(), [a, b] = times.map((t) => this.nearest(t)), gap = times[1] - times[0];
    this.plot.redraw(false, false);
    const x = this.view.unit(this.about), rate = x === "s" ? `, ${si(1 / Math.abs(gap), "Hz", 3)}` : "";
    const head = ["", `A  ${si(times[0], x)}`, `B  ${si(times[1], x)}`, `B − A  ${si(gap, x)}${rate}`, "lowest", "highest"];
    const rows = this.names.map((name, k) => {
      const unit = this.about.channels[name].unit, [values, lows, highs] = this.data.slice(3 * k + 1, 3 * k + 4);
      const low = lows.reduce((least, v) => Math.min(least, v), Infinity), high = highs.reduce((most, v) => Math.max(most, v), -Infinity);
      return [name, ...[values[a], values[b], values[b] - values[a], low, high].map((value) => si(value, unit, 5))];
    });
    const table = at("readout");
    fill(table.tHead, [head], "th");
    fill(table.tBodies[0], rows, "td");
    for (const row of table.tBodies[0].rows) [...row.cells].forEach((cell, c) => { cell.dataset.head = head[c]; });
    [...table.tBodies[0].rows].forEach((row, k) => {
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = look(this.names[k], this.names).stroke;
      row.cells[0].replaceChildren(swatch, title(this.names[k]));
      row.cells[0].title = this.about.channels[this.names[k]].meaning;
    });
  }

  nearest(t) {
    const x = this.data[0];
    let low = 0, high = x.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (x[middle] <= t) low = middle; else high = middle;
    }
    return t - x[low] <= x[high] - t ? low : high;
  }

  fit() {
    const width = at("scope-plot").clientWidth;
    if (width && Math.abs(width - this.plot.width) > 1) this.plot.setSize({ width, height: 340 });
  }
}

function title(name) {
  return name.replaceAll("_", " ");
}

function fill(part, rows, cell) {
  while (part.rows.length > rows.length) part.deleteRow(-1);
  rows.forEach((row, r) => {
    const line = part.rows[r] || part.insertRow();
    while (line.cells.length < row.length) line.append(document.createElement(cell));
    row.forEach((text, c) => { if (c || cell === "th") line.cells[c].textContent = text; });
  });
}

// Target and actual, tracking error, current: as they come, the lowest and the highest of each bucket.

import { axisLook, calm, curves, envelope, legend, missing, ticks, veils } from "./plot.js";

const PANELS = [
  { id: "position", names: ["target", "measured"], labels: ["target", "actual position"] },
  { id: "error", names: ["error"], labels: ["tracking error"] },
  { id: "current", names: ["current", "measured_current"], labels: ["commanded", "measured current"] },
];
// s between two messages at most.  The picture lags the newest bucket by this and one bucket, so it moves with every
// frame of the screen, not with every message.
const APART = 0.05;
const NAMES = PANELS.flatMap((panel) => panel.names);

export class Strips {
  constructor(link) {
    this.link = link;
    this.number = 0;
    this.span = 10;
    this.paused = false;
    this.plots = [];
    this.clear();
    document.getElementById("strip-span").onchange = (event) => {
      this.span = Number(event.target.value);
      this.ask();
    };
    const pause = document.getElementById("pause");
    pause.onclick = () => {
      this.paused = !this.paused;
      pause.setAttribute("aria-pressed", this.paused);
      pause.textContent = this.paused ? "Go on" : "Pause";
      if (!this.paused) this.ask();
    };
    new ResizeObserver(() => this.plots.forEach((plot) => this.fit(plot))).observe(document.getElementById("strips"));
  }

  show(axis, about) {
    this.axis = axis;
    this.about = about;
    this.build();
    this.ask();
  }

  ask() {
    this.clear();
    const points = Math.min(Math.max(Math.round((document.getElementById("strip-position").clientWidth || 600) * 0.8), 200), 1000);
    this.link.ask("strip", { axis: this.axis, channels: NAMES, span: this.span, points, number: ++this.number });
  }

  clear() {
    this.x = [];
    this.low = NAMES.map(() => []);
    this.high = NAMES.map(() => []);
    this.ahead = -Infinity;  // of the service's clock before this one's, s
    this.dirty = true;
  }

  clock() { return performance.now() / 1000; }

  // New buckets: of each the lowest and the highest, at its middle.
  take(found) {
    if (found.number !== this.number || this.paused) return;
    const step = found.size * found.period, half = (found.size - 1) * found.period / 2;
    if (this.x.length && found.start + half - this.x.at(-1) > 2.5 * step) this.put(found.start - half, null, 0);  // rows were lost: a gap
    for (let k = 0; k < found.buckets; k++) {
      const t = found.start + half + k * step;
      if (!(t <= this.x.at(-1))) this.put(t, found, k);
    }
    this.ahead = Math.max(this.x.at(-1) - this.clock(), this.ahead - 1e-4);  // what comes late does not set it
    this.behind = APART + step;
    const oldest = this.x.at(-1) - this.span - step;
    let old = 0;
    while (old < this.x.length && this.x[old] < oldest) old++;
    if (old > 200 || (old && this.x.length > 4000)) {
      this.x = this.x.slice(old);
      this.low = this.low.map((values) => values.slice(old));
      this.high = this.high.map((values) => values.slice(old));
    }
    this.dirty = true;
  }

  put(t, found, k) {
    const value = (numbers) => (Number.isNaN(numbers[k]) ? null : numbers[k]);
    this.x.push(t);
    NAMES.forEach((_, c) => {
      this.low[c].push(found && value(found.low[c]));
      this.high[c].push(found && value(found.high[c]));
    });
  }

  draw() {
    const end = this.x.length ? Math.min(this.x.at(-1), this.clock() + this.ahead - this.behind) : 0;
    if ((end === this.end && !this.dirty) || !this.plots.length) return;
    this.dirty = false;
    this.end = end;
    const times = this.x.map((t) => t - end);
    let first = 0;
    for (const plot of this.plots) {
      plot.setData([times, ...plot.panel.names.flatMap((_, index) => envelope(this.low[first + index], this.high[first + index]))], false);
      plot.batch(() => {
        plot.setScale("x", { min: -this.span, max: 0 });
        plot.setScale("y", this.range(plot, first));
      });
      first += plot.panel.names.length;
    }
  }

  range(plot, first) {
    let low = Infinity, high = -Infinity;
    plot.panel.names.forEach((_, index) => {
      for (const value of this.low[first + index]) if (value !== null && value < low) low = value;
      for (const value of this.high[first + index]) if (value !== null && value > high) high = value;
    });
    const [min, max] = calm(low, high, this.about.channels[plot.panel.names[0]].unit);
    return { min, max };
  }

  build() {
    this.plots.forEach((plot) => plot.destroy());
    this.plots = [];
    for (const panel of PANELS) {
      const place = document.getElementById(`strip-${panel.id}`);
      const unit = this.about.channels[panel.names[0]].unit;
      const say = legend(document.getElementById(`strip-${panel.id}-title`), panel.names, panel.labels, unit);
      if (!window.uPlot) { missing(place); continue; }
      place.innerHTML = "";
      const last = panel.id === "current", high = matchMedia("(min-width: 901px)").matches ? 265 : 145;  // beside the orders there is room
      const plot = new uPlot({
        width: place.clientWidth || 300, height: last ? high + 20 : high, pxAlign: 0, legend: { show: false }, cursor: { show: false },
        scales: { x: { time: false }, y: { auto: false } },
        series: [{}, ...panel.names.flatMap((name) => curves(name, panel.names))],
        bands: veils(panel.names),
        axes: [{ ...axisLook(), size: last ? 34 : 8, values: last ? (u, values) => values.map((v) => `${v} s`) : () => [] },
               { ...axisLook(), size: 58, values: ticks(unit, { axis: 1, unit: say }) }],
      }, [[], ...panel.names.flatMap(() => [[], [], []])], place);
      plot.panel = panel;
      this.plots.push(plot);
    }
    this.dirty = true;
  }

  fit(plot) {
    const width = plot.root.parentElement.clientWidth;
    if (width && Math.abs(width - plot.width) > 1) plot.setSize({ width, height: plot.height });
  }
}

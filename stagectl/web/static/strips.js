// Target and actual, tracking error, current: as they come, the lowest and the highest of each bucket.

import { axisLook, calm, css, legend, look, missing, ticks } from "./plot.js";

const PANELS = [
  { id: "position", names: ["target", "measured"], labels: ["target", "actual position"], least: 0 },
  { id: "error", names: ["error"], labels: ["tracking error"], least: 0 },
  { id: "current", names: ["current", "measured_current"], labels: ["current, command", "measured"], least: 0.02 },
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
    this.y = NAMES.map(() => []);
    this.ahead = -Infinity;  // of the service's clock before this one's, s
    this.dirty = true;
  }

  clock() { return performance.now() / 1000; }

  // New buckets: two points each, the lowest and the highest.
  take(found) {
    if (found.number !== this.number || this.paused) return;
    const step = found.size * found.period, half = found.size > 1 ? step / 2 : 0;
    if (this.x.length && found.start - this.x.at(-1) > 2.5 * step) {  // rows were lost: a gap
      this.x.push(found.start - step / 2);
      this.y.forEach((values) => values.push(null));
    }
    for (let k = 0; k < found.buckets; k++) {
      const t = found.start + k * step;
      if (t <= this.x.at(-1)) continue;
      this.x.push(t);
      if (half) this.x.push(t + half);
      for (let c = 0; c < NAMES.length; c++) {
        const low = found.low[c][k], high = found.high[c][k];
        this.y[c].push(Number.isNaN(low) ? null : low);
        if (half) this.y[c].push(Number.isNaN(high) ? null : high);
      }
    }
    this.ahead = Math.max(this.x.at(-1) - this.clock(), this.ahead - 1e-4);  // what comes late does not set it
    this.behind = APART + step;
    const oldest = this.x.at(-1) - this.span - step;
    let old = 0;
    while (old < this.x.length && this.x[old] < oldest) old++;
    if (old > 200 || (old && this.x.length > 4000)) {
      this.x = this.x.slice(old);
      this.y = this.y.map((values) => values.slice(old));
    }
    this.dirty = true;
  }

  draw() {
    const end = this.x.length ? Math.min(this.x.at(-1), this.clock() + this.ahead - this.behind) : 0;
    if ((end === this.end && !this.dirty) || !this.plots.length) return;
    this.dirty = false;
    this.end = end;
    const times = this.x.map((t) => t - end);
    let first = 0;
    for (const plot of this.plots) {
      plot.setData([times, ...plot.panel.names.map((_, index) => this.y[first + index])], false);
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
      for (const value of this.y[first + index]) {
        if (value === null) continue;
        if (value < low) low = value;
        if (value > high) high = value;
      }
    });
    const [min, max] = calm(low, high, plot.panel.least || 4 * (this.about.step || 1e-9));
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
      const last = panel.id === "current";
      const plot = new uPlot({
        width: place.clientWidth || 300, height: last ? 165 : 145, pxAlign: 0, legend: { show: false }, cursor: { show: false },
        scales: { x: { time: false }, y: { auto: false } },
        series: [{}, ...panel.names.map((name) => ({ ...look(name, panel.names), width: 1.25, points: { show: false } }))],
        axes: [{ ...axisLook(), size: last ? 34 : 8, values: last ? (u, values) => values.map((v) => `${v} s`) : () => [] },
               { ...axisLook(), size: 58, values: ticks(unit, { axis: 1, unit: say }) }],
      }, [[], ...panel.names.map(() => [])], place);
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

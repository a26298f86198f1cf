// Interactive plots over time or frequency: drag to zoom, two clicks for the whole; plots of the same span zoom together.
// By keyboard: + and - zoom, the arrows move, 0 shows the whole.
const groups = new Map();
const near = (a, b) => a.every((value, k) => Math.abs(value - b[k]) < 1e-3 * Math.abs(b[1] - b[0]));

function groupOf(panel) {
  for (const group of groups.values()) if (group.label === panel.x && near(group.xlim, panel.xlim)) return group;
  const group = { key: `span-${groups.size}`, label: panel.x, xlim: panel.xlim, plots: [] };
  groups.set(group.key, group);
  return group;
}

// A curve's numbers, from base64; a place without a value is null, which breaks the curve.
const unpacked = (text, Kind) => Array.from(new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer), (value) => (Number.isFinite(value) ? value : null));
const spaced = ([first, last, count]) => Array.from({ length: count }, (_, k) => first + (last - first) * k / (count - 1));
const curve = (line) => ({ ...line, x: Array.isArray(line.x) ? spaced(line.x) : unpacked(line.x, Float64Array), y: unpacked(line.y, Float32Array) });

// Curves on one axis: where their times differ each has no value (undefined: no gap) at those of the others.
function aligned(lines) {
  const same = lines.every((line) => line.x.length === lines[0].x.length && line.x.every((t, k) => t === lines[0].x[k]));
  if (same) return [lines[0].x, ...lines.map((line) => line.y)];
  const rows = lines.flatMap((line, of) => line.x.map((t, k) => ({ t, of, y: line.y[k] }))).sort((a, b) => a.t - b.t);
  return [rows.map((row) => row.t), ...lines.map((_, of) => rows.map((row) => (row.of === of ? row.y : undefined)))];
}

function zoom(group, min, max) {
  group.window = [Math.max(min, group.xlim[0]), Math.min(max, group.xlim[1])];
  for (const plot of group.plots) plot.setScale("x", { min: group.window[0], max: group.window[1] });
}

function shade(plot, panel) {
  const { ctx, bbox } = plot, at = (value, scale) => plot.valToPos(value, scale, true);
  ctx.save();
  ctx.beginPath(); ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height); ctx.clip();
  ctx.fillStyle = "#f1f5f9";
  for (const [from, to] of panel.spans) ctx.fillRect(at(from, "x"), bbox.top, at(to, "x") - at(from, "x"), bbox.height);
  ctx.fillStyle = "#cbd5e1b0";
  for (const [low, high] of panel.bands) ctx.fillRect(bbox.left, at(high, "y"), bbox.width, at(low, "y") - at(high, "y"));
  ctx.restore();
}

// Words that a curve does not strike out.
function written(ctx, words, x, y) {
  ctx.save();
  ctx.setLineDash([]);
  ctx.lineJoin = "round";
  ctx.lineWidth = 4 * devicePixelRatio;
  ctx.strokeStyle = "#fff";  // the plate of a plot, in the dark too
  ctx.strokeText(words, x, y);
  ctx.restore();
  ctx.fillText(words, x, y);
}

// Levels, single places and words beside a place, as the picture has them.
function mark(plot, panel) {
  const { ctx, bbox } = plot, scale = devicePixelRatio, said = [];
  const across = (x, side) => (x === null ? bbox.left + side * bbox.width : plot.valToPos(x, "x", true));
  const up = (y, side) => (y === null ? bbox.top + side * bbox.height : plot.valToPos(y, "y", true));
  ctx.save();
  ctx.beginPath(); ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height); ctx.clip();
  ctx.font = `${12 * scale}px system-ui, sans-serif`;
  ctx.textAlign = "left";
  ctx.lineWidth = 1.5 * scale;
  for (const { x, y, colour, dashed, label } of panel.marks) {
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.setLineDash(dashed ? [6 * scale, 4 * scale] : []);
    ctx.beginPath();
    if (x.length === 1) { ctx.arc(across(x[0], 0), up(y[0], 0), 3.5 * scale, 0, 2 * Math.PI); ctx.fill(); }
    else { ctx.moveTo(across(x[0], 0), up(y[0], 0)); ctx.lineTo(across(x[1], 1), up(y[1], 1)); ctx.stroke(); }
    if (!label) continue;
    const above = up(y[1], 1) - 5 * scale, height = above > bbox.top + 12 * scale ? above : above + 20 * scale;
    const edges = said.filter((other) => Math.abs(other.height - height) < 12 * scale).map((other) => other.right);
    const edge = Math.max(across(x[0], 0) + 6 * scale, ...edges);  // right of a label that stands there already
    said.push({ label, colour, edge, height, right: edge + ctx.measureText(label).width + 12 * scale });
  }
  for (const { label, colour, edge, height } of said) {
    ctx.fillStyle = colour;
    written(ctx, label, edge, height);
  }
  for (const { x, y, offset, words, colour } of panel.notes) {
    const at = across(x, 0), within = (value, low, high) => Math.min(Math.max(value, low), high);
    if (at < bbox.left - 1 || at > bbox.left + bbox.width + 1) continue;  // the zoom leaves its place out
    ctx.fillStyle = colour;  // where all of it is seen
    const left = within(at + offset[0] * 4 / 3 * scale, bbox.left, bbox.left + bbox.width - ctx.measureText(words).width);
    written(ctx, words, left, within(up(y, 0) - offset[1] * 4 / 3 * scale, bbox.top + 12 * scale, bbox.top + bbox.height - 4 * scale));
  }
  ctx.restore();
}

// Ticks of a logarithmic axis: its decades, and what lies between as far as there is room.  uPlot's own have no end where
// the axis begins just below a decade.
function ticks(plot, of, low, high) {
  const first = Math.floor(Math.log10(low)), last = Math.ceil(Math.log10(high));
  const most = (of === 0 ? plot.bbox.width / 50 : plot.bbox.height / 15) / devicePixelRatio;
  const between = (digits) => Array.from({ length: last - first + 1 }, (_, k) => digits.map((digit) => +`${digit}e${first + k}`)).flat();
  const all = [[1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9], [1, 2, 5], [1]].map((digits) => between(digits).filter((value) => low <= value && value <= high));
  return all.find((values) => values.length <= most) ?? all.at(-1);
}
const decades = { splits: ticks, filter: (_, splits) => splits, values: (_, splits) => splits.map((value) => `${value}`) };

const linear = { values: (_, splits) => splits.map((value) => `${+value.toPrecision(9)}`) };  // as many digits as a zoom needs

// A value under the pointer; at rest the legend names the curves alone.
const read = (_, value) => (value === null || value === undefined ? "" : `${+value.toPrecision(5)}`);

function build(place, panel) {
  const group = groupOf(panel), axis = { stroke: "#475569", grid: { stroke: "#e2e8f0", width: 1 }, ticks: { show: false } };
  const whole = () => !group.window || near(group.window, group.xlim);
  const room = (low, high) => { const gap = 0.08 * (high - low) || Math.abs(high) || 1; return [low - gap, high + gap]; };
  const fit = (plot, low, high) => (whole() || low === null ? panel.ylim : panel.logarithmic ? [low / 1.2, high * 1.2] : room(low, high));
  // Zoomed until they stand apart, the samples are dots.  Of more than its width shows, uPlot draws the lowest and highest.
  const apart = (plot, _, from, to) => !whole() && to - from < plot.bbox.width / (12 * devicePixelRatio);
  const plot = new uPlot({
    width: place.clientWidth || 600, height: 240, title: panel.title || undefined, pxAlign: 0,
    cursor: { sync: { key: group.key, scales: ["x", null] }, drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => () => zoom(group, ...group.xlim) } },
    scales: { x: { time: false, distr: panel.over_decades ? 3 : 1, range: (_, min, max) => [min, max] }, y: { distr: panel.logarithmic ? 3 : 1, range: fit } },
    legend: { markers: { width: 0, fill: (_, of) => panel.lines[of - 1]?.colour } },
    series: [{ label: panel.x, value: read }, ...panel.lines.map((line) => ({
      label: line.label || panel.y, value: read, stroke: line.colour, width: line.width, dash: line.dashed ? [6, 4] : undefined,
      points: { show: line.points || apart, size: 4, fill: line.colour }, ...(line.points ? { paths: () => null } : {}),
    }))],
    axes: [
      { ...axis, label: panel.x, size: 26, labelSize: 20, ...(panel.over_decades ? decades : linear) },
      { ...axis, label: panel.y, size: 70, labelSize: 22, ...(panel.logarithmic ? decades : linear) },
    ],
    hooks: {
      drawClear: [(shown) => shade(shown, panel)],
      draw: [(shown) => mark(shown, panel)],
      setSelect: [(shown) => {
        const { left, width } = shown.select;
        if (width < 4) return;
        zoom(group, shown.posToVal(left, "x"), shown.posToVal(left + width, "x"));
        shown.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
      }],
    },
  }, aligned(panel.lines.map(curve)), place);
  group.plots.push(plot);
  plot.setScale("x", { min: group.xlim[0], max: group.xlim[1] });
  const [even, back] = panel.over_decades ? [Math.log10, (power) => 10 ** power] : [Number, Number];  // to a linear axis
  place.tabIndex = 0;
  place.setAttribute("role", "application");
  place.setAttribute("aria-label", `${panel.title} ${panel.y} over ${panel.x}. Plus and minus zoom, arrows move, 0 shows the whole.`);
  place.onkeydown = (event) => {
    const [min, max] = (group.window ?? group.xlim).map(even), [first, last] = group.xlim.map(even), span = max - min;
    const to = { "+": [min + span / 4, max - span / 4], "-": [min - span / 2, max + span / 2], 0: [first, last],
      ArrowLeft: [min, max].map((end) => end - Math.min(span / 4, min - first)),
      ArrowRight: [min, max].map((end) => end + Math.min(span / 4, last - max)) }[event.key];
    if (!to || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    zoom(group, ...to.map(back));
  };
  new ResizeObserver(() => place.clientWidth && plot.setSize({ width: place.clientWidth, height: 240 })).observe(place);
}

for (const place of document.querySelectorAll("[data-plot]")) {
  place.closest("figure").classList.add("explored");
  for (const panel of JSON.parse(place.dataset.plot)) {
    if (!panel.lines.length) continue;
    const made = place.appendChild(document.createElement("div"));
    made.classList.toggle("single", panel.lines.length === 1 && !panel.lines[0].label);
    build(made, panel);
  }
}

// What all plots have in common: colours by theme, units with prefixes, ranges that stand still.

const NAMED = { reference: "--target", target: "--target", measured: "--measured", error: "--error", current: "--current",
  measured_current: "--current-measured" };
const OTHERS = ["--c6", "--c7", "--c8", "--c9", "--c10"];
const PREFIX = [[1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];
const NOTHING = 1e-12;  // SI: smaller values are rounding, and are shown as 0
const LEAST = { m: 4e-9, rad: 4e-8, A: 0.02, s: 1e-6 };  // SI: an axis shows this much at least, so that rounding is no curve
const FAR = 20;  // spans of an axis from 0: farther away its ticks count from an offset

export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// Colour of a channel, and whether its line is dashed: five colours twice for those without one of their own.
export function look(name, names) {
  if (NAMED[name]) return { stroke: css(NAMED[name]), dash: name === "reference" ? [6, 3] : undefined };
  const place = names.filter((one) => !NAMED[one]).indexOf(name);
  return { stroke: css(OTHERS[place % OTHERS.length]), dash: place >= OTHERS.length ? [6, 3] : undefined };
}

export function prefix(largest, unit) {
  if (!unit) return [1, unit];
  const found = PREFIX.find(([scale]) => largest >= scale) || PREFIX[3];
  return [found[0], found[1] + unit];
}

export function si(value, unit, digits = 4) {
  if (value === null || !Number.isFinite(value)) return "not known";
  if (unit ? Math.abs(value) < NOTHING : value === 0) return `0 ${unit}`.trim();
  const [scale, name] = prefix(Math.abs(value), unit);
  return `${Number((value / scale).toPrecision(digits))} ${name}`.trim();
}

export function fixed(value, scale, digits, unit) {
  return value === null || !Number.isFinite(value) ? "not known" : `${(value / scale).toFixed(digits)} ${unit}`;
}

// A range on round numbers, a little wider than needed: it changes seldom.
export function calm(low, high, unit) {
  if (!Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
  const middle = (low + high) / 2, width = Math.max((high - low) * 1.1, LEAST[unit?.split("/")[0]] || 1e-3, Math.abs(middle) * 1e-9);
  const decade = 10 ** Math.floor(Math.log10(width));
  const step = [0.25, 0.5, 1, 2.5].map((part) => part * decade).find((part) => width / part <= 6) || decade;
  return [Math.floor((middle - width / 2) / step) * step, Math.ceil((middle + width / 2) / step) * step];
}

export function axisLook() {
  return { stroke: css("--soft"), grid: { stroke: css("--grid"), width: 1 }, ticks: { stroke: css("--grid"), width: 1 },
    font: "12px system-ui, sans-serif" };
}

// How the ticks of an axis are told: in one unit, and far from 0 as distances from an offset.
export function ticking(min, max, unit) {
  const span = max - min, middle = (min + max) / 2;
  if (!unit || !(Math.abs(middle) > FAR * span)) {
    const [factor, name] = prefix(Math.max(Math.abs(min), Math.abs(max)) * 0.999, unit);
    return { offset: 0, factor, name, from: "" };
  }
  const [factor, name] = prefix(span * 0.999, unit), [large, called] = prefix(Math.abs(middle), unit);
  const decade = 10 ** Math.ceil(Math.log10(span)), digits = Math.max(Math.round(Math.log10(large / decade)), 0);
  const told = (middle / large).toFixed(digits);
  return { offset: Number(told) * large, factor, name, from: `from ${told} ${called}` };
}

export function tick(value, { offset, factor }) {
  const shown = Number(((value - offset) / factor).toPrecision(6));
  if (Math.abs(value - offset) < NOTHING) return "0";
  return offset && shown > 0 ? `+${shown}` : String(shown);
}

// Ticks in a prefix that fits; `said.unit(name, from)` receives the unit, and what the ticks count from.
export function ticks(unit, said) {
  return (u, values) => {
    const { min, max } = u.scales[u.axes[said.axis].scale], how = ticking(min, max, unit);
    said.unit(how.name, how.from);
    return values.map((value) => tick(value, how));
  };
}

// The curves of a channel: the middle, and between the lowest and the highest value of each bucket a veil, so that noise
// does not hide what lies behind it.  `first`: number of the middle's series.
export function curves(name, names, scale = "y") {
  const { stroke, dash } = look(name, names), points = { show: false };
  const edge = { stroke: `${stroke}99`, width: 0.75, scale, points };
  return [{ stroke, dash, scale, width: 1.25, points }, edge, edge];
}

export function veils(names) {
  return names.map((name, k) => ({ series: [3 * k + 3, 3 * k + 2], fill: `${look(name, names).stroke}40` }));
}

// Middle, lowest, highest; where a bucket is one row they are one curve.
export function envelope(low, high) {
  return [low.map((value, k) => (value === null ? null : (value + high[k]) / 2)), low, high];
}

export function missing(place) {
  place.innerHTML = "";
  const words = document.createElement("p");
  words.className = "missing";
  words.textContent = "uPlot is not installed yet. The service downloads it once; connect it to a network, then reload this page.";
  place.append(words);
}

export function legend(place, names, labels, unit) {
  place.innerHTML = "";
  names.forEach((name, index) => {
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = look(name, names).stroke;
    place.append(index ? ", " : "", swatch, labels[index]);
  });
  const said = document.createElement("span");
  said.textContent = unit ? ` [${unit}]` : "";
  place.append(said);
  return (name, from) => {
    const words = name ? ` [${name}]${from ? ` ${from}` : ""}` : "";
    if (said.textContent !== words) said.textContent = words;
  };
}

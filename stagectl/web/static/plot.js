// What all plots have in common: colours by theme, units with prefixes, ranges that stand still.

const NAMED = { reference: "--target", target: "--target", measured: "--measured", error: "--error", current: "--current",
  measured_current: "--current-measured" };
const OTHERS = ["--c6", "--c7", "--c8", "--c9", "--c10"];
const PREFIX = [[1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];

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
  if (!unit || unit === "A") return [1, unit];
  const found = PREFIX.find(([scale]) => largest >= scale) || PREFIX[3];
  return [found[0], found[1] + unit];
}

export function si(value, unit, digits = 4) {
  if (value === null || !Number.isFinite(value)) return "not known";
  if (value === 0) return `0 ${unit}`.trim();
  const [scale, name] = prefix(Math.abs(value), unit);
  return `${Number((value / scale).toPrecision(digits))} ${name}`.trim();
}

export function fixed(value, scale, digits, unit) {
  return value === null || !Number.isFinite(value) ? "not known" : `${(value / scale).toFixed(digits)} ${unit}`;
}

// A range on round numbers, a little wider than needed: it changes seldom.
export function calm(low, high, least = 0) {
  if (!Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
  const middle = (low + high) / 2, width = Math.max((high - low) * 1.1, least, Math.abs(middle) * 1e-9, 1e-12);
  const decade = 10 ** Math.floor(Math.log10(width));
  const step = [0.25, 0.5, 1, 2.5].map((part) => part * decade).find((part) => width / part <= 6) || decade;
  return [Math.floor((middle - width / 2) / step) * step, Math.ceil((middle + width / 2) / step) * step];
}

export function axisLook() {
  return { stroke: css("--soft"), grid: { stroke: css("--grid"), width: 1 }, ticks: { stroke: css("--grid"), width: 1 },
    font: "12px system-ui, sans-serif" };
}

// Ticks in a prefix that fits; `said(unit)` receives the prefix.
export function ticks(unit, said) {
  return (u, values) => {
    const scale = u.scales[u.axes[said.axis].scale];
    const [factor, name] = prefix(Math.max(Math.abs(scale.min), Math.abs(scale.max)) * 0.999, unit);
    said.unit(name);
    return values.map((value) => String(Number((value / factor).toPrecision(6))));
  };
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
  return (name) => { said.textContent = name ? ` [${name}]` : ""; };
}

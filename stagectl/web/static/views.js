// What the scope draws of a capture: over time, as a spectrum, or over the position.  Each view gives
// [x, then of each channel its middle, lowest and highest], the unit of x, and how the curves are drawn.

import { calm, curves, envelope, look } from "./plot.js";
import { spectrum } from "./spectrum.js";

const QUIET = 1e-6;  // of the largest amplitude: smaller ones are not shown
const PLACE = "measured";  // the position that errors and currents are drawn over

const time = {
  unit: () => "s",
  x: { time: false },
  y: { auto: false },
  needs: [],
  data(found, names) {
    const step = found.size * found.period, half = (found.size - 1) * found.period / 2;
    const x = Array.from({ length: found.buckets }, (_, k) => found.start - found.at + half + k * step);
    return [x, ...names.flatMap((_, c) => envelope([...found.low[c]], [...found.high[c]]))];
  },
  curves,
  range: calm,
};

const frequency = {
  unit: () => "Hz",
  x: { time: false, distr: 3 },
  y: { auto: false, distr: 3 },
  needs: [],
  data(found, names) {
    const all = names.map((_, c) => spectrum(found.low[c], found.size * found.period));
    return [all[0].frequency, ...all.flatMap(({ amplitude }) => [amplitude, amplitude, amplitude])];
  },
  curves: alone,
  range: decades,
};

// Both directions of a motion lie over each other: points, in the order of the position.
const place = {
  unit: (about) => about.channels[PLACE].unit,
  x: { time: false },
  y: { auto: false },
  needs: [PLACE],
  data(found, names) {
    const where = found.low[names.indexOf(PLACE)];
    const order = Array.from(where, (_, k) => k).sort((a, b) => where[a] - where[b]);
    const along = (values) => order.map((k) => values[k]);
    return [along(where), ...names.flatMap((_, c) => { const y = along(found.low[c]); return [y, y, y]; })];
  },
  curves: (name, names, scale) => {
    const [curve, ...edges] = alone(name, names, scale), { stroke } = look(name, names);
    return [{ ...curve, show: name !== PLACE, paths: () => null, points: { show: true, size: 2.5, width: 0, fill: stroke, stroke } }, ...edges];
  },
  range: calm,
};

// From a whole decade: uPlot 1.6 adds up ticks without end where a logarithmic axis begins just below one.
function decades(low, high) {
  if (!(high > 0) || !Number.isFinite(low) || !Number.isFinite(high)) return [1e-9, 1];
  const least = Math.max(low, high * QUIET, 1e-15);
  return [Number(`1e${Math.floor(Math.log10(least))}`), Math.max(high * 2, 1e-14)];
}

function alone(name, names, scale) {
  const [curve, edge] = curves(name, names, scale);
  return [curve, { ...edge, show: false }, { ...edge, show: false }];
}

export const VIEWS = { time, frequency, place };

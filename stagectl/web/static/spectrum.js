// The amplitude spectrum of rows that are equally spaced: Hann's window, without the mean, as amplitudes of sines.

export function spectrum(values, period) {
  const n = 2 ** Math.floor(Math.log2(values.length)), from = values.length - n;
  const mean = values.slice(from).reduce((sum, value) => sum + value, 0) / n;
  const re = new Float64Array(n), im = new Float64Array(n);
  for (let k = 0; k < n; k++) re[k] = (values[from + k] - mean) * (0.5 - 0.5 * Math.cos((2 * Math.PI * k) / n));
  transform(re, im);
  const frequency = [], amplitude = [];
  for (let k = 1; k < n / 2; k++) {  // the window's mean is a half, and each sine lies at both signs of its frequency
    frequency.push(k / (n * period));
    amplitude.push((4 * Math.hypot(re[k], im[k])) / n);
  }
  return { frequency, amplitude };
}

// The fast Fourier transform in place, radix 2.
function transform(re, im) {
  const n = re.length;
  for (let k = 1, j = 0; k < n; k++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (k < j) { [re[k], re[j]] = [re[j], re[k]]; [im[k], im[j]] = [im[j], im[k]]; }
  }
  for (let size = 2; size <= n; size *= 2) {
    for (let k = 0; k < size / 2; k++) {
      const c = Math.cos((2 * Math.PI * k) / size), s = -Math.sin((2 * Math.PI * k) / size);
      for (let a = k, b = k + size / 2; a < n; a += size, b += size) {
        const x = re[b] * c - im[b] * s, y = re[b] * s + im[b] * c;
        [re[b], im[b], re[a], im[a]] = [re[a] - x, im[a] - y, re[a] + x, im[a] + y];
      }
    }
  }
}

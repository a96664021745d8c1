// Decoding of the flights that colift/visualization/playback.py encodes, and interpolation between frames.

const decoded = ({ shape, float32 }) => {
  const bytes = Uint8Array.from(atob(float32), (letter) => letter.charCodeAt(0));
  return { width: shape.slice(1).reduce((n, each) => n * each, 1), values: new Float32Array(bytes.buffer) };
};

/** Returns the data of the page: geometry of the team, and all cases with their tracks as arrays. */
export function flights(text) {
  const written = JSON.parse(text);
  for (const flight of written.cases) {
    for (const [name, packed] of Object.entries(flight.tracks)) flight.tracks[name] = decoded(packed);
  }
  return written;
}

/** Stores new frames of a running simulation and its events until now. */
export function arrive(flight, { from, known, tracks, marks, stopped, t_sigma, sigma }) {
  for (const [name, packed] of Object.entries(tracks)) {
    const { width, values } = decoded(packed);
    flight.tracks[name].values.set(values, from * width);
  }
  Object.assign(flight, { known, marks, stopped });
  if (sigma) {
    flight.t_sigma = t_sigma;
    flight.tracks.sigma = decoded(sigma);
  }
}

/** Returns the time of the last available frame, s. */
export const last = ({ t, known = t.length }) => t[known - 1];

/** Returns the frame before a time and the fraction to the next frame, 0 to 1; first or last frame outside the flight. */
export function moment({ t: times, known = times.length }, t) {
  let low = 0;
  let high = known - 1;
  if (t >= times[high]) return { i: high, s: 0 };
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return { i: low, s: Math.max(0, (t - times[low]) / (times[high] - times[low])) };
}

/** Writes three numbers of a track at a moment, from column `k` on, into a vector of three.js. */
export function vector(track, { i, s }, k, into) {
  const { width, values } = track;
  const a = i * width + k;
  if (s === 0) return into.set(values[a], values[a + 1], values[a + 2]);
  const b = a + width;
  const between = (n) => values[a + n] + s * (values[b + n] - values[a + n]);
  return into.set(between(0), between(1), between(2));
}

/** Writes a rotation of a track (w, x, y, z) at a moment into a quaternion of three.js. */
export function rotation(track, { i, s }, k, into, spare) {
  const read = (at, q) => q.set(track.values[at + 1], track.values[at + 2], track.values[at + 3], track.values[at]);
  read(i * track.width + k, into);
  return s === 0 ? into : into.slerp(read((i + 1) * track.width + k, spare), s);
}

/** Returns one number of a track at a moment. */
export function number(track, { i, s }, k) {
  const a = i * track.width + k;
  return s === 0 ? track.values[a] : track.values[a] + s * (track.values[a + track.width] - track.values[a]);
}

/** Returns a column of a track as a list for a plot; null for values that are not finite. */
export function column(track, k) {
  const out = [];
  for (let at = k; at < track.values.length; at += track.width) {
    out.push(Number.isFinite(track.values[at]) ? track.values[at] : null);
  }
  return out;
}

/** Returns the norms of the three columns of a track from `k` on as a list for a plot. */
export function norms(track, k) {
  const [x, y, z] = [0, 1, 2].map((n) => column(track, k + n));
  return x.map((each, i) => (each === null || y[i] === null || z[i] === null ? null : Math.hypot(each, y[i], z[i])));
}

/** Returns the product of the conjugate of one quaternion and another one (w, x, y, z) in row i of two tracks. */
export function product(first, second, i) {
  const [a, b, c, d] = first.values.subarray(4 * i, 4 * i + 4);
  const [w, x, y, z] = second.values.subarray(4 * i, 4 * i + 4);
  return [
    a * w + b * x + c * y + d * z,
    a * x - b * w - c * z + d * y,
    a * y + b * z - c * w - d * x,
    a * z - b * y + c * x - d * w,
  ];
}

/** Returns the rotation vector of a unit quaternion (w, x, y, z), rad. */
export function rotationVector([w, x, y, z]) {
  const sine = Math.hypot(x, y, z);
  const scale = sine < 1e-12 ? 2 * Math.sign(w || 1) : (2 * Math.atan2(sine, Math.abs(w)) * Math.sign(w || 1)) / sine;
  return [scale * x, scale * y, scale * z];
}

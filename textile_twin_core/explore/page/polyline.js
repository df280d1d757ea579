// Curves as paths of few points: what a straight line shows as well is left out, to a tenth of a pixel.

const TOLERANCE = 0.1;

// A periodic curve over one turn, closed to its first value; samples that are no number leave a gap. Points go as long as
// the line to the next passes all those left out within the tolerance (Bristol's swinging door, 1990).
export function polyline(values, x, y) {
  const n = values.length, step = x(360 / n) - x(0), left = x(0);
  let d = "", px = 0, py = 0, on = false, kept = 0, low = -Infinity, high = Infinity;
  const add = (k, value) => {
    d += `${on ? "L" : "M"}${tenth(left + k * step)} ${tenth(value)}`;
    on = true;
    kept = k;
    low = -Infinity;
    high = Infinity;
  };
  let before = NaN;
  for (let k = 0; k <= n; k++) {
    const value = y(values[k % n]);
    if (!Number.isFinite(value)) {
      if (on && kept < k - 1) add(k - 1, before);
      on = false;
    } else if (!on) {
      add(k, value);
      [px, py] = [k, value];
    } else {
      const slope = (value - py) / (k - px);
      if (slope < low || slope > high) {
        add(k - 1, before);
        [px, py] = [k - 1, before];
      }
      low = Math.max(low, (value - TOLERANCE - py) / (k - px));
      high = Math.min(high, (value + TOLERANCE - py) / (k - px));
      if (k === n) add(k, value);
    }
    before = value;
  }
  return d;
}

// A closed path in the plane; points nearer than two pixels to the one before are left out.
export function loop(xs, ys, x, y) {
  let d = "", px = Infinity, py = Infinity;
  for (let k = 0; k < xs.length; k++) {
    const qx = x(xs[k]), qy = y(ys[k]);
    if (!Number.isFinite(qx) || (Math.abs(qx - px) < 2 && Math.abs(qy - py) < 2)) continue;
    d += `${d && "L"}${tenth(qx)} ${tenth(qy)}`;
    [px, py] = [qx, qy];
  }
  return d ? `M${d}Z` : "";
}

// Single measured values.
export function dots(theta, values, x, y) {
  let d = "";
  for (let k = 0; k < theta.length; k++) {
    if (Number.isFinite(values[k])) d += `M${tenth(x((theta[k] * 180) / Math.PI))} ${tenth(y(values[k]))}h0`;
  }
  return d;
}

function tenth(value) {
  return Math.round(10 * value) / 10;
}

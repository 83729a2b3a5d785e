/** Distances between two clips: per vertex at a time, and per frame, measured in small slices of time. */

/** Time [ms] that reading or measuring frames may take between two pictures. */
export const SLICE_MS = 8;

/** Return the distance of each vertex [scene units]. */
export function distances(a, b) {
  const found = new Float32Array(a.length / 3);
  for (let v = 0; v < found.length; v++) {
    const x = a[3 * v] - b[3 * v];
    const y = a[3 * v + 1] - b[3 * v + 1];
    const z = a[3 * v + 2] - b[3 * v + 2];
    found[v] = Math.sqrt(x * x + y * y + z * z);  // Math.hypot is many times slower
  }
  return found;
}

/** Return the largest value and its index. */
export function findLargest(values) {
  let place = 0;
  for (let k = 1; k < values.length; k++) if (values[k] > values[place]) place = k;
  return { value: values[place] ?? 0, place };
}

export class FrameErrors {
  /** `measure(time)` returns the errors of all elements. */
  constructor(times, measure) {
    Object.assign(this, { times, measure });
    this.most = new Float64Array(times.length);
    this.rms = new Float64Array(times.length);
    this.count = 0;
    this.worst = { value: 0, element: 0, frame: 0 };
  }

  get isDone() {
    return this.count === this.most.length;
  }

  /** Measure more frames until the time slice is used up. */
  step() {
    const until = performance.now() + SLICE_MS;
    while (!this.isDone && performance.now() < until) {
      const frame = this.count++;
      const found = this.measure(this.times[frame]);
      const { value, place } = findLargest(found);
      this.most[frame] = value;
      this.rms[frame] = Math.sqrt(found.reduce((sum, own) => sum + own * own, 0) / Math.max(found.length, 1));
      if (value > this.worst.value) this.worst = { value, element: place, frame };
    }
  }

  /** The largest error so far, as the scale of charts and colours. */
  get scale() {
    return this.worst.value || 1;
  }
}

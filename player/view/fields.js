/** Fields on the page: what there is to choose, values and ranges, and which row each drawn vertex shows. */
import { COLORMAPS, countRowsBefore, reduceRows, rowsOfDrawn, runsOf, splitsVertices } from "pdeanim/fields.js";
import { listTriangleCorners } from "pdeanim/mesh.js";
import { listVertices } from "pdeanim/motion.js";

/** Colours at equal distances along a range. */
export const MAPS = {
  error: ["#29459e", "#219e99", "#fad44a", "#d62629"],
  sequential: COLORMAPS.viridis,
  diverging: COLORMAPS.coolwarm,
};

/** Smallest share of the range on the other side of zero for which colours diverge about zero: less is noise. */
const MIN_SHARE_BEYOND_ZERO = 0.02;

/** Time [ms] that may go into measuring the range of a component when it is chosen. */
const RANGE_MS = 200;

/** Largest number of components that are listed one by one. */
const MAX_LISTED_COMPONENTS = 12;

const COMPONENT_NAMES = { 2: "x y", 3: "x y z", 6: "xx yy zz xy yz zx", 9: "xx xy xz yx yy yz zx zy zz" };

/** Return the names of components, in order. */
export function componentNames(count) {
  return COMPONENT_NAMES[count]?.split(" ") ?? Array.from({ length: count }, (_, k) => `component ${k + 1}`);
}

/**
 * List what can be shown: each field, or of several components the magnitude and each component. Cells are not drawn
 * themselves, so their fields are left out.
 */
export function listChoices(animation) {
  const shown = [...runsOf(animation)].flatMap((run) => run.fieldList.filter(({ domain }) => domain !== "cells"));
  const fields = new Map(shown.map((field) => [field.name, field]));
  return [...fields.values()].flatMap(({ name, components }) => {
    if (components === 1) return [{ name, component: 0, label: name }];
    const parts = componentNames(components).slice(0, components > MAX_LISTED_COMPONENTS ? 0 : components);
    return [
      { name, component: null, label: `${name}, magnitude` },
      ...parts.map((part, component) => ({ name, component, label: `${name} ${part}` })),
    ];
  });
}

/**
 * Return which row of a field each drawn vertex shows, -1 for none, and the first row of each object. `isSplit`: drawn
 * vertices are the corners of triangles, in the order of `trianglesOf`.
 */
function listRows(run, field) {
  const isSplit = splitsVertices(field);
  const rows = run.objects.map((object, index) => {
    const corners = isSplit ? listTriangleCorners(object) : null;
    return rowsOfDrawn(field, run, index, corners ?? listVertices(object), corners);
  });
  const all = new Int32Array(rows.reduce((sum, { length }) => sum + length, 0));
  let at = 0;
  for (const own of rows) {
    all.set(own, at);
    at += own.length;
  }
  return { rows: all, starts: rows.map((_, index) => countRowsBefore(run, field, index)), isSplit };
}

/** One choice of `listChoices` as it is shown. */
export class ShownField {
  #rows = new Map();

  constructor(clip, { name, component, label }) {
    Object.assign(this, { clip, animation: clip.animation, name, component, label, low: Infinity, high: -Infinity });
    const fields = [...runsOf(clip.animation)].map((run) => this.#in(run)).filter(Boolean);
    [{ unit: this.unit, components: this.components, domain: this.domain, type: this.type }] = fields;
    this.bound = Math.max(...fields.map((field) => field.bound));
    if (this.components === 1) for (const { smallest, largest } of fields) this.#widen([smallest, largest]);
    else this.#measure();
  }

  #in(run) {
    return run.fieldList.find((field) => field.name === this.name);
  }

  /** The description in the run that is shown at a time; undefined if that run does not have the field. */
  at(time) {
    return this.#in(this.animation.at(time));
  }

  /** Widen the range by frames in the middle of those before, as far as time allows. */
  #measure() {
    const until = performance.now() + RANGE_MS;
    const { times } = this.animation;
    for (let parts = 1; parts <= 2 * times.length; parts *= 2) {
      for (let k = parts === 1 ? 0 : 1; k <= parts; k += parts === 1 ? 1 : 2) {
        this.values(this.clip, times[Math.round((k / parts) * (times.length - 1))]);
        if (performance.now() > until && k) return;
      }
    }
  }

  #widen(values) {
    for (const value of values) {
      if (!Number.isFinite(value)) continue;
      if (value < this.low) this.low = value;
      if (value > this.high) this.high = value;
    }
  }

  /** One number for each row at a time; null if there are none. */
  values(clip, time) {
    const raw = clip.field(this.name, time);
    if (!raw) return null;
    const found = reduceRows(raw, this.components, this.component);
    if (this.components > 1) this.#widen(found);
    return found;
  }

  /** The difference of each row between two clips at a time: of the component, or the largest of all. */
  errors(first, second, time) {
    const [a, b] = [first.field(this.name, time), second.field(this.name, time)];
    const { components, component } = this;
    const found = new Float32Array(a.length / components);
    for (let row = 0; row < found.length; row++) {
      for (let k = component ?? 0; k < (component === null ? components : component + 1); k++) {
        const at = row * components + k;
        const error = Math.abs(Number(a[at]) - Number(b[at]));
        if (error > found[row]) found[row] = error;  // false for NaN
      }
    }
    return found;
  }

  /** The colours of the range: its map, and the values at its two ends. */
  get scale() {
    const [low, high] = this.low <= this.high ? [this.low, this.high] : [0, 1];
    const most = Math.max(Math.abs(low), Math.abs(high));
    const isAround = low < 0 && high > 0 && Math.min(-low, high) >= MIN_SHARE_BEYOND_ZERO * most;
    return isAround ? { map: "diverging", low: -most, high: most } : { map: "sequential", low, high };
  }

  /** Which row each drawn vertex of a run shows. */
  rows(time) {
    const run = this.animation.at(time);
    if (!this.#rows.has(run)) this.#rows.set(run, listRows(run, this.#in(run)));
    return this.#rows.get(run);
  }
}

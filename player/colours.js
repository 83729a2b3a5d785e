/** Colours of a field for three.js. */
import { Color, SRGBColorSpace } from "three";

import { PdeanimError } from "./errors.js";
import { COLORMAPS, reduceRows, runsOf, splitsVertices } from "./fields.js";

const STEPS = 256;

/** Colour of vertices without a value, and where it is not a number. */
const WITHOUT_VALUE = "#808080";

/** Return red, green and blue of STEPS colours and then of WITHOUT_VALUE, in three.js's working colour space. */
function tabulate(colormap) {
  const names = typeof colormap === "string" ? COLORMAPS[colormap] : colormap;
  if (!names?.length) {
    const known = Object.keys(COLORMAPS).join(", ");
    throw new PdeanimError(`there is no colour map "${colormap}"; there are ${known}, or a list of colours`, "argument");
  }
  const stops = names.map((name) => new Color(name).getRGB({}, SRGBColorSpace));
  const table = new Float32Array(3 * (STEPS + 1));
  const color = new Color();
  for (let step = 0; step < STEPS; step++) {
    const place = (step / (STEPS - 1)) * (stops.length - 1);
    const [a, b] = [stops[Math.floor(place)], stops[Math.ceil(place)]];
    const mix = (axis) => a[axis] + (b[axis] - a[axis]) * (place % 1);
    color.setRGB(mix("r"), mix("g"), mix("b"), SRGBColorSpace).toArray(table, 3 * step);
  }
  new Color(WITHOUT_VALUE).toArray(table, 3 * STEPS);
  return table;
}

/** Return a field's description in the first run that has it. */
function describe(animation, name) {
  for (const run of runsOf(animation)) {
    const found = run.fieldList.find((field) => field.name === name);
    if (found) return found;
  }
  throw new PdeanimError(`there is no field "${name}"`, "argument");
}

/** A field as `DeformingGroup.setField` shows it. */
export class FieldColours {
  constructor(animation, name, { colormap = "viridis", range, component = null } = {}) {
    const { components, smallest, largest } = describe(animation, name);
    if (component !== null && !(component >= 0 && component < components)) {
      throw new PdeanimError(`field "${name}" has no component ${component}`, "argument");
    }
    const isMagnitude = components > 1 && component === null;
    this.name = name;
    this.component = isMagnitude ? null : (component ?? 0);
    this.range = range ?? (isMagnitude ? [0, Math.max(Math.abs(smallest), Math.abs(largest))] : [smallest, largest]);
    this.table = colormap === null ? null : tabulate(colormap);
  }

  /** The field's description in a run of frames; undefined if the run lacks it. */
  in(run) {
    return run.fieldList.find((field) => field.name === this.name);
  }

  /** Whether faces that share a vertex may differ there, so that each corner of a triangle needs a vertex of its own. */
  splits(run) {
    return splitsVertices(this.in(run));
  }

  /** The geometry's attribute to fill, and its numbers per vertex: colours, or without a colour map the values. */
  get attribute() {
    return this.table ? { name: "color", size: 3 } : { name: "field", size: 1 };
  }

  /** Return one number for each row of a run at a time: the component, or the magnitude of all. */
  values(run, time) {
    return reduceRows(run.field(this.name, time), this.in(run).components, this.component);
  }

  /** Fill an attribute: `rows` has the row of each vertex, or -1. */
  fill(array, values, rows) {
    const { table } = this;
    const [low, high] = this.range;
    for (let k = 0; k < rows.length; k++) {
      const value = rows[k] < 0 ? NaN : values[rows[k]];
      if (!table) {
        array[k] = value;
        continue;
      }
      const share = high > low ? (value - low) / (high - low) : value < low ? 0 : 1;
      const step = Number.isNaN(value) ? STEPS : Math.round(Math.min(Math.max(share, 0), 1) * (STEPS - 1));
      for (let axis = 0; axis < 3; axis++) array[3 * k + axis] = table[3 * step + axis];
    }
  }
}

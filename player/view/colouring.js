/** What colours stand for: nothing, patches, the distance from another clip, a field or its error. */
import { trianglesOf } from "pdeanim/mesh.js";

import { distances, FrameErrors } from "pdeanim/view/errors.js";
import { listChoices, ShownField } from "pdeanim/view/fields.js";

const PLAIN = [["plain", "one colour"], ["patches", "by patch or curve"]];

/** Singular of the elements of a domain. */
export const ELEMENTS = { vertices: "vertex", faces: "face", corners: "corner", object: "object" };

export class Colouring {
  /** Errors of positions, null without another clip of the same vertices. */
  distances = null;
  /** The field that is shown, null if colours stand for something else. */
  shown = null;
  /** Errors that charts and colours show: of the shown field, if the other clip has it, else of positions. */
  errors = null;
  isOfField = false;

  constructor(first) {
    this.first = first;
    this.choices = listChoices(first.animation);
  }

  /** Compare with another clip of the same vertices. */
  compare(second) {
    const { first } = this;
    this.second = second;
    this.distances = new FrameErrors(first.animation.times, (time) => distances(first.positions(time), second.positions(time)));
    this.errors = this.distances;
  }

  /** Pairs of a value and a text for a select element. */
  get options() {
    const fields = this.choices.map(({ label }, index) => [`field${index}`, label]);
    return [...PLAIN, ...(this.distances ? [["error", "by error"]] : []), ...fields];
  }

  choose(value, time) {
    const { first, second, choices } = this;
    this.value = value;
    this.shown = value.startsWith("field") ? new ShownField(first, choices[Number(value.slice(5))]) : null;
    const { shown } = this;
    const [own, other] = [first, second].map((clip) => shown && this.distances && clip.field(shown.name, time));
    this.isOfField = Boolean(own && own.length === other?.length);
    this.errors = this.isOfField
      ? new FrameErrors(first.animation.times, (at) => shown.errors(first, second, at))
      : this.distances;
  }

  /** The clip whose values of the shown field are compared, null if there is none. */
  get other() {
    return this.isOfField ? this.second : null;
  }

  /** What errors are measured of. */
  get caption() {
    return this.isOfField ? `Error of ${this.shown.label} against` : "Distance from";
  }

  /** Word for the elements that errors are measured at. */
  get element() {
    return this.isOfField ? ELEMENTS[this.shown.domain] : "vertex";
  }

  /** A vertex where an element that errors are measured at is drawn, null if it is not drawn. */
  vertexOf(element, time) {
    if (!this.isOfField) return element;
    const { rows, isSplit } = this.shown.rows(time);
    const drawn = rows.indexOf(element);
    if (drawn < 0 || !isSplit) return drawn < 0 ? null : drawn;
    return trianglesOf(this.first.animation.at(time).objects).triangles[drawn];
  }

  /**
   * Give the models of clips the values that colours stand for at a time. Return a description: `clips` that are
   * coloured, map, range, title and notes for the legend, whether values are of corners (`isSplit`), and whether some
   * elements have none; or null.
   */
  apply(view, drawn, time) {
    const { first, shown, errors } = this;
    const isError = errors && (view === "change" ? this.isOfField || !shown : this.value === "error");
    if (!isError && !shown) return null;
    const place = isError && !this.isOfField ? { rows: null, isSplit: false } : this.#rows(time);
    const clips = isError ? [first] : drawn;
    const values = clips.map((clip) => (isError ? errors.measure(time) : shown.values(clip, time)));
    const scale = isError ? this.#errorScale() : { ...shown.scale, title: withUnit(shown.label, shown.unit), notes: [] };
    clips.forEach((clip, k) => {
      if (clip.model.setValues(values[k], scale, place.rows, place.isSplit)) clip.show(time);
    });
    const isMissing = place.rows?.some((row) => row < 0) || values.some((own) => !own?.every(Number.isFinite));
    return { clips, ...scale, isSplit: place.isSplit, isMissing };
  }

  /** Rows of drawn vertices; none where the run that is shown does not have the field. */
  #rows(time) {
    if (this.shown.at(time)) return this.shown.rows(time);
    return { rows: new Int32Array(this.first.animation.at(time).vertexCount).fill(-1), isSplit: false };
  }

  /** From 0 to the bound of the field, or to the largest error so far. */
  #errorScale() {
    const { errors, shown } = this;
    if (!this.isOfField) return { map: "error", low: 0, high: errors.scale, title: "distance", notes: [] };
    const isBound = shown.bound > 0 && errors.worst.value <= shown.bound;
    const title = withUnit(`error of ${shown.label}`, shown.unit);
    return { map: "error", low: 0, high: isBound ? shown.bound : errors.scale, title, notes: isBound ? ["right end: the bound"] : [] };
  }
}

const withUnit = (text, unit) => (unit ? `${text} [${unit}]` : text);

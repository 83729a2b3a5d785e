/** Values of the shown field that the page says: under the pointer, and of the picked element over time. */
import { reduceRows } from "pdeanim/fields.js";

import { ELEMENTS } from "pdeanim/view/colouring.js";
import { SLICE_MS } from "pdeanim/view/errors.js";
import { componentNames } from "pdeanim/view/fields.js";
import { formatNumber, TimeChart } from "pdeanim/view/panel.js";

/** Movement [pixels] between pressing and releasing that still is a click. */
const CLICK_REACH = 5;

/** A row of a field, as the page names it. */
export class Element {
  /** @param {{ object: number, vertex: number, corner: number }} hit what was found under the pointer */
  constructor(shown, time, { object, vertex, corner }) {
    const { rows, starts, isSplit } = shown.rows(time);
    const run = shown.animation.at(time);
    const row = isSplit && corner < 0 ? -1 : rows[isSplit ? corner : vertex];
    Object.assign(this, { shown, run, vertex, row });
    const { name } = run.object(object);
    const number = row < 0 ? `vertex ${vertex}` : `${ELEMENTS[shown.domain]} ${row - starts[object]}`;
    this.name = shown.domain === "object" ? name : run.objectCount > 1 ? `${number} of ${name}` : number;
  }

  /** The value at a time, NaN if there is none; the components of a magnitude in `parts`. */
  valueAt(clip, time) {
    const { shown, row } = this;
    const raw = row >= 0 && shown.animation.at(time) === this.run && clip.field(shown.name, time);
    if (!raw) return { value: NaN, parts: [] };
    const own = raw.subarray(row * shown.components, (row + 1) * shown.components);
    return { value: reduceRows(own, shown.components, shown.component)[0], parts: shown.component === null ? [...own] : [] };
  }

  /** Lines that tell its value at a time, and the error where there is another clip. */
  describe(time, first, other) {
    const { shown } = this;
    const withUnit = (value) => (Number.isNaN(value) ? "no value" : `${formatNumber(value)} ${shown.unit}`.trim());
    const { value, parts } = this.valueAt(first, time);
    const lines = [`${shown.label}: ${withUnit(value)}`];
    if (parts.length) {
      const names = componentNames(parts.length);
      lines.push(parts.map((part, k) => `${names[k]} ${formatNumber(Number(part))}`).join(", "));
    }
    if (other) lines.push(`error: ${withUnit(shown.errors(first, other, time)[this.row] ?? NaN)}`);
    return [...lines, this.name];
  }
}

/** The picked element over time, read in small slices of time. */
export class History {
  count = 0;

  constructor(svg, element, first, other, seek) {
    const { animation } = element.shown;
    const names = other?.animation ? ["A", "B"] : other ? ["decoded", "original"] : [element.shown.unit];
    const others = other ? [{ clip: other, name: names[1], colour: "var(--second)" }] : [];
    Object.assign(this, { element, times: animation.times, chart: new TimeChart(svg, animation, seek) });
    this.series = [...others, { clip: first, name: names[0], colour: "var(--accent)" }];
    for (const own of this.series) own.values = new Float64Array(this.times.length);
  }

  get isDone() {
    return this.count === this.times.length;
  }

  step() {
    const until = performance.now() + SLICE_MS;
    for (; !this.isDone && performance.now() < until; this.count++) {
      const time = this.times[this.count];
      for (const { clip, values } of this.series) values[this.count] = this.element.valueAt(clip, time).value;
    }
  }

  draw(time) {
    const { count } = this;
    let [low, high] = [Infinity, -Infinity];
    for (const { values } of this.series) {
      for (let frame = 0; frame < count; frame++) {
        if (values[frame] < low) low = values[frame];
        if (values[frame] > high) high = values[frame];
      }
    }
    const range = low <= high ? { low, high, lowText: formatNumber(low), highText: low < high ? formatNumber(high) : "" } : { low: 0, high: 1 };
    this.chart.draw(this.series.map((own) => ({ ...own, count })), time, range);
  }
}

/** Call `hover(point or null)` as the pointer moves, and `click(point)`; points are in pixels of an element. */
export function followPointer(element, hover, click) {
  let pressed = null;
  const at = ({ offsetX, offsetY }) => ({ x: offsetX, y: offsetY });
  element.addEventListener("pointerdown", (event) => (pressed = at(event)));
  element.addEventListener("pointermove", (event) => hover(event.buttons ? null : at(event)));
  element.addEventListener("pointerleave", () => hover(null));
  element.addEventListener("pointerup", (event) => {
    const { x, y } = at(event);
    if (pressed && Math.hypot(x - pressed.x, y - pressed.y) <= CLICK_REACH) click({ x, y });
  });
}

/** Show lines next to a point of a box; nothing without lines. */
export function showNextTo(output, lines, point, { clientWidth, clientHeight }) {
  output.hidden = !lines;
  if (!lines) return;
  output.replaceChildren(...lines.map((text) => Object.assign(document.createElement("span"), { textContent: text })));
  const inside = (at, size, own) => `${Math.max(Math.min(at + 14, size - own - 4), 4)}px`;
  output.style.left = inside(point.x, clientWidth, output.offsetWidth);
  output.style.top = inside(point.y, clientHeight, output.offsetHeight);
}

/** Tables, the error chart, and the frame marks under the time slider. */
import { findFrame } from "pdeanim/motion.js";

import { MAPS } from "pdeanim/view/fields.js";

const SECTION_NAMES = {
  SEQN: "times, names",
  NAME: "names of objects",
  CONN: "faces and lines",
  SOLD: "cells",
  ORDR: "order of faces and vertices",
  REST: "reference frame",
  MODL: "model",
  GRUP: "table of groups",
  TIME: "functions of time",
  COEF: "coefficients",
  CORR: "corrections",
  ATTR: "attributes",
  META: "remarks",
  FLDS: "headers of fields",
  FDAT: "values of fields",
  RFLD: "fields of runs",
  RUNS: "table of runs",
  RDAT: "runs of frames",
  SCEN: "scene",
};

const SVG = "http://www.w3.org/2000/svg";

/** Smallest gap between two frame marks [pixels]; denser marks would merge into a grey band. */
const MIN_MARK_GAP = 4;

export function formatBytes(bytes) {
  const units = ["bytes", "kB", "MB", "GB"];
  const power = Math.min(Math.floor(Math.log10(Math.max(bytes, 1)) / 3), 3);
  return `${power ? (bytes / 1000 ** power).toPrecision(3) : bytes} ${units[power]}`;
}

/** Format a value with four digits; whole numbers as they are. */
export const formatNumber = (value) => {
  if (!Number.isFinite(value)) return "none";
  return String(Number.isInteger(value) && Math.abs(value) < 1e9 ? value : Number(value.toPrecision(4)));
};

export const formatLength = (value) => String(Number(value.toPrecision(3)));

function row(cells) {
  const found = document.createElement("tr");
  for (const cell of cells) {
    const box = found.insertCell();
    if (cell instanceof Node) box.append(cell);
    else box.textContent = cell;
  }
  return found;
}

export function showFacts(table, animation) {
  const run = animation.at(animation.start);
  const sum = (key) => run.objects.reduce((total, object) => total + object[key].length, 0);
  const functions = run.groups.map((group) => group.functionCount);
  const rows = [
    ["objects", run.objectCount],
    ["vertices", animation.runCount > 1 ? `at most ${animation.vertexCount}` : animation.vertexCount],
    ["faces", sum("faceSizes")],
    ["lines", sum("lineSizes")],
    ["frames", `${animation.frameCount} at ${Number(animation.frameRate.toPrecision(6))} per second`],
    ["seconds", formatSeconds(animation, animation.end - animation.start)],
    ["runs of frames, each with its own faces", animation.runCount],
    ["groups of frames", run.groupCount],
    ["functions of time per group", [...new Set([Math.min(...functions), Math.max(...functions)])].join(" to ")],
    ["fields", run.fieldList.map((field) => field.name).join(", ")],
    ["attributes", [...new Set(run.objects.flatMap((_, k) => run.attributes(k).map((own) => own.name)))].join(", ")],
  ];
  const shown = rows.filter(([, value]) => value && !(value === 1 && rows.length > 3));
  table.replaceChildren(...shown.map(([name, value]) => row([name, String(value)])));
}

export function showBytes(table, animations) {
  const rows = [];
  for (const { animation, name } of animations) {
    if (animations.length > 1) rows.push(row([name, "", formatBytes(animation.fileSize)]));
    const sections = animation.sections.map(({ type, length }) => [SECTION_NAMES[type] ?? type, length]);
    const rest = animation.fileSize - sections.reduce((sum, [, length]) => sum + length, 0);
    for (const [what, length] of [...sections, ["headers", rest]].sort((a, b) => b[1] - a[1])) {
      if (!length) continue;
      const bar = document.createElement("i");
      bar.style.width = `${(100 * length) / animation.fileSize}%`;
      const made = row([what, bar, formatBytes(length)]);
      made.cells[1].className = "share";
      rows.push(made);
    }
  }
  table.replaceChildren(...rows);
}

/** Mark frames, with longer marks where groups (or runs) begin. */
export function drawTicks(canvas, animation, colour) {
  const scale = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = width * scale;
  canvas.height = height * scale;
  const context = canvas.getContext("2d");
  context.scale(scale, scale);
  context.fillStyle = colour;
  const { times, start, end } = animation;
  const edge = 8;  // half the width of the slider's thumb
  const place = (time) => edge + ((time - start) / (end - start || 1)) * (width - 2 * edge);
  const run = animation.at(start);
  const starts = new Set(
    animation.runCount > 1
      ? Array.from({ length: animation.runCount }, (_, index) => animation.firstFrameOfRun(index))
      : run.groups.map((group) => group.firstFrame),
  );
  const every = Math.max(1, Math.ceil((MIN_MARK_GAP * times.length) / width));
  for (let frame = 0; frame < times.length; frame++) {
    const isStart = starts.has(frame);
    if (frame % every && !isStart) continue;
    context.fillRect(Math.round(place(times[frame])), height - (isStart ? 10 : 5), 1, isStart ? 10 : 5);
  }
}

function element(name, attributes, text) {
  const found = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) found.setAttribute(key, value);
  if (text !== undefined) found.textContent = text;
  return found;
}

/** Width [pixels] of the numbers on the left of a chart. */
const CHART_LEFT = 52;

/** A chart of numbers per frame, with the current time; a click goes to a time. */
export class TimeChart {
  constructor(svg, animation, seek) {
    Object.assign(this, { svg, animation });
    svg.onclick = (event) => {
      const box = svg.getBoundingClientRect();
      const share = (event.clientX - box.left - CHART_LEFT) / (box.width - CHART_LEFT);
      seek(animation.start + Math.min(Math.max(share, 0), 1) * (animation.end - animation.start));
    };
  }

  /** Draw series `{ name, values, count, colour }`, the first `count` values of each, in a range with its two texts. */
  draw(series, time, { low, high, lowText, highText }) {
    const { svg, animation } = this;
    const [width, height] = [svg.clientWidth || 300, svg.clientHeight || 140];
    const bottom = height - 18;
    const x = (at) => CHART_LEFT + ((at - animation.start) / (animation.end - animation.start || 1)) * (width - CHART_LEFT - 2);
    const y = (value) => bottom - ((value - low) / (high - low || 1)) * (bottom - 8);
    const text = { fill: "var(--quiet)", "font-size": 11 };
    const drawn = [element("line", { x1: CHART_LEFT, x2: width, y1: bottom, y2: bottom, stroke: "var(--edge)" })];
    let left = CHART_LEFT;
    for (const { name, values, count, colour } of series) {
      let command = "M";
      let path = "";
      for (let frame = 0; frame < count; frame++) {
        const isThere = Number.isFinite(values[frame]);
        if (isThere) path += `${command}${x(animation.times[frame]).toFixed(1)},${y(values[frame]).toFixed(1)}`;
        command = isThere ? "L" : "M";
      }
      drawn.push(element("path", { d: path, fill: "none", "stroke-width": 1.5, stroke: colour }));
      drawn.push(element("text", { ...text, x: left, y: height - 3, fill: colour }, name));
      left += 8 + 6.5 * name.length;
    }
    svg.replaceChildren(
      ...drawn,
      element("text", { ...text, x: 0, y: 14 }, highText),
      element("text", { ...text, x: 0, y: bottom }, lowText),
      element("line", { x1: x(time), x2: x(time), y1: 0, y2: bottom, stroke: "var(--text)", "stroke-dasharray": "2 3" }),
    );
  }
}

/** Draw the largest and the root mean square error per frame. */
export function drawErrors(chart, errors, time) {
  const { count, scale } = errors;
  const series = [
    { name: "largest", values: errors.most, count, colour: "var(--second)" },
    { name: "root mean square", values: errors.rms, count, colour: "var(--accent)" },
  ];
  chart.draw(series, time, { low: 0, high: scale, lowText: "0", highText: formatLength(scale) });
}

/** Show a map of colours with its two ends and its middle. */
export function showLegend(legend, { title, map, low, high, notes }) {
  const ramp = document.createElement("i");
  ramp.style.background = `linear-gradient(90deg, ${MAPS[map].join(", ")})`;
  const line = (texts) => {
    const found = document.createElement("div");
    for (const text of texts) found.append(Object.assign(document.createElement("span"), { textContent: text }));
    return found;
  };
  const ends = [low, (low + high) / 2, high].map(formatNumber);
  legend.replaceChildren(line([title]), ramp, line(ends), ...notes.map((note) => line([note])));
}

/** Format seconds so that frames differ: three decimals, more where frames are closer. */
export function formatSeconds({ times, start, end }, time) {
  const gap = (end - start) / Math.max(times.length - 1, 1) || 1;
  return time.toFixed(Math.min(Math.max(3, 2 - Math.floor(Math.log10(gap))), 12));
}

/** Format a time: "1.250 s, frame 30.00 of 48". */
export function formatTime(animation, time) {
  const { times } = animation;
  const frame = findFrame(times, time);
  const gap = (times[frame + 1] ?? times[frame]) - times[frame];
  const share = gap ? Math.min(Math.max((time - times[frame]) / gap, 0), 1) : 0;
  return `${formatSeconds(animation, time)} s, frame ${(frame + share).toFixed(2)} of ${times.length - 1}`;
}

/** Convert a colour such as "#8fa9c9" to numbers from 0 to 1. */
export function parseColour(text) {
  const digits = text.length === 4 ? [...text.slice(1)].map((digit) => digit + digit) : text.slice(1).match(/../g);
  return digits.map((digit) => parseInt(digit, 16) / 255);
}

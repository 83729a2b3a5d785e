/** The page of the viewer: opens the embedded clips, plays them and handles the controls. */
import { compile, PdeAnimation } from "pdeanim";
import { findFrame } from "pdeanim/motion.js";

import { OrbitCamera } from "pdeanim/view/camera.js";
import { decodeBase64, Clip, Original, gunzip } from "pdeanim/view/clip.js";
import { Colouring } from "pdeanim/view/colouring.js";
import { findLargest } from "pdeanim/view/errors.js";
import { handleKey, listKeys } from "pdeanim/view/keys.js";
import * as panel from "pdeanim/view/panel.js";
import { pick } from "pdeanim/view/picking.js";
import { Stage } from "pdeanim/view/stage.js";
import { Element, followPointer, History, showNextTo } from "pdeanim/view/values.js";

const SPEEDS = [0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 4];

/** Shortest and longest clip [s] that plays in real time at first; simulations of milliseconds or days do not. */
const REAL_TIME_SECONDS = [0.5, 120];

/** Time [s] in which other clips play. */
const FITTED_SECONDS = 6;
const SHADINGS = { smooth: "smooth", flat: "flat", edges: "smooth with edges", wireframe: "wireframe" };

/** Names of the views of two clips; A is the first clip, B the second. */
const VIEWS = { side: "side by side", a: "A only", b: "B only", over: "B as a wireframe over A", change: "A coloured by error" };

/** Number of times in a group of frames at which the extent of the mesh is sampled. */
const EXTENT_STEPS = 6;

const byId = (id) => document.getElementById(id);

class App {
  time = 0;
  isPlaying = false;
  object = null;
  frames = 0;
  pointer = null;
  history = null;

  async start(data) {
    const canvas = byId("canvas");
    this.gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("this browser does not support WebGL 2; try another one");
    await compile(data.wasm && (await gunzip(await decodeBase64(data.wasm))));
    this.stage = new Stage(this.gl);
    this.clips = [];
    for (const { name, data: text, address } of data.clips) {
      const animation = await PdeAnimation.open(text ? await decodeBase64(text) : await this.#fetched(address));
      this.clips.push(new Clip(this.gl, animation, name));
    }
    const [first] = this.clips;
    this.first = first;
    this.animation = first.animation;
    this.second = this.clips[1] ?? null;
    this.camera = new OrbitCamera();
    this.up = data.up;
    this.time = this.animation.start;
    this.colouring = new Colouring(first);
    this.#setUpControls(data);
    first.show(this.time);
    this.fit();
    this.#resize();
    this.#draw();
    this.gl.finish();
    this.firstFrame = performance.now();
    if (data.original) await this.#takeOriginal(data.original);
    if (this.second) this.#compare();
    if (this.colouring.choices.length && (!this.second || this.second.isStill)) this.#choose("field0");
    this.#showTables();
    new ResizeObserver(() => this.#resize()).observe(byId("stage"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#resize());
    this.play();
    requestAnimationFrame((now) => this.#tick(now));
  }

  async #fetched(address) {
    const response = await fetch(address);
    if (!response.ok) throw new Error(`${address}: the server answered ${response.status}`);
    return response.arrayBuffer();
  }

  /** Errors that are shown: of positions, or of a field. */
  get errors() {
    return this.colouring.errors;
  }

  async #takeOriginal({ name, step, data, fields }) {
    const unpacked = async (text) => new Int16Array(await gunzip(await decodeBase64(text)));
    const own = new Map();
    for (const field of fields) own.set(field.name, { step: field.step, differences: field.data && (await unpacked(field.data)) });
    this.second = new Original(this.gl, this.first, { name, step, differences: await unpacked(data), fields: own });
  }

  #compare() {
    const [a, b] = [this.animation, this.second.animation ?? this.animation];
    if (a.runCount > 1 || b.runCount > 1 || a.vertexCount !== b.vertexCount) {
      this.say("no distances: the two clips have different vertices");
    } else {
      this.colouring.compare(this.second);
      this.chart = new panel.TimeChart(byId("chart"), a, (time) => this.seek(time));
      byId("errors").hidden = false;
      byId("go").onclick = () => this.halt(a.times[this.errors.worst.frame]);
      byId("other").textContent = this.second.name;
    }
    byId("comparing").hidden = false;
    if (!this.errors) byId("compare").querySelector('[value="change"]').remove();
    this.#listColours();
    byId("compare").value = this.errors ? "change" : "side";
  }

  #listColours() {
    const select = this.#option("colour", this.colouring.options, byId("colour").value || "plain");
    select.onchange = () => this.#choose(select.value);
    this.colouring.choose(select.value, this.time);
  }

  /** Choose what colours stand for. */
  #choose(value) {
    byId("colour").value = value;
    this.colouring.choose(value, this.time);
    byId("what").textContent = this.colouring.caption;
    byId("values").hidden = !this.colouring.shown;
    this.#pick(null);
    this.#draw();
  }

  /** Fill a select element with (value, text) pairs. */
  #option(id, choices, chosen) {
    const select = byId(id);
    const before = chosen ?? select.value;
    select.replaceChildren(...choices.map(([value, text]) => new Option(text, value)));
    if (before) select.value = before;
    select.onchange = () => this.#draw();
    return select;
  }

  #setUpControls(data) {
    const { animation } = this;
    const time = byId("time");
    [time.min, time.max, time.value] = [animation.start, animation.end, animation.start];
    time.addEventListener("input", () => {
      this.pause();
      this.seek(Number(time.value));
    });
    byId("play").onclick = () => (this.isPlaying ? this.pause() : this.play());
    const fitted = (animation.end - animation.start) / FITTED_SECONDS;
    const isRealTime = !fitted || fitted * FITTED_SECONDS >= REAL_TIME_SECONDS[0] && fitted * FITTED_SECONDS <= REAL_TIME_SECONDS[1];
    const speeds = SPEEDS.map((speed) => [speed, `${speed} ×`]);
    if (!isRealTime) speeds.push([fitted, `in ${FITTED_SECONDS} s`]);
    this.#option("speed", speeds, isRealTime ? "1" : String(fitted));
    this.#option("shading", Object.entries(SHADINGS));
    this.#listColours();
    this.#option("compare", Object.entries(VIEWS));
    const names = animation.at(animation.start).objects.map((object, index) => [index, object.name]);
    const isOne = names.length < 2 || animation.runCount > 1;
    const object = this.#option("object", [["all", "all"]]);
    if (!isOne) object.append(...names.map(([index, name]) => new Option(name, index)));
    object.onchange = () => {
      this.object = object.value === "all" ? null : Number(object.value);
      this.fit();
      this.#draw();
    };
    this.camera.follow(byId("canvas"), () => this.#draw());
    const hover = (point) => {
      this.pointer = point;
      if (!this.isPlaying) this.#showUnder();
    };
    followPointer(byId("canvas"), hover, (point) => {
      this.pointer = point;
      this.#pick(this.elementAt(point));
      this.#draw();
    });
    document.addEventListener("keydown", (event) => handleKey(this, event));
    const { length } = data.clips;
    byId("summary").textContent = `${animation.frameCount} frames, ${panel.formatBytes(this.animation.fileSize)}${
      length > 1 ? ` against ${panel.formatBytes(this.clips[1].animation.fileSize)}` : ""
    }`;
    listKeys(byId("keys"));
  }

  /** Return the element of the shown field at a point of the canvas [pixels], null if there is none. */
  elementAt({ x, y }) {
    const { shown } = this.colouring;
    if (!shown?.at(this.time)) return null;
    const { clientWidth, clientHeight: height } = byId("canvas");
    const width = this.#view() === "side" ? clientWidth / 2 : clientWidth;
    const clip = x > width || this.#view() === "b" ? this.second : this.first;
    const place = { x: x > width ? x - width : x, y, width, height };
    const hit = pick(this.animation.at(this.time), clip.positions(this.time), this.camera, place, this.object);
    return hit && new Element(shown, this.time, hit);
  }

  #showUnder() {
    const element = this.pointer && this.elementAt(this.pointer);
    const lines = element && element.describe(this.time, this.first, this.colouring.other);
    showNextTo(byId("under"), lines, this.pointer, byId("canvas"));
  }

  #pick(element) {
    const { other, shown } = this.colouring;
    this.history = element && new History(byId("history"), element, this.first, other, (time) => this.seek(time));
    byId("history").toggleAttribute("hidden", !element);
    byId("picked").textContent = element ? `${shown.label} of ${element.name}` : "Click the mesh for a value over time";
  }

  #view() {
    return this.second ? byId("compare").value : "a";
  }

  #showTables() {
    panel.showFacts(byId("facts"), this.animation);
    panel.showBytes(byId("bytes"), this.clips);
  }

  halt(time) {
    this.pause();
    this.seek(time);
  }

  next(id, step = 1, isRound = true) {
    const select = byId(id);
    const { length } = select.options;
    const place = select.selectedIndex + step;
    select.selectedIndex = isRound ? place % length : Math.min(Math.max(place, 0), length - 1);
    select.onchange();
  }

  say(text) {
    byId("message").textContent = text;
  }

  play() {
    this.isPlaying = this.animation.end > this.animation.start;
    this.before = null;
    this.#showPlaying();
  }

  pause() {
    this.isPlaying = false;
    this.#showPlaying();
  }

  #showPlaying() {
    byId("play").textContent = this.isPlaying ? "❚❚" : "▶";
    byId("play").setAttribute("aria-label", this.isPlaying ? "Pause" : "Play");
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.animation.start), this.animation.end);
    this.#draw();
  }

  /** Frame the whole mesh, by its extent over the current group of frames, which is decoded anyway. */
  fit() {
    const { object } = this;
    const run = this.animation.at(this.time);
    const { firstFrame, frameCount } = run.groups[run.groupOf(findFrame(run.times, this.time))];
    const [low, high] = [Array(3).fill(Infinity), Array(3).fill(-Infinity)];
    for (let k = 0; k <= EXTENT_STEPS; k++) {
      const time = run.times[firstFrame + Math.round((k / EXTENT_STEPS) * (frameCount - 1))];
      run.positions(time, object === null ? {} : { object }).forEach((value, place) => {
        low[place % 3] = Math.min(low[place % 3], value);
        high[place % 3] = Math.max(high[place % 3], value);
      });
    }
    this.camera.fit(low, high, this.up);
  }

  #tick(now) {
    if (this.isPlaying) {
      const { start, end } = this.animation;
      const passed = this.before === null ? 0 : (now - this.before) / 1000;
      this.before = now;
      const time = this.time - start + passed * Number(byId("speed").value);
      this.time = start + (time % (end - start));
      this.frames++;
      this.#draw();
    } else if (this.errors && !this.errors.isDone) {
      this.#drawErrors();
    } else if (this.history && !this.history.isDone) {
      this.history.draw(this.time);
    }
    if (this.history && !this.history.isDone) this.history.step();
    if (this.errors && !this.errors.isDone) this.errors.step();
    this.first.prefetch(this.time);
    requestAnimationFrame((next) => this.#tick(next));
  }

  #resize() {
    const canvas = byId("canvas");
    const scale = Math.min(devicePixelRatio || 1, 2);
    canvas.width = Math.max(Math.round(canvas.clientWidth * scale), 1);
    canvas.height = Math.max(Math.round(canvas.clientHeight * scale), 1);
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => panel.parseColour(style.getPropertyValue(name).trim());
    this.look = { page: colour("--page"), mesh: colour("--mesh"), other: colour("--second"), missing: colour("--missing"), pointSize: 3 * scale };
    panel.drawTicks(byId("ticks"), this.animation, style.getPropertyValue("--quiet"));
    this.#draw();
  }

  #draw() {
    if (!this.look) return;
    const { first, second, time } = this;
    const view = this.#view();
    first.show(time);
    if (second && view !== "a" && view !== "change") second.show(time);
    const drawn = { b: [second], side: [first, second] }[view] ?? [first];
    const scale = this.colouring.apply(view, drawn, time);
    const item = (clip, own = {}) => ({
      model: clip.model,
      object: this.object,
      shading: byId("shading").value,
      colouring: scale ? (scale.clips.includes(clip) ? "values" : "plain") : byId("colour").value,
      map: scale?.map,
      isSplit: Boolean(scale?.isSplit),
      plain: this.look.mesh,
      ...own,
    });
    const whole = { from: 0, to: 1 };
    const views = {
      a: () => [{ ...whole, items: [item(first)] }],
      change: () => [{ ...whole, items: [item(first)] }],
      b: () => [{ ...whole, items: [item(second)] }],
      over: () => [{ ...whole, items: [item(first), item(second, { ...WIRES, plain: this.look.other })] }],
      side: () => [
        { from: 0, to: 0.5, items: [item(first)] },
        { from: 0.5, to: 1, items: [item(second)] },
      ],
    };
    this.stage.draw(views[view](), this.camera, this.look);
    this.#showState(view, scale);
  }

  #showState(view, scale) {
    byId("time").value = this.time;
    byId("now").textContent = panel.formatTime(this.animation, this.time);
    const names = view === "side" ? [this.first.name, this.second.name] : [];
    byId("labels").replaceChildren(
      ...names.map((name, k) => {
        const label = document.createElement("span");
        label.textContent = name;
        label.style.left = `calc(${50 * k}% + .5em)`;
        return label;
      }),
    );
    byId("legend").hidden = !scale;
    if (scale) panel.showLegend(byId("legend"), scale);
    byId("none").hidden = !scale?.isMissing;
    this.#drawErrors();
    this.#showUnder();
    this.history?.draw(this.time);
    const isPicked = this.history?.element.run === this.animation.at(this.time);
    this.#mark("pick", isPicked ? this.history.element.vertex : null);
  }

  #drawErrors() {
    if (!this.errors) return;
    const { errors, colouring } = this;
    panel.drawErrors(this.chart, errors, this.time);
    byId("measured").textContent = errors.isDone ? "" : `(${errors.count} of ${errors.most.length} frames measured)`;
    const { value, element, frame } = errors.worst;
    const isShown = this.time === this.animation.times[frame] && this.#view() === "change";
    this.#mark("mark", isShown ? colouring.vertexOf(element, this.time) : null);
    byId("worst").textContent = `Worst: ${panel.formatLength(value)} at ${colouring.element} ${element} in frame ${frame}.`;
  }

  /** Place a ring around a vertex; hide it if there is none. */
  #mark(id, vertex) {
    const mark = byId(id);
    mark.hidden = vertex === null;
    if (mark.hidden) return;
    const point = this.first.positions(this.time).subarray(3 * vertex, 3 * vertex + 3);
    const { clientWidth, clientHeight } = byId("canvas");
    const share = this.#view() === "side" ? 0.5 : 1;
    const [x, y] = this.camera.projector((share * clientWidth) / clientHeight)(point);
    mark.style.left = `${100 * share * x}%`;
    mark.style.top = `${100 * y}%`;
  }

  /** Return the positions on the graphics processor at a time, for tests. */
  readPositions(time) {
    this.pause();
    this.seek(time);
    const { motion } = this.first.model;
    return { positions: [...motion.readPositions()], isOnGpu: motion.isOnGpu };
  }

  worstVertexNow() {
    return findLargest(this.errors.measure(this.time));
  }
}

const WIRES = { shading: "wireframe", colouring: "plain", isSplit: false };

const app = new App();
globalThis.pdeanimView = app;
app.ready = app.start(JSON.parse(byId("data").textContent)).catch((error) => {
  app.say(error.message);
  console.error(error);
});

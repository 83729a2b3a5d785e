/** The page of the viewer: opens the embedded clips, plays them and handles the controls. */
import { compile, PdeAnimation } from "pdeanim";
import { findFrame } from "pdeanim/motion.js";

import { OrbitCamera } from "pdeanim/view/camera.js";
import { decodeBase64, Clip, Original, gunzip } from "pdeanim/view/clip.js";
import { distances, FrameErrors, findLargest } from "pdeanim/view/errors.js";
import * as panel from "pdeanim/view/panel.js";
import { Stage } from "pdeanim/view/stage.js";

const SPEEDS = [0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 4];
const SHADINGS = { smooth: "smooth", flat: "flat", edges: "smooth with edges", wireframe: "wireframe" };
const COLOURINGS = [["plain", "one colour"], ["patches", "by patch or curve"]];

/** Names of the views of two clips; A is the first clip, B the second. */
const VIEWS = { side: "side by side", a: "A only", b: "B only", over: "B as a wireframe over A", change: "A coloured by error" };

const KEYS = [
  ["space", "play or pause"],
  ["← →", "previous, next frame; with shift a tenth of a frame"],
  ["home end", "first, last frame"],
  ["[ ]", "slower, faster"],
  ["s", "next shading"],
  ["c", "next colouring"],
  ["o", "next object"],
  ["v", "next view of two clips"],
  ["f", "show the whole mesh"],
];

/** Number of times in a group of frames at which the extent of the mesh is sampled. */
const EXTENT_STEPS = 6;

const byId = (id) => document.getElementById(id);

class App {
  time = 0;
  isPlaying = false;
  object = null;
  frames = 0;
  errors = null;

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
    this.#setUpControls(data);
    first.show(this.time);
    this.fit();
    this.#resize();
    this.#draw();
    this.gl.finish();
    this.firstFrame = performance.now();
    if (data.original) await this.#takeOriginal(data.original);
    if (this.second) this.#compare();
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

  async #takeOriginal({ name, step, data }) {
    const differences = new Int16Array(await gunzip(await decodeBase64(data)));
    this.second = new Original(this.gl, this.first, differences, step, name);
  }

  #compare() {
    const [a, b] = [this.animation, this.second.animation ?? this.animation];
    if (a.runCount > 1 || b.runCount > 1 || a.vertexCount !== b.vertexCount) {
      this.say("no distances: the two clips have different vertices");
    } else {
      this.errors = new FrameErrors(this.first, this.second);
      this.chart = new panel.ErrorChart(byId("chart"), a, (time) => this.seek(time));
      byId("errors").hidden = false;
      byId("go").onclick = () => this.#halt(a.times[this.errors.worst.frame]);
      byId("other").textContent = this.second.name;
    }
    byId("comparing").hidden = false;
    if (!this.errors) byId("compare").querySelector('[value="change"]').remove();
    this.#option("colour", this.errors ? [...COLOURINGS, ["error", "by error"]] : COLOURINGS);
    byId("compare").value = this.errors ? "change" : "side";
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
    this.#option("speed", SPEEDS.map((speed) => [speed, `${speed} ×`]), "1");
    this.#option("shading", Object.entries(SHADINGS));
    this.#option("colour", COLOURINGS);
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
    document.addEventListener("keydown", (event) => this.#key(event));
    const { length } = data.clips;
    byId("summary").textContent = `${animation.frameCount} frames, ${panel.formatBytes(this.animation.fileSize)}${
      length > 1 ? ` against ${panel.formatBytes(this.clips[1].animation.fileSize)}` : ""
    }`;
    byId("keys").replaceChildren();
    for (const [key, what] of KEYS) {
      const row = byId("keys").insertRow();
      row.insertCell().innerHTML = `<kbd>${key}</kbd>`;
      row.insertCell().textContent = what;
    }
  }

  #showTables() {
    panel.showFacts(byId("facts"), this.animation);
    panel.showBytes(byId("bytes"), this.clips);
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { times, start, end } = this.animation;
    const frame = findFrame(times, this.time);
    const step = (direction) => {
      const gap = times.length > 1 ? (end - start) / (times.length - 1) : 0;
      if (event.shiftKey) return this.time + 0.1 * direction * gap;
      const next = direction > 0 || this.time > times[frame] ? frame + Math.max(direction, 0) : frame - 1;
      return times[Math.min(Math.max(next, 0), times.length - 1)];
    };
    const actions = {
      " ": () => byId("play").click(),
      ArrowLeft: () => this.#halt(step(-1)),
      ArrowRight: () => this.#halt(step(1)),
      Home: () => this.#halt(start),
      End: () => this.#halt(end),
      "[": () => this.#next("speed", -1, false),
      "]": () => this.#next("speed", 1, false),
      s: () => this.#next("shading"),
      c: () => this.#next("colour"),
      o: () => this.#next("object"),
      v: () => this.second && this.#next("compare"),
      f: () => {
        this.fit();
        this.#draw();
      },
    };
    const action = actions[event.key];
    if (!action || (event.target instanceof HTMLSelectElement && event.key.startsWith("Arrow"))) return;
    event.preventDefault();
    action();
  }

  #halt(time) {
    this.pause();
    this.seek(time);
  }

  #next(id, step = 1, isRound = true) {
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
    }
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
    this.look = { page: colour("--page"), mesh: colour("--mesh"), other: colour("--second"), pointSize: 3 * scale };
    panel.drawTicks(byId("ticks"), this.animation, style.getPropertyValue("--quiet"));
    this.#draw();
  }

  #draw() {
    if (!this.look) return;
    const { first, second, time } = this;
    const view = second ? byId("compare").value : "a";
    first.show(time);
    if (second && view !== "a" && view !== "change") second.show(time);
    const most = this.errors?.scale ?? 1;
    const isHeat = this.errors && (view === "change" || byId("colour").value === "error");
    if (isHeat) first.model.setErrors(distances(first.positions(time), second.positions(time)));
    const item = (clip, own = {}) => ({
      model: clip.model,
      object: this.object,
      shading: byId("shading").value,
      colouring: isHeat && clip === first ? "error" : isHeat ? "plain" : byId("colour").value,
      most,
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
    this.#showState(view, isHeat, most);
  }

  #showState(view, isHeat, most) {
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
    const legend = byId("legend");
    legend.hidden = !isHeat;
    if (isHeat) {
      legend.innerHTML = `<i style="background:${COLOUR_RAMP}"></i><div><span>0</span><span>distance</span><span>${panel.formatLength(most)}</span></div>`;
    }
    this.#drawErrors();
  }

  #drawErrors() {
    if (!this.errors) return;
    const { errors } = this;
    this.chart.draw(errors, this.time);
    byId("measured").textContent = errors.isDone ? "" : `(${errors.count} of ${errors.most.length} frames measured)`;
    const { value, vertex, frame } = errors.worst;
    this.#markWorst();
    byId("worst").textContent = `Worst: ${panel.formatLength(value)} at vertex ${vertex} in frame ${frame}.`;
  }

  /** Place a ring around the worst vertex if its frame is shown and A is coloured by error. */
  #markWorst() {
    const { vertex, frame } = this.errors.worst;
    const mark = byId("mark");
    mark.hidden = this.time !== this.animation.times[frame] || byId("compare").value !== "change";
    if (mark.hidden) return;
    const point = this.first.positions(this.time).subarray(3 * vertex, 3 * vertex + 3);
    const { clientWidth, clientHeight } = byId("canvas");
    const [x, y] = this.camera.placeOf(point, clientWidth / clientHeight);
    mark.style.left = `${100 * x}%`;
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
    return findLargest(distances(this.first.positions(this.time), this.second.positions(this.time)));
  }
}

const COLOUR_RAMP = "linear-gradient(90deg, #29459e, #219e99, #fad44a, #d62629)";
const WIRES = { shading: "wireframe", colouring: "plain" };

const app = new App();
globalThis.pdeanimView = app;
app.ready = app.start(JSON.parse(byId("data").textContent)).catch((error) => {
  app.say(error.message);
  console.error(error);
});

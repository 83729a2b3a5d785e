/** Keys of the page of the viewer. */
import { findFrame } from "pdeanim/motion.js";

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

export function listKeys(table) {
  table.replaceChildren();
  for (const [key, what] of KEYS) {
    const row = table.insertRow();
    row.insertCell().innerHTML = `<kbd>${key}</kbd>`;
    row.insertCell().textContent = what;
  }
}

/** Do what a key stands for. */
export function handleKey(app, event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const { times, start, end } = app.animation;
  const frame = findFrame(times, app.time);
  const step = (direction) => {
    const gap = times.length > 1 ? (end - start) / (times.length - 1) : 0;
    if (event.shiftKey) return app.time + 0.1 * direction * gap;
    const next = direction > 0 || app.time > times[frame] ? frame + Math.max(direction, 0) : frame - 1;
    return times[Math.min(Math.max(next, 0), times.length - 1)];
  };
  const actions = {
    " ": () => document.getElementById("play").click(),
    ArrowLeft: () => app.halt(step(-1)),
    ArrowRight: () => app.halt(step(1)),
    Home: () => app.halt(start),
    End: () => app.halt(end),
    "[": () => app.next("speed", -1, false),
    "]": () => app.next("speed", 1, false),
    s: () => app.next("shading"),
    c: () => app.next("colour"),
    o: () => app.next("object"),
    v: () => app.second && app.next("compare"),
    f: () => {
      app.fit();
      app.seek(app.time);
    },
  };
  const action = actions[event.key];
  if (!action || (event.target instanceof HTMLSelectElement && event.key.startsWith("Arrow"))) return;
  event.preventDefault();
  action();
}

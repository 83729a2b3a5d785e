/**
 * A camera that orbits a point, driven by drag, wheel, pinch or keys. Matrices are in column-major order, as WebGL
 * expects.
 */

const FIELD_OF_VIEW = Math.PI / 5;
const MAX_PITCH = Math.PI / 2 - 0.01;

/** Rotation per pixel of dragging [radians], and the factor by which a unit of wheel movement changes the distance. */
const RADIANS_PER_PIXEL = 0.008;
const ZOOM_PER_WHEEL_UNIT = 1.0015;

export class OrbitCamera {
  yaw = 0.6;
  pitch = 0.35;
  distance = 1;
  target = [0, 0, 0];
  size = 1;

  /** Frame a whole box. `up` is the vertical axis: 1 for y, 2 for z. */
  fit(low, high, up = 1) {
    this.up = up;
    this.target = low.map((value, axis) => (value + high[axis]) / 2);
    this.size = Math.hypot(...low.map((value, axis) => high[axis] - value)) || 1;
    this.distance = (0.5 * this.size) / Math.sin(FIELD_OF_VIEW / 2);
  }

  /** Return the axes of the view: right, up, and towards the camera. */
  axes() {
    const [side, height] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    const back = this.#turned([side * Math.sin(this.yaw), height, side * Math.cos(this.yaw)]);
    const right = this.#turned([Math.cos(this.yaw), 0, -Math.sin(this.yaw)]);
    return { right, above: cross(back, right), back };
  }

  #turned([x, y, z]) {
    return this.up === 2 ? [x, -z, y] : [x, y, z];
  }

  matrix(aspect) {
    const { right, above, back } = this.axes();
    const eye = this.target.map((value, axis) => value + this.distance * back[axis]);
    const near = Math.max(this.distance - 2 * this.size, this.distance * 0.01);
    const far = this.distance + 2 * this.size;
    const scale = 1 / Math.tan(FIELD_OF_VIEW / 2);
    const fitted = Math.min(aspect, 1);  // narrow windows still show the whole width
    const depth = (far + near) / (near - far);
    const rows = [
      [right, (scale * fitted) / aspect, 0],
      [above, scale * fitted, 0],
      [back, depth, (2 * far * near) / (near - far)],
      [back, -1, 0],
    ];
    const found = new Float32Array(16);
    rows.forEach(([axis, factor, shift], row) => {
      for (let k = 0; k < 3; k++) found[4 * k + row] = axis[k] * factor;
      found[12 + row] = shift - dot(axis, eye) * factor;
    });
    return found;
  }

  /** Return a function that projects points to the picture: fractions of its width and height from the top left. */
  projector(aspect) {
    const matrix = this.matrix(aspect);
    return (point) => {
      const row = (k) => point[0] * matrix[k] + point[1] * matrix[4 + k] + point[2] * matrix[8 + k] + matrix[12 + k];
      return [0.5 + row(0) / row(3) / 2, 0.5 - row(1) / row(3) / 2];
    };
  }

  /** Return the ray through a point of the picture: the eye, and the direction. */
  rayOf(x, y, aspect) {
    const { right, above, back } = this.axes();
    const height = Math.tan(FIELD_OF_VIEW / 2) / Math.min(aspect, 1);
    const [across, up] = [(2 * x - 1) * aspect * height, (1 - 2 * y) * height];
    return {
      eye: this.target.map((value, axis) => value + this.distance * back[axis]),
      direction: back.map((value, axis) => across * right[axis] + up * above[axis] - value),
    };
  }

  turn(x, y) {
    this.yaw -= RADIANS_PER_PIXEL * x;
    this.pitch = Math.min(Math.max(this.pitch + RADIANS_PER_PIXEL * y, -MAX_PITCH), MAX_PITCH);
  }

  /** Move by fractions of the picture's height. */
  pan(x, y) {
    const { right, above } = this.axes();
    const step = 2 * this.distance * Math.tan(FIELD_OF_VIEW / 2);
    this.target = this.target.map((value, axis) => value + step * (y * above[axis] - x * right[axis]));
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, this.size * 1e-3), this.size * 1e3);
  }

  /** Handle pointer and wheel events of an element; `changed` is called after each step. */
  follow(element, changed) {
    const pointers = new Map();
    const spread = () => {
      const [a, b] = [...pointers.values()];
      return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) || 1 };
    };
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    for (const end of ["pointerup", "pointercancel"]) {
      element.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    element.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const now = { x: event.clientX, y: event.clientY };
      const height = element.clientHeight;
      if (pointers.size === 2) {
        const old = spread();
        pointers.set(event.pointerId, now);
        const fresh = spread();
        this.zoom(old.apart / fresh.apart);
        this.pan((fresh.x - old.x) / height, (fresh.y - old.y) / height);
      } else {
        pointers.set(event.pointerId, now);
        const [x, y] = [now.x - before.x, now.y - before.y];
        if (event.buttons === 2 || event.shiftKey) this.pan(x / height, y / height);
        else this.turn(x, y);
      }
      changed();
    });
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    element.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(ZOOM_PER_WHEEL_UNIT ** event.deltaY);
        changed();
      },
      { passive: false },
    );
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

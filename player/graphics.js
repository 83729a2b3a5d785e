/** Motions on the graphics processor of a renderer, each shared by all meshes that show the run of frames. */
export class Graphics {
  #motions = new Map();
  #Motion;
  #getDevice;

  /**
   * @param {typeof import("./gpu.js").GpuMotion | typeof import("./webgpu.js").WebGpuMotion} Motion
   * @param {() => WebGL2RenderingContext | GPUDevice} getDevice
   */
  constructor(Motion, getDevice) {
    this.#Motion = Motion;
    this.#getDevice = getDevice;
  }

  /** Whether a run of frames fits. */
  holds(run) {
    return this.#Motion.holds(this.#getDevice(), run);
  }

  /** Return the motion of a run; its users' `restore` is called when a lost context is back. */
  borrow(run, user) {
    if (!this.#motions.has(run)) {
      const motion = this.work(() => new this.#Motion(this.#getDevice(), run, []));
      this.#motions.set(run, { motion, users: new Set() });
    }
    const { motion, users } = this.#motions.get(run);
    users.add(user);
    return motion;
  }

  giveBack(run, user) {
    const found = this.#motions.get(run);
    if (!found?.users.delete(user) || found.users.size > 0) return;
    this.work(() => found.motion.close());
    this.#motions.delete(run);
  }

  /** Upload everything again after a lost context. */
  restore() {
    const users = [...this.#motions.values()].flatMap((found) => [...found.users]);
    this.#motions.clear();
    for (const user of users) user.restore();
  }

  /** Do work on the graphics processor; subclasses whose renderer caches the context's state make it forget that. */
  work(work) {
    return work();
  }
}

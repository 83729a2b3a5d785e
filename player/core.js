import { CODES, PdeanimError } from "./errors.js";

/**
 * Layout of the C interface's structures (core/bindings/c/include/pdeanim.h) on a 32-bit machine: size and field
 * offsets [bytes].
 */
const ERROR = { bytes: 280, status: 0, offset: 8, frame: 16, text: 24 };
const OPTIONS = { bytes: 24, size: 0, maxMemory: 8, threads: 16 };

const decoder = new TextDecoder();

/** @type {Promise<WebAssembly.Module> | null} */
let compiled = null;

/** Compile the module once. `bytes` is the module, if `pdeanim.wasm` is not next to this script. */
export function compile(bytes) {
  compiled ??= bytes ? WebAssembly.compile(bytes) : compileFile(new URL("./pdeanim.wasm", import.meta.url));
  return compiled;
}

async function compileFile(address) {
  if (address.protocol === "file:" && globalThis.process?.versions?.node) {
    const { readFile } = await import("node:fs/promises");
    return WebAssembly.compile(await readFile(address));
  }
  const response = await fetch(address);
  if (!response.ok) throw new PdeanimError(`${address}: the server answered ${response.status}`, "read-failed");
  return WebAssembly.compile(await response.arrayBuffer());
}

/** An instance of the decoder with its own memory, for one file. */
export class Core {
  static async start(source, wasm) {
    const core = new Core(source);
    const read = (_, offset, into, size) => core.#read(Number(offset), into, size);
    const { exports } = await WebAssembly.instantiate(await compile(wasm), { pdeanim: { read } });
    exports._initialize();
    core.functions = exports;
    core.error = exports.malloc(ERROR.bytes);
    core.scratch = exports.malloc(SCRATCH_BYTES);
    return core;
  }

  constructor(source) {
    this.source = source;
  }

  #read(offset, into, size) {
    const found = this.source.read(offset, size);
    if (!found) return -1n;
    new Uint8Array(this.functions.memory.buffer).set(found, into);
    return BigInt(found.length);
  }

  get view() {
    return new DataView(this.functions.memory.buffer);
  }

  /**
   * Call a function of the C interface that returns a status and whose last argument is the address of an error; throw
   * if it fails.
   */
  call(name, ...values) {
    const status = this.functions[`pdeanim_${name}`](...values, this.error);
    if (status !== 0) throw this.#failure();
  }

  #failure() {
    const view = this.view;
    const code = CODES[view.getInt32(this.error + ERROR.status, true)];
    if (code === "read-failed" && this.source.isMissing) {
      return new PdeanimError("bytes of the file are not fetched yet; await prepare(time) first", "bytes-missing");
    }
    const offset = Number(view.getBigInt64(this.error + ERROR.offset, true));
    const frame = Number(view.getBigInt64(this.error + ERROR.frame, true));
    return new PdeanimError(this.text(this.error + ERROR.text), code, offset, frame);
  }

  /** Run `work` until it succeeds; each time bytes are missing, fetch them first. */
  async retryUntilFetched(work) {
    for (;;) {
      try {
        return work();
      } catch (error) {
        if (error.code !== "bytes-missing") throw error;
        await this.source.fetchMissing();
      }
    }
  }

  open(maxMemory) {
    const options = this.scratch;
    const handle = this.scratch + OPTIONS.bytes;
    const view = this.view;
    view.setUint32(options + OPTIONS.size, OPTIONS.bytes, true);
    view.setBigUint64(options + OPTIONS.maxMemory, BigInt(maxMemory), true);
    view.setUint32(options + OPTIONS.threads, 1, true);
    this.call("open_page", 0, BigInt(this.source.size), options, handle);
    return this.pointer(handle);
  }

  pointer(at) {
    return this.view.getUint32(at, true);
  }

  number(at) {
    return Number(this.view.getBigInt64(at, true));
  }

  text(at) {
    const bytes = new Uint8Array(this.functions.memory.buffer, at);
    return decoder.decode(bytes.slice(0, bytes.indexOf(0)));
  }

  /** Copy `count` numbers out of the module's memory. */
  copy(Type, at, count) {
    return count ? new Type(this.functions.memory.buffer, at, count).slice() : new Type(0);
  }

  /** Allocate `count` numbers, let `work(address)` fill them, and return a copy (or `out`, if given). */
  readArray(Type, count, work, out) {
    const at = this.functions.malloc(Math.max(count, 1) * Type.BYTES_PER_ELEMENT);
    if (!at) throw new PdeanimError("not enough memory for the result", "no-memory");
    try {
      work(at);
      const found = new Type(this.functions.memory.buffer, at, count);
      if (!out) return found.slice();
      out.set(found);
      return out;
    } finally {
      this.functions.free(at);
    }
  }
}

/** Enough for the largest structure that a call writes. */
export const SCRATCH_BYTES = 256;

import { CODES, PdeanimError } from "./errors.js";
import { fetchOrThrow } from "./source.js";

/**
 * Layout of the C interface's structures (core/bindings/c/include/pdeanim.h) on a 32-bit machine: size and field
 * offsets [bytes].
 */
const ERROR = { bytes: 280, status: 0, offset: 8, frame: 16, text: 24 };
const OPTIONS = { bytes: 24, size: 0, maxMemory: 8, threads: 16 };

/** Default of `maxMemory` [bytes]: half of what WebAssembly can address. */
const DEFAULT_MAX_MEMORY = 2 ** 31;

const decoder = new TextDecoder();

/** @type {Promise<WebAssembly.Module> | null} */
let compiled = null;

/** Compile the module once. `from` holds its bytes or its address, if `pdeanim.wasm` is not next to this script. */
export function compile(from) {
  compiled ??= compileModule(from).catch((error) => {
    compiled = null;  // the next call may name another address
    throw error;
  });
  return compiled;
}

async function compileModule(from) {
  const address = from ?? new URL("./pdeanim.wasm", import.meta.url);
  const isAddress = typeof address === "string" || address instanceof URL;
  const bytes = isAddress ? await fetchModule(address) : address;
  return WebAssembly.compile(bytes).catch((cause) => {
    const what = isAddress ? address : "what compile() was given";
    const advice = "copy pdeanim.wasm there, or pass its address or bytes to compile()";
    const message = `${what} is not the decoder, or this program cannot run it (${cause.message}): ${advice}`;
    throw Object.assign(new PdeanimError(message, "read-failed"), { cause });
  });
}

async function fetchModule(address) {
  if (String(address).startsWith("file:") && globalThis.process?.versions?.node) {
    const name = "node:fs/promises";  // not a literal: bundlers for browsers would look for it
    const { readFile } = await import(/* webpackIgnore: true */ /* @vite-ignore */ name);
    return new Uint8Array(await readFile(new URL(address))).buffer;
  }
  return (await fetchOrThrow(address)).arrayBuffer();
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

  /** Open the file, each time with the limit that was first given. */
  open(maxMemory = DEFAULT_MAX_MEMORY) {
    this.maxMemory ??= maxMemory;
    const options = this.scratch;
    const handle = this.scratch + OPTIONS.bytes;
    const view = this.view;
    view.setUint32(options + OPTIONS.size, OPTIONS.bytes, true);
    view.setBigUint64(options + OPTIONS.maxMemory, BigInt(this.maxMemory), true);
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
    if (out && !(out.length >= count)) {
      throw new PdeanimError(`out has ${out.length} numbers; it needs ${count} (${Type.name})`, "argument");
    }
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

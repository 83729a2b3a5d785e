import { PdeanimError } from "./errors.js";

/** Size of a request [bytes]: a few milliseconds on a slow line, and enough for all headers of most files. */
const BLOCK_BYTES = 1 << 16;

/** Fetch an address; throw our error if the host is refused, unknown or answers with an error. */
export async function fetchOrThrow(address, request) {
  const response = await fetch(address, request).catch((cause) => {
    const reason = cause.cause?.message ?? cause.message;
    throw Object.assign(new PdeanimError(`${address}: no answer from the server (${reason})`, "read-failed"), { cause });
  });
  if (!response.ok) throw new PdeanimError(`${address}: the server answered ${response.status}`, "read-failed");
  return response;
}

/** A whole file in memory. */
export class MemorySource {
  /** @param {ArrayBuffer | ArrayBufferView} data */
  constructor(data) {
    this.bytes = ArrayBuffer.isView(data)
      ? new Uint8Array(data.buffer, data.byteOffset, data.byteLength)
      : new Uint8Array(data);
    this.size = this.bytes.length;
  }

  /** Return bytes from `offset` on, fewer only at the end of the file; null if they must be fetched first. */
  read(offset, size) {
    return this.bytes.subarray(offset, offset + size);
  }

  /** Whether the last read needs bytes that are not fetched yet. */
  get isMissing() {
    return false;
  }
}

/** A file at a URL, read in parts as they are needed (HTTP ranges). */
export class HttpSource {
  /**
   * Read the first part; a server that does not support ranges sends the whole file.
   * @param {string | URL} address
   * @param {RequestInit} request options for `fetch`, such as headers
   */
  static async open(address, request = {}) {
    const source = new HttpSource(address, request);
    await source.#fetchBlocks(0, 1);
    return source;
  }

  #blocks = new Map();
  #tag = null;
  #missing = null;

  constructor(address, request) {
    this.address = String(address);
    this.request = request;
    this.size = 0;
    this.bytesFetched = 0;
  }

  read(offset, size) {
    const end = Math.min(offset + size, this.size);
    const first = Math.floor(offset / BLOCK_BYTES);
    const behind = Math.ceil(end / BLOCK_BYTES);
    const found = new Uint8Array(Math.max(end - offset, 0));
    for (let block = first; block < behind; block++) {
      const bytes = this.#blocks.get(block);
      if (!bytes) {
        this.#missing = { first: block, behind };
        return null;
      }
      const start = block * BLOCK_BYTES;
      const from = Math.max(offset - start, 0);
      found.set(bytes.subarray(from, Math.min(end - start, bytes.length)), start + from - offset);
    }
    return found;
  }

  get isMissing() {
    return this.#missing !== null;
  }

  /** Fetch the bytes that the last read missed. */
  async fetchMissing() {
    const { first, behind } = this.#missing;
    await this.#fetchBlocks(first, behind);
    this.#missing = null;
  }

  async #fetchBlocks(first, behind) {
    const headers = new Headers(this.request.headers);
    headers.set("Range", `bytes=${first * BLOCK_BYTES}-${behind * BLOCK_BYTES - 1}`);
    const response = await fetchOrThrow(this.address, { ...this.request, headers });
    const tag = response.headers.get("ETag");
    if (this.size && tag !== this.#tag) {
      throw new PdeanimError(`${this.address}: the file has changed on the server; open it again`, "read-failed");
    }
    this.#tag = tag;
    const bytes = new Uint8Array(await response.arrayBuffer());
    this.bytesFetched += bytes.length;
    let start = 0;
    if (response.status === 206) {
      const range = /bytes (\d+)-\d+\/(\d+)/.exec(response.headers.get("Content-Range") ?? "");
      if (!range) throw new PdeanimError(`${this.address}: the server did not say which bytes it sent (Content-Range)`, "read-failed");
      start = Number(range[1]);
      this.size = Number(range[2]);
    } else {
      this.size = bytes.length;
    }
    for (let at = 0; at < bytes.length; at += BLOCK_BYTES) {
      this.#blocks.set((start + at) / BLOCK_BYTES, bytes.subarray(at, at + BLOCK_BYTES));
    }
  }
}

/** Error codes, in the order of `pdeanim_status` in the C interface. */
export const CODES = Object.freeze([
  "ok",
  "corrupt",
  "limit",
  "argument",
  "read-failed",
  "no-memory",
  "cancelled",
  "internal",
]);

/** An error with a code: a damaged file, a file that needs too much memory, an argument out of range ... */
export class PdeanimError extends Error {
  /**
   * @param {string} message one line
   * @param {string} code one of CODES, or "bytes-missing": call `prepare` to fetch the bytes
   * @param {number} offset byte of the file, or -1
   * @param {number} frame frame index, or -1
   */
  constructor(message, code, offset = -1, frame = -1) {
    super(message);
    this.name = "PdeanimError";
    this.code = code;
    this.offset = offset;
    this.frame = frame;
  }
}

/** What can go wrong, as `pdeanim_status` of the C interface numbers it. */
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

/** A file that is damaged or asks for too much, or an argument that is out of range. */
export class PdeanimError extends Error {
  /**
   * @param {string} message one line
   * @param {string} code one of CODES, or "bytes-missing": `prepare` reads them
   * @param {number} offset byte of the file, or -1
   * @param {number} frame or -1
   */
  constructor(message, code, offset = -1, frame = -1) {
    super(message);
    this.name = "PdeanimError";
    this.code = code;
    this.offset = offset;
    this.frame = frame;
  }
}

// SPDX-License-Identifier: Apache-2.0
// SHA-256 (FIPS 180-4) in pieces, for pages: crypto.subtle needs https and all bytes at once.

/** @param {number} count */
const primes = count => {
  /** @type {number[]} */
  const found = [];
  for (let n = 2; found.length < count; n++) if (found.every(p => n % p)) found.push(n);
  return found;
};
/** @param {number} x */
const fraction = x => ((x - Math.floor(x)) * 2 ** 32) | 0;
const K = new Int32Array(primes(64).map(p => fraction(Math.cbrt(p))));
const START = primes(8).map(p => fraction(Math.sqrt(p)));

/**
 * @param {Int32Array} h
 * @param {Uint8Array} block
 * @param {Int32Array} w
 */
function compress(h, block, w) {
  const view = new DataView(block.buffer, block.byteOffset, 64);
  for (let i = 0; i < 16; i++) w[i] = view.getInt32(4 * i);
  /** @type {(x: number, n: number) => number} */
  const turn = (x, n) => (x >>> n) | (x << (32 - n));
  for (let i = 16; i < 64; i++) {
    const a = w[i - 15], b = w[i - 2];
    w[i] = (w[i - 16] + (turn(a, 7) ^ turn(a, 18) ^ (a >>> 3)) + w[i - 7] + (turn(b, 17) ^ turn(b, 19) ^ (b >>> 10))) | 0;
  }
  let [a, b, c, d, e, f, g, k] = h;
  for (let i = 0; i < 64; i++) {
    const t = (k + (turn(e, 6) ^ turn(e, 11) ^ turn(e, 25)) + ((e & f) ^ (~e & g)) + K[i] + w[i]) | 0;
    const u = ((turn(a, 2) ^ turn(a, 13) ^ turn(a, 22)) + ((a & b) ^ (a & c) ^ (b & c))) | 0;
    [k, g, f, e, d, c, b, a] = [g, f, e, (d + t) | 0, c, b, a, (t + u) | 0];
  }
  [a, b, c, d, e, f, g, k].forEach((x, i) => {
    h[i] = (h[i] + x) | 0;
  });
}

export class Sha256 {
  constructor() {
    this.h = new Int32Array(START);
    this.w = new Int32Array(64);
    this.rest = new Uint8Array(0); // less than a block
    this.count = 0; // bytes
  }

  /** @param {Uint8Array} bytes the next ones */
  update(bytes) {
    this.count += bytes.length;
    const joined = new Uint8Array(this.rest.length + bytes.length);
    joined.set(this.rest);
    joined.set(bytes, this.rest.length);
    let at = 0;
    for (; at + 64 <= joined.length; at += 64) compress(this.h, joined.subarray(at, at + 64), this.w);
    this.rest = joined.slice(at);
  }

  /** The hash in hexadecimal. It ends the computation. */
  hex() {
    const count = this.count;
    const end = new Uint8Array((this.rest.length < 56 ? 64 : 128) - this.rest.length);
    end[0] = 0x80;
    new DataView(end.buffer).setBigUint64(end.length - 8, BigInt(count) * 8n);
    this.update(end);
    return [...this.h].map(x => (x >>> 0).toString(16).padStart(8, "0")).join("");
  }
}

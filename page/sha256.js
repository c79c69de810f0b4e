// SHA-256 (FIPS 180-4) of a file, piece by piece. The browser's own wants all of it in memory, and https.

const primes = count => {
  const found = [];
  for (let n = 2; found.length < count; n++) if (found.every(p => n % p)) found.push(n);
  return found;
};
const fraction = x => ((x - Math.floor(x)) * 2 ** 32) | 0;
const K = new Int32Array(primes(64).map(p => fraction(Math.cbrt(p))));
const START = primes(8).map(p => fraction(Math.sqrt(p)));

function compress(h, block, w) {
  const view = new DataView(block.buffer, block.byteOffset, 64);
  for (let i = 0; i < 16; i++) w[i] = view.getInt32(4 * i);
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

/** The hash of a Blob in hexadecimal; `onProgress` gets the share that is done. */
export async function sha256(blob, onProgress) {
  const h = new Int32Array(START), w = new Int32Array(64);
  let rest = new Uint8Array(0), read = 0;
  const take = bytes => {
    let at = 0;
    for (; at + 64 <= bytes.length; at += 64) compress(h, bytes.subarray(at, at + 64), w);
    rest = bytes.slice(at);
  };
  const reader = blob.stream().getReader();
  for (let piece = await reader.read(); !piece.done; piece = await reader.read()) {
    const joined = new Uint8Array(rest.length + piece.value.length);
    joined.set(rest);
    joined.set(piece.value, rest.length);
    take(joined);
    read += piece.value.length;
    onProgress(read / blob.size);
  }
  const end = new Uint8Array(rest.length < 56 ? 64 : 128);
  end.set(rest);
  end[rest.length] = 0x80;
  new DataView(end.buffer).setBigUint64(end.length - 8, BigInt(read) * 8n);
  take(end);
  return [...h].map(x => (x >>> 0).toString(16).padStart(8, "0")).join("");
}

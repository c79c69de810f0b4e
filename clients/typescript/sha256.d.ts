// SPDX-License-Identifier: Apache-2.0
export class Sha256 {
    h: Int32Array;
    w: Int32Array;
    rest: Uint8Array;
    count: number;
    /** @param {Uint8Array} bytes the next ones */
    update(bytes: Uint8Array): void;
    /** The hash in hexadecimal. It ends the computation. */
    hex(): string;
}

// SPDX-License-Identifier: Apache-2.0
// Maps from numbers to colours, as 256 colours of four bytes, and the range that a map spans.

const ramp = stops => t => {
  const at = Math.min(t, 0.9999) * (stops.length - 1), i = Math.floor(at), part = at - i;
  return stops[i].map((value, k) => value + part * (stops[i + 1][k] - value));
};

/** Neighbours 4, 5, 6, 7 and 8 in fifths. */
const NEIGHBOURS = [[150, 40, 140], [225, 110, 0], [215, 222, 226], [30, 110, 200], [20, 20, 120]];

export const MAPS = {
  viridis: ramp([[71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37]]),
  "blue to red": ramp([[33, 102, 172], [146, 197, 222], [247, 247, 247], [244, 165, 130], [178, 24, 43]]),
  grey: ramp([[40, 40, 40], [240, 240, 240]]),
  shading: () => [205, 200, 190],
  neighbours: t => NEIGHBOURS[Math.min(4, Math.floor(t * 5))],
};

const INK_SHARE = 0.35; // 0: viridis begins as dark as the ground of the dark theme; 1: colours as bright as the ground become ink

const brightness = ([red, green, blue]) => 0.3 * red + 0.59 * green + 0.11 * blue;

/** The colours of a map on a ground. On a dark one, colours of about its brightness are mixed with the ink of texts, so that none is
 * like the ground; on a light one, the rims of discs are dark. */
export function coloursOf(name, {ground, ink}) {
  const bytes = new Uint8Array(1024);
  const mixed = colour => {
    const share = (brightness(ground) > 0.5 ? 0 : INK_SHARE) * (1 - Math.abs(brightness(colour) / 255 - brightness(ground)));
    return colour.map((part, k) => Math.round(part + share * (255 * ink[k] - part)));
  };
  for (let i = 0; i < 256; i++) bytes.set([...mixed(MAPS[name](i / 255)), 255], 4 * i);
  return bytes;
}

const SAMPLES = 20000;

const BARS = 64;

/** How many of the values lie in each of BARS equal parts of what rangeOf spans and a quarter beyond each end: {low, high, bars}, bars of at most 1. */
export function histogramOf(column, count) {
  const [from, to] = rangeOf(column, count), low = from - (to - from) / 4, high = to + (to - from) / 4, bars = new Array(BARS).fill(0);
  for (let i = 0; i < count; i += Math.max(1, Math.floor(count / SAMPLES))) {
    const at = Math.floor(BARS * (column[i] - low) / (high - low));
    if (at >= 0 && at < BARS) bars[at]++;
  }
  const most = Math.max(1, ...bars);
  return {low, high, bars: bars.map(bar => bar / most)};
}

/** What all but two in a hundred values at each end lie within. */
export function rangeOf(column, count) {
  const step = Math.max(1, Math.floor(count / SAMPLES)), some = [];
  for (let i = 0; i < count; i += step) if (isFinite(column[i])) some.push(column[i]);
  some.sort((a, b) => a - b);
  if (!some.length) return [0, 1];
  const low = some[Math.floor(0.02 * (some.length - 1))], high = some[Math.ceil(0.98 * (some.length - 1))];
  const least = 0.01 * Math.max(Math.abs(low), Math.abs(high), 1e-12); // noise is not spread over all colours
  return high - low < least ? [low - least, high + least] : [low, high];
}

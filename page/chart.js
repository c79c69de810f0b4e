// SPDX-License-Identifier: Apache-2.0
// Charts of a run over its sweeps, drawn by uPlot.
import {html, useEffect, useRef} from "./preact.js";
import {valueAt} from "./report.js";
import uPlot from "./uplot.js";
import {numberOf} from "./words.js";

const HEIGHT = 180;
const LINEAR = 1, LOG = 3, ASINH = 4; // uPlot's numbers of scales

/** What is plotted: of the sweeps of a report, and of the progress lines of a worker. */
export const QUANTITIES = [
  {key: "energy_excess", word: "Energy excess", scale: {distr: ASINH, asinh: 0.01},
    hint: "Mean energy over that of an ideal packing, less one: 0 is ideal."},
  {key: "rms_step", word: "Step", scale: {distr: LOG}, hint: "How far points move in a sweep, in spacings."},
  {key: "mean_log10_lambda", word: "Lambda (log10)", scale: {distr: LINEAR}, hint: "Above 14 nearly all points are settled."},
  {key: "count", word: "Points", scale: {distr: LINEAR}, hint: "The number of points of the level."},
];
export const TIME_LEFT = {key: "eta_s", word: "Time left (s)", scale: {distr: LINEAR}, hint: "As the worker expects it."};

/** The sweeps of a report as rows of the quantities. */
export function rowsOfReport(report) {
  const ideal = valueAt(report, "diagnostics.energy.ideal");
  return (report.sweeps || []).map((sweep, i) => ({sweep: i + 1, ...sweep, energy_excess: ideal ? sweep.energy / ideal - 1 : null}));
}

const colour = name => () => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const LINES = ["--accent", "--warn"];

const TICK_PX = 22; // least distance of two numbers on a scale that is not linear

/** The numbers that such a scale may show, within its ends: 0, and 1, 2 and 5 times the powers of ten. */
function candidates(_, __, least, most) {
  const positive = [];
  for (let power = -12; power <= 12; power++) for (const digit of [1, 2, 5]) positive.push(Number(`${digit}e${power}`));
  return [...positive.map(value => -value).reverse(), 0, ...positive].filter(value => value >= least && value <= most);
}

/** Of these numbers those with space for their texts, the others as null: first 0, then powers of ten, then 5 and 2 times them. */
function spaced(plot, ticks) {
  const kept = new Set(), places = [], digitOf = tick => Number(Math.abs(tick).toExponential()[0]);
  for (const digit of [0, 1, 5, 2]) {
    for (const tick of ticks) {
      const place = plot.valToPos(tick, "y");
      if (digitOf(tick) !== digit || places.some(other => Math.abs(other - place) < TICK_PX)) continue;
      kept.add(tick);
      places.push(place);
    }
  }
  return ticks.map(tick => (kept.has(tick) ? tick : null));
}

const tickOf = tick => (tick === null ? "" : tick && Math.abs(tick) < 1e-3 ? tick.toExponential() : numberOf(tick));

export function optionsOf(quantity, words, width) {
  const line = {stroke: colour("--line"), width: 1};
  const axis = {stroke: colour("--dim"), grid: line, ticks: line};
  const values = (_, ticks) => ticks.map(tickOf);
  const marked = {...line, filter: spaced};
  const own = quantity.scale.distr === LINEAR ? {} : {splits: candidates, filter: spaced, grid: marked, ticks: marked};
  return {
    width, height: HEIGHT, legend: {show: false}, cursor: {y: false},
    scales: {x: {time: false}, y: quantity.scale},
    axes: [{...axis, values, size: 32}, {...axis, values, size: 68, ...own}],
    series: [{}, ...words.map((word, i) => ({label: word, stroke: colour(LINES[i]), width: 1.5, dash: i ? [6, 4] : [], spanGaps: true, points: {show: false}}))],
  };
}

/** Rows of each run as columns for uPlot: the sweeps of all, and a value of each run or null. */
function columnsOf(runs, quantity) {
  const drawable = value => (value === null || value === undefined || (quantity.scale.distr === LOG && value <= 0) ? null : value);
  if (runs.length === 1) return [runs[0].map(row => row.sweep), runs[0].map(row => drawable(row[quantity.key]))];
  const known = runs.map(rows => new Map(rows.map(row => [row.sweep, drawable(row[quantity.key])])));
  const sweeps = [...new Set(known.flatMap(map => [...map.keys()]))].sort((a, b) => a - b);
  return [sweeps, ...known.map(map => sweeps.map(sweep => map.get(sweep) ?? null))];
}

/** A chart of one quantity for one or two runs; `words` name the runs. */
export function Chart({quantity, runs, words}) {
  const place = useRef(null), plot = useRef(null);
  const columns = columnsOf(runs, quantity);
  const last = columns[1].filter(value => value !== null).pop();
  useEffect(() => {
    plot.current = new uPlot(optionsOf(quantity, words, place.current.clientWidth), columns, place.current);
    const watcher = new ResizeObserver(() => plot.current.setSize({width: place.current.clientWidth, height: HEIGHT}));
    watcher.observe(place.current);
    const repaint = () => plot.current.redraw(false);
    addEventListener("theme", repaint);
    return () => {
      removeEventListener("theme", repaint);
      watcher.disconnect();
      plot.current.destroy();
    };
  }, []);
  useEffect(() => plot.current.setData(columns), [runs.map(rows => rows.length).join()]);
  const label = `${quantity.word} over ${columns[0][columns[0].length - 1] ?? 0} sweeps; the last value is ${numberOf(last)}`;
  return html`<figure class="chart"><figcaption><strong>${quantity.word}</strong> <span class="last">${numberOf(last)}</span>
    <span class="hint">${quantity.hint}</span></figcaption><div ref=${place} role="img" aria-label=${label}></div></figure>`;
}

export function Charts({runs, words, live}) {
  const shown = runs.map(rows => rows.filter(row => row.sweep));
  if (!shown.some(rows => rows.length > 1)) return null;
  return html`<div class="charts">${[...QUANTITIES, ...(live ? [TIME_LEFT] : [])].map(quantity =>
    html`<${Chart} key=${quantity.key} quantity=${quantity} runs=${shown} words=${words} />`)}</div>`;
}

// SPDX-License-Identifier: Apache-2.0
// The points of a job in 3-D, and the views of their properties.
import {html, useEffect, useMemo, useRef, useState} from "./preact.js";
import {get, query, wait} from "./api.js";
import {Camera, DIRECTIONS, steer} from "./camera.js";
import {coloursOf, histogramOf, MAPS, rangeOf} from "./colours.js";
import {Discs} from "./discs.js";
import {countNeighbours} from "./neighbours.js";
import {Trouble, useTitle} from "./parts.js";
import {hasSpacing, loadEdges, loadPoints} from "./ply.js";
import {countOf, nameOf, numberOf} from "./words.js";

/** The maximum number of shown points. If there are more, a selection is shown, with a note: two million are 64 MiB on the graphics card. */
const MOST = 2000000;
const NEIGHBOURS = "neighbours";
const SHADING = "shading";
const WORDS = {kappa: "curvature", kappa1: "largest curvature", kappa2: "smallest curvature", spacing_local: "spacing", spacing: "requested spacing"};
const BACKGROUNDS = {"": "As the page", white: "White", grey: "Grey", black: "Black"};
const NO_COLOURS = ["x", "y", "z", "nx", "ny", "nz"];
const SHOWN_MS = 250; // how often points that arrive are shown
const HELD = 60; // milliseconds: a film shows no frame for less
const SNAPSHOT_S = 2; // the worker writes one so often

const AXES = {"": "No cut", x: "x", y: "y", z: "z"};

/** "rgb(29, 35, 39)" as numbers up to 1. */
const partsOf = colour => colour.match(/[\d.]+/g).slice(0, 3).map(part => part / 255);

/** The colours of an element's text and background. */
function coloursAt(element) {
  const {backgroundColor, color} = getComputedStyle(element);
  return {ground: partsOf(backgroundColor), ink: partsOf(color)};
}

/** The axes and the scale bar over a picture of the points. The bar's length holds at the distance of the point that is looked at. */
function drawScale(stage, camera, width, height) {
  const {right, up} = camera.axes();
  for (const [k, arm] of stage.querySelectorAll(".axes g").entries()) {
    const [x, y] = [22 * right[k], -22 * up[k]], [line, text] = arm.children;
    for (const [name, value] of [["x2", x], ["y2", y]]) line.setAttribute(name, value);
    for (const [name, value] of [["x", 1.3 * x], ["y", 1.3 * y]]) text.setAttribute(name, value);
  }
  const bar = stage.querySelector(".scale-bar");
  if (!bar || !width) return;
  const unit = camera.pixel(width, height) * camera.distance, longest = unit * Math.min(140, width / 4);
  const power = 10 ** Math.floor(Math.log10(longest)), length = power * [5, 2, 1].find(part => part * power <= longest);
  bar.style.width = `${length / unit}px`;
  bar.textContent = numberOf(length);
}

const AXIS_LETTERS = ["x", "y", "z"];

function Scale() {
  return html`<svg class="axes" viewBox="-32 -32 64 64" aria-hidden="true">${AXIS_LETTERS.map(letter =>
    html`<g class=${letter}><line x1="0" y1="0" /><text text-anchor="middle" dominant-baseline="central">${letter}</text></g>`)}</svg>
    <span class="scale-bar" title="Length at the centre of the view"></span>`;
}

/**
 * Draws into a canvas whenever something has changed. Holds what is not the view's state. The data attributes of the canvas
 * have what measurements/service/web_page.py measures: draw calls and milliseconds of script of a frame, and bytes on the graphics card.
 */
class Scene {
  constructor(canvas) {
    this.canvas = canvas;
    this.discs = new Discs(canvas);
    this.camera = new Camera();
    this.points = null;
    this.watcher = new ResizeObserver(() => this.resize());
    this.watcher.observe(canvas);
    this.repaint = () => this.change();
    addEventListener("theme", this.repaint);
  }

  resize() {
    const ratio = Math.min(2, devicePixelRatio || 1);
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    this.change();
  }

  /** Has the next frame drawn. */
  change() {
    this.frame = this.frame || requestAnimationFrame(() => this.draw());
  }

  draw() {
    cancelAnimationFrame(this.frame);
    this.frame = null;
    const {ground, ink} = coloursAt(this.canvas.parentNode);
    const begun = performance.now();
    const calls = this.discs.draw(this.camera, ground, ink);
    drawScale(this.canvas.parentNode, this.camera, this.canvas.clientWidth, this.canvas.clientHeight);
    Object.assign(this.canvas.dataset, {calls, bytes: this.discs.bytes || 0, ms: performance.now() - begun});
  }

  /** Fits the camera to the bounding box of the points received so far, unless the user has moved the camera or `still` is set. */
  frameAll(still = false) {
    const {columns: {x, y, z}, count} = this.points;
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const step = Math.max(1, Math.floor(count / 50000));
    for (let i = 0; i < count; i += step)
      [x[i], y[i], z[i]].forEach((value, k) => {
        low[k] = Math.min(low[k], value);
        high[k] = Math.max(high[k], value);
      });
    this.box = {low, high};
    if (still) return;
    const center = low.map((l, k) => (l + high[k]) / 2);
    let radius = 0;
    for (let i = 0; i < count; i += step) radius = Math.max(radius, Math.hypot(x[i] - center[0], y[i] - center[1], z[i] - center[2]));
    this.camera.frame(center, radius || 1);
  }

  /** Cuts away what lies beyond a part of the box along an axis. */
  cut(axis, part, other) {
    const k = "xyz".indexOf(axis), sign = other ? 1 : -1;
    this.discs.plane = [0, 0, 0, 1];
    if (axis && this.box) {
      const at = this.box.low[k] + part * (this.box.high[k] - this.box.low[k]);
      this.discs.plane = [0, 1, 2].map(i => (i === k ? sign : 0)).concat(-sign * at);
    }
    this.change();
  }

  free() {
    cancelAnimationFrame(this.frame);
    this.watcher.disconnect();
    removeEventListener("theme", this.repaint);
    this.discs.free();
  }
}

function Legend({colouring, counts, theme}) {
  const place = useRef(null);
  useEffect(() => {
    if (!place.current) return;
    const canvas = place.current, context = canvas.getContext("2d"), image = context.createImageData(256, 1);
    image.data.set(coloursOf(colouring.map, coloursAt(canvas.closest(".stage"))));
    context.putImageData(image, 0, 0);
  }, [colouring.map, colouring.by === SHADING, theme]);
  if (colouring.by === SHADING) return null;
  const ends = colouring.by === NEIGHBOURS ? null : colouring.range;
  return html`<div class="legend"><canvas ref=${place} width="256" height="1" aria-hidden="true"></canvas>
    ${ends ? html`<span class="ends"><span>${numberOf(ends[0])}</span><span>${WORDS[colouring.by] || colouring.by}</span><span>${numberOf(ends[1])}</span></span>`
      : html`<span class="ends">${[4, 5, 6, 7, 8].map(n => html`<span>${n === 4 ? "≤ 4" : n === 8 ? "≥ 8" : n}</span>`)}</span>`}
    ${counts && colouring.by === NEIGHBOURS && html`<p class="hint">Five: ${countOf(counts[5] || 0)}, six: ${countOf(counts[6] || 0)}, seven: ${countOf(counts[7] || 0)}, others: ${countOf(counts.others)}</p>`}</div>`;
}

function Picked({points, index, onClose}) {
  if (index < 0) return null;
  const {columns, origin, step} = points;
  const value = name => columns[name][index] + (origin["xyz".indexOf(name)] ?? 0);
  return html`<aside class="picked card" aria-label="Point"><button class="plain close" aria-label="Close" onClick=${onClose}>✕</button>
    <h3>Point ${countOf(index * step)}</h3><dl>${Object.keys(columns).map(name => html`<div><dt>${name}</dt><dd>${numberOf(value(name))}</dd></div>`)}</dl></aside>`;
}

/** The histogram of the colouring's values, with a handle at each end of the range. */
function Range({column, count, range, onChange}) {
  const {low, high, bars} = useMemo(() => histogramOf(column, count), [column, count]);
  const handle = (k, word) => html`<input type="range" aria-label=${word} min=${low} max=${high} step=${(high - low) / 500} value=${range[k]}
    onInput=${e => onChange(range.map((old, i) => (i === k ? Number(e.target.value) : old)))} />`;
  return html`<span class="histogram"><svg viewBox=${`0 0 ${bars.length} 1`} preserveAspectRatio="none" aria-hidden="true">
    ${bars.map((bar, i) => html`<rect x=${i} y=${1 - bar} width="0.9" height=${bar} />`)}</svg>${handle(0, "Lower end of the range")}${handle(1, "Upper end of the range")}</span>`;
}

function ColourControls({colouring, names, points, onChange}) {
  const set = change => onChange({...colouring, ...change});
  const bound = (k, word) => html`<label>${word}<input type="number" step="any" value=${Number(colouring.range[k].toPrecision(4))}
    onChange=${e => set({range: colouring.range.map((old, i) => (i === k ? Number(e.target.value) : old))})} /></label>`;
  return html`<label>Colour by<select value=${colouring.by} onChange=${e => set({by: e.target.value, range: null})}>
      ${names.map(name => html`<option value=${name} selected=${name === colouring.by}>${WORDS[name] || name}</option>`)}</select></label>
    ${![NEIGHBOURS, SHADING].includes(colouring.by) && colouring.range && points.columns[colouring.by] && html`<${Range} column=${points.columns[colouring.by]}
      count=${points.count} range=${colouring.range} onChange=${range => set({range})} />${bound(0, "From")}${bound(1, "To")}
      <label>Map<select value=${colouring.map} onChange=${e => set({map: e.target.value})}>
        ${Object.keys(MAPS).filter(map => ![NEIGHBOURS, SHADING].includes(map)).map(map => html`<option value=${map} selected=${map === colouring.map}>${map}</option>`)}</select></label>`}`;
}

/** The neighbours of all points, counted once and kept with them. */
async function addNeighbours(scene) {
  const {points} = scene;
  const degrees = await countNeighbours(points, () => scene.points === points);
  if (!degrees) return null;
  points.columns[NEIGHBOURS] = degrees;
  points.neighbours = {others: 0};
  for (const degree of degrees) {
    const key = degree >= 5 && degree <= 7 ? degree : "others";
    points.neighbours[key] = (points.neighbours[key] || 0) + 1;
  }
  return degrees;
}

/** Changes with the theme. */
function useTheme() {
  const [theme, setTheme] = useState(0);
  useEffect(() => {
    const change = () => setTheme(old => old + 1);
    addEventListener("theme", change);
    return () => removeEventListener("theme", change);
  }, []);
  return theme;
}

/**
 * The points of a job or of one of its frames; `onShown` is called when a frame is there. `snapshot` has points of a job that runs,
 * which are shown instead of its results. Views with the same set of `scenes` move their cameras together.
 */
export function PointCloud({job, frame, onShown, snapshot, scenes}) {
  const stage = useRef(null), canvas = useRef(null), scene = useRef(null);
  const [error, setError] = useState(null);
  const [progress, setProgress] = useState(null); // the points so far; null before the first
  const graded = ["curvature", "feature", "grid", "curve_spacing"].some(name => job.spec && job.spec.sampling && job.spec.sampling[name]);
  const [colouring, setColouring] = useState({by: !graded ? SHADING : snapshot ? "spacing" : "spacing_local", map: "viridis", range: null});
  const [size, setSize] = useState(1);
  const [background, setBackground] = useState("");
  const [picked, setPicked] = useState(-1);
  const [counting, setCounting] = useState(false);
  const [wire, setWire] = useState("none"); // none, wire, only
  const [cut, setCut] = useState({axis: "", part: 0.5, other: false});
  const [up, setUp] = useState("z");
  const theme = useTheme();
  const moveOthers = () => (scenes || []).forEach(other => {
    if (other === scene.current) return;
    other.camera.follow(scene.current.camera);
    other.change();
  });

  useEffect(() => {
    try {
      scene.current = new Scene(canvas.current);
    } catch (e) {
      setError(e);
      return undefined;
    }
    const {camera, discs} = scene.current;
    if (scenes) scenes.add(scene.current);
    steer(canvas.current, camera, () => {
      scene.current.change();
      moveOthers();
    }, (x, y) => {
      const ratio = canvas.current.width / canvas.current.clientWidth;
      discs.picked = discs.pick(camera, Math.round(x * ratio), Math.round(y * ratio));
      setPicked(discs.picked);
      scene.current.change();
    }, (x, y) => {
      const ratio = canvas.current.width / canvas.current.clientWidth;
      const found = discs.pick(camera, Math.round(x * ratio), Math.round(y * ratio));
      if (found < 0) return;
      const {columns} = scene.current.points;
      camera.centre([columns.x[found], columns.y[found], columns.z[found]]);
      scene.current.change();
      moveOthers();
    });
    return () => {
      if (scenes) scenes.delete(scene.current);
      scene.current.free();
    };
  }, []);

  useEffect(() => {
    if (!snapshot) get(`v1/jobs/${job.id}/results/report.json${query({frame})}`).then(report => setUp(report.up || "z"), () => {});
  }, [job.id]);

  useEffect(() => {
    const now = scene.current;
    if (!now || !snapshot) return;
    const first = now.points === null;
    now.discs.allocate(snapshot.kept);
    now.points = snapshot;
    now.discs.extend(snapshot);
    now.frameAll(!first);
    if (first) setUp(snapshot.comments.up);
    setPicked(-1);
    setProgress({count: snapshot.count, points: snapshot, whole: true});
    now.change();
  }, [snapshot]);

  useEffect(() => {
    const now = scene.current, stop = new AbortController();
    if (!now || snapshot) return undefined;
    const more = points => {
      now.discs.extend(points);
      now.frameAll(!alone); // in a film it is the surface that moves
      setProgress({count: points.count, points});
      now.change();
    };
    let shownAt = 0;
    const alone = now.points === null; // the first file is shown while it comes, frames of a film when they are whole
    loadPoints(`v1/jobs/${job.id}/results/points.ply${query({frame})}`, MOST, {
      signal: stop.signal,
      onStart: async points => {
        if (!points.columns.nx || !points.columns.ny || !points.columns.nz)
          throw new Error("points.ply has no normals: submit a changed copy whose output.ply.properties name nx, ny and nz.");
        if (!hasSpacing(points))
          points.even = (await get(`v1/jobs/${job.id}/results/report.json${query({frame})}`, {signal: stop.signal})).spacing;
        if (!alone) return;
        now.points = points;
        now.discs.allocate(points.kept);
      },
      onMore: points => {
        if (!alone || performance.now() - shownAt < SHOWN_MS) return;
        more(points);
        shownAt = performance.now();
      },
    }).then(points => {
      if (!alone) now.discs.allocate(points.kept);
      now.points = points;
      setPicked(-1);
      more(points);
      setProgress({count: points.count, points, whole: true});
      if (onShown) onShown(points);
    }).catch(e => e.name === "AbortError" || setError(e));
    return () => stop.abort();
  }, [job.id, frame]);

  const points = progress && progress.points;
  const names = points ? [SHADING, ...Object.keys(points.columns).filter(name => !NO_COLOURS.includes(name) && name !== NEIGHBOURS), ...(points.step === 1 ? [NEIGHBOURS] : [])] : [];
  useEffect(() => {
    if (!points || !points.count) return;
    const {discs} = scene.current, column = points.columns[colouring.by];
    if (colouring.by === SHADING) {
      discs.setMap(coloursOf(SHADING, coloursAt(canvas.current.parentNode)));
      scene.current.change();
      return;
    }
    if (!column) {
      if (colouring.by !== NEIGHBOURS) setColouring({...colouring, by: SHADING, range: null});
      else if (progress.whole && !counting) {
        setCounting(true);
        addNeighbours(scene.current).then(() => {
          setCounting(false);
          setProgress(old => ({...old}));
        });
      }
      return;
    }
    const range = colouring.by === NEIGHBOURS ? [3.5, 8.5] : !snapshot && colouring.range || rangeOf(column, points.count);
    const map = colouring.by === NEIGHBOURS ? NEIGHBOURS : colouring.map === NEIGHBOURS ? "viridis" : colouring.map;
    discs.setMap(coloursOf(map, coloursAt(canvas.current.parentNode)));
    discs.colourBy(column);
    discs.range = range;
    scene.current.change();
    if (progress.whole && (String(range) !== String(colouring.range) || map !== colouring.map)) setColouring({...colouring, range, map});
  }, [progress, colouring.by, colouring.map, String(colouring.range), theme, background]);

  useEffect(() => {
    if (!scene.current) return;
    scene.current.discs.size = size;
    scene.current.change();
  }, [size]);

  useEffect(() => {
    if (scene.current) scene.current.cut(cut.axis, cut.part, cut.other);
  }, [cut, progress && progress.whole]);

  useEffect(() => {
    if (!scene.current) return;
    scene.current.camera.up = up;
    scene.current.change();
  }, [up]);

  const mesh = !snapshot && points && points.step === 1 && job.spec && job.spec.output && job.spec.output.mesh;
  useEffect(() => {
    const now = scene.current;
    if (!now || !points || !mesh) return;
    Object.assign(now.discs, {showWire: wire !== "none", showDiscs: wire !== "only"});
    now.change();
    if (wire === "none" || now.discs.edgeCount) return;
    loadEdges(`v1/jobs/${job.id}/results/mesh.ply${query({frame})}`, {}).then(edges => {
      now.discs.setEdges(edges);
      now.change();
    }, setError);
  }, [wire, points]);

  const save = () => {
    scene.current.draw(); // the picture is there until the browser shows the next one
    canvas.current.toBlob(blob => {
      const link = Object.assign(document.createElement("a"), {href: URL.createObjectURL(blob), download: `${nameOf(job)}.png`});
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    });
  };
  const look = ({target}) => {
    if (target.value) scene.current.camera.look(target.value);
    target.value = "";
    scene.current.change();
    moveOthers();
  };
  const home = () => {
    scene.current.camera.reset();
    scene.current.frameAll();
    scene.current.change();
    moveOthers();
  };
  return html`<div class="cloud">
    <${Trouble} error=${error} />
    <div class="stage" ref=${stage} data-ground=${background}><canvas ref=${canvas} tabindex="0" role="img" class="points"
      aria-label=${`The points of ${nameOf(job)} in 3-D. Arrow keys turn, with shift they move, plus and minus zoom, Home shows all.`}></canvas>
      ${points && html`<${Legend} colouring=${colouring} counts=${points.neighbours} theme=${`${theme}${background}`} />`}
      ${points && html`<${Scale} />`}
      ${points && html`<${Picked} points=${points} index=${picked} onClose=${() => {
        scene.current.discs.picked = -1;
        scene.current.change();
        setPicked(-1);
      }} />`}
      ${(!progress || !progress.whole) && !error && html`<p class="loading-points" role="status">${points ? `${countOf(progress.count * points.step)} of ${countOf(points.total)} points …` : "Loading points …"}</p>`}
      ${counting && html`<p class="loading-points" role="status">Counting neighbours …</p>`}</div>
    ${points && points.step > 1 && html`<p class="notice">One of ${points.step} points is shown: ${countOf(points.kept)} of ${countOf(points.total)}. Gaps between discs are no gaps in the packing.</p>`}
    ${points && !snapshot && html`<div class="controls"><${ColourControls} colouring=${colouring} names=${names} points=${points} onChange=${setColouring} />
      <label>Size of points<input type="range" min="0.2" max="2" step="0.05" value=${size} onInput=${e => setSize(Number(e.target.value))} /></label>
      <label>Background<select value=${background} onChange=${e => setBackground(e.target.value)}>
        ${Object.entries(BACKGROUNDS).map(([key, word]) => html`<option value=${key} selected=${key === background}>${word}</option>`)}</select></label>
      <label>View from<select value="" onChange=${e => look(e)}><option value="">Free</option>
        ${DIRECTIONS.map(word => html`<option value=${word}>${word}</option>`)}</select></label>
      <label>Up<select value=${up} onChange=${e => setUp(e.target.value)}>
        ${["z", "y"].map(axis => html`<option value=${axis} selected=${axis === up}>${axis}</option>`)}</select></label>
      <label>Cut along<select value=${cut.axis} onChange=${e => setCut({...cut, axis: e.target.value})}>
        ${Object.entries(AXES).map(([key, word]) => html`<option value=${key} selected=${key === cut.axis}>${word}</option>`)}</select></label>
      ${cut.axis && html`<label>Where<input type="range" min="0" max="1" step="0.005" value=${cut.part} onInput=${e => setCut({...cut, part: Number(e.target.value)})} /></label>
        <button onClick=${() => setCut({...cut, other: !cut.other})}>Other side</button>`}
      ${mesh && html`<label>Mesh<select value=${wire} onChange=${e => setWire(e.target.value)}>
        <option value="none">Hidden</option><option value="wire">With points</option><option value="only">Alone</option></select></label>`}
      <span class="buttons"><button onClick=${home}>Show all</button><button onClick=${save}>Save picture</button>
        ${document.fullscreenEnabled && html`<button onClick=${() => stage.current.requestFullscreen().catch(setError)}>Full screen</button>`}</span></div>
`}
    ${points && html`<p class="hint stats">${countOf(progress.count)} point${progress.count === 1 ? "" : "s"}. Drag turns, shift or two fingers move, the wheel zooms, a click reads a point, a double click centres it.</p>`}</div>`;
}

/** The points of a job or of one of its frames while its worker relaxes them; nothing before its first snapshot. */
export function LivePoints({job, frame}) {
  const [points, setPoints] = useState(null);
  useEffect(() => {
    const stop = new AbortController(), {signal} = stop;
    const read = () => loadPoints(`v1/jobs/${job.id}/snapshot${query({frame})}`, MOST, {signal, onStart() {}, onMore() {}});
    (async () => {
      for (;; await wait(SNAPSHOT_S, signal)) {
        if (document.hidden) continue;
        const found = await read().catch(e => e); // none yet, or none any more: the events of the job say so
        if (found.columns) setPoints(found);
      }
    })().catch(() => {}); // the view is left
    return () => stop.abort();
  }, [job.id, frame]);
  if (!points) return null;
  const {particles} = points.comments;
  return html`<section aria-label="Points so far"><h2>Points so far</h2><${PointCloud} job=${job} frame=${frame} snapshot=${points} />
    ${particles > points.count && html`<p class="notice">${countOf(points.count)} of ${countOf(particles)} points are shown.</p>`}</section>`;
}

/** The frames of an array as a film. */
function Film({frames, frame, shown, onChange}) {
  const [plays, setPlays] = useState(false);
  const at = frames.indexOf(frame);
  useEffect(() => {
    if (!plays || shown !== frame) return undefined;
    const timer = setTimeout(() => onChange(frames[(at + 1) % frames.length]), HELD);
    return () => clearTimeout(timer);
  }, [plays, shown, frame]);
  return html`<div class="controls film"><button aria-pressed=${plays} onClick=${() => setPlays(!plays)}>${plays ? "Stop" : "Play"}</button>
    <label class="grow">Frame ${frame}<input type="range" min="0" max=${frames.length - 1} value=${at} onInput=${e => onChange(frames[Number(e.target.value)])} /></label></div>`;
}

export function Points({ids: [id], search}) {
  const [job, setJob] = useState(null);
  const [frames, setFrames] = useState(null); // those that have succeeded; empty: the job is not an array
  const [frame, setFrame] = useState(search.has("frame") ? Number(search.get("frame")) : null);
  const [shown, setShown] = useState(null);
  const [error, setError] = useState(null);
  useTitle(job ? `Points of ${nameOf(job)}` : "Points");
  useEffect(() => {
    (async () => {
      const found = await get(`v1/jobs/${id}`), done = [];
      for (let after = null; found.array && after !== undefined;) {
        const page = await get(`v1/jobs/${id}/tasks${query({after, limit: 500})}`);
        done.push(...page.tasks.filter(task => task.state === "succeeded").map(task => task.frame));
        after = page.next ?? undefined;
      }
      if (done.length && frame === null) setFrame(done[0]);
      setFrames(done);
      setJob(found);
    })().catch(setError);
  }, [id]);
  if (!job) return html`<${Trouble} error=${error} />`;
  if (job.array && !frames.length) return html`<p class="empty">No frame has succeeded yet.</p>`;
  return html`<p class="back"><a href="#/">Queue</a> › <a href=${`#/jobs/${id}`}>${nameOf(job)}</a></p><h1>Points of ${nameOf(job)}</h1>
    ${frames.length > 1 && html`<${Film} frames=${frames} frame=${frame} shown=${shown} onChange=${setFrame} />`}
    <${PointCloud} job=${job} frame=${frame} onShown=${() => setShown(frame)} />`;
}

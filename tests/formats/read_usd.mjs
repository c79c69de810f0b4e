// Prints what two readers that share no code find in USD files, as JSON: three.js' parser its attributes, and tinyusdz whether each
// is a stage whose prims it knows, with the layer as it prints it again. tinyusdz is built for browsers, and is told that this is one;
// a copy's name says that it is a module, which its package leaves out and node 18 asks for.
import fs from "fs";
import os from "os";
import path from "path";
import url from "url";
import {USDAParser} from "three/examples/jsm/loaders/usd/USDAParser.js";

Object.defineProperty(process, "type", {value: "renderer"});
globalThis.window = globalThis;
const folder = fs.mkdtempSync(path.join(os.tmpdir(), "hexad-")), copy = path.join(folder, "tinyusdz.mjs");
fs.copyFileSync(new URL("node_modules/tinyusdz/tinyusdz.js", import.meta.url), copy);
const {default: initialise} = await import(url.pathToFileURL(copy));
fs.rmSync(folder, {recursive: true});
const wasmBinary = fs.readFileSync(new URL("node_modules/tinyusdz/tinyusdz.wasm", import.meta.url));
const native = await initialise({wasmBinary, print: () => {}, printErr: () => {}});

const found = process.argv.slice(2).map(file => {
  const stage = new native.TinyUSDZLoaderNative(), layer = new native.TinyUSDZLoaderNative();
  const bytes = fs.readFileSync(file);
  const whole = stage.loadFromBinary(bytes, file);
  let specs = null;
  try {
    specs = new USDAParser().parseData(bytes.toString()).specsByPath;
  } catch {
    // it does not know declarations without a value
  }
  return {
    specs,
    stage: whole, complaint: stage.error(), meshes: whole ? stage.numMeshes() : 0,
    printed: layer.loadAsLayerFromBinary(bytes, file) ? layer.layerToString() : null,
  };
});
console.log(JSON.stringify(found));

// Prints what two readers that share no code find in USD files, as JSON: three.js' parser its attributes, and tinyusdz whether each
// is a stage whose prims it knows, with the layer as it prints it again. tinyusdz is built for browsers, and is told that this is one.
import fs from "fs";
import {USDAParser} from "three/examples/jsm/loaders/usd/USDAParser.js";

Object.defineProperty(process, "type", {value: "renderer"});
globalThis.window = globalThis;
const {default: initialise} = await import("tinyusdz/tinyusdz.js");
const wasmBinary = fs.readFileSync(new URL("node_modules/tinyusdz/tinyusdz.wasm", import.meta.url));
const native = await initialise({wasmBinary, print: () => {}, printErr: () => {}});

const found = process.argv.slice(2).map(path => {
  const stage = new native.TinyUSDZLoaderNative(), layer = new native.TinyUSDZLoaderNative();
  const bytes = fs.readFileSync(path);
  const whole = stage.loadFromBinary(bytes, path);
  let specs = null;
  try {
    specs = new USDAParser().parseData(bytes.toString()).specsByPath;
  } catch {
    // it does not know declarations without a value
  }
  return {
    specs,
    stage: whole, complaint: stage.error(), meshes: whole ? stage.numMeshes() : 0,
    printed: layer.loadAsLayerFromBinary(bytes, path) ? layer.layerToString() : null,
  };
});
console.log(JSON.stringify(found));

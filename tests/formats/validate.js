// SPDX-License-Identifier: Apache-2.0
// Prints the report of Khronos's validator on a glTF file, as JSON.
const fs = require("fs");
const validator = require("gltf-validator");

validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), {uri: "points.glb"})
  .then(report => console.log(JSON.stringify(report)));

#include "formats/format.h"

#include "formats/glb.h"
#include "formats/npz.h"
#include "formats/usda.h"

const point_format formats[FORMATS] = {
    [FORMAT_NPZ] = {"points.npz", false, npz_write, npz_verify},
    [FORMAT_GLB] = {"points.glb", true, glb_write, glb_verify},
    [FORMAT_USDA] = {"points.usda", true, usda_write, usda_verify},
    [FORMAT_MESH_USDA] = {"mesh.usda", true, usda_write, usda_verify},
};

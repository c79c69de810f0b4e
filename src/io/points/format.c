#include "io/points/format.h"

#include "base/core/worker_contract.h"
#include "io/points/glb.h"
#include "io/points/npz.h"
#include "io/points/usda.h"

const point_format formats[FORMATS] = {
    [FORMAT_NPZ] = {"points.npz", false, false, false, npz_write},
    [FORMAT_GLB] = {"points.glb", true, false, false, glb_write},
    [FORMAT_USDA] = {"points.usda", true, false, false, usda_write},
    [FORMAT_USDA_SEQUENCE] = {"points_sequence.usda", true, true, false, usda_write_sequence},
    [FORMAT_USDA_STAGE] = {"points" WORKER_STAGE_ENDING, true, true, false, usda_write_stage},
    [FORMAT_MESH_USDA] = {"mesh.usda", true, false, true, usda_write},
    [FORMAT_MESH_USDA_SEQUENCE] = {"mesh_sequence.usda", true, true, true, usda_write_sequence},
    [FORMAT_MESH_USDA_STAGE] = {"mesh" WORKER_STAGE_ENDING, true, true, true, usda_write_stage},
};

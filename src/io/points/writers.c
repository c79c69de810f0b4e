// SPDX-License-Identifier: Apache-2.0
#include "io/points/writers.h"

#include "base/core/memory.h"
#include "io/points/glb.h"
#include "io/points/npz.h"
#include "io/points/usda.h"
#include "io/points/vtp.h"

const writer writers[FILE_FORMATS] = {
    [FILE_FORMAT_VTP] = {.write = {vtp_write}},
    [FILE_FORMAT_NPZ] = {.write = {npz_write}},
    [FILE_FORMAT_GLTF] = {.write = {glb_write}, .has_colors = true},
    [FILE_FORMAT_USD] = {.write = {usda_write, usda_write_sequence, usda_write_stage},
                         .has_colors = true,
                         .has_mesh = true,
                         .has_instances = true},
};

char *writers_name(file_format format, writer_part part, bool of_mesh)
{
    static const char *const parts[WRITER_PARTS] = {"", "_sequence", "_stage"};
    return mem_printf("%s%s%s", of_mesh ? "mesh" : "points", parts[part], file_formats[format].ending[0]);
}

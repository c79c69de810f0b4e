/* What the process that reads meshes answers: mesh_file_parse, and the judgement of its triangles on the way to a
 * level set. */
#include <math.h>

#include "fuzz/target.h"
#include "mesh/levelset.h"
#include "mesh/mesh_file.h"

static const size_t memory = (size_t)64 << 20;

static void check_grid(const vdb_grid *g)
{
    for (size_t n = 0; n < g->leaf_count * VDB_LEAF_VOXELS; n++) expect(isfinite(g->leaf_values[n]));
    for (size_t n = 0; n < g->leaf_count; n++)
        for (int k = 0; k < 3; k++) expect(g->leaf_origin[n][k] % VDB_LEAF_SIDE == 0);
    expect(g->leaf_count > 0);
}

static void make_levelset(mesh *m)
{
    error e = {0};
    mesh_notes notes = {0};
    threads *alone = threads_new(1, NULL, &e);
    expect(alone);
    levelset_params params = {
        .resolution = 16, .band_vox = 3, .weld = 1e-4, .memory_limit = memory, .pool = alone};
    vdb_grid *g = levelset_make(m, &params, &notes, &e);
    expect(g || (e.code != ERROR_INTERNAL && *e.message));
    expect(notes.count <= MESH_MAX_NOTES);
    if (g) check_grid(g);
    vdb_grid_free(g);
    threads_free(alone);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    error e = {0};
    mesh m = {0};
    mesh_reader_header header = {0};
    if (size == 0) return 0; /* not for fmemopen */
    FILE *stream = fmemopen((void *)data, size, "rb");
    expect(stream);
    if (mesh_file_parse(stream, memory, &header, &m, &e))
        make_levelset(&m);
    else
        expect(*e.message);
    fclose(stream);
    mesh_free(&m);
    return 0;
}

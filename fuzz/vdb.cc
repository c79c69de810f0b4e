// SPDX-License-Identifier: Apache-2.0
/* A VDB file: the listing, and the loading of every grid, by the shim and without it. Of what is loaded each
 * promise of vdb.h is held. */
#include <cmath>

#include <sys/mman.h>
#include <unistd.h>

#include "fuzz/target.h"
#include "io/vdb/plain_vdb.h"
#include "io/vdb/vdb.h"

/* Far below a job's, so that what a file makes up is seen. */
static const size_t memory = size_t(64) << 20;

static void check_grid(const vdb_grid *g)
{
    uint64_t sum = 0;
    for (int k = 0; k < 16; k++) expect(std::isfinite(g->index_to_world[k]));
    for (size_t n = 0; n < g->leaf_count; n++)
        for (int k = 0; k < 3; k++) expect(g->leaf_origin[n][k] % VDB_LEAF_SIDE == 0);
    for (size_t n = 0; n < g->leaf_count * 8; n++) sum += (uint64_t)__builtin_popcountll(g->leaf_active[n]);
    expect(sum <= g->active_voxels);
    for (size_t n = 0; n < g->tile_count; n++) {
        int32_t side = g->tiles[n].side;
        expect(side == 8 || side == 128 || side == 4096);
        for (int k = 0; k < 3; k++) expect(g->tiles[n].origin[k] % side == 0);
    }
}

/* What attributes ask of a grid: values at and beside its places, and far from it. */
static bool look(void *, const vdb_voxels *v, error *)
{
    static const int32_t places[][3] = {
        {0, 0, 0}, {1, 2, 3}, {-1, -1, -1}, {4096, 0, -4096}, {INT32_MAX, INT32_MIN, 7}};
    expect(v->components == 1 || v->components == 3);
    for (int k = 0; k < 16; k++) expect(std::isfinite(v->index_to_world[k]));
    for (const int32_t *at : places) {
        double value[3];
        v->read(v, at, value);
    }
    return true;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    error e = {};
    vdb_listing list;
    int fd = memfd_create("vdb", MFD_CLOEXEC);
    expect(fd >= 0 && write(fd, data, size) == (ssize_t)size);
    if (plain_vdb_list_grids(fd, &list)) {
        for (size_t n = 0; n < list.count; n++) {
            vdb_grid *g = plain_vdb_load_grid(fd, n, memory, nullptr);
            if (g) check_grid(g);
            vdb_grid_free(g);
        }
        vdb_listing_free(&list);
    }
    if (vdb_list_grids(fd, &list, &e)) {
        for (size_t n = 0; n < list.count; n++) {
            vdb_grid *g = vdb_load_grid(fd, n, vdb_loading(), memory, &e);
            if (g) check_grid(g);
            expect(g || (e.code != ERROR_INTERNAL && *e.message));
            expect(!g || list.entries[n].scalar);
            vdb_grid_free(g);
            e.code = ERROR_NONE;
            bool seen = vdb_visit_grid(fd, n, memory, look, NULL, &e);
            expect(seen || (e.code != ERROR_INTERNAL && *e.message));
            expect(!seen || list.entries[n].numeric);
        }
        vdb_listing_free(&list);
    } else {
        expect(e.code != ERROR_INTERNAL && *e.message);
    }
    close(fd);
    return 0;
}

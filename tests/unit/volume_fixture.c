// SPDX-License-Identifier: Apache-2.0
#include "volume_fixture.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/core/memory.h"

const double fixture_uniform[16] = {0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 1};
const double fixture_nonuniform[16] = {0.1, 0, 0, 0.03, 0, 0.15, 0, -0.02, 0, 0, 0.08, 0.01, 0, 0, 0, 1};
/* The columns are 0.1, 0.15 and 0.08 times an orthonormal frame. */
const double fixture_rotated[16] = {0.0666666666666667,
                                    -0.1,
                                    0.0266666666666667,
                                    0.03,
                                    0.0666666666666667,
                                    0.05,
                                    -0.0533333333333333,
                                    -0.02,
                                    0.0333333333333333,
                                    0.1,
                                    0.0533333333333333,
                                    0.01,
                                    0,
                                    0,
                                    0,
                                    1};
const double fixture_mirrored[16] = {-0.1, 0, 0, 0.03, 0, 0.15, 0, -0.02, 0, 0, 0.08, 0.01, 0, 0, 0, 1};

static vec3 place(const double m[16], int x, int y, int z)
{
    return (vec3){m[0] * x + m[1] * y + m[2] * z + m[3], m[4] * x + m[5] * y + m[6] * z + m[7],
                  m[8] * x + m[9] * y + m[10] * z + m[11]};
}

fixture fixture_make(const double matrix[16], int half, fixture_function f, double band)
{
    fixture g = {{0}, {0}, NULL, NULL, NULL};
    size_t side = (size_t)(2 * half + 1), capacity = side * side * side, n = 0;
    memcpy(g.matrix, matrix, sizeof g.matrix);
    g.voxels = mem_array(capacity, sizeof *g.voxels, "voxels", NULL);
    g.values = mem_array(capacity, sizeof *g.values, "values", NULL);
    g.active = mem_array(capacity, sizeof *g.active, "flags", NULL);
    for (int x = -half; x <= half; x++)
        for (int y = -half; y <= half; y++)
            for (int z = -half; z <= half; z++) {
                double v = f(place(matrix, x, y, z));
                if (band > 0 && v >= band) continue;
                g.active[n] = !(band > 0 && v <= -band);
                g.values[n] = (float)(g.active[n] ? v : -band);
                g.voxels[n][0] = x;
                g.voxels[n][1] = y;
                g.voxels[n++][2] = z;
            }
    g.draft = (vdb_draft){.name = "surface",
                          .type = "float",
                          .grid_class = band > 0 ? VDB_LEVEL_SET : VDB_FOG,
                          .background = band,
                          .voxel_count = n};
    return g;
}

void fixture_free(fixture *g)
{
    free(g->voxels);
    free(g->values);
    free(g->active);
}

void fixture_set(fixture *g, int x, int y, int z, float value, bool active)
{
    for (size_t i = 0; i < g->draft.voxel_count; i++)
        if (g->voxels[i][0] == x && g->voxels[i][1] == y && g->voxels[i][2] == z) {
            g->values[i] = value;
            g->active[i] = active;
            return;
        }
    fail_msg("no voxel (%d, %d, %d) in the fixture", x, y, z);
}

int fixture_bytes(const void *bytes, size_t count)
{
    int fd = memfd_create("hexad-test", MFD_CLOEXEC);
    assert_true(fd >= 0);
    if (count) assert_int_equal(write(fd, bytes, count), (ssize_t)count);
    return fd;
}

int fixture_write(const vdb_draft *drafts, size_t count, vdb_layout layout, bool compressed)
{
    error e = {0};
    int fd = fixture_bytes(NULL, 0);
    if (!vdb_write_grids(fd, drafts, count, layout, compressed, &e)) fail_msg("%s", e.message);
    return fd;
}

volume *fixture_open(int fd, const char *grid, double isovalue, volume_reconstruction how, error *e)
{
    volume_request r = {.fd = fd,
                        .path = "test.vdb",
                        .grid = grid,
                        .has_isovalue = !isnan(isovalue),
                        .isovalue = isnan(isovalue) ? 0 : isovalue,
                        .reconstruction = how,
                        .memory_limit = FIXTURE_MEMORY};
    return volume_open(&r, e);
}

vdb_draft fixture_draft(const fixture *g)
{
    vdb_draft draft = g->draft;
    draft.index_to_world = g->matrix;
    draft.voxels = (const int32_t(*)[3])g->voxels;
    draft.values = g->values;
    draft.active = g->active;
    return draft;
}

volume *fixture_volume(const fixture *g, double isovalue, volume_reconstruction how)
{
    error e = {0};
    const vdb_draft draft = fixture_draft(g);
    int fd = fixture_write(&draft, 1, VDB_SEEKABLE, true);
    volume *v = fixture_open(fd, NULL, isovalue, how, &e);
    close(fd);
    if (!v) fail_msg("%s: %s", error_code_name(e.code), e.message);
    return v;
}

bool fixture_project(const field *f, vec3 x, vec3 *out)
{
    field_sample s;
    /* quadratic convergence: a dozen steps suffice from one cell away */
    for (int step = 0; step < 20; step++) {
        if (!field_sample_at(f, x, FIELD_GRADIENT, &s)) return false;
        double g2 = vec3_norm2(s.gradient);
        if (!(g2 > 0)) return false;
        x = vec3_axpy(-s.value / g2, s.gradient, x);
    }
    if (!field_sample_at(f, x, FIELD_GRADIENT, &s)) return false;
    *out = x;
    return fabs(s.value) < 1e-6 * f->cell_size * vec3_norm(s.gradient);
}

vec3 fixture_cell_center(const field *f, size_t k)
{
    field_cell cell;
    f->ops->cell(f, k, &cell);
    return vec3_scale(vec3_add(cell.corner[0], cell.corner[7]), 0.5);
}

/* splitmix64 */
double fixture_random(uint64_t *state)
{
    uint64_t z = (*state += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

const char *fixture_shared(void)
{
    static char place_[4096];
    const char *named = getenv("HEXAD_SHARED"), *source = getenv("HEXAD_SOURCE");
    snprintf(place_, sizeof place_, "%s", named ? named : "");
    if (!named) snprintf(place_, sizeof place_, "%s/../shared/data", source ? source : ".");
    return access(place_, R_OK) == 0 ? place_ : NULL;
}

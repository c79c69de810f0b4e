// SPDX-License-Identifier: Apache-2.0
/* volume_fixture: small volumes for tests of src/surface/volume and src/io/vdb, in memory files. */
#ifndef HEXAD_TESTS_VOLUME_FIXTURE_H
#define HEXAD_TESTS_VOLUME_FIXTURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "io/vdb/vdb.h"
#include "surface/volume/volume.h"

#define FIXTURE_MEMORY ((size_t)1 << 30)

/* A draft with the arrays that it points to. */
typedef struct fixture {
    vdb_draft draft;
    double matrix[16];
    int32_t (*voxels)[3];
    float *values;
    bool *active;
} fixture;

typedef double (*fixture_function)(vec3 world);

extern const double fixture_uniform[16];    /* voxel 0.1 */
extern const double fixture_nonuniform[16]; /* voxels 0.1 x 0.15 x 0.08, shifted */
extern const double fixture_rotated[16];    /* the same, rotated about an oblique axis */
extern const double fixture_mirrored[16];   /* the same, mirrored: the determinant is negative */

/* Voxels from -half to +half on each axis. With a band, a level set: values are clamped to +-band and
 * inactive there, and voxels outside of the band are missing. With band 0, a fog volume in which all
 * voxels are active. */
fixture fixture_make(const double matrix[16], int half, fixture_function f, double band);
void fixture_free(fixture *g);
/* Sets an existing voxel of the fixture. */
void fixture_set(fixture *g, int x, int y, int z, float value, bool active);

/* The draft of a fixture; the fixture must not be moved afterwards. */
vdb_draft fixture_draft(const fixture *g);

/* Writes the drafts, or the bytes, to a file in memory. */
int fixture_write(const vdb_draft *drafts, size_t count, vdb_layout layout, bool compressed);
int fixture_bytes(const void *bytes, size_t count);

/* Calls volume_open with the descriptor. An isovalue of NAN means none. */
volume *fixture_open(int fd, const char *grid, double isovalue, volume_reconstruction how, error *e);
/* Writes, opens and closes the descriptor. The test fails if the volume cannot be opened. */
volume *fixture_volume(const fixture *g, double isovalue, volume_reconstruction how);

/* Newton's method from x to the surface along the gradient. False if it leaves the coefficient blocks. */
bool fixture_project(const field *f, vec3 x, vec3 *out);
vec3 fixture_cell_center(const field *f, size_t k);

/* Random numbers in [0, 1); equal seeds give equal sequences. */
double fixture_random(uint64_t *state);

/* HEXAD_SHARED, or ../shared/data beside the source. NULL if there is no such directory. */
const char *fixture_shared(void);

#endif

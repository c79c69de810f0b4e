// SPDX-License-Identifier: Apache-2.0
/* A GIfTI file in the process that reads, with the values of its points. */
#include <string.h>

#include "fuzz/target.h"
#include "io/meshes/plain_mesh.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    plain_mesh m = {.keeps_values = true};
    char *copy = malloc(size + 1); /* the sanitizers see what is read behind it */
    expect(copy);
    memcpy(copy, data, size);
    copy[size] = 0;
    if (plain_mesh_read(FILE_FORMAT_GIFTI, copy, size, &m)) {
        for (size_t n = 0; n < m.triangles; n++)
            for (int k = 0; k < 3; k++) expect(m.triangle[n][k] < m.vertices);
        for (uint32_t k = 0; k < m.value_arrays; k++)
            expect(m.values[k].count == m.vertices && m.values[k].head.components <= MESH_VALUES_COMPONENTS);
        plain_mesh_free(&m);
    } else {
        expect(m.refused != ERROR_NONE && *m.text);
    }
    free(copy);
    return 0;
}

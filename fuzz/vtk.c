// SPDX-License-Identifier: Apache-2.0
/* The same bytes as a legacy file and as an XML file of VTK, with the values of the vertices, in the process that reads. */
#include <string.h>

#include "fuzz/target.h"
#include "io/meshes/plain_mesh.h"

static void read_as(file_format format, const char *data, size_t size)
{
    plain_mesh m = {.keeps_values = true};
    if (!plain_mesh_read(format, data, size, &m)) {
        expect(m.refused != ERROR_NONE && *m.text);
        return;
    }
    for (size_t n = 0; n < m.triangles; n++)
        for (int k = 0; k < 3; k++) expect(m.triangle[n][k] < m.vertices);
    for (uint32_t k = 0; k < m.value_arrays; k++)
        expect(m.values[k].count == m.vertices && m.values[k].head.components <= MESH_VALUES_COMPONENTS);
    plain_mesh_free(&m);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char *copy = malloc(size + 1); /* the sanitizers see what is read behind it */
    expect(copy);
    memcpy(copy, data, size);
    copy[size] = 0;
    read_as(FILE_FORMAT_VTK, copy, size);
    read_as(FILE_FORMAT_VTP, copy, size);
    free(copy);
    return 0;
}

// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/foreign_format.h"

#include "io/meshes/plain_mesh.h"

const char *foreign_format(const char *ending, const char *data, size_t size)
{
    const file_format found = file_format_of_bytes(data, size), named = file_format_of_name(ending);
    if (plain_mesh_reads(found) && file_format_has_ending(found, ending)) return NULL;
    if (!file_formats[found].as_mesh && file_formats[named].is_misread) return file_formats[named].as_mesh;
    return file_formats[found].as_mesh;
}

// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/foreign_format.h"

#include "io/meshes/plain_mesh.h"

const char *foreign_format(const char *ending, const char *data, size_t size)
{
    const file_format found = file_format_of_bytes(data, size), named = file_format_of_name(ending);
    if (plain_mesh_reads(found) && file_format_has_ending(found, ending)) return NULL;
    const file_format_row *by_name = &file_formats[named];
    const bool is_read = by_name->reading != FILE_FORMAT_NOT_READ;
    return file_formats[found].as_mesh || is_read ? file_formats[found].as_mesh : by_name->as_mesh;
}

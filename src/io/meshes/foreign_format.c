// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/foreign_format.h"

#include "io/meshes/plain_mesh.h"

const char *foreign_format(const char *ending, const char *data, size_t size)
{
    const file_format found = file_format_of_bytes(data, size), named = file_format_of_name(ending);
    if (plain_mesh_reads(found) && file_format_has_ending(found, ending)) return NULL;
    const file_format_row *by_name = &file_formats[named];
    const bool is_none =
        by_name->is_misread || by_name->kind == FILE_FORMAT_IMAGES || by_name->kind == FILE_FORMAT_DOCUMENTS;
    return file_formats[found].as_mesh || !is_none ? file_formats[found].as_mesh : by_name->as_mesh;
}

// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/attribute.h"

#include <string.h>

#include "base/core/file_format.h"
#include "job/attributes/base_color.h"
#include "job/attributes/corners.h"
#include "job/attributes/dense_attributes.h"
#include "job/attributes/grid.h"

/* The functions that read a kind of file. */
typedef struct reader {
    bool (*find)(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);
    bool (*read)(const attribute_request *request, size_t count, const vec3 *position, double *values,
                 attribute_counts *counts, error *e);
} reader;

/* The reader for a file. Files that are no other kind are treated as meshes, whose reader refuses unknown
 * ones. */
static const reader *reader_of(const attribute_request *request)
{
    static const reader grids = {grid_find, grid_read},
                        volumes = {dense_attributes_find, dense_attributes_read},
                        meshes = {corners_find, corners_read}, textures = {base_color_find, base_color_read};
    if (request->stack) return &volumes;
    const file_format_kind kind = file_formats[file_format_of_file(request->fd, request->path)].kind;
    if (kind == FILE_FORMAT_GRIDS) return &grids;
    if (kind == FILE_FORMAT_VOLUMES) return &volumes;
    return request->name && strcmp(request->name, BASE_COLOR_NAME) == 0 ? &textures : &meshes;
}

static bool suits(point_attribute_kind kind, int components)
{
    switch (kind) {
    case POINT_ATTRIBUTE_VECTOR:
    case POINT_ATTRIBUTE_NORMAL:
        return components == 3;
    case POINT_ATTRIBUTE_COLOR:
        return components >= 3;
    case POINT_ATTRIBUTE_UV:
        return components == 2;
    default:
        return true;
    }
}

bool attribute_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e)
{
    static const char *const needs[] = {"", "", "three", "three", "three or four", "two"};
    const reader *r = reader_of(request);
    point_attribute_kind found;
    if (!r->find(request, &found, components, e)) return error_prefix(e, "%s", request->path);
    *kind = request->has_kind ? request->kind : found;
    return suits(*kind, *components) ||
           error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "%s: \"%s\" has %d components, but this type has %s: give another type", request->path,
                     request->name ? request->name : "", *components, needs[*kind]);
}

void attribute_forget(attribute_mesh **last)
{
    corners_forget(last);
}

bool attribute_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                    attribute_counts *counts, error *e)
{
    return reader_of(request)->read(request, count, position, values, counts, e) ||
           error_prefix(e, "%s", request->path);
}

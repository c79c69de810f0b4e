#include "attribute/attribute.h"

#include <string.h>
#include <unistd.h>

#include "attribute/grid.h"

/* What reads a kind of file. */
typedef struct reader {
    const char *magic;
    size_t magic_length;
    bool (*find)(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);
    bool (*read)(const attribute_request *request, size_t count, const vec3 *position, double *values,
                 attribute_counts *counts, error *e);
} reader;

static const reader readers[] = {{" BDV\0\0\0\0", 8, grid_find, grid_read}};

/* By the file's first bytes. */
static const reader *reader_of(const attribute_request *request, error *e)
{
    char head[8] = "";
    ssize_t got = pread(request->fd, head, sizeof head, 0);
    for (size_t k = 0; k < sizeof readers / sizeof *readers; k++)
        if (got >= (ssize_t)readers[k].magic_length &&
            memcmp(head, readers[k].magic, readers[k].magic_length) == 0)
            return &readers[k];
    error_set(e, ERROR_INPUT_UNSUPPORTED, "the file is none that attributes are read from: OpenVDB");
    return NULL;
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
    const reader *r = reader_of(request, e);
    point_attribute_kind own;
    if (!r || !r->find(request, &own, components, e)) return error_prefix(e, "%s", request->path);
    *kind = request->has_kind ? request->kind : own;
    return suits(*kind, *components) ||
           error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "%s: \"%s\" has %d components, and such an attribute has %s: give another type",
                     request->path, request->name ? request->name : "", *components, needs[*kind]);
}

bool attribute_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                    attribute_counts *counts, error *e)
{
    const reader *r = reader_of(request, e);
    return (r && r->read(request, count, position, values, counts, e)) ||
           error_prefix(e, "%s", request->path);
}

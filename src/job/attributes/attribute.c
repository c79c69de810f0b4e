#include "job/attributes/attribute.h"

#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "job/attributes/corners.h"
#include "job/attributes/dense.h"
#include "job/attributes/grid.h"

/* What reads a kind of file. */
typedef struct reader {
    const char *magic;
    size_t magic_length;
    const char *
        endings; /* each between blanks, if the first bytes do not determine the format; NULL: all other files */
    bool (*find)(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);
    bool (*read)(const attribute_request *request, size_t count, const vec3 *position, double *values,
                 attribute_counts *counts, error *e);
} reader;

enum { GRIDS, VOLUMES, PAIRS, PAGES, MESHES, READERS };
static const reader readers[READERS] = {
    [GRIDS] = {" BDV\0\0\0\0", 8, "", grid_find, grid_read},
    [VOLUMES] = {"NRRD", 4, "", dense_find, dense_read},
    [PAIRS] = {"", 0, " .nii .nii.gz .hdr .mha .mhd ", dense_find, dense_read},
    [PAGES] = {"", 0, " .tif .tiff .btf ", dense_find, dense_read},
    [MESHES] = {"", 0, NULL, corners_find, corners_read}, /* whose reader knows the formats */
};

static bool ends_with_one_of(const char *path, const char *endings)
{
    size_t length = strlen(path);
    for (const char *at = endings; (at = strchr(at, '.')); at += strcspn(at, " ")) {
        size_t n = strcspn(at, " ");
        if (length > n && strncasecmp(path + length - n, at, n) == 0) return true;
    }
    return false;
}

/* By the file's first bytes, or its name. */
static const reader *reader_of(const attribute_request *request)
{
    char head[8] = "";
    const reader *r = readers;
    if (request->stack) return &readers[VOLUMES];
    ssize_t got = pread(request->fd, head, sizeof head, 0);
    for (; r->endings; r++)
        if (r->magic_length > 0
                ? got >= (ssize_t)r->magic_length && memcmp(head, r->magic, r->magic_length) == 0
                : ends_with_one_of(request->path, r->endings))
            break;
    return r;
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
    point_attribute_kind own;
    if (!r->find(request, &own, components, e)) return error_prefix(e, "%s", request->path);
    *kind = request->has_kind ? request->kind : own;
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

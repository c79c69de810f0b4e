// SPDX-License-Identifier: Apache-2.0
#include "job/phases/surface_meshes.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "geometry/space/affine.h"

void surface_append_transform(const spec_surface *s, double m[3][4])
{
    double product[3][4];
    affine_compose((const double(*)[4])m, s->matrix, product);
    memcpy(m, product, sizeof product);
}

static size_t count_meshes(const spec_surface *s)
{
    size_t count = s->kind == SPEC_SURFACE_MESH;
    for (size_t k = 0; k < s->part_count; k++) count += count_meshes(s->parts[k]);
    return count;
}

/* Opens the meshes of a part and adds them to the list. `m`: from the space of the part to world space. */
static bool open_part(const spec_surface *s, const double m[3][4], source *from, surface_meshes *out,
                      error *e)
{
    double to_world[3][4];
    memcpy(to_world, m, sizeof to_world);
    if (s->kind == SPEC_SURFACE_TRANSFORM) surface_append_transform(s, to_world);
    if (s->kind == SPEC_SURFACE_MESH) {
        attachment_file *file = &out->file[out->count];
        const source_array *given = source_arrays_find(from->arrays, s->mesh.path);
        *file = (attachment_file){.fd = given ? -1 : source_open_file(from, s->mesh.path, e),
                                  .path = s->mesh.path,
                                  .array = given ? &given->mesh : NULL};
        memcpy(file->to_world, to_world, sizeof to_world);
        out->count += given || file->fd >= 0;
        return given || file->fd >= 0;
    }
    for (size_t k = 0; k < s->part_count; k++)
        if (!open_part(s->parts[k], (const double(*)[4])to_world, from, out, e)) return false;
    return true;
}

bool surface_meshes_open(const spec_surface *s, source *from, surface_meshes *out, error *e)
{
    static const double world[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
    const size_t count = count_meshes(s);
    if (count == 0)
        return error_set(
            e, ERROR_ATTRIBUTE_MISSING,
            "the surface has no mesh on which its points could have a place: remove this attribute");
    out->file = mem_alloc(count * sizeof *out->file);
    return open_part(s, world, from, out, e);
}

void surface_meshes_close(surface_meshes *m)
{
    for (size_t k = 0; k < m->count; k++)
        if (m->file[k].fd >= 0) close(m->file[k].fd);
    free(m->file);
    *m = (surface_meshes){0};
}

char *surface_meshes_comments(const surface_meshes *m)
{
    char *text = mem_strdup("comment hexad\n");
    for (size_t k = 0; k < m->count; k++) {
        char *line = attachment_comment(k, &m->file[k].topology), *longer = mem_printf("%s%s\n", text, line);
        free(line);
        free(text);
        text = longer;
    }
    return text;
}

// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/corners.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "job/attributes/lattice.h"
#include "base/core/memory.h"
#include "geometry/space/affine.h"
#include "io/meshes/mesh_file.h"
#include "surface/triangles/triangle_tree.h"

static const point_attribute_kind kinds[MESH_VALUES_KINDS] = {
    [MESH_VALUES_NUMBER] = POINT_ATTRIBUTE_FLOAT,  [MESH_VALUES_WHOLE] = POINT_ATTRIBUTE_INT,
    [MESH_VALUES_NORMAL] = POINT_ATTRIBUTE_NORMAL, [MESH_VALUES_COLOR] = POINT_ATTRIBUTE_COLOR,
    [MESH_VALUES_UV] = POINT_ATTRIBUTE_UV,
};

struct attribute_mesh {
    char *path;
    mesh m;
    mesh_values values;
    mesh_notes notes;    /* none once an attribute has them */
    triangle_tree *tree; /* built when first needed; or NULL */
};

void corners_forget(attribute_mesh **last)
{
    attribute_mesh *kept = *last;
    *last = NULL;
    if (!kept) return;
    triangle_tree_free(kept->tree);
    mesh_values_free(&kept->values);
    mesh_free(&kept->m);
    free(kept->path);
    free(kept);
}

/* Returns the mesh, which is read unless it is the last one, and the index of the requested array. */
static bool find_mesh(const attribute_request *request, attribute_mesh **out, size_t *which, error *e)
{
    const mesh_file file = {request->fd, request->path, NULL, request->memory_limit};
    attribute_mesh *kept = *request->last;
    if (!kept || strcmp(kept->path, request->path) != 0) {
        corners_forget(request->last);
        attribute_mesh read = {0};
        if (!mesh_file_read_values(&file, &read.m, &read.values, &read.notes, e)) return false;
        kept = *request->last = mem_alloc(sizeof *kept);
        *kept = read;
        kept->path = mem_strdup(request->path);
    }
    *out = kept;
    return mesh_values_find(&kept->values, request->name, which, e);
}

bool corners_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e)
{
    attribute_mesh *kept;
    size_t which;
    if (!find_mesh(request, &kept, &which, e)) return false;
    const mesh_reader_values *head = &kept->values.head[which];
    const bool is_vector = head->kind == MESH_VALUES_NUMBER && head->components == 3;
    *kind = is_vector ? POINT_ATTRIBUTE_VECTOR : kinds[head->kind];
    *components = (int)head->components;
    return true;
}

/* Interpolates the values of the corners by their weights. Whole numbers are those of the nearest corner. */
static void mix(const double *value, int components, const uint32_t corner[3], const double weight[3],
                bool whole, double *out)
{
    int nearest = weight[1] > weight[0];
    if (weight[2] > weight[nearest]) nearest = 2;
    for (int c = 0; c < components; c++) {
        out[c] = whole ? value[(size_t)components * corner[nearest] + (size_t)c] : 0;
        for (int k = 0; !whole && k < 3; k++)
            out[c] += weight[k] * value[(size_t)components * corner[k] + (size_t)c];
    }
}

bool corners_is_far(const attribute_request *request, size_t i, vec3 x, const mesh *m,
                    const uint32_t corner[3], const double weight[3])
{
    vec3 at = {0, 0, 0};
    for (int k = 0; k < 3; k++) at = vec3_axpy(weight[k], m->vertex[corner[k]], at);
    at = affine_apply(request->from_file, at.x, at.y, at.z);
    return vec3_norm(vec3_sub(at, x)) > request->spacing[i];
}

bool corners_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                  attribute_counts *counts, error *e)
{
    attribute_mesh *kept;
    size_t which;
    double to_file[3][4];
    if (!find_mesh(request, &kept, &which, e)) return false;
    if (!kept->tree && !(kept->tree = triangle_tree_new(&kept->m, NULL, e))) return false;
    for (size_t k = 0; k < kept->notes.count && !request->is_of_surface; k++)
        dense_warn(&counts->warnings, "%s", kept->notes.text[k]);
    kept->notes.count = 0;
    const mesh_reader_values *head = &kept->values.head[which];
    const int components = (int)head->components;
    affine_invert(request->from_file, to_file);
    for (size_t i = 0; i < count; i++) {
        double weight[3], *out = values + (size_t)components * i;
        vec3 x = affine_apply((const double(*)[4])to_file, position[i].x, position[i].y, position[i].z);
        const uint32_t *corner = kept->m.triangle[triangle_tree_find(kept->tree, x, weight)];
        counts->far += corners_is_far(request, i, position[i], &kept->m, corner, weight);
        bool finite = true;
        mix(kept->values.value[which], components, corner, weight, head->kind == MESH_VALUES_WHOLE, out);
        for (int c = 0; c < components; c++) finite &= isfinite(out[c]);
        for (int c = 0; c < components && !finite; c++) out[c] = 0;
        if (finite) lattice_turn(request->kind, request->from_file, out);
        counts->not_finite += !finite;
    }
    return true;
}

#include "attribute/corners.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "attribute/lattice.h"
#include "geometry/affine.h"
#include "mesh/mesh_file.h"
#include "mesh/nearest_triangle.h"

static const point_attribute_kind kinds[MESH_VALUES_KINDS] = {
    [MESH_VALUES_NUMBER] = POINT_ATTRIBUTE_FLOAT,  [MESH_VALUES_WHOLE] = POINT_ATTRIBUTE_INT,
    [MESH_VALUES_NORMAL] = POINT_ATTRIBUTE_NORMAL, [MESH_VALUES_COLOR] = POINT_ATTRIBUTE_COLOR,
    [MESH_VALUES_UV] = POINT_ATTRIBUTE_UV,
};

static bool missing(const attribute_request *request, const mesh_values *v, error *e)
{
    char list[600] = "";
    for (size_t k = 0; k < v->count; k++) {
        size_t used = strlen(list);
        snprintf(list + used, sizeof list - used, "%s\"%s\"", k ? ", " : "", v->head[k].name);
    }
    return error_set(e, ERROR_ATTRIBUTE_MISSING, "the mesh has no \"%s\"; its vertices have %s",
                     request->name ? request->name : "", *list ? list : "nothing but their places");
}

/* Reads the mesh and which of its arrays is asked for. Free both after success. */
static bool read_mesh(const attribute_request *request, mesh *m, mesh_values *values, size_t *which, error *e)
{
    const mesh_file file = {request->fd, request->path, NULL, request->memory_limit};
    if (!mesh_file_read_values(&file, m, values, e)) return false;
    for (*which = 0; *which < values->count; ++*which)
        if (request->name && strcmp(values->head[*which].name, request->name) == 0) return true;
    missing(request, values, e);
    mesh_values_free(values);
    mesh_free(m);
    return false;
}

bool corners_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e)
{
    mesh m;
    mesh_values values;
    size_t which;
    if (!read_mesh(request, &m, &values, &which, e)) return false;
    *kind = kinds[values.head[which].kind];
    *components = (int)values.head[which].components;
    mesh_values_free(&values);
    mesh_free(&m);
    return true;
}

/* Between the corners, each by its weight; whole numbers are the same at all of them. */
static void mix(const float *value, int components, const uint32_t corner[3], const double weight[3],
                bool whole, double *out)
{
    for (int c = 0; c < components; c++) {
        out[c] = whole ? (double)value[(size_t)components * corner[0] + (size_t)c] : 0;
        for (int k = 0; !whole && k < 3; k++)
            out[c] += weight[k] * (double)value[(size_t)components * corner[k] + (size_t)c];
    }
}

bool corners_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                  attribute_counts *counts, error *e)
{
    mesh m;
    mesh_values of_file;
    size_t which;
    double to_file[3][4];
    if (!read_mesh(request, &m, &of_file, &which, e)) return false;
    const mesh_reader_values *head = &of_file.head[which];
    const int components = (int)head->components;
    nearest_triangle *tree = nearest_triangle_new(&m, e);
    affine_invert(request->from_file, to_file);
    for (size_t i = 0; tree && i < count; i++) {
        double weight[3], *out = values + (size_t)components * i;
        vec3 x = affine_apply((const double(*)[4])to_file, position[i].x, position[i].y, position[i].z);
        const uint32_t *corner = m.triangle[nearest_triangle_find(tree, x, weight)];
        bool finite = true;
        mix(of_file.value[which], components, corner, weight, head->kind == MESH_VALUES_WHOLE, out);
        for (int c = 0; c < components; c++) finite &= isfinite(out[c]);
        for (int c = 0; c < components && !finite; c++) out[c] = 0;
        if (finite) lattice_turn(request->kind, request->from_file, out);
        counts->not_finite += !finite;
    }
    bool ok = tree != NULL;
    nearest_triangle_free(tree);
    mesh_values_free(&of_file);
    mesh_free(&m);
    return ok;
}

// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/map.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/affine.h"
#include "io/vdb/vdb.h"
#include "surface/triangles/triangle_tree.h"
#include "surface/volume/grid_selection.h"
#include "surface/volume/grid_view.h"

struct map {
    double to_index[3][4];
    vdb_grid *grid;
    grid_view grid_view;     /* as a level set at 0, so that values are unchanged */
    bool everywhere;         /* the background counts as a value */
    const array_grid *array; /* instead of the grid, or NULL */
    /* instead of the grid: triangles, and the value of each vertex; or NULL */
    triangle_tree *tree;
    mesh triangles;
    double *value;
};

static bool check_finite(const vdb_grid *g, error *e)
{
    for (size_t leaf = 0; leaf < g->leaf_count; leaf++)
        for (int k = 0; k < VDB_LEAF_VOXELS; k++) {
            bool active = g->leaf_active[leaf * 8 + (size_t)(k >> 6)] >> (k & 63) & 1;
            if (!active || isfinite(g->leaf_values[leaf * VDB_LEAF_VOXELS + (size_t)k])) continue;
            const int32_t *o = g->leaf_origin[leaf];
            return error_set(e, ERROR_INPUT_DAMAGED,
                             "the voxel (%d, %d, %d) is not finite: replace its value", o[0] + (k >> 6),
                             o[1] + (k >> 3 & 7), o[2] + (k & 7));
        }
    for (size_t k = 0; k < g->tile_count; k++)
        if (g->tiles[k].active && !isfinite(g->tiles[k].value)) {
            const int32_t *o = g->tiles[k].origin;
            return error_set(e, ERROR_INPUT_DAMAGED,
                             "the tile at (%d, %d, %d) is not finite: replace its value", o[0], o[1], o[2]);
        }
    return isfinite(g->background) ||
           error_set(e, ERROR_INPUT_DAMAGED, "its background is not finite: replace its value");
}

static vdb_grid *load_grid(int fd, const char *request, size_t memory_limit, char name[VDB_NAME_SIZE],
                           error *e)
{
    vdb_class any;
    size_t index;
    if (!grid_selection_find_in_file(fd, request, &index, &any, name, e)) return NULL;
    vdb_grid *grid = vdb_load_grid(fd, index, (vdb_loading){0}, memory_limit, e);
    if (grid && check_finite(grid, e) && grid->active_voxels > 0) return grid;
    if (grid && grid->active_voxels == 0)
        error_set(e, ERROR_INPUT_UNSUPPORTED, "it has no active voxel: choose another grid");
    vdb_grid_free(grid);
    error_prefix(e, "grid \"%s\"", name);
    return NULL;
}

/* Removes inactive tiles, which count as absent. */
static void drop_inactive_tiles(vdb_grid *g)
{
    size_t kept = 0;
    for (size_t k = 0; k < g->tile_count; k++)
        if (g->tiles[k].active) g->tiles[kept++] = g->tiles[k];
    g->tile_count = kept;
}

map *map_open(int fd, const char *path, const char *grid, size_t memory_limit, error *e)
{
    map *m = mem_alloc(sizeof *m);
    char name[VDB_NAME_SIZE];
    m->grid = load_grid(fd, grid, memory_limit, name, e);
    if (m->grid) {
        m->everywhere = m->grid->background > 0;
        if (!m->everywhere) drop_inactive_tiles(m->grid);
    }
    if (m->grid && grid_view_init(&m->grid_view, m->grid, GRID_VIEW_LEVEL_SET, 0, memory_limit, NULL, e)) {
        double to_world[3][4];
        for (int i = 0; i < 12; i++) to_world[i / 4][i % 4] = m->grid->index_to_world[i];
        affine_invert(to_world, m->to_index);
        return m;
    }
    error_prefix(e, "%s", path);
    map_close(m);
    return NULL;
}

static float element(const array_grid *g, size_t i, size_t j, size_t k)
{
    const array_view *a = &g->values;
    return (float)number_value((const char *)array_view_at(a, i, j) + (ptrdiff_t)k * a->stride[2], a->type,
                               false);
}

map *map_of_array(const array_grid *grid, error *e)
{
    const size_t *size = grid->values.size;
    double to_world[3][4];
    if (!array_grid_check(grid, e)) return NULL;
    for (size_t i = 0; i < size[0]; i++)
        for (size_t j = 0; j < size[1]; j++) {
            if (array_view_stopped(&grid->values)) {
                error_set(e, ERROR_CANCELLED, "stopped");
                return NULL;
            }
            for (size_t k = 0; k < size[2]; k++)
                if (!isfinite(element(grid, i, j, k))) {
                    error_set(e, ERROR_INPUT_DAMAGED, "values[%zu, %zu, %zu] is not finite: replace it", i, j,
                              k);
                    return NULL;
                }
        }
    map *m = mem_alloc(sizeof *m);
    m->array = grid;
    for (int i = 0; i < 12; i++) to_world[i / 4][i % 4] = grid->index_to_world[i];
    affine_invert(to_world, m->to_index);
    return m;
}

/* Copies a component of an array to m->value. */
static bool take_component(map *m, const mesh_reader_values *head, const double *from, int component,
                           error *e)
{
    const size_t components = head->components, at = component < 0 ? 0 : (size_t)component;
    if (at >= components || (components > 1 && component < 0))
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "\"%s\" has %zu component%s: set /sampling/grid/component to one of 0 to %zu",
                         head->name, components, components > 1 ? "s" : "", components - 1);
    m->value = mem_array(m->triangles.vertex_count, sizeof *m->value, "the values of the vertices", e);
    if (!m->value) return false;
    for (size_t k = 0; k < m->triangles.vertex_count; k++) m->value[k] = from[components * k + at];
    for (size_t n = 0; n < m->triangles.triangle_count; n++)
        for (int k = 0; k < 3; k++)
            if (!isfinite(m->value[m->triangles.triangle[n][k]]))
                return error_set(e, ERROR_INPUT_DAMAGED,
                                 "\"%s\" is not finite at vertex %" PRIu32 ": replace its value", head->name,
                                 m->triangles.triangle[n][k]);
    return true;
}

map *map_of_vertices(const mesh_file *file, const char *name, int component, mesh_notes *notes, error *e)
{
    map *m = mem_alloc(sizeof *m);
    mesh_values values = {0};
    size_t which;
    const bool ok = mesh_file_read_values(file, &m->triangles, &values, notes, e) &&
                    mesh_values_find(&values, name, &which, e) &&
                    take_component(m, &values.head[which], values.value[which], component, e) &&
                    (m->tree = triangle_tree_new(&m->triangles, NULL, e));
    mesh_values_free(&values);
    if (ok) return m;
    error_prefix(e, "%s", file->path);
    map_close(m);
    return NULL;
}

void map_close(map *m)
{
    if (!m) return;
    triangle_tree_free(m->tree);
    mesh_free(&m->triangles);
    free(m->value);
    grid_view_free(&m->grid_view);
    vdb_grid_free(m->grid);
    free(m);
}

size_t map_memory(const map *m)
{
    if (m && m->tree)
        return triangle_tree_bytes(m->tree) + m->triangles.vertex_count * sizeof *m->value +
               mesh_bytes(m->triangles.vertex_count, m->triangles.triangle_count);
    if (!m || !m->grid) return 0;
    return m->grid->leaf_count * (VDB_LEAF_VOXELS * sizeof(float) + 128) +
           m->grid->tile_count * sizeof(vdb_tile);
}

/* The value of a voxel. `everywhere`: also of the background. False: it is ignored. */
static bool voxel(const map *m, bool everywhere, const int32_t at[3], double *value)
{
    if (m->array) {
        const size_t *size = m->array->values.size;
        for (int a = 0; a < 3; a++)
            if (at[a] < 0 || (size_t)at[a] >= size[a]) return false;
        *value = (double)element(m->array, (size_t)at[0], (size_t)at[1], (size_t)at[2]);
        return true;
    }
    grid_view_block b = grid_view_find(&m->grid_view, at[0] >> 3, at[1] >> 3, at[2] >> 3);
    *value = (double)b.constant;
    if (b.leaf == BLOCK_MAP_NONE) return everywhere || b.constant != m->grid_view.background;
    size_t x = (size_t)(at[0] & 7), yz = (size_t)(8 * (at[1] & 7) + (at[2] & 7));
    *value = (double)m->grid->leaf_values[b.leaf * (size_t)VDB_LEAF_VOXELS + 64 * x + yz];
    return everywhere || m->grid->leaf_active[8 * (size_t)b.leaf + x] >> yz & 1;
}

static double vertex_value(const map *m, vec3 x)
{
    double weight[3], value = 0;
    const uint32_t *corner = m->triangles.triangle[triangle_tree_find(m->tree, x, weight)];
    for (int k = 0; k < 3; k++) value += weight[k] * (double)m->value[corner[k]];
    return value;
}

static double voxel_value(const map *m, bool everywhere, vec3 x)
{
    vec3 index = affine_apply(m->to_index, x.x, x.y, x.z);
    int32_t low[3];
    double t[3], sum = 0, weights = 0;
    for (int a = 0; a < 3; a++) {
        double v = vec3_get(index, a), below = floor(v);
        if (!(fabs(v) < INT32_MAX - 1)) return everywhere ? (double)m->grid->background : NAN;
        low[a] = (int32_t)below;
        t[a] = v - below;
    }
    for (int c = 0; c < 8; c++) {
        const int32_t at[3] = {low[0] + (c & 1), low[1] + (c >> 1 & 1), low[2] + (c >> 2)};
        double weight = (c & 1 ? t[0] : 1 - t[0]) * (c & 2 ? t[1] : 1 - t[1]) * (c & 4 ? t[2] : 1 - t[2]),
               value;
        if (weight == 0 || !voxel(m, everywhere, at, &value)) continue;
        sum += weight * value;
        weights += weight;
    }
    return weights > 0 ? sum / weights : NAN;
}

double map_value(const void *context, vec3 x)
{
    const map *m = context;
    return m->tree ? vertex_value(m, x) : voxel_value(m, m->everywhere, x);
}

bool map_is_near(const map *m, vec3 x, double distance)
{
    double distance2 = distance * distance;
    size_t nearest;
    if (m->tree) return triangle_tree_find_nearer(m->tree, x, &distance2, &nearest);
    bool is_near = !isnan(voxel_value(m, false, x));
    for (int k = 0; k < 12 && !is_near; k++) { /* three axes, both directions, two distances */
        vec3 at = x;
        vec3_set(&at, k % 3, vec3_get(x, k % 3) + (k & 1 ? 1 : -1) * (k < 6 ? 1 : 0.5) * distance);
        is_near = !isnan(voxel_value(m, false, at));
    }
    return is_near;
}

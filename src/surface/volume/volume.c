// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/volume.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/space/affine.h"
#include "surface/levelset/levelset.h"
#include "io/vdb/plain_vdb.h"
#include "io/vdb/vdb.h"
#include "surface/volume/coefficient_block.h"
#include "surface/volume/crossed_cells.h"
#include "surface/volume/dense_grid.h"
#include "surface/volume/hidden_crossing.h"
#include "surface/volume/grid_selection.h"
#include "surface/volume/slope.h"
#include "surface/volume/volume_field.h"
#include "surface/volume/band_extension.h"
#include "surface/volume/crossings.h"
#include "surface/volume/grid_view.h"
#include "surface/volume/prefilter.h"
#include "surface/volume/reach.h"
#include "surface/volume/ringing.h"
#include "surface/volume/samples.h"

/* Distances, in voxels from crossed cells, within which voxels are read. Coefficient blocks depend on two
 * voxels beyond the margin.
 * An error at the end of the voxels decays as 0.268 to the number of voxels, counted along all axes; for
 * arbitrary values 11 voxels beyond the coefficients of a crossed cell give 5e-7. For a level set only the
 * known voxels are used, wherever they end, and coefficient blocks extrapolate them independently: from 3
 * voxels off the surface adjacent coefficient blocks may differ, which only affects trial steps. */
#define REACH (VOLUME_FIELD_MARGIN + 2)
#define PATH 13
/* With smoothing, all coefficient blocks are searched for crossings, margin included: a coefficient block
 * extends up to 7 voxels beyond the margin, its apron 1 more, and a crossing may move by a cell. */
#define REACH_SMOOTH (VOLUME_FIELD_MARGIN + 9)

static const reach_limits coefficient_reach = {.straight = VOLUME_FIELD_MARGIN};

/* State while a volume is opened. */
typedef struct loading {
    char name[300]; /* name of the input in messages: `grid "NAME"` or `its level set` */
    int fd;         /* file of grids */
    size_t index;   /* index of the grid */
    bool is_grid;
    size_t memory_limit;
    vdb_grid *grid;
    grid_view_kind kind;
    dense_grid_facts facts; /* of a dense volume */
    double lowest, highest; /* range of the finite values */
    size_t solids;          /* number of solids of a mesh */
    grid_view grid_view;
    crossings crossings;
    block_map reach;
    samples_leaves leaves; /* ownership moves to `samples` */
    samples samples;
    bool smooth;
    size_t points; /* number that will be sampled; 0: unknown */
    threads *pool;
    bool limits;      /* samples are limited, because the spline rings beside them */
    char no_data[32]; /* as in io/volumes/warnings.h */
    bool rings;       /* a jump was found beside which the spline rings */
} loading;

/* ---- stages of opening */

static void warn(volume_info *info, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void warn(volume_info *info, const char *format, ...)
{
    if (info->warning_count == VOLUME_MAX_WARNINGS) return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(info->warning[info->warning_count++], sizeof info->warning[0], format, arguments);
    va_end(arguments);
}

/* Sets the isovalue for a surface at an offset. */
static bool move_isovalue(loading *l, volume *v, double offset, error *e)
{
    double to_world[3][4], to_index[3][4], unit;
    for (int k = 0; k < 12; k++) to_world[k / 4][k % 4] = l->grid->index_to_world[k];
    affine_invert(to_world, to_index);
    if (!slope_find_offset(l->grid, v->info.isovalue, offset, to_index, &v->info.isovalue, &unit, e))
        return error_prefix(e, "%s", l->name);
    if (unit != 1)
        warn(&v->info, "grid \"%s\" stores distances in units of %.4g: the offset of %g is %.4g units",
             v->info.grid, 1 / unit, offset, offset * unit);
    snprintf(l->name, sizeof l->name, "grid \"%s\" at an offset of %g", v->info.grid, offset);
    return true;
}

/* Warns of metadata on position or size of a grid, which are not applied. */
static void warn_of_space(volume_info *info, const vdb_grid *g)
{
    if (*g->unit)
        warn(info, "grid \"%s\" has the unit \"%s\", which is ignored: coordinates follow its transform",
             info->grid, g->unit);
    if (g->is_local)
        warn(info,
             "grid \"%s\" is in local space: the file lacks the transform of its object, and "
             "coordinates are local. Apply surface.transform for world coordinates.",
             info->grid);
}

/* Selects the grid, determines its kind, and loads it. */
static bool load_grid(const void *request, loading *l, volume *v, error *e)
{
    const volume_request *r = request;
    vdb_class class;
    size_t index;
    if (!grid_selection_find_in_file(r->fd, r->grid, &index, &class, v->info.grid, e)) return false;
    snprintf(l->name, sizeof l->name, "grid \"%s\"", v->info.grid);
    l->memory_limit = r->memory_limit;
    l->smooth = r->reconstruction == VOLUME_SMOOTHING;
    l->points = r->points;
    l->pool = r->pool;
    l->fd = r->fd;
    l->index = index;
    l->is_grid = true;
    v->info.level_set = class == VDB_LEVEL_SET;
    l->kind = v->info.level_set ? GRID_VIEW_LEVEL_SET : GRID_VIEW_FOG;
    if (!v->info.level_set && !r->has_isovalue)
        return error_set(
            e, ERROR_ISOVALUE_REQUIRED,
            "grid \"%s\" is %s: give isovalue (only level sets have a default, 0). hexadctl inspect "
            "FILE suggests one.",
            v->info.grid, class == VDB_FOG ? "a fog volume" : "not marked as a level set");
    if (!v->info.level_set && r->offset != 0)
        return error_set(
            e, ERROR_INPUT_UNSUPPORTED,
            "grid \"%s\" is not a level set, so its values are not distances: an offset requires "
            "a level set",
            v->info.grid);
    v->info.isovalue = r->has_isovalue ? r->isovalue : 0;
    if (!isfinite(v->info.isovalue))
        return error_set(e, ERROR_SPEC_INVALID, "the isovalue is not finite: give a number");
    if (class == VDB_UNKNOWN || class == VDB_STAGGERED)
        warn(&v->info,
             "grid \"%s\" has no grid class: it is treated as a fog volume (inside above the "
             "isovalue). Set its class to level set if it is one.",
             v->info.grid);
    l->grid = plain_vdb_load_grid(r->fd, index, r->memory_limit, r->pool);
    if (!l->grid && threads_stopped(r->pool)) return error_set(e, ERROR_CANCELLED, "stopped");
    if (!l->grid)
        l->grid = vdb_load_grid(r->fd, index, (vdb_loading){.zero = v->info.isovalue}, r->memory_limit, e);
    if (l->grid) warn_of_space(&v->info, l->grid);
    if (!l->grid) return error_prefix(e, "%s", l->name);
    if (l->grid->from_newer)
        warn(&v->info, "the file was written by a newer OpenVDB: only features of the installed version are "
                       "read");
    v->info.active_voxels = l->grid->active_voxels;
    if (v->info.active_voxels == 0)
        return error_set(e, ERROR_NO_SURFACE, "grid \"%s\" is empty (no active voxel): give another grid",
                         v->info.grid);
    return r->offset == 0 || move_isovalue(l, v, r->offset, e);
}

static void set_transform(volume *v, const double m[16])
{
    memcpy(v->info.index_to_world, m, sizeof v->info.index_to_world);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++) v->to_world[i][j] = m[4 * i + j];
    double determinant = affine_invert(v->to_world, v->to_index);
    for (int i = 0; i < 3; i++) {
        v->base.cell_size = fmax(v->base.cell_size, vec3_norm(affine_axis(v->to_world, i)));
        for (int k = 0; k < 4; k++) { /* diagonals of a cell */
            const vec3 side = vec3_axpy(k & 1 ? -1 : 1, affine_axis(v->to_world, 1),
                                        affine_axis(v->to_world, 0)),
                       across = vec3_axpy(k & 2 ? -1 : 1, affine_axis(v->to_world, 2), side);
            v->cell_radius = fmax(v->cell_radius, 0.5 * vec3_norm(across));
        }
    }
    v->info.voxel_size = elementary_cbrt(fabs(determinant));
}

static bool no_crossing(const loading *l, const volume *v, error *e)
{
    const grid_view *a = &l->grid_view;
    if (v->info.triangles && v->info.isovalue < 0) /* with an offset */
        return error_set(e, ERROR_NO_SURFACE,
                         "an offset of %g leaves no part of the mesh as thick as a voxel of %g; its deepest "
                         "voxel is %g below the surface: reduce the offset",
                         v->info.isovalue, v->info.voxel_size, -(double)a->lowest);
    if (v->info.triangles)
        return error_set(e, ERROR_NO_SURFACE,
                         "its %zu triangles enclose no voxel of size %g, because the mesh is thinner "
                         "everywhere: use smaller voxels",
                         v->info.triangles, v->info.voxel_size);
    char more[128] = "";
    if (a->not_finite) {
        int32_t at[3] = {0};
        grid_view_find_not_finite(a, at);
        snprintf(more, sizeof more, "; %llu of its voxels are not finite, the first at (%d, %d, %d)",
                 (unsigned long long)a->not_finite, at[0], at[1], at[2]);
    }
    if (l->lowest == l->highest)
        return error_set(e, ERROR_NO_SURFACE, "all values of %s are %g%s: choose another grid", l->name,
                         l->lowest, more);
    return error_set(e, ERROR_NO_SURFACE,
                     "%s has no surface at isovalue %g: choose an isovalue above its lowest value, %g, "
                     "and below its highest, %g%s",
                     l->name, v->info.isovalue, l->lowest, l->highest, more);
}

/* Fraction of the crossed cells from which the surface counts as the edge of a plateau at the isovalue. */
static const double plateau_from = 0.1;

/* Whether the isovalue and all values near the surface are whole numbers. */
static bool has_whole_values(const loading *l, const volume *v)
{
    const vdb_grid *g = l->grid;
    bool whole = v->info.isovalue == rint(v->info.isovalue);
    for (size_t n = 0; whole && n < g->leaf_count * VDB_LEAF_VOXELS; n++)
        whole = g->leaf_values[n] == rintf(g->leaf_values[n]);
    return whole;
}

static bool check_plateau(const loading *l, const volume *v, error *e)
{
    const grid_view *a = &l->grid_view;
    const uint64_t cells = l->crossings.cells, flat = crossings_count_plateau(a, &l->crossings, l->pool);
    if ((double)flat < plateau_from * (double)cells) return true;
    char other[128];
    const double isovalue = v->info.isovalue;
    if (has_whole_values(l, v))
        snprintf(other, sizeof other, "Try %g, or one that hexadctl inspect FILE suggests", isovalue + 0.5);
    else
        snprintf(other, sizeof other, "Choose an isovalue above %g and below %g",
                 isovalue < l->highest ? isovalue : l->lowest, isovalue < l->highest ? l->highest : isovalue);
    return error_set(
        e, ERROR_NO_SURFACE,
        "%s has no surface at isovalue %g: in %.3g %% of the cells there, the values reach it without "
        "a sign change, as where the background has this value. %s",
        l->name, isovalue, 100 * (double)flat / (double)cells, other);
}

/* Half-width of a narrow band beside its isovalue that is sufficient for the cells on the surface. */
static const double BAND_VOXELS = 3;

/* Sets the error for a crossed cell of a level set with an inactive or clamped corner, in a grid whose
 * inactive voxels have the right sign. */
static bool refuse_open(const loading *l, const volume *v, error *e)
{
    const crossings *c = &l->crossings;
    const double band = fabs((double)l->grid->background);
    int32_t at[3] = {0};
    if (l->grid_view.not_finite > 0) {
        grid_view_find_not_finite(&l->grid_view, at);
        return error_set(
            e, ERROR_INPUT_DAMAGED,
            "%s: %llu of its voxels are NaN or infinite, the first at voxel (%d, %d, %d). Write the level set "
            "again without them.",
            l->name, (unsigned long long)l->grid_view.not_finite, at[0], at[1], at[2]);
    }
    return error_set(
        e, ERROR_INPUT_UNSUPPORTED,
        "%s: its narrow band does not contain the surface at isovalue %g: %llu of its %llu cells, the first at "
        "voxel (%d, %d, %d), have a corner where the band is cut open or clamped at %g (%.3g voxels). Rebuild the "
        "level set, uncut, with a half-width of at least %.0f voxels.",
        l->name, v->info.isovalue, (unsigned long long)c->open_cells, (unsigned long long)c->cells,
        c->open_at[0], c->open_at[1], c->open_at[2], band, band / v->info.voxel_size,
        ceil(BAND_VOXELS + fabs(v->info.isovalue) / v->info.voxel_size));
}

static bool look_for_crossings(loading *l, volume *v, error *e);

/* Reloads the grid and computes the signs of inactive voxels from the active ones by flood fill. Some
 * programs give the inside of a narrow band the sign of the outside, so that the end of the band looks
 * like a surface. */
static bool flood(loading *l, volume *v, error *e)
{
    const uint64_t open = l->crossings.open_cells;
    grid_view_free(&l->grid_view);
    crossings_free(&l->crossings);
    vdb_grid_free(l->grid);
    l->grid = vdb_load_grid(l->fd, l->index, (vdb_loading){.flood = true}, l->memory_limit, e);
    if (!l->grid) return error_prefix(e, "%s", l->name);
    if (!look_for_crossings(l, v, e)) return false;
    if (l->crossings.open_cells > 0) return refuse_open(l, v, e);
    warn(&v->info,
         "%s: inactive voxels have the wrong sign (%llu cells, such as an inside with the "
         "sign of the outside): they are filled from the band. Write the level set with "
         "flood-filled signs.",
         l->name, (unsigned long long)open);
    return true;
}

static bool look_for_crossings(loading *l, volume *v, error *e)
{
    if (!grid_view_init(&l->grid_view, l->grid, l->kind, v->info.isovalue - l->grid->zero, l->memory_limit,
                        l->pool, e) ||
        !crossings_find(&l->grid_view, l->memory_limit, l->pool, &l->crossings, e))
        return error_prefix(e, "%s", l->name);
    const crossings *c = &l->crossings;
    const bool dense = l->kind == GRID_VIEW_DENSE; /* without the extrapolated voxels */
    l->lowest = dense ? l->facts.lowest : (double)l->grid_view.lowest + l->grid->zero;
    l->highest = dense ? l->facts.highest : (double)l->grid_view.highest + l->grid->zero;
    if (c->cells == 0) return no_crossing(l, v, e);
    if (!v->info.triangles && !check_plateau(l, v, e)) return false;
    return true;
}

static bool find_crossings(loading *l, volume *v, error *e)
{
    if (!look_for_crossings(l, v, e)) return false;
    if (l->crossings.open_cells == 0) return true;
    return l->is_grid && l->grid_view.not_finite == 0 ? flood(l, v, e) : refuse_open(l, v, e);
}

/* Bytes of a volume without its cells. */
static size_t held_bytes(size_t blocks, size_t made)
{
    return sizeof(volume) + made * COEFFICIENT_BLOCK_SIZE * sizeof(float) +
           blocks * (8 * sizeof(uint64_t) + 4 * 64 + sizeof(atomic_uint)) + block_map_bytes(blocks);
}

/* Whether the blocks of samples are those of the coefficient blocks, with the same indices. Otherwise
 * there are more. */
static bool reaches_coefficients_alone(const loading *l)
{
    return l->kind == GRID_VIEW_LEVEL_SET && !l->smooth;
}

static bool plan_samples(loading *l, const block_map *near, error *e)
{
    const bool band = l->kind == GRID_VIEW_LEVEL_SET;
    const reach_limits far = {.axis = l->smooth ? REACH_SMOOTH : 0,
                              .straight = band ? VOLUME_FIELD_MARGIN : REACH,
                              .path = band ? 0 : PATH};
    if (reaches_coefficients_alone(l)) return block_map_copy(near, &l->reach, e);
    return block_map_init(&l->reach, 4 * l->crossings.count, e) &&
           reach_add_blocks(&l->crossings, far, l->pool, &l->reach, e);
}

static bool plan(loading *l, volume *v, error *e)
{
    if (!block_map_init(&v->map, 2 * l->crossings.count, e) ||
        !reach_add_blocks(&l->crossings, coefficient_reach, l->pool, &v->map, e) ||
        !plan_samples(l, &v->map, e) || !crossed_cells_list(&l->crossings, &v->map, l->pool, &v->cells, e))
        return error_prefix(e, "%s", l->name);
    l->leaves = samples_look(&l->grid_view, &l->reach);
    size_t grid = l->grid->leaf_count * (VDB_LEAF_VOXELS * sizeof(float) + sizeof(grid_view_signs) + 128) +
                  l->grid->tile_count * sizeof(vdb_tile) - l->leaves.used;
    const size_t stored = coefficient_blocks_capacity(v->map.count, l->points);
    size_t held = held_bytes(v->map.count, stored > 0 ? stored : v->map.count) +
                  crossed_cells_bytes(&v->cells) + l->leaves.spare,
           limit = l->memory_limit;
    size_t peak = samples_bytes(l->reach.count, false) + (grid > held ? grid : held);
    if (peak <= limit) return true;
    return error_set(e, ERROR_LIMIT_MEMORY,
                     "%s requires %zu MiB for the %u blocks around its surface (%llu cells), and %zu MiB "
                     "of the limit are left: raise limits.memory_mb by at least %zu",
                     l->name, (peak >> 20) + 1, v->map.count, (unsigned long long)l->crossings.cells,
                     limit >> 20, ((peak - limit) >> 20) + 1);
}

/* Smoothing moves the surface: finds the crossings of the spline, near those of the samples. */
static bool find_smooth_crossings(loading *l, volume *v, error *e)
{
    crossings found = {.known_only = l->kind == GRID_VIEW_DENSE};
    bool ok = true;
    for (uint32_t n = 0; ok && n < v->map.count; n++) {
        corner_signs corners;
        samples_signs(&l->samples, v->map.blocks[n], true, &corners);
        ok = crossings_add(&found, v->map.blocks[n], &corners, e);
    }
    crossings_free(&l->crossings);
    l->crossings = found;
    block_map_free(&v->map);
    crossed_cells_free(&v->cells);
    if (!ok || !block_map_init(&v->map, 2 * found.count, e) ||
        !reach_add_blocks(&found, coefficient_reach, l->pool, &v->map, e) ||
        !crossed_cells_list(&found, &v->map, l->pool, &v->cells, e))
        return error_prefix(e, "%s", l->name);
    if (found.cells == 0)
        return error_set(
            e, ERROR_NO_SURFACE,
            "%s has no surface at isovalue %g once it is smoothed: use the interpolating reconstruction",
            l->name, v->info.isovalue);
    return true;
}

static bool read_samples(loading *l, volume *v, error *e)
{
    bool ok = samples_read(&l->grid_view, l->grid, l->leaves, &l->reach, l->pool, &l->samples, e);
    grid_view_free(&l->grid_view);
    vdb_grid_free(l->grid);
    l->grid = NULL;
    if (!ok || (l->kind == GRID_VIEW_LEVEL_SET && !band_extension_fill(&l->samples, l->pool, e)))
        return error_prefix(e, "%s", l->name);
    return !l->smooth || find_smooth_crossings(l, v, e);
}

/* Sets the data that determine the side of places far from the surface. */
static bool note_sides(loading *l, volume *v, error *e)
{
    v->crossed = mem_array((size_t)v->map.count * 64, 1, "the sides of the surface", e);
    if (!v->crossed) return false;
    crossed_cells_mark(&v->cells, l->pool, v->crossed);
    if (reaches_coefficients_alone(l)) {
        v->inside = l->samples.inside;
        l->samples.inside = NULL;
        return true;
    }
    v->inside = mem_array((size_t)v->map.count * 8, sizeof *v->inside, "the sides of the surface", e);
    if (v->inside) coefficient_block_set_sides(&l->samples, &v->map, v->inside);
    return v->inside;
}

static bool build_coefficients(loading *l, volume *v, error *e)
{
    if (!l->smooth && !prefilter_run(&l->samples, l->kind == GRID_VIEW_LEVEL_SET, l->pool, e)) return false;
    if (!coefficient_blocks_build(&l->samples, &v->map, coefficient_blocks_capacity(v->map.count, l->points),
                                  l->pool, &v->coefficients, e))
        return false;
    for (int axis = 0; axis < 3; axis++) {
        int32_t low = INT32_MAX, high = INT32_MIN;
        for (uint32_t n = 0; n < v->map.count; n++) {
            const int32_t at = v->map.blocks[n][axis];
            low = at < low ? at : low;
            high = at > high ? at : high;
        }
        v->low[axis] = (double)low * GRID_VIEW_SIDE;
        v->high[axis] = ((double)high + 1) * GRID_VIEW_SIDE;
    }
    return true;
}

static bool add_hidden_crossings(loading *l, volume *v, error *e)
{
    hidden_crossing found = {0};
    bool ok = hidden_crossing_find(&v->coefficients, v->info.size, affine_aspect(v->to_world, v->to_index),
                                   l->pool, v->crossed, &found, e);
    if (ok) {
        crossed_cells_add_late(&v->cells, found.cell, found.count);
        found.cell = NULL;
    }
    if (ok && l->kind != GRID_VIEW_LEVEL_SET && !l->smooth) {
        v->info.ringing = ringing_share(&v->coefficients, &v->cells, l->pool, &l->rings);
        l->rings |= v->info.ringing > 0;
        v->info.ringing = fmax(v->info.ringing, ringing_one_sided(&v->coefficients, &v->cells));
    }
    v->base.joined = found.joined;
    v->hidden_crossing = found.passed;
    v->flat = found.flat;
    v->gentle = found.gentle;
    found.passed = found.flat = found.gentle = NULL;
    hidden_crossing_free(&found);
    return ok;
}

static void measure(volume *v)
{
    const bbox box = volume_field_cells_box(v);
    v->beyond = volume_field_side_beyond(v);
    vec3 pad = {v->base.cell_size, v->base.cell_size, v->base.cell_size};
    v->base.domain = (bbox){vec3_sub(box.min, pad), vec3_add(box.max, pad)};
    for (int face = 0; face < 6; face++) {
        vec3 at = vec3_scale(vec3_add(box.min, box.max), 0.5);
        vec3_set(&at, face >> 1, vec3_get(face & 1 ? v->base.domain.max : v->base.domain.min, face >> 1));
        const double on = v->base.ops->side(&v->base, at) < 0 ? INFINITY : 0;
        vec3_set(face & 1 ? &v->base.solid_above : &v->base.solid_below, face >> 1, on);
    }
    v->base.extent = bbox_longest(box);
    v->info.surface_box = box;
    v->info.crossing_cells = v->cells.count;
    v->info.coefficient_blocks = v->map.count;
    v->info.memory_bytes =
        held_bytes(v->map.count, v->coefficients.capacity) + crossed_cells_bytes(&v->cells) +
        samples_bytes(v->coefficients.source.map.count, true) + v->coefficients.source.spare;
}

/* F at the corners of the cells, from samples that are limited where required. */
static bool take_values(loading *l, volume *v, error *e)
{
    if (!crossed_cells_take_values(&v->cells, &l->samples, l->smooth, l->pool, e)) return false;
    if (!l->limits) return true;
    if (!ringing_limit(&v->cells, &l->samples, &v->ringing, e)) return error_prefix(e, "%s", l->name);
    v->info.is_limited = v->ringing.limited;
    if (!v->info.is_limited) return true;
    free(v->cells.value);
    return crossed_cells_take_values(&v->cells, &l->samples, l->smooth, l->pool, e);
}

/* Builds the coefficient blocks of a loaded grid. */
static bool build(loading *l, volume *v, error *e)
{
    set_transform(v, l->grid->index_to_world);
    if (!find_crossings(l, v, e) || !plan(l, v, e) || !read_samples(l, v, e) || !take_values(l, v, e) ||
        !note_sides(l, v, e) || !build_coefficients(l, v, e) || !add_hidden_crossings(l, v, e))
        return false;
    measure(v);
    return true;
}

static void loading_free(loading *l)
{
    grid_view_free(&l->grid_view);
    vdb_grid_free(l->grid);
    crossings_free(&l->crossings);
    block_map_free(&l->reach);
    samples_free(&l->samples);
    thin_walls_free(&l->facts.walls);
}

/* Warns of limited samples. */
static void warn_of_limits(volume *v)
{
    const ringing_limits *r = &v->ringing;
    warn(
        &v->info,
        "%llu samples near the surface are limited, as %g at voxel (%d, %d, %d): the spline would overshoot beside this "
        "jump. Curvature is undefined there. If a value means that there are no data, give it as no_data.",
        (unsigned long long)r->count, v->info.isovalue - (double)r->was, r->first[0], r->first[1],
        r->first[2]);
}

/* Places between the samples of an edge at which the spline is evaluated. */
enum { EDGE_PLACES = 7 };
/* Distance, in voxels, of the places beside a kink whose gradients are compared: the spline rounds the kink. */
static const double BESIDE_KINK = 1.5;
/* Maximum cosine of the gradients on both sides of a wall, the bound of opposite walls in the measures. Near a sharp edge of the
 * surface lines have kinks, too. */
static const double OPPOSITE = -0.4;

static bool sample_edge(const volume *v, const thin_walls_edge *edge, double along, field_sample *out)
{
    double at[3] = {edge->at[0], edge->at[1], edge->at[2]};
    at[edge->axis] += along;
    return field_sample_at(&v->base, affine_apply(v->to_world, at[0], at[1], at[2]), FIELD_GRADIENT, out);
}

/* Whether a wall passes between the samples of an edge, and the spline does not. Far from the surface the spline is not
 * defined. */
static bool is_wall_lost(const volume *v, const thin_walls_edge *edge)
{
    bool inside = false, outside = false;
    field_sample s, below, above;
    for (int k = 0; k <= EDGE_PLACES + 1; k++) {
        if (!sample_edge(v, edge, (double)k / (EDGE_PLACES + 1), &s)) return true;
        inside |= s.value < 0;
        outside |= s.value >= 0;
    }
    if (inside && outside) return false;
    return !sample_edge(v, edge, 0.5 - BESIDE_KINK, &below) ||
           !sample_edge(v, edge, 0.5 + BESIDE_KINK, &above) ||
           vec3_dot(vec3_unit(below.gradient), vec3_unit(above.gradient)) <= OPPOSITE;
}

/* Minimum share of the area of thin walls for a warning. The caps of a ball are thin along the lines of the grid: 2 % of
 * its area at a radius of five voxels, 6 % at three. Smaller: warnings about bodies that have no thin walls. */
static const double THIN_SHARE = 0.1;

/* `walls`: of a dense volume, otherwise 0. */
static void note_walls(const thin_walls_found *walls, volume *v)
{
    const size_t kept = thin_walls_kept(walls);
    size_t lost = 0;
    if (walls->crossed == 0) return;
    for (size_t k = 0; k < kept; k++) lost += is_wall_lost(v, &walls->kink[k]);
    const double kinks = 2 * (double)walls->kinks, all = (double)walls->crossed + kinks,
                 thin = ((double)walls->thin + kinks) / all;
    if (kept > 0) v->info.lost_share = (double)lost / (double)kept * kinks / all;
    if (thin > THIN_SHARE && v->info.lost_share <= THIN_WALLS_MOST_LOST)
        warn(
            &v->info,
            "%.3g %% of the area belongs to walls thinner than two voxels; %.2g %% of the area is lost between samples",
            100 * thin, 100 * v->info.lost_share);
}

/* load_grid or load_dense. */
typedef bool loader(const void *request, loading *l, volume *v, error *e);

static volume *try_volume(loader *load, const void *request, isa kernels, loading *l, error *e)
{
    volume *v = mem_alloc(sizeof *v);
    v->spline = spline_for(kernels);
    v->base.ops = &volume_field_ops;
    const bool ok = load(request, l, v, e) && build(l, v, e);
    if (ok) note_walls(&l->facts.walls, v);
    loading_free(l);
    if (ok) return v;
    volume_close(v);
    return NULL;
}

/* Opens a volume; if its spline rings, again with its samples limited. */
static volume *open_volume(loader *load, const void *request, isa kernels, const char *path, error *e)
{
    loading l = {0};
    volume *v = try_volume(load, request, kernels, &l, e);
    if (v && l.rings) {
        volume_close(v);
        l = (loading){.limits = true};
        v = try_volume(load, request, kernels, &l, e);
    }
    if (v && v->info.is_limited) warn_of_limits(v);
    if (v && (v->info.is_limited || v->info.ringing > 0) && *l.no_data)
        warn(&v->info, "the file states that %s means \"no data\": give it as no_data", l.no_data);
    if (!v) error_prefix(e, "%s", path);
    return v;
}

volume *volume_open(const volume_request *request, error *e)
{
    return open_volume(load_grid, request, request->isa, request->path, e);
}

/* ---- meshes */

/* Minimum fraction of the area that is reported as not represented: less is at single creases. */
static const double unresolved_from = 0.001;
/* Spacing, in voxels, below which there is a warning: creases are rounded over a voxel. */
static const double spacing_below = 0.8;

/* Half-widths of bands, voxels: minimum on both sides of a surface at an offset; maximum. */
enum { BAND_BESIDE = 3, BAND_WIDEST = 32 };

double volume_mesh_least_voxel(double offset)
{
    return fabs(offset) / (BAND_WIDEST - BAND_BESIDE);
}

static bool load_mesh(const volume_mesh_request *r, const resolution *choice, loading *l, volume *v, mesh *m,
                      mesh_notes *notes, error *e)
{
    const double away = fabs(r->offset) / choice->voxel_size, band = ceil(away - 1e-9) + BAND_BESIDE;
    if (band > BAND_WIDEST)
        return error_set(e, ERROR_SPEC_INVALID,
                         "an offset of %g is %.4g voxels, more than the maximum of %d: set voxel_size to at "
                         "least %.3g",
                         r->offset, away, BAND_WIDEST - BAND_BESIDE,
                         /* the message rounds to three digits */
                         1.005 * volume_mesh_least_voxel(r->offset));
    const levelset_params params = {.voxel_size = choice->voxel_size,
                                    .band_vox = (int)fmax(band, r->band_vox),
                                    .weld = r->weld,
                                    .memory_limit = r->resolution.memory_limit,
                                    .edges = r->edges,
                                    .pool = r->pool};
    snprintf(l->name, sizeof l->name, "its level set");
    v->info.level_set = true;
    l->kind = GRID_VIEW_LEVEL_SET;
    l->points = (size_t)r->resolution.count;
    l->pool = r->pool;
    if (!(l->grid = levelset_make(m, &params, notes, &l->solids, e)))
        return r->offset != 0 && error_prefix(e, "at an offset of %g", r->offset);
    v->info.isovalue = r->offset;
    l->memory_limit = mem_left(r->resolution.memory_limit, mesh_bytes(m->vertex_count, m->triangle_count));
    v->info.active_voxels = l->grid->active_voxels;
    v->info.triangles = m->triangle_count;
    return true;
}

static bool keep_faces(volume *v, mesh *m, bool hides, threads *pool, error *e)
{
    v->faces = mesh_faces_new(m, v->info.index_to_world, hides, pool, e);
    if (v->faces) v->info.memory_bytes += mesh_faces_bytes(v->faces);
    return v->faces != NULL;
}

/* Converts the mesh, which does not change, to one level set. *measured is set also if there is no surface
 * because everything is too thin. */
static volume *try_mesh(const volume_mesh_request *r, const resolution *choice, const mesh *whole,
                        fidelity *measured, error *e)
{
    loading l = {0};
    mesh m = {0};
    mesh_notes notes = {0};
    volume *v = mem_alloc(sizeof *v);
    v->spline = spline_for(r->isa);
    v->base.ops = &volume_field_ops;
    bool loaded = mesh_copy(whole, r->pool, &m, e) && load_mesh(r, choice, &l, v, &m, &notes, e),
         ok = loaded && build(&l, v, e);
    for (size_t k = 0; k < notes.count; k++) warn(&v->info, "%s", notes.text[k]);
    loading_free(&l);
    if (r->offset == 0 && (ok || (loaded && e->code == ERROR_NO_SURFACE))) {
        error told = {0};
        if (!fidelity_measure(&m, v->info.index_to_world, ok ? &v->base : NULL, choice->finest, r->pool,
                              measured, &told)) {
            ok = false;
            *e = told;
        }
    }
    if (ok) {
        v->projects = r->keep_faces && r->offset == 0;
        ok = keep_faces(v, &m, v->projects && (l.solids > 1 || measured->hidden > 0), r->pool, e);
    }
    mesh_free(&m);
    if (ok) return v;
    volume_close(v);
    return NULL;
}

/* Opens a mesh; repeats with finer voxels if thin parts are not represented, as far as memory allows. */
static volume *open_mesh(const volume_mesh_request *r, const mesh *whole, resolution *choice, fidelity *f,
                         error *e)
{
    *choice = voxel_size_begin(whole, &r->resolution);
    volume *v = try_mesh(r, choice, whole, f, e);
    const double enough = choice->voxel_size;
    if ((v || e->code == ERROR_NO_SURFACE) && f->area > 0 &&
        voxel_size_refine(choice, &r->resolution, f->thin_voxel, f->worth_voxel)) {
        volume_close(v);
        while (!(v = try_mesh(r, choice, whole, f, e)) && e->code == ERROR_LIMIT_MEMORY &&
               choice->voxel_size < enough)
            voxel_size_coarsen(choice, enough);
    }
    if (!v && e->code == ERROR_NO_SURFACE && f->thin_voxel > 0 && f->thin_voxel < choice->voxel_size)
        error_set(e, ERROR_NO_SURFACE,
                  "the mesh is thinner than a voxel of %g everywhere: set voxel_size to at most %.3g, "
                  "and raise limits.memory_mb if necessary",
                  choice->voxel_size, f->thin_voxel);
    return v;
}

static void warn_of_mesh(volume_info *info)
{
    const fidelity *f = &info->fidelity;
    const resolution *r = &info->resolution;
    const bool much = f->thin > FIDELITY_MAX_THIN,
               by_memory = r->limited_by && strcmp(r->limited_by, "memory") == 0;
    if (f->thin >= unresolved_from)
        warn(info,
             "%.3g %% of the mesh area is thinner than a voxel and is not sampled: set voxel_size "
             "to at most %.3g (%.2g %% then remain)%s",
             100 * f->thin, much ? f->thin_voxel : f->tenth_voxel,
             100 * (much ? FIDELITY_MAX_THIN : f->thin / 10),
             by_memory ? ", and limits.memory_mb higher if the job then exceeds it" : "");
    if (f->hidden >= unresolved_from)
        warn(info,
             "%.3g %% of the mesh area is inside the union of its shells and is not sampled: "
             "shells overlap, touch or intersect",
             100 * f->hidden);
    if (r->spacing > 0 && r->spacing < spacing_below * r->voxel_size)
        warn(
            info,
            "the spacing of %.3g is less than a voxel, %.3g: details smaller than a voxel, such as sharp edges if "
            "the mesh has any, are rounded over several points. Set voxel_size to at most %.3g",
            r->spacing, r->voxel_size, r->spacing);
}

volume *volume_of_mesh(const volume_mesh_request *request, const mesh *whole, const mesh_notes *notes,
                       error *e)
{
    resolution choice = {0};
    fidelity kept = {0};
    error why = {0};
    volume *v = open_mesh(request, whole, &choice, &kept, &why);
    if (!v) {
        fidelity_free(&kept);
        error_set(e, why.code, "%s: %s", request->path, why.message);
        return NULL;
    }
    for (size_t k = 0; k < notes->count; k++) warn(&v->info, "%s", notes->text[k]);
    v->info.fidelity = kept;
    v->info.memory_bytes += kept.thin_places * sizeof *kept.thin_place;
    v->info.resolution = choice;
    warn_of_mesh(&v->info);
    return v;
}

/* ---- dense volumes */

/* Maximum deviation of the corners of data, in voxels, from an axis-aligned box: matrices are stored in
 * single precision, and such an error of a boundary affects no measure. */
static const double stray_limit = 1e-3;

/* The world axis, 0 to 2, of each axis of the data. False: not axis-aligned. */
static bool find_axes(const volume *v, int world_of[3])
{
    bool used[3] = {false, false, false};
    for (int k = 0; k < 3; k++) {
        int along = 0;
        double stray = 0;
        for (int i = 1; i < 3; i++)
            if (fabs(v->to_world[i][k]) > fabs(v->to_world[along][k])) along = i;
        for (int i = 0; i < 3; i++)
            if (i != along) stray = fmax(stray, fabs(v->to_world[i][k]));
        if (used[along] || stray * (double)v->info.size[k] > stray_limit * fabs(v->to_world[along][k]))
            return false;
        used[along] = true;
        world_of[k] = along;
    }
    return true;
}

/* The faces of the data (bit 2 axis + end) that the surface meets in cell k. */
static unsigned faces_met(const volume *v, size_t k)
{
    crossed_cell c;
    unsigned faces = 0;
    crossed_cells_get(&v->cells, k, &c);
    for (int face = 0; face < 6; face++) {
        int axis = face >> 1, high = face & 1, inside = 0;
        if (c.at[axis] != (high ? v->info.size[axis] - 2 : 0)) continue;
        for (int corner = 0; corner < 8; corner++)
            inside += (corner >> axis & 1) == high && c.value[corner] < 0;
        if (inside > 0 && inside < 4) faces |= 1u << face;
    }
    return faces;
}

static bbox data_box(const volume *v)
{
    const int64_t *size = v->info.size;
    return affine_box(v->to_world,
                      (bbox){.max = {(double)(size[0] - 1), (double)(size[1] - 1), (double)(size[2] - 1)}});
}

/* Whether the centre of a face of the data is inside. */
static bool is_solid_at(const volume *v, int face)
{
    double at[3];
    field_sample s;
    for (int k = 0; k < 3; k++) at[k] = 0.5 * (double)(v->info.size[k] - 1);
    at[face >> 1] *= 2 * (face & 1);
    const vec3 x = affine_apply(v->to_world, at[0], at[1], at[2]);
    const double side = v->base.ops->side(&v->base, x);
    return side < 0 || (side == 0 && field_sample_at(&v->base, x, FIELD_GRADIENT, &s) && s.value < 0);
}

/* Sets the boundary: the domain ends where the surface meets the end of the data. A face that the surface
 * does not meet is entirely inside or outside; if inside, the solid extends to it. */
static void set_ends(volume *v)
{
    field *f = &v->base;
    int world_of[3];
    unsigned met = 0, boundary = 0;
    for (size_t k = 0; k < v->cells.count; k++) met |= faces_met(v, k);
    v->loose = !find_axes(v, world_of);
    f->solid_below = f->solid_above = (vec3){0, 0, 0};
    for (int face = 0; face < 6; face++) {
        const bool is_met = met >> face & 1, solid = !is_met && is_solid_at(v, face);
        if (v->loose && solid) field_set_solid_box(f, data_box(v));
        if (v->loose || !(is_met || solid)) continue;
        const int axis = face >> 1, along = world_of[axis];
        const double *m = v->to_world[along];
        const double at = m[3] + (face & 1 ? m[axis] * (double)(v->info.size[axis] - 1) : 0);
        const bool high = (m[axis] > 0) == (face & 1);
        vec3 *end = high ? &f->domain.max : &f->domain.min;
        const double beyond = high ? at - vec3_get(*end, along) : vec3_get(*end, along) - at;
        if (is_met || beyond < 0) vec3_set(end, along, at);
        if (solid) vec3_set(high ? &f->solid_above : &f->solid_below, along, fmax(beyond, 0));
        if (is_met) boundary |= 1u << (2 * along + high);
    }
    field_set_boundary(&v->base, boundary);
    if (met) v->beyond = 0;
}

size_t volume_loose_ends(const volume *v, bbox box)
{
    size_t count = 0;
    for (size_t k = 0; v->loose && k < v->cells.count; k++) {
        if (!faces_met(v, k)) continue;
        field_cell c;
        bbox reach = bbox_empty();
        v->base.ops->cell(&v->base, k, &c);
        for (int corner = 0; corner < 8; corner++) reach = bbox_include(reach, c.corner[corner]);
        count += bbox_overlap(reach, box);
    }
    return count;
}

bool volume_align(volume *v, double to_world[16])
{
    vec3 axis[3];
    double length[3], most = 0;
    for (int k = 0; k < 3; k++) {
        axis[k] = affine_axis(v->to_world, k);
        length[k] = vec3_norm(axis[k]);
        axis[k] = vec3_scale(axis[k], 1 / length[k]);
        most = fmax(most, (double)v->info.size[k]);
    }
    for (int k = 0; k < 3; k++)
        if (fabs(vec3_dot(axis[k], axis[(k + 1) % 3])) * most > stray_limit) return false;
    if (vec3_dot(vec3_cross(axis[0], axis[1]), axis[2]) < 0) { /* mirrored data remain mirrored */
        axis[2] = vec3_scale(axis[2], -1);
        length[2] = -length[2];
    }
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) to_world[4 * i + k] = vec3_get(axis[k], i);
        to_world[4 * i + 3] = v->to_world[i][3];
        to_world[12 + i] = 0;
    }
    to_world[15] = 1;
    memset(v->to_world, 0, sizeof v->to_world);
    for (int k = 0; k < 3; k++) v->to_world[k][k] = length[k];
    affine_invert(v->to_world, v->to_index);
    measure(v);
    set_ends(v);
    return true;
}

/* The range of an index coordinate within an axis-aligned world box with these half sizes. */
static double index_reach(const volume *v, int axis, vec3 half)
{
    const double *m = v->to_index[axis];
    return fabs(m[0]) * half.x + fabs(m[1]) * half.y + fabs(m[2]) * half.z;
}

bbox volume_clear_box(const volume *v)
{
    const int64_t *size = v->info.size;
    const bbox whole = data_box(v), cell = affine_box(v->to_world, (bbox){.max = {1, 1, 1}});
    double share = 1;
    const vec3 half = vec3_scale(bbox_size(whole), 0.5), middle = vec3_add(whole.min, half);
    for (int k = 0; k < 3; k++) {
        const double left = 0.5 * (double)(size[k] - 1) - index_reach(v, k, bbox_size(cell));
        share = fmin(share, left / index_reach(v, k, half));
    }
    if (!(share > 0)) return bbox_empty();
    return (bbox){vec3_axpy(-share, half, middle), vec3_axpy(share, half, middle)};
}

/* Whether each value near the surface is the lowest or the highest. */
static bool has_two_values(const vdb_grid *g, const dense_grid_facts *facts)
{
    const float low = (float)(facts->lowest - g->zero), high = (float)(facts->highest - g->zero);
    bool two = true;
    for (size_t n = 0; two && n < g->leaf_count * VDB_LEAF_VOXELS; n++) {
        const size_t leaf = n / VDB_LEAF_VOXELS, k = n % VDB_LEAF_VOXELS;
        const bool active = g->leaf_active[leaf * VDB_LEAF_SIDE + (k >> 6)] >> (k & 63) & 1;
        two = !active || g->leaf_values[n] == low || g->leaf_values[n] == high;
    }
    return two;
}

static bool load_dense(const void *request, loading *l, volume *v, error *e)
{
    const volume_dense_request *r = request;
    const dense_grid_facts *facts = &l->facts;
    const double *m = r->source->index_to_world;
    double to_world[3][4], to_index[3][4];
    for (int k = 0; k < 12; k++) to_world[k / 4][k % 4] = m[k];
    double determinant = affine_invert(to_world, to_index);
    if (!isfinite(1 / determinant))
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "the axes of the volume are in one plane, so its orientation is singular: correct "
                         "its header");
    snprintf(l->name, sizeof l->name, "the volume");
    l->kind = GRID_VIEW_DENSE;
    l->memory_limit = r->memory_limit;
    l->smooth = r->reconstruction == VOLUME_SMOOTHING;
    l->points = r->points;
    l->pool = r->pool;
    v->info.isovalue = r->isovalue;
    memcpy(v->info.size, r->source->size, sizeof v->info.size);
    memcpy(v->info.format, r->source->format, sizeof v->info.format);
    memcpy(v->info.space, r->source->space, sizeof v->info.space);
    l->grid = dense_grid_make(r->source, r->isovalue, r->no_data, r->memory_limit, r->pool, &l->facts, e);
    if (!l->grid) return false;
    v->info.two_values = has_two_values(l->grid, facts);
    v->info.active_voxels = l->grid->active_voxels;
    for (uint32_t k = 0; k < r->source->warnings.count; k++)
        warn(&v->info, "%s", r->source->warnings.text[k]);
    snprintf(l->no_data, sizeof l->no_data, "%s", r->source->warnings.no_data);
    if (facts->unusable)
        warn(
            &v->info,
            "%llu values are not finite or beyond %g, the first at (%lld, %lld, %lld): NaN and negative ones are read "
            "as the lowest other value, %g, and positive ones as the highest, %g",
            (unsigned long long)facts->unusable, DENSE_GRID_LARGEST, (long long)facts->unusable_at[0],
            (long long)facts->unusable_at[1], (long long)facts->unusable_at[2], facts->lowest,
            facts->highest);
    return true;
}

volume *volume_open_dense(const volume_dense_request *request, error *e)
{
    volume *v = open_volume(load_dense, request, request->isa, request->path, e);
    if (v) set_ends(v);
    return v;
}

void volume_close(volume *v)
{
    if (!v) return;
    mesh_faces_free(v->faces);
    fidelity_free(&v->info.fidelity);
    block_map_free(&v->map);
    coefficient_blocks_free(&v->coefficients);
    free(v->inside);
    free(v->crossed);
    free(v->hidden_crossing);
    free(v->flat);
    free(v->gentle);
    ringing_free(&v->ringing);
    crossed_cells_free(&v->cells);
    free(v);
}

bool volume_is_limited(const volume *v, vec3 x)
{
    if (!v->info.is_limited) return false;
    const vec3 at = affine_apply(v->to_index, x.x, x.y, x.z);
    const int32_t cell[3] = {(int32_t)floor(at.x), (int32_t)floor(at.y), (int32_t)floor(at.z)};
    return ringing_is_limited(&v->ringing, &v->map, cell);
}

const mesh_faces *volume_faces(const volume *v)
{
    return v->projects ? v->faces : NULL;
}

const mesh_faces *volume_mesh_faces(const volume *v)
{
    return v->faces;
}

double volume_mesh_offset(const volume *v)
{
    return v->faces ? v->info.isovalue : 0;
}

const field *volume_field(const volume *v)
{
    return &v->base;
}

const volume_info *volume_describe(const volume *v)
{
    return &v->info;
}

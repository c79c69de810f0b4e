// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/dense_attributes.h"

#include <stdlib.h>
#include <string.h>

#include "job/attributes/lattice.h"
#include "base/core/memory.h"
#include "io/volumes/volume_file.h"
#include "geometry/space/affine.h"

/* Number of slices in memory: those that a cubic stencil needs. */
enum { HELD = 4 };

/* Parses the number of a component or volume, "0", "1", ...; -1: all. False: it is not such a number. */
static bool parse_number(const char *name, int64_t *out)
{
    char *end = NULL;
    *out = name ? strtol(name, &end, 10) : -1;
    return !name || (*name >= '0' && *name <= '9' && !*end);
}

static bool missing(const attribute_request *request, int components, error *e)
{
    return error_set(e, ERROR_ATTRIBUTE_MISSING,
                     "the file has no \"%s\": give the number of one of %s, from 0 (%d at each sample), "
                     "or omit the name for all of them",
                     request->name, components > 1 ? "components" : "volumes", components);
}

/* Opens the slices. *component: the index of the requested one; -1: all. */
static slices *open_slices(const attribute_request *request, int *component, error *e)
{
    int64_t number;
    *component = -1;
    if (request->stack) {
        exr_stack_params params = *request->stack;
        error own = {0};
        if (request->name) params.channel = request->name;
        slices *images = volume_file_open_stack(&params, &own);
        if (!images && own.code == ERROR_GRID_MISSING && params.part) {
            params.part = NULL; /* the channel may be in another part */
            images = volume_file_open_stack(&params, &own);
        }
        if (!images && e) *e = own;
        if (!images && e && e->code == ERROR_GRID_MISSING) e->code = ERROR_ATTRIBUTE_MISSING;
        return images;
    }
    if (!parse_number(request->name, &number)) {
        missing(request, 1, e);
        return NULL;
    }
    volume_file file = {.fd = request->fd,
                        .path = request->path,
                        .files = request->files,
                        .memory_limit = request->memory_limit,
                        .voxel_size = request->voxel_size};
    slices *s = volume_file_open_vectors(&file, e);
    if (!s || number < 0) return s;
    if (s->components > 1 && number < s->components) {
        *component = (int)number;
        return s;
    }
    bool vector = s->components > 1;
    if (vector) missing(request, s->components, e);
    s->ops->close(s);
    if (vector) return NULL;
    file.index = number;
    s = volume_file_open_vectors(&file, e);
    if (!s && e && e->code == ERROR_GRID_MISSING) e->code = ERROR_ATTRIBUTE_MISSING;
    return s;
}

bool dense_attributes_find(const attribute_request *request, point_attribute_kind *kind, int *components,
                           error *e)
{
    int component;
    slices *s = open_slices(request, &component, e);
    if (!s) return false;
    *components = component < 0 ? s->components : 1;
    *kind = *components == 3 ? POINT_ATTRIBUTE_VECTOR : POINT_ATTRIBUTE_FLOAT;
    s->ops->close(s);
    return true;
}

/* The slices in memory: slice k has the index k % HELD. */
typedef struct window {
    const slices *source;
    int component;
    double *slice[HELD];
} window;

/* Reads a sample; beyond an end of the data it is the last sample. */
static bool read_sample(const void *context, const int32_t at[3], double value[4])
{
    const window *w = context;
    const int64_t *size = w->source->size;
    const int n = w->source->components;
    int64_t inside[3];
    bool known = true;
    for (int a = 0; a < 3; a++) {
        inside[a] = at[a] < 0 ? 0 : at[a] >= size[a] ? size[a] - 1 : at[a];
        known &= inside[a] == at[a];
    }
    const double *sample = w->slice[inside[2] % HELD] + (size_t)n * (size_t)(inside[0] + size[0] * inside[1]);
    if (w->component >= 0)
        value[0] = sample[w->component];
    else
        for (int c = 0; c < n; c++) value[c] = sample[c];
    return known;
}

/* A point, for sorting by the last slice that it needs. */
typedef struct slice_order {
    int64_t last;
    size_t point;
} slice_order;

static int compare_turns(const void *a, const void *b)
{
    const slice_order *x = a, *y = b;
    return x->last != y->last ? (x->last < y->last ? -1 : 1) : (x->point > y->point) - (x->point < y->point);
}

static void line_up(const lattice *l, const slices *s, size_t count, const vec3 *position, slice_order *turns)
{
    for (size_t i = 0; i < count; i++) {
        vec3 index = affine_apply(l->to_index, position[i].x, position[i].y, position[i].z);
        stencil around;
        int64_t last =
            stencil_at(l->stencil, index, &around) ? (int64_t)around.first[2] + around.count - 1 : 0;
        turns[i] = (slice_order){last < 0 ? 0 : last >= s->size[2] ? s->size[2] - 1 : last, i};
    }
    qsort(turns, count, sizeof *turns, compare_turns);
}

/* Rotates the components of vectors if the file gives their directions. */
static void turn_vectors(const slices *s, lattice *l)
{
    double product[3][3], sum = 0;
    for (int k = 0; k < 9; k++) sum += s->vector_to_world[k] * s->vector_to_world[k];
    if (l->kind != POINT_ATTRIBUTE_VECTOR || sum == 0) return;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            product[i][j] = 0;
            for (int k = 0; k < 3; k++) product[i][j] += l->from_file[i][k] * s->vector_to_world[3 * k + j];
        }
    for (int i = 0; i < 3; i++) memcpy(l->from_file[i], product[i], sizeof product[i]);
}

static bool read_slices(slices *s, window *w, const lattice *l, const slice_order *turns, size_t count,
                        const vec3 *position, double *values, attribute_counts *counts, error *e)
{
    size_t next = 0;
    bool ok = true;
    for (int64_t k = 0; ok && k < s->size[2] && next < count; k++) {
        ok = s->ops->read(s, k, w->slice[k % HELD], e);
        for (; ok && next < count && turns[next].last == k; next++) {
            size_t i = turns[next].point;
            lattice_value(l, position[i], values + (size_t)l->components * i, counts);
        }
    }
    return ok;
}

bool dense_attributes_read(const attribute_request *request, size_t count, const vec3 *position,
                           double *values, attribute_counts *counts, error *e)
{
    window w = {0};
    slices *s = open_slices(request, &w.component, e);
    if (!s) return false;
    w.source = s;
    lattice l = {.components = w.component < 0 ? s->components : 1,
                 .kind = request->kind,
                 .read = read_sample,
                 .context = &w};
    double bytes = (double)s->size[0] * (double)s->size[1] * s->components * sizeof(double);
    slice_order *turns = NULL;
    bool ok = HELD * bytes + (double)count * sizeof *turns <= (double)request->memory_limit ||
              error_set(e, ERROR_LIMIT_MEMORY, "four of its slices require %.0f MiB: raise limits.memory_mb",
                        HELD * bytes / (1 << 20));
    lattice_place(request, s->index_to_world, &l);
    turn_vectors(s, &l);
    for (int k = 0; ok && k < HELD; k++)
        ok = (w.slice[k] = mem_array((size_t)(s->size[0] * s->size[1]),
                                     (size_t)s->components * sizeof(double), "a slice", e)) != NULL;
    if (ok) ok = (turns = mem_array(count, sizeof *turns, "the order of the points", e)) != NULL;
    if (ok) line_up(&l, s, count, position, turns);
    ok = ok && read_slices(s, &w, &l, turns, count, position, values, counts, e);
    counts->warnings = s->warnings;
    for (int k = 0; k < HELD; k++) free(w.slice[k]);
    free(turns);
    s->ops->close(s);
    return ok;
}

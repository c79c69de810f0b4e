// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/exr_stack.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/reader.h"
#include "io/volumes/exr_reader.h"
#include "io/volumes/slice_faults.h"

/* CPU limit of the decoding process: seconds_at_least plus 2 s for each slice, 100 times the measured time
 * of a picture of a million pixels. */
static const unsigned seconds_at_least = 60, seconds_per_slice = 2;

/* Relative tolerance for equal pixel aspect ratios: the header has a float. */
static const double aspect_agrees = 1e-4;

/* One slice's data window. */
typedef struct window {
    int64_t low[2], high[2];
} window;

typedef struct exr_stack {
    slices base; /* first: the slices' functions get this pointer */
    exr_stack_params params;
    char *names; /* channel and part, in the format of the reader process */
    window *windows;
    int64_t low[2];   /* lowest corner of the union of the windows */
    uint32_t *pixels; /* pixels of the window of a slice, as received */
    size_t stretched; /* number of slices whose pixel aspect ratio differs from that of voxel_size */
    float aspect;     /* aspect ratio of the first such slice */
    reader reader;
} exr_stack;

/* ---- talking to the process */

static bool start(exr_stack *s, error *e)
{
    const reader_params params = {s->params.program,
                                  EXR_READER_COMMAND,
                                  s->names,
                                  -1,
                                  s->params.memory_limit,
                                  seconds_at_least + seconds_per_slice * (unsigned)s->params.count};
    return s->reader.stream || reader_start(&params, &s->reader, e);
}

/* Receives the pixels of a slice. Its window must not have changed since the stack was opened. */
static bool read_pixels(exr_stack *s, const window *w, const exr_reader_answer *a, uint32_t *pixels, error *e)
{
    const size_t count = (size_t)((w->high[0] - w->low[0] + 1) * (w->high[1] - w->low[1] + 1));
    for (int axis = 0; axis < 2; axis++)
        if (a->low[axis] != w->low[axis] || a->high[axis] != w->high[axis])
            return error_set(e, ERROR_INPUT_DAMAGED, "the file has changed while it was read: try again");
    return reader_get(&s->reader, pixels, sizeof *pixels, count, e);
}

/* Requests slice k from the process. *list receives its channels, for EXR_READER_LIST. */
static bool ask(exr_stack *s, size_t k, char what, exr_reader_answer *a, uint32_t *pixels, char **list,
                error *e)
{
    if (!start(s, e)) return false;
    int fd = s->params.files->open(s->params.files->context, s->params.paths[k], e);
    if (fd < 0) return false;
    off_t size;
    bool ok = reader_check_file(fd, "image", &size, e);
    if (ok) {
        ok = reader_send(&s->reader, &what, 1, fd, e) &&
             reader_get_answer(&s->reader, a, sizeof *a, list, list ? EXR_READER_LIST_MAX : 0, e) &&
             (what != EXR_READER_PIXELS || read_pixels(s, &s->windows[k], a, pixels, e));
        reader_settle(&s->reader, ok, e);
    }
    close(fd);
    return ok || error_prefix(e, "%s", s->params.paths[k]);
}

/* Stores the window of a slice, and checks its aspect ratio. */
static void note_answer(exr_stack *s, size_t k, const exr_reader_answer *a)
{
    const double aspect = (double)a->aspect, meant = s->params.voxel_size.x / s->params.voxel_size.y;
    for (int axis = 0; axis < 2; axis++) {
        s->windows[k].low[axis] = a->low[axis];
        s->windows[k].high[axis] = a->high[axis];
    }
    s->base.fine |= a->whole != 0;
    if (fabs(aspect - 1) < aspect_agrees || fabs(aspect - meant) < aspect_agrees * fabs(meant)) return;
    if (s->stretched++ == 0) s->aspect = a->aspect;
}

typedef struct request {
    exr_stack *stack;
    uint32_t *pixels; /* NULL: only the windows */
} request;

static bool ask_slice(void *context, size_t k, error *e)
{
    const request *r = context;
    exr_reader_answer a;
    if (!ask(r->stack, k, r->pixels ? EXR_READER_PIXELS : EXR_READER_WINDOW, &a, r->pixels, NULL, e))
        return false;
    if (!r->pixels) note_answer(r->stack, k, &a);
    return true;
}

static bool ask_all(exr_stack *s, size_t first, uint32_t *pixels, error *e)
{
    return slice_faults_check(first, s->params.count, s->params.numbers, ask_slice, &(request){s, pixels}, e);
}

/* ---- as slices */

static double value_of(uint32_t pixel, bool whole)
{
    float value;
    memcpy(&value, &pixel, sizeof value);
    return whole ? (double)pixel : (double)value;
}

static void place_rows(const exr_stack *s, const window *w, bool whole, double *values)
{
    const int64_t width = w->high[0] - w->low[0] + 1;
    for (int64_t k = 0; k < s->base.size[0] * s->base.size[1]; k++) values[k] = 0;
    for (int64_t y = w->low[1]; y <= w->high[1]; y++) {
        double *to = values + (y - s->low[1]) * s->base.size[0] + (w->low[0] - s->low[0]);
        const uint32_t *from = s->pixels + (y - w->low[1]) * width;
        for (int64_t x = 0; x < width; x++) to[x] = value_of(from[x], whole);
    }
}

static bool exr_read(slices *base, int64_t k, double *values, error *e)
{
    exr_stack *s = (exr_stack *)base;
    const window *w = &s->windows[k];
    size_t count = (size_t)(s->base.size[0] * s->base.size[1]);
    exr_reader_answer a;
    error fault = {0};
    if (!s->pixels && !(s->pixels = mem_array(count, sizeof *s->pixels, "a slice", e))) return false;
    if (!ask(s, (size_t)k, EXR_READER_PIXELS, &a, s->pixels, NULL, &fault)) {
        uint32_t *rest = mem_array(count, sizeof *rest, "a slice", e);
        /* the message names this slice and all later damaged ones */
        bool told = rest && !ask_all(s, (size_t)k, rest, e);
        free(rest);
        if (!told && e) *e = fault;
        return false;
    }
    place_rows(s, w, a.whole != 0, values);
    return true;
}

static void exr_close(slices *base)
{
    exr_stack *s = (exr_stack *)base;
    reader_close(&s->reader);
    free(s->names);
    free(s->windows);
    free(s->pixels);
    free(s);
}

static const slices_ops exr_ops = {exr_read, exr_close};

static bool span(exr_stack *s, error *e)
{
    bool differ = false;
    int64_t high[2];
    for (int axis = 0; axis < 2; axis++) {
        s->low[axis] = s->windows[0].low[axis];
        high[axis] = s->windows[0].high[axis];
        for (size_t k = 1; k < s->params.count; k++) {
            const window *w = &s->windows[k];
            differ |= w->low[axis] != s->windows[0].low[axis] || w->high[axis] != s->windows[0].high[axis];
            if (w->low[axis] < s->low[axis]) s->low[axis] = w->low[axis];
            if (w->high[axis] > high[axis]) high[axis] = w->high[axis];
        }
        s->base.size[axis] = high[axis] - s->low[axis] + 1;
        if (s->base.size[axis] < 2)
            return error_set(e, ERROR_NO_SURFACE,
                             "its images are one pixel wide or high: give images of at least 2 x 2 pixels");
    }
    s->base.size[2] = (int64_t)s->params.count;
    if (differ)
        dense_warn(&s->base.warnings,
                   "the data windows of the slices differ: the volume spans %lld x %lld pixels, and "
                   "pixels outside the data window of a slice are 0",
                   (long long)s->base.size[0], (long long)s->base.size[1]);
    if (s->stretched > 0)
        dense_warn(
            &s->base.warnings,
            "%zu slice%s a pixelAspectRatio that voxel_size does not have, the first %g: voxel_size counts. Set "
            "voxel_size to the size of a pixel.",
            s->stretched, s->stretched == 1 ? " has" : "s have", (double)s->aspect);
    return true;
}

static exr_stack *make(const exr_stack_params *params)
{
    exr_stack *s = mem_alloc(sizeof *s);
    *s = (exr_stack){.base = {.ops = &exr_ops, .components = 1, .format = "EXR"}, .params = *params};
    s->windows = mem_alloc(params->count * sizeof *s->windows);
    s->names = mem_printf("%s%s\n%s%s", params->channel ? "=" : "*", params->channel ? params->channel : "",
                          params->part ? "=" : "*", params->part ? params->part : "");
    return s;
}

char *exr_stack_list(const exr_stack_params *params, error *e)
{
    exr_stack *s = make(params);
    exr_reader_answer a;
    char *text = NULL;
    if (ask(s, 0, EXR_READER_LIST, &a, NULL, &text, e)) reader_blank(text, "\t\n");
    exr_close(&s->base);
    return text;
}

slices *exr_stack_open(const exr_stack_params *params, error *e)
{
    exr_stack *s = make(params);
    if (!ask_all(s, 0, NULL, e) || !span(s, e)) {
        exr_close(&s->base);
        return NULL;
    }
    double *m = s->base.index_to_world;
    for (int k = 0; k < 3; k++) {
        double size = vec3_get(params->voxel_size, k), first = k < 2 ? (double)s->low[k] : 0;
        m[5 * k] = size;
        m[4 * k + 3] = vec3_get(params->origin, k) + size * first;
    }
    m[15] = 1;
    return &s->base;
}

// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/tiff_stack.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/file_format.h"
#include "base/core/memory.h"
#include "base/core/reader.h"
#include "io/volumes/numbers.h"
#include "io/volumes/slice_faults.h"
#include "io/volumes/tiff_reader.h"

/* CPU limit of the process: 60 s, plus 2 s for each slice, plus the time of three passes over the file at 1
 * MiB/s, a tenth of the measured speed. */
static const unsigned seconds_at_least = 60, passes = 3, seconds_per_slice = 2;
static const off_t bytes_per_second = 1 << 20;

/* Longer sides are refused as damaged. */
static const int64_t largest_side = 1 << 20;

typedef struct tiff_stack {
    slices base; /* first: the slices' functions get this pointer */
    const char *program;
    size_t memory_limit;
    exr_stack_params params; /* the stack; count 0: one file is read */
    int fd;                  /* the one file; owned by the caller */
    tiff_answer head;        /* answer for the first file */
    int64_t first_page;      /* index of the volume's first page */
    bool is_size_warned;
    int64_t opened;         /* index of the file that is open in the process, or -1 */
    unsigned char *numbers; /* buffer for the numbers of a page */
    reader reader;
} tiff_stack;

/* ---- talking to the process */

static bool is_stack(const tiff_stack *s)
{
    return s->params.count > 0;
}

static bool start(tiff_stack *s, off_t bytes, error *e)
{
    const double seconds = seconds_at_least + passes * (double)(bytes / bytes_per_second) +
                           (double)seconds_per_slice * (double)s->params.count;
    const reader_params params = {s->program,      TIFF_READER_COMMAND,
                                  "file",          -1,
                                  s->memory_limit, seconds < 1e9 ? (unsigned)seconds : 1000000000};
    return s->reader.stream || reader_start(&params, &s->reader, e);
}

static bool is_between(int64_t value, int64_t low, int64_t high)
{
    return value >= low && value <= high;
}

static bool check_answer(const tiff_answer *a, error *e)
{
    bool ok = is_between(a->width, 1, largest_side) && is_between(a->height, 1, largest_side) &&
              is_between(a->pages, 1, largest_side) && is_between(a->slices, 1, a->pages) &&
              is_between(a->channels, 1, a->pages) && is_between(a->frames, 1, a->pages) &&
              is_between(a->slice_step, 1, a->pages) && is_between(a->channel_step, 1, a->pages) &&
              is_between(a->frame_step, 1, a->pages) && a->type < NUMBER_TYPES &&
              memchr(a->unit, 0, sizeof a->unit) &&
              /* leaves room for warnings of this module */
              a->warnings.count <= DENSE_WARNINGS_MOST / 2;
    ok = ok && (a->slices - 1) * a->slice_step + (a->channels - 1) * a->channel_step +
                       (a->frames - 1) * a->frame_step <
                   a->pages;
    for (int k = 0; k < 3; k++) ok = ok && a->size[k] >= 0 && isfinite(a->size[k]) && isfinite(a->origin[k]);
    for (uint32_t k = 0; ok && k < a->warnings.count; k++)
        ok = memchr(a->warnings.text[k], 0, sizeof a->warnings.text[k]) != NULL;
    return ok ||
           error_set(e, ERROR_INPUT_DAMAGED,
                     "claims pages of %lld x %lld pixels, of which at most %lld x %lld are read, or made "
                     "its reader return an invalid answer",
                     (long long)a->width, (long long)a->height, (long long)largest_side,
                     (long long)largest_side);
}

/* Opens a file in the process: file k of the stack, or the only one. */
static bool open_file(tiff_stack *s, int64_t k, tiff_answer *a, error *e)
{
    off_t size;
    const tiff_request request = {TIFF_READER_OPEN, 0};
    int fd = is_stack(s) ? s->params.files->open(s->params.files->context, s->params.paths[k], e) : s->fd;
    if (fd < 0) return false;
    bool ok = reader_check_file(fd, "image", &size, e) &&
              (!is_stack(s) || file_format_of_file(fd, "") == FILE_FORMAT_TIFF ||
               error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the file is not a TIFF file, and others of the stack are: save it as TIFF")) &&
              start(s, size, e);
    if (ok) {
        ok = reader_send(&s->reader, &request, sizeof request, fd, e) &&
             reader_get_answer(&s->reader, a, sizeof *a, NULL, 0, e) && check_answer(a, e);
        s->opened = ok ? k : -1;
        reader_settle(&s->reader, ok, e);
    }
    if (is_stack(s)) close(fd);
    return ok || (is_stack(s) ? error_prefix(e, "%s", s->params.paths[k]) : false);
}

static bool is_alike(const tiff_answer *a, const tiff_answer *b)
{
    return a->width == b->width && a->height == b->height && a->type == b->type;
}

static bool is_shown_alike(const tiff_answer *a, const tiff_answer *b)
{
    return a->orientation == b->orientation && a->fill_order == b->fill_order &&
           a->white_is_zero == b->white_is_zero;
}

static const char *base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

/* Reads the numbers of a page of the open file. */
static bool read_page(tiff_stack *s, int64_t page, error *e)
{
    const tiff_request request = {TIFF_READER_PAGE, (uint32_t)page};
    const size_t count = (size_t)(s->base.size[0] * s->base.size[1]);
    tiff_answer a;
    const bool ok = reader_send(&s->reader, &request, sizeof request, -1, e) &&
                    reader_get_answer(&s->reader, &a, sizeof a, NULL, 0, e) &&
                    (is_alike(&a, &s->head) || error_set(e, ERROR_INPUT_DAMAGED, "the file has changed")) &&
                    reader_get(&s->reader, s->numbers, number_bytes((number_type)a.type), count, e);
    reader_settle(&s->reader, ok, e);
    if (!s->reader.stream) s->opened = -1;
    return ok;
}

/* ---- as slices */

static bool read_slice(tiff_stack *s, int64_t k, error *e)
{
    tiff_answer a;
    const int64_t file = is_stack(s) ? k : 0;
    if (s->opened != file) {
        if (!open_file(s, file, &a, e)) return false;
        if (!is_alike(&a, &s->head)) return error_set(e, ERROR_INPUT_DAMAGED, "the file has changed");
    }
    const int64_t page = is_stack(s) ? 0 : s->first_page + k * s->head.slice_step;
    if (read_page(s, page, e)) return true;
    return is_stack(s) ? error_prefix(e, "%s", s->params.paths[k])
                       : error_prefix(e, "page %lld", (long long)page);
}

static bool tiff_read(slices *base, int64_t k, double *values, error *e)
{
    tiff_stack *s = (tiff_stack *)base;
    const int64_t count = base->size[0] * base->size[1];
    const number_type type = (number_type)s->head.type;
    if (!s->numbers &&
        !(s->numbers = mem_array((size_t)count, number_bytes(type), "a slice of the volume", e)))
        return false;
    if (!read_slice(s, k, e)) return false;
    numbers_convert(s->numbers, type, false, count, values, base->inexact);
    return true;
}

static void tiff_close(slices *base)
{
    tiff_stack *s = (tiff_stack *)base;
    reader_close(&s->reader);
    free(s->numbers);
    free(s);
}

static const slices_ops tiff_ops = {tiff_read, tiff_close};

static tiff_stack *make(const char *program, size_t memory_limit)
{
    tiff_stack *s = mem_alloc(sizeof *s);
    *s = (tiff_stack){.base = {.ops = &tiff_ops, .components = 1, .format = "TIFF"},
                      .program = program,
                      .memory_limit = memory_limit,
                      .fd = -1,
                      .opened = -1};
    return s;
}

/* Chooses voxel sizes that neither the spec nor the file gives. */
static void choose_size(tiff_stack *s, const double given[3], double size[3])
{
    dense_warnings *w = &s->base.warnings;
    for (int k = 0; k < 3; k++) size[k] = given ? given[k] : s->head.size[k];
    if (given) return;
    const bool is_flat_known = size[0] > 0 || size[1] > 0;
    if (!is_flat_known && size[2] == 0)
        dense_warn(w, "the file does not state the size of its voxels: 1 x 1 x 1 is used. Set voxel_size.");
    if (size[0] == 0) size[0] = size[1] > 0 ? size[1] : 1;
    if (size[1] == 0) size[1] = size[0];
    if (is_flat_known && size[2] == 0)
        dense_warn(w,
                   "the file does not state the distance of its slices: %g, the width of a pixel, is used. "
                   "Set voxel_size.",
                   size[0]);
    if (size[2] == 0) size[2] = size[0];
    dense_warn_of_unit(w, s->head.unit);
}

/* Sets the transform. `origin` is added to the origin in the file. */
static bool place(tiff_stack *s, int64_t slice_count, const double given[3], vec3 origin, error *e)
{
    double size[3], *m = s->base.index_to_world;
    s->base.size[0] = s->head.width;
    s->base.size[1] = s->head.height;
    s->base.size[2] = slice_count;
    for (int k = 0; k < 3; k++)
        if (s->base.size[k] < 2)
            return error_set(
                e, ERROR_NO_SURFACE,
                "the volume has %lld x %lld x %lld samples: give one with at least two along each "
                "axis, as a file of several pages, or a stack of files with slices",
                (long long)s->base.size[0], (long long)s->base.size[1], (long long)s->base.size[2]);
    s->base.warnings = s->head.warnings;
    choose_size(s, given, size);
    for (int k = 0; k < 3; k++) {
        m[5 * k] = size[k];
        m[4 * k + 3] = vec3_get(origin, k) - size[k] * s->head.origin[k];
    }
    m[15] = 1;
    s->base.type = numbers_name((number_type)s->head.type);
    s->base.fine = numbers_need_doubles((number_type)s->head.type);
    return true;
}

slices *tiff_file_open(int fd, const char *program, int64_t index, size_t memory_limit,
                       const double voxel_size[3], error *e)
{
    tiff_stack *s = make(program, memory_limit);
    s->fd = fd;
    bool ok = open_file(s, 0, &s->head, e);
    if (ok) {
        s->base.volumes = s->head.channels * s->head.frames;
        ok = place(s, s->head.slices, voxel_size, (vec3){0, 0, 0}, e) &&
             slices_choose_volume(&s->base, &index, e);
    }
    if (ok) {
        s->first_page =
            index % s->head.channels * s->head.channel_step + index / s->head.channels * s->head.frame_step;
        return &s->base;
    }
    tiff_close(&s->base);
    return NULL;
}

/* Checks file k of the stack. */
static bool check_slice(void *context, size_t k, error *e)
{
    tiff_stack *s = context;
    tiff_answer a;
    if (!open_file(s, (int64_t)k, &a, e)) return false;
    if (s->head.pages == 0) s->head = a;
    if (a.pages != 1)
        return error_set(
            e, ERROR_INPUT_UNSUPPORTED,
            "%s: the file has %lld pages, and a slice has one: name the file as path without slices",
            s->params.paths[k], (long long)a.pages);
    if (is_alike(&a, &s->head) && !is_shown_alike(&a, &s->head))
        return error_set(
            e, ERROR_INPUT_UNSUPPORTED,
            "%s: Orientation, FillOrder and WhiteIsZero of the image are %u, %u and %s, and those of %s are %u, "
            "%u and %s: save all images with the same",
            s->params.paths[k], a.orientation, a.fill_order, a.white_is_zero ? "set" : "not set",
            s->params.paths[0], s->head.orientation, s->head.fill_order,
            s->head.white_is_zero ? "set" : "not set");
    if (!s->is_size_warned &&
        (memcmp(a.size, s->head.size, sizeof a.size) != 0 || strcmp(a.unit, s->head.unit) != 0)) {
        dense_warn(&s->head.warnings,
                   "%.60s has another size of pixels than %.60s, whose size is used for all images",
                   base_name(s->params.paths[k]), base_name(s->params.paths[0]));
        s->is_size_warned = true;
    }
    return is_alike(&a, &s->head) ||
           error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "%s: the image has %lld x %lld pixels of %s, and others have %lld x %lld of %s: save "
                     "images of one size and type",
                     s->params.paths[k], (long long)a.width, (long long)a.height,
                     numbers_name((number_type)a.type), (long long)s->head.width, (long long)s->head.height,
                     numbers_name((number_type)s->head.type));
}

slices *tiff_stack_open(const exr_stack_params *params, error *e)
{
    tiff_stack *s = make(params->program, params->memory_limit);
    s->params = *params;
    const double given[3] = {params->voxel_size.x, params->voxel_size.y, params->voxel_size.z};
    if (params->part || params->channel) {
        error_set(e, ERROR_SPEC_INVALID,
                  "the images are TIFF files, which have no part and no channel: remove these members");
    } else if (slice_faults_check(0, params->count, params->numbers, check_slice, s, e) &&
               place(s, (int64_t)params->count, params->has_voxel_size ? given : NULL, params->origin, e)) {
        return &s->base;
    }
    tiff_close(&s->base);
    return NULL;
}

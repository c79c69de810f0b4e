// SPDX-License-Identifier: Apache-2.0
#include "job/phases/outputs.h"
#include "job/phases/pictures.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "io/pictures/picture_png.h"
#include "io/pictures/preview_exr.h"
#include "files/file.h"

/* Frames of a turntable are numbered from 1. */
#define FRAME_NAME "preview.%04d.png"

static bool write_png(const char *directory, const char *name, const canvas *picture, json *outputs, error *e)
{
    char *path = mem_printf("%s/%s", directory, name);
    store_file file = {0};
    bool ok = store_file_begin_hashed(path, &file, e) && picture_png_write(file.stream, picture, e) &&
              outputs_commit(&file, name, outputs, e);
    store_file_abort(&file);
    free(path);
    return ok;
}

static bool write_exr(const char *directory, const spec *s, const image *picture, json *outputs, error *e)
{
#define PACKING(prefix, name, word) [SPEC_COMPRESSION_##name] = prefix##_##name,
    static const preview_exr_packing packings[] = {SPEC_COMPRESSION_LIST(PACKING, PREVIEW_EXR)};
#undef PACKING
    const preview_exr_options options = {packings[s->preview_compression],
                                         s->preview_channels == SPEC_CHANNELS_ALL};
    char *path = mem_printf("%s/preview.exr", directory);
    store_file file = {0};
    bool ok = store_file_begin_hashed(path, &file, e) &&
              preview_exr_write(file.stream, picture, &options, e) &&
              outputs_commit(&file, "preview.exr", outputs, e);
    store_file_abort(&file);
    free(path);
    return ok;
}

static bool write_turntable(const char *directory, int frames, const points *set,
                            const preview_options *options, threads *pool, json *outputs, error *e)
{
    camera *from = mem_alloc((size_t)frames * sizeof *from);
    bool ok = true;
    if (frames > 0) preview_orbit(set, options, frames, from);
    for (int k = 0; ok && k < frames; k++) {
        char *name = mem_printf(FRAME_NAME, k + 1);
        image *picture = NULL;
        ok = preview_render_from(set, options, &from[k], pool, &picture, e) &&
             write_png(directory, name, &(canvas){picture->rgb, picture->width, picture->height, 1}, outputs,
                       e);
        preview_free(picture);
        free(name);
    }
    free(from);
    return ok;
}

/* Sets the values of an attribute in the look: three per point for a color, otherwise one. The caller
 * frees *values. */
static bool show_attribute(const points *set, const char *name, quantity_look *look, double **values,
                           error *e)
{
    const point_attribute *a = set->attributes;
    while (strcmp(a->name, name) != 0) a++; /* the name has been checked before */
    const bool color = a->kind == POINT_ATTRIBUTE_COLOR && a->components >= 3;
    const size_t n = (size_t)a->components;
    if (!(*values = mem_array(set->count, (color ? 3 : 1) * sizeof **values, "the preview's colours", e)))
        return false;
    for (size_t i = 0; i < set->count; i++) {
        const double *v = a->values + n * i;
        double squares = 0;
        for (size_t c = 0; c < n; c++) squares += v[c] * v[c];
        for (size_t c = 0; color && c < 3; c++) (*values)[3 * i + c] = fmin(fmax(v[c], 0), 1);
        if (!color) (*values)[i] = n == 1 ? v[0] : sqrt(squares);
    }
    look->which = color ? QUANTITY_COLOR : QUANTITY_VALUES;
    look->title = name;
    look->values = *values;
    return true;
}

bool pictures_write_preview(const char *directory, const results_input *in, const quantity_look *look,
                            threads *pool, json *outputs, error *e)
{
    const spec *s = in->spec;
    const points *set = in->set;
    const spec_camera *c = &s->camera;
    const camera_place place = {c->position, c->target, c->up, c->fov, c->orthographic};
    preview_options options = {s->preview_width, s->preview_height, *look, s->has_camera ? &place : NULL,
                               in->y_up,         in->thin};
    image *picture;
    double *values = NULL;
    if ((s->preview_attribute && !show_attribute(set, s->preview_attribute, &options.color, &values, e)) ||
        !preview_render(set, &options, pool, &picture, e)) {
        free(values);
        return false;
    }
    const canvas visible = {picture->rgb, picture->width, picture->height, 1};
    bool ok = write_png(directory, WORKER_PREVIEW_NAME, &visible, outputs, e) &&
              (!s->has_preview_exr || write_exr(directory, s, picture, outputs, e));
    preview_free(picture);
    ok = ok && write_turntable(directory, s->turntable, set, &options, pool, outputs, e);
    free(values);
    return ok;
}

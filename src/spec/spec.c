// SPDX-License-Identifier: Apache-2.0
#include "spec/spec.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/frames.h"
#include "base/core/memory.h"
#include "spec/file_names.h"
#include "spec/surface_spec.h"

/* The axis that points up: y for assets of films and games; z for models of CAD and printing, and for
 * medical volumes. For a combination, that of its first part. */
bool spec_y_up(const spec *s)
{
    const spec_surface *first = &s->surface;
    if (s->preview_up != SPEC_UP_AUTO) return s->preview_up == SPEC_UP_Y;
    while (first->part_count > 0) first = first->parts[0];
    if (first->kind != SPEC_SURFACE_MESH) return first->kind == SPEC_SURFACE_VDB;
    return !file_formats[file_format_of_name(first->mesh.path)].z_up;
}

bool spec_up_is_certain(const spec *s)
{
    if (s->preview_up != SPEC_UP_AUTO || s->frame_count > 0 || s->surface.kind != SPEC_SURFACE_MESH)
        return true;
    return !file_formats[file_format_of_name(s->surface.mesh.path)].up_varies;
}

bool spec_has_other_outputs(const spec *s)
{
    bool has_points = false;
    for (int k = 0; k < FILE_FORMATS; k++) has_points |= s->points_in[k];
    return s->has_preview || s->has_convergence || s->has_mesh || has_points;
}

bool spec_attribute_has_file(const spec_attribute *a)
{
    return strcmp(a->from, SPEC_FROM_SURFACE) != 0 && strcmp(a->from, SPEC_FROM_GEOMETRY) != 0;
}

bool spec_attribute_is(const spec_attribute *a, const char *quantity)
{
    return strcmp(a->from, SPEC_FROM_GEOMETRY) == 0 && a->name && strcmp(a->name, quantity) == 0;
}

bool spec_has_weight(const spec *s)
{
    bool has = false;
    for (size_t k = 0; k < s->attribute_count; k++)
        has |= spec_attribute_is(&s->attributes[k], SPEC_GEOMETRY_WEIGHT);
    return has;
}

bool spec_input_at(const spec *s, size_t index, spec_input *out)
{
    if (surface_spec_input_at(&s->surface, &index, out)) return true;
    if (s->region_inside && surface_spec_input_at(s->region_inside, &index, out)) return true;
    if (s->grid.path && index-- == 0) {
        *out = (spec_input){"/sampling/grid/path", s->grid.path, false};
        return true;
    }
    if (s->attach && index-- == 0) {
        *out = (spec_input){"/sampling/attach", s->attach, false};
        return true;
    }
    if (s->points.path && index-- == 0) {
        *out = (spec_input){"/sampling/points/path", s->points.path, false};
        return true;
    }
    for (size_t k = 0; k < s->attribute_count; k++) {
        const spec_attribute *a = &s->attributes[k];
        if (!spec_attribute_has_file(a) || index-- > 0) continue;
        *out = (spec_input){a->input_pointer, a->from, false};
        return true;
    }
    return false;
}

static void replace_path(char **path, surface_spec_renamer *rename, const void *by)
{
    char *old = *path;
    if (!old) return;
    *path = rename(old, by);
    free(old);
}

/* Replaces the paths of all input files, except those of stacks of images. */
static void replace_paths(spec *s, surface_spec_renamer *rename, const void *by)
{
    surface_spec_rename(&s->surface, rename, by);
    if (s->region_inside) surface_spec_rename(s->region_inside, rename, by);
    replace_path(&s->grid.path, rename, by);
    replace_path(&s->attach, rename, by);
    replace_path(&s->points.path, rename, by);
    for (size_t k = 0; k < s->attribute_count; k++) replace_path(&s->attributes[k].from, rename, by);
}

static char *insert_frame(const char *path, const void *frame)
{
    return frames_path(path, *(const int *)frame);
}

static char *insert_file(const char *path, const void *name)
{
    return file_names_path(path, name);
}

void spec_set_frame(spec *s, int frame)
{
    replace_paths(s, insert_frame, &frame);
}

void spec_set_file(spec *s, const char *name)
{
    replace_paths(s, insert_file, name);
}

void spec_free(spec *s)
{
    if (!s) return;
    free(s->name);
    surface_spec_free_parts(&s->surface);
    if (s->region_inside) surface_spec_free_parts(s->region_inside);
    free(s->region_inside);
    free(s->grid.path);
    free(s->attach);
    free(s->grid.name);
    free(s->points.path);
    for (size_t i = 0; i < s->attribute_count; i++) {
        free(s->attributes[i].from);
        free(s->attributes[i].name);
        free(s->attributes[i].as);
        free(s->attributes[i].input_pointer);
    }
    free(s->attributes);
    mem_free_texts(s->ply_properties, s->ply_property_count);
    free(s->orient.twist);
    free(s->instancer.prototype);
    free(s->instancer.scale);
    free(s->preview_attribute);
    free(s->preview_range);
    mem_free_texts(s->labels, s->label_count);
    mem_free_texts(s->depends_on, s->depends_on_count);
    mem_free_texts(s->after, s->after_count);
    mem_free_texts(s->after_frames, s->after_frames_count);
    mem_free_texts(s->slurm, s->slurm_count);
    free(s->frames);
    free(s->frame);
    mem_free_texts(s->files.name, s->files.count);
    free(s->directory);
    free(s->webhook);
    json_free(s->normalised);
    free(s);
}

bool spec_surface_is_bounded(const spec_surface *s)
{
    if (s->part_count == 0)
        return s->kind != SPEC_SURFACE_ANALYTIC || s->analytic.shape != SPEC_SHAPE_HALFSPACE;
    bool any = false, all = true, first = false;
    for (size_t k = 0; k < s->part_count; k++) {
        bool bounded = spec_surface_is_bounded(s->parts[k]);
        if (k == 0) first = bounded;
        any |= bounded;
        all &= bounded;
    }
    return s->kind == SPEC_SURFACE_INTERSECTION ? any : s->kind == SPEC_SURFACE_DIFFERENCE ? first : all;
}

const char *spec_energy_name(spec_energy energy)
{
    static const char *const names[] = {SPEC_ENERGY_LIST(WORDS_TEXT, )};
    return names[energy];
}

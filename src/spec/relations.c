// SPDX-License-Identifier: Apache-2.0
#include "spec/relations.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/frames.h"
#include "spec/file_names.h"
#include "spec/frame_values.h"
#include "spec/group.h"
#include "spec/rules.h"

/* ---- defaults ---- */

/* What the preview shows. The frames of a sequence have one scale: without bounds of the spacing, which give one, they
 * are shaded. */
static const char *default_color(const spec *s)
{
    const bool has_scale = s->frame_count == 0 || s->min_spacing < s->max_spacing;
    if (s->has_alpha) return "\"alpha\"";
    return spec_is_graded(s) && has_scale ? "\"spacing\"" : "\"shading\"";
}

/* The default of a row with SPEC_DEPENDENT as JSON; NULL: none. */
static const char *default_of(const spec *s, const spec_surface *surface, const spec_row *row)
{
    bool has = true;
    if (row->offset == offsetof(spec, method)) return s->has_alpha ? "\"paper\"" : row->otherwise;
    if (row->offset == offsetof(spec, init))
        return s->has_alpha && !s->has_points ? "\"sized\"" : row->otherwise;
    if (row->offset == offsetof(spec, camera.up)) return spec_y_up(s) ? "[0,1,0]" : "[0,0,1]";
    if (row->offset == offsetof(spec, preview_color)) return default_color(s);
    if (row->offset == offsetof(spec, step)) has = s->minimiser == SPEC_MINIMISER_GRADIENT;
    if (row->offset == offsetof(spec, curvature.exponent)) has = s->curvature.ratio > 0;
    if (row->offset == offsetof(spec, gradation)) has = spec_is_graded(s);
    if (row->offset == offsetof(spec, surface.mesh.max_resolution))
        has = !(surface->mesh.voxel_size > 0 || surface->mesh.resolution > 0);
    return has ? row->otherwise : NULL;
}

void relations_set_defaults(reading *r)
{
    const spec *s = reading_whole(r);
    partial_surface *whole = r->surface;
    for (size_t i = 0; s && i < r->absent_count; i++) {
        const absent_member *a = &r->absent[i];
        const char *otherwise = default_of(s, (const spec_surface *)a->surface, a->row);
        r->surface = a->surface;
        if (otherwise)
            group_read_default(r, a->row, otherwise, a->normal);
        else
            json_remove(a->normal, spec_row_key(a->row));
    }
    r->surface = whole;
}

/* ---- relations. `at` is the whole document ---- */

static void check_grid(reading *r, const json_at *at, const spec *s)
{
    const json_at sampling = json_member(at, "sampling"), grid = json_member(&sampling, "grid");
    if (s->has_grid && !s->grid.path && s->surface.kind != SPEC_SURFACE_VDB &&
        s->surface.kind != SPEC_SURFACE_MESH)
        reading_add_fault(r, &grid,
                          "requires a path, because the surface is neither a VDB file nor a mesh file");
}

static void check_solver(reading *r, const json_at *at, const spec *s)
{
    const json_at solver = json_member(at, "solver"), method = json_member(&solver, "method"),
                  init = json_member(&solver, "init");
    if (s->has_alpha && s->method == SPEC_METHOD_SIZED)
        reading_add_fault(
            r, &method,
            "sampling.alpha requires the method \"paper\" or \"witkin-heckbert\" (given \"sized\")");
    if (spec_is_graded(s) && s->method != SPEC_METHOD_SIZED)
        reading_add_fault(r, &method, "sampling.%s requires the method \"sized\"",
                          s->has_feature     ? "feature"
                          : s->has_grid      ? "grid"
                          : s->has_curvature ? "curvature"
                                             : "curve_spacing");
    if (s->has_points && s->method != SPEC_METHOD_SIZED)
        reading_add_fault(r, &method,
                          "sampling.points requires the method \"sized\", which excludes sampling.alpha");
    if (s->has_points && s->init != SPEC_INIT_SURFACE)
        reading_add_fault(r, &init, "excludes sampling.points: remove one of the two");
    if (s->has_control && s->method == SPEC_METHOD_WITKIN_HECKBERT)
        reading_add_fault(
            r, &method,
            "sampling.control requires the method \"sized\" or \"paper\" (given \"witkin-heckbert\")");
}

static void check_output(reading *r, const json_at *at, const spec *s)
{
    const json_at output = json_member(at, "output"), mesh = json_member(&output, "mesh"),
                  parts = json_member(&output, "label_meshes"), order = json_member(&output, "order"),
                  preview = json_member(&output, "preview"), camera = json_member(&preview, "camera"),
                  range = json_member(&preview, "range");
    if (s->has_mesh && s->has_points && s->points.mode == SPEC_POINTS_AVOID)
        reading_add_fault(r, &mesh, "excludes sampling.points with mode \"avoid\": remove one of the two");
    if (s->has_label_meshes && s->surface.kind != SPEC_SURFACE_LABELS)
        reading_add_fault(r, &parts, RULES_LABEL_MESHES);
    if (s->has_order && s->order == SPEC_ORDER_ID && !s->coherent)
        reading_add_fault(
            r, &order,
            "\"id\" requires queue.coherent, because only points of coherent sequences have ids: "
            "use \"progressive\" or \"spatial\", or remove it");
    if (range.node && s->preview_color == SPEC_COLOR_SHADING && !s->preview_attribute)
        reading_add_fault(
            r, &range,
            "is a range of values, and the preview is shaded: set color or attribute beside it to "
            "what the values are, or remove it");
    if (s->has_camera && !json_member(&camera, "up").node) rules_check_up(r, &camera, &s->camera);
}

static bool has_pattern(const spec *s)
{
    spec_input input;
    bool any = false;
    for (size_t k = 0; !any && spec_input_at(s, k, &input); k++)
        any = !input.is_slice && frames_is_pattern(input.path);
    return any;
}

static void check_frames(reading *r, const json_at *at, const spec *s)
{
    const json_at queue = json_member(at, "queue"), frames = json_member(&queue, "frames");
    if (!s->frames || r->known) return; /* paths and frames are the same for all frames */
    const bool all = strcmp(s->frames, FRAMES_ALL) == 0;
    if ((all || !s->has_frame_values) && !has_pattern(s))
        reading_add_fault(r, &frames,
                          all ? "\"" FRAMES_ALL
                                "\" requires the path of a file with %s in place of the frame "
                                "number"
                              : "all frames are equal: write %s in place of the frame number into a path "
                                "of the surface, or add by_frame",
                          FRAMES_NOTATIONS);
    if (s->directory && !frames_is_pattern(s->directory))
        reading_add_fault(
            r, &frames,
            "output.directory is the same for all frames, which would overwrite each other: add %s "
            "in place of the frame number",
            FRAMES_NOTATIONS);
    if (s->has_frame_values) frame_values_check_places(r, at);
}

/* Exactly one input path has the place of a file's name, if and only if there are files. */
static void check_files(reading *r, const json_at *at, const spec *s)
{
    const json_at queue = json_member(at, "queue"), files = json_member(&queue, "files");
    spec_input input;
    const char *place = NULL, *second = NULL;
    if (r->known) return;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) {
        if (!file_names_has_place(input.path)) continue;
        if (input.is_slice) {
            reading_add_fault(r, &files, "%s: the path of a stack of images cannot have %s", input.pointer,
                              FILE_NAMES_PLACE);
            return;
        }
        *(place ? &second : &place) = input.pointer;
    }
    if (!s->files.count && place)
        reading_add_fault(r, &files, "is required, because %s has %s", place, FILE_NAMES_PLACE);
    if (s->files.count && !place)
        reading_add_fault(r, &files,
                          "all frames are equal: write %s in place of the name into the path of the surface",
                          FILE_NAMES_PLACE);
    if (second)
        reading_add_fault(r, &files, "%s and %s have %s: only one input path may have it", place, second,
                          FILE_NAMES_PLACE);
    if (s->files.count && s->directory && !frames_is_pattern(s->directory))
        reading_add_fault(
            r, &files,
            "output.directory is the same for all files, which would overwrite each other: add %s "
            "in place of the frame number",
            FRAMES_NOTATIONS);
}

static void check_coherent(reading *r, const json_at *at, const spec *s)
{
    const json_at queue = json_member(at, "queue"), coherent = json_member(&queue, "coherent");
    if (!s->coherent) return;
    if (s->method != SPEC_METHOD_SIZED)
        reading_add_fault(
            r, &coherent,
            s->has_alpha ? "excludes /sampling/alpha: replace alpha by /sampling/curvature or /sampling/grid"
                         : "requires /solver/method \"sized\": remove /solver/method, whose default it is");
    if (s->features)
        reading_add_fault(
            r, &coherent,
            "excludes features, because points on edges are computed anew in each frame: remove "
            "one of the two");
    if (s->has_points)
        reading_add_fault(
            r, &coherent,
            "excludes sampling.points, because each frame starts with the points of the one before: remove "
            "one of the two");
}

static void check_bounds(reading *r, const json_at *at, const spec *s)
{
    const json_at surface = json_member(at, "surface");
    bool cut = s->region_inside ? spec_surface_is_bounded(s->region_inside) : s->has_region;
    if (!cut && !spec_surface_is_bounded(&s->surface))
        reading_add_fault(
            r, &surface,
            "is unbounded, because it contains a halfspace: give a region, or intersect it with "
            "a bounded shape");
}

static bool has_mesh(const spec_surface *s)
{
    bool found = s->kind == SPEC_SURFACE_MESH;
    for (size_t k = 0; k < s->part_count; k++) found |= has_mesh(s->parts[k]);
    return found;
}

/* Refuses members that concern the number, the neighbours or the order of computed points, if points are
 * attached. */
static void check_attach(reading *r, const json_at *at, const spec *s)
{
    static const char *const excluded[][2] = {
        {"sampling", "alpha"},         {"sampling", "curvature"},   {"sampling", "grid"},
        {"sampling", "feature"},       {"sampling", "min_spacing"}, {"sampling", "max_spacing"},
        {"sampling", "curve_spacing"}, {"output", "mesh"},          {"output", "convergence"},
        {"output", "order"},           {"queue", "coherent"},       {"outcome", "require"}};
    json_at sampling = json_member(at, "sampling"), attach = json_member(&sampling, "attach");
    if (!s->attach) return;
    if (!has_mesh(&s->surface))
        reading_add_fault(r, &attach, "requires a surface that is a mesh, or has one as a part");
    for (size_t k = 0; k < sizeof excluded / sizeof *excluded; k++) {
        json_at group = json_member(at, excluded[k][0]), member = json_member(&group, excluded[k][1]);
        if (member.node && (json_type_of(member) != JSON_BOOL || json_bool(member, true)))
            reading_add_fault(
                r, &member,
                "excludes sampling.attach, which places points that are given: remove one of the two");
    }
}

/* Refuses weights of points that are not all points of the surface. */
static void check_weight(reading *r, const json_at *at, const spec *s)
{
    const json_at list = json_member(at, "attributes");
    const bool avoids = s->has_points && s->points.mode == SPEC_POINTS_AVOID;
    size_t k = 0;
    if (!s->attach && !avoids) return;
    for (json_at one = json_first(&list); one.node && k < s->attribute_count; one = json_next(&one)) {
        const json_at name = json_member(&one, "name");
        if (!spec_attribute_is(&s->attributes[k++], SPEC_GEOMETRY_WEIGHT)) continue;
        reading_add_fault(r, &name, "\"weight\" excludes %s: remove one of the two",
                          s->attach ? "sampling.attach" : "sampling.points with mode \"avoid\"");
    }
}

static bool has_labels(const spec_surface *s)
{
    bool found = s->kind == SPEC_SURFACE_LABELS;
    for (size_t k = 0; k < s->part_count; k++) found |= has_labels(s->parts[k]);
    return found;
}

/* Refuses members that concern a packing, points on curves or given points, if the pattern is blue noise. */
static void check_pattern(reading *r, const json_at *at, const spec *s)
{
    static const char *const excluded[][2] = {{"sampling", "control"}, {"sampling", "alpha"},
                                              {"sampling", "resolve"}, {"sampling", "points"},
                                              {"sampling", "attach"},  {"sampling", "curve_spacing"},
                                              {"", "features"},        {"queue", "coherent"}};
    static const char *const fixed[] = {"method", "init", "energy", "minimiser", "sigma"};
    const bool is_fixed[] = {s->method == SPEC_METHOD_SIZED, s->init == SPEC_INIT_SURFACE,
                             s->energy == SPEC_ENERGY_COTANGENT, s->minimiser == SPEC_MINIMISER_LM,
                             !(s->sigma > 0)};
    const json_at sampling = json_member(at, "sampling"), pattern = json_member(&sampling, "pattern"),
                  solver = json_member(at, "solver");
    if (s->pattern != SPEC_PATTERN_BLUE_NOISE) return;
    if (has_labels(&s->surface))
        reading_add_fault(r, &pattern,
                          "\"blue_noise\" requires a surface without labels: use \"hexagonal\", or sample a "
                          "mesh of the interfaces");
    for (size_t k = 0; k < sizeof excluded / sizeof *excluded; k++) {
        const json_at group = *excluded[k][0] ? json_member(at, excluded[k][0]) : *at,
                      member = json_member(&group, excluded[k][1]);
        if (member.node && (json_type_of(member) != JSON_BOOL || json_bool(member, true)))
            reading_add_fault(r, &member, "excludes the pattern \"blue_noise\": remove one of the two");
    }
    for (size_t k = 0; k < sizeof fixed / sizeof *fixed; k++) {
        const json_at member = json_member(&solver, fixed[k]);
        if (!is_fixed[k] && member.node)
            reading_add_fault(
                r, &member,
                "excludes the pattern \"blue_noise\", which requires the default: remove one of the two");
    }
}

/* The interfaces of labels do not bound one solid, so they can be neither combined nor cut. */
static void check_labels(reading *r, const json_at *at, const spec *s)
{
    const json_at surface = json_member(at, "surface"), region = json_member(at, "region");
    if (!has_labels(&s->surface)) return;
    if (region.node)
        reading_add_fault(
            r, &region,
            "excludes surface.labels, whose interfaces do not bound one solid: remove it, or crop the "
            "file of labels");
    if (s->surface.part_count > 0)
        reading_add_fault(
            r, &surface,
            "contains labels, whose interfaces do not bound one solid: make surface.labels the whole "
            "surface, without a combination, offset or transform");
}

void relations_check(reading *r, const json_at *root)
{
    static void (*const checks[])(reading *, const json_at *, const spec *) = {
        check_grid,   check_solver, check_output, check_frames,  check_files, check_coherent,
        check_bounds, check_attach, check_weight, check_pattern, check_labels};
    const spec *s = reading_whole(r);
    for (size_t k = 0; s && k < sizeof checks / sizeof *checks; k++) checks[k](r, root, s);
}

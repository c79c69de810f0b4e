// SPDX-License-Identifier: Apache-2.0
#include "spec/rules.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/frames.h"
#include "base/core/memory.h"
#include "base/core/nearest_name.h"
#include "geometry/space/affine.h"
#include "geometry/space/vec3.h"
#include "spec/spec_table.h"
#include "spec/surface_spec.h"
#include "spec/frame_values.h"

/* Minimum sine of the angle between a camera's up and its line of sight: below it rounding would rotate the
 * picture. */
static const double UPRIGHT_LEAST = 1e-6;

static size_t depth(const char *pointer)
{
    size_t steps = 0;
    for (; *pointer; pointer++) steps += *pointer == '/';
    return steps;
}

/* A member of the group with nearly that name. Else the member of that name elsewhere with the fewest steps
 * in its pointer, if it is the only one. A member of a kind of surface belongs to no group outside of
 * /surface. Else NULL. */
static const char *suggestion(const char *group, const char *key)
{
    static const char surfaces[] = "/surface/";
    const bool outside = *group && strncmp(group, surfaces, strlen(surfaces) - 1) != 0;
    const char *elsewhere = NULL;
    size_t least = SIZE_MAX;
    nearest_name nearest = nearest_name_to(key, strlen(key));
    for (size_t i = 0; i < spec_row_count; i++) {
        const char *name = spec_row_key(&spec_rows[i]), *pointer = spec_rows[i].pointer;
        if (spec_row_is_member(&spec_rows[i], group)) nearest_name_offer(&nearest, name);
        if (strcmp(key, name) != 0 || depth(pointer) > least) continue;
        if (outside && strncmp(pointer, surfaces, strlen(surfaces)) == 0) continue;
        elsewhere = depth(pointer) < least ? pointer : NULL;
        least = depth(pointer);
    }
    return nearest.name ? nearest.name : elsewhere;
}

void rules_list_members(const spec_row *first, char list[RULES_LIST_MAX])
{
    size_t used = 0;
    *list = '\0';
    for (const spec_row *row = first; row && used < RULES_LIST_MAX; row = spec_row_next(row))
        used +=
            (size_t)snprintf(list + used, RULES_LIST_MAX - used, "%s%s", used ? ", " : "", spec_row_key(row));
    if (used >= RULES_LIST_MAX) snprintf(list, RULES_LIST_MAX, "listed by hexad-worker spec-help");
}

/* Members of earlier versions: what to give instead. Jobs that wait since an upgrade may have them. */
static const struct removed {
    const char *group, *key, *remedy;
} removed[] = {
    {"/sampling", "time_s", "give count, spacing or density; hexad-worker estimate predicts the time"},
};

static const char *removed_remedy(const char *group, const char *key)
{
    for (size_t k = 0; k < sizeof removed / sizeof *removed; k++)
        if (strcmp(group, removed[k].group) == 0 && strcmp(key, removed[k].key) == 0)
            return removed[k].remedy;
    return NULL;
}

static void unknown_member(reading *r, const json_at *at, const char *group)
{
    char key[READING_SHOWN_MAX + 4], members[RULES_LIST_MAX];
    const char *remedy = removed_remedy(group, at->key);
    if (remedy) {
        reading_add_fault(r, at, "was removed: %s", remedy);
        return;
    }
    const char *instead = suggestion(group, at->key);
    reading_shorten(at->key, key);
    rules_list_members(spec_row_first(group), members);
    if (instead)
        reading_add_fault(r, at, "unknown member '%s': did you mean '%s'?", key, instead);
    else
        reading_add_fault(r, at, "unknown member '%s': the members here are %s", key, members);
}

/* Adds faults for members that are unknown or not supported. Stops after SPEC_MAX_FAULTS unknown ones, since
 * names within an object differ. */
static void check_names(reading *r, const json_at *at, const char *group, const spec_row *first)
{
    size_t unknown = 0;
    const spec_row *next = first; /* members are mostly in the order of the table */
    for (json_at member = json_first(at); member.node && unknown < SPEC_MAX_FAULTS;
         member = json_next(&member)) {
        const spec_row *row = spec_row_find_from(next, member.key);
        if (!row && next != first) row = spec_row_find_from(first, member.key);
        if (row) {
            next = spec_row_next(row);
        } else {
            unknown_member(r, &member, group);
            unknown++;
        }
    }
}

static void append(char *list, size_t size, const char *word)
{
    size_t n = strlen(list);
    snprintf(list + n, size - n, "%s%s", n ? ", " : "", word);
}

static void refuse_choice(reading *r, const json_at *at, const spec_row *first, spec_choice choice)
{
    char all[192] = "", given[192] = "";
    for (const spec_row *row = first; row; row = spec_row_next(row)) {
        if (row->choice != choice) continue;
        append(all, sizeof all, spec_row_key(row));
        if (json_member(at, spec_row_key(row)).node) append(given, sizeof given, spec_row_key(row));
    }
    reading_add_fault(r, at, "give %s one of %s (given %s)",
                      choice >= SPEC_CHOICE_GRADING ? "at most" : "exactly", all, *given ? given : "none");
}

/* Whether the member `max` of a region is given: then check_region reports that `min` is missing. */
static bool is_half_a_box(const json_at *at, spec_choice choice)
{
    return choice == SPEC_CHOICE_REGION && json_member(at, "max").node;
}

/* Returns the choices of which more than one member is given. */
static unsigned check_choices(reading *r, const json_at *at, const spec_row *first)
{
    size_t rows[SPEC_CHOICE_COUNT] = {0}, given[SPEC_CHOICE_COUNT] = {0};
    unsigned several = 0;
    for (const spec_row *row = first; row; row = spec_row_next(row)) {
        if (row->choice == SPEC_CHOICE_NONE) continue;
        rows[row->choice]++;
        given[row->choice] += json_member(at, spec_row_key(row)).node != NULL;
    }
    for (spec_choice c = SPEC_CHOICE_SURFACE; c < SPEC_CHOICE_COUNT; c++) {
        if (given[c] > 1) several |= 1u << c;
        if (given[c] > 1 || (rows[c] && !given[c] && c < SPEC_CHOICE_GRADING && !is_half_a_box(at, c)))
            refuse_choice(r, at, first, c);
    }
    return several;
}

/* ---- relations within one group, whose values are valid by themselves ---- */

static bool is_given(const json_at *at, const char *key)
{
    return json_member(at, key).node != NULL;
}

static void check_analytic(reading *r, const json_at *at)
{
    const spec_analytic *a = reading_target(r, offsetof(spec, surface.analytic));
    json_at minor = json_member(at, "minor_radius"), axis = json_member(at, "axis"),
            rounding = json_member(at, "rounding");
    double smallest = a->shape == SPEC_SHAPE_CYLINDER
                          ? fmin(a->radius, 0.5 * a->height)
                          : fmin(a->half_size.x, fmin(a->half_size.y, a->half_size.z));
    if (a->shape == SPEC_SHAPE_TORUS && a->minor_radius >= a->major_radius)
        reading_add_fault(r, &minor, "must be less than major_radius, %.16g (given %.16g)", a->major_radius,
                          a->minor_radius);
    if (axis.node && !(vec3_norm2(a->axis) > 0))
        reading_add_fault(r, &axis, "must not be the zero vector: give a direction");
    if (rounding.node && a->rounding > smallest)
        reading_add_fault(
            r, &rounding,
            "must be at most the smallest half size or radius of the shape, %.16g (given %.16g)", smallest,
            a->rounding);
}

static void check_feature(reading *r, const json_at *at)
{
    json_at resolve = json_member(at, "resolve"), alpha = json_member(at, "alpha"),
            curvature = json_member(at, "curvature");
    const bool resolves = json_bool(resolve, false), feature = is_given(at, "feature");
    if (resolve.node && !resolves)
        reading_add_fault(r, &resolve, "must be true: for another target, remove this member");
    if (resolves && !feature)
        reading_add_fault(r, &resolve,
                          "requires feature: add \"feature\": {} to /sampling, which has defaults");
    if (resolves && curvature.node)
        reading_add_fault(r, &curvature, "excludes resolve: give a count or another target");
    if ((feature || is_given(at, "curve_spacing")) && alpha.node)
        reading_add_fault(r, &alpha, "excludes %s: use curvature, or remove one of the two",
                          feature ? "feature" : "curve_spacing");
}

static void check_points(reading *r, const json_at *at)
{
    static const char *const targets[] = {"control", "resolve"};
    const spec_points *given = reading_target(r, offsetof(spec, points));
    const json_at points = json_member(at, "points"), distance = json_member(&points, "distance");
    if (!points.node) return;
    for (size_t k = 0; k < sizeof targets / sizeof *targets; k++)
        if (is_given(at, targets[k]))
            reading_add_fault(r, &points, "excludes %s: give a count, spacing or density", targets[k]);
    if (given->mode == SPEC_POINTS_AVOID && !distance.node)
        reading_add_fault(r, &points, "mode \"avoid\" requires distance: add it");
    if (given->mode != SPEC_POINTS_AVOID && distance.node)
        reading_add_fault(r, &distance, "requires mode \"avoid\": remove one of the two");
}

/* Checks the limits of a spacing that varies. */
static void check_limits(reading *r, const json_at *at)
{
    static const char *const gradings[] = {"curvature", "grid", "feature", "curve_spacing"},
                             *const limits[] = {"min_spacing", "max_spacing", "gradation"};
    bool graded = false;
    for (size_t k = 0; k < sizeof gradings / sizeof *gradings; k++) graded |= is_given(at, gradings[k]);
    for (size_t k = 0; k < sizeof limits / sizeof *limits && !graded; k++) {
        json_at limit = json_member(at, limits[k]);
        if (limit.node)
            reading_add_fault(
                r, &limit,
                "requires curvature, grid, feature or curve_spacing: add one of them, or remove this "
                "member");
    }
}

static void check_sampling(reading *r, const json_at *at)
{
    json_at least = json_member(at, "min_spacing"), most = json_member(at, "max_spacing");
    const double low = json_number(least, 0), high = json_number(most, 0);
    check_limits(r, at);
    check_feature(r, at);
    check_points(r, at);
    if (most.node && high < low)
        reading_add_fault(r, &most, "must be at least min_spacing, %.16g (given %.16g)", low, high);
}

static void check_curvature(reading *r, const json_at *at)
{
    json_at exponent = json_member(at, "exponent");
    if (exponent.node && !is_given(at, "ratio"))
        reading_add_fault(r, &exponent, "requires ratio: add it, or remove this member");
}

/* Whether a list has `low` to `high` numbers, without duplicates. */
static bool is_set(const spec_list *list, size_t low, size_t high)
{
    bool good = list->count >= low && list->count <= high;
    double *sorted = mem_alloc((list->count + 1) * sizeof *sorted);
    for (size_t i = 0; i < list->count; i++) sorted[i] = list->number[i];
    qsort(sorted, list->count, sizeof *sorted, compare_doubles);
    for (size_t i = 1; good && i < list->count; i++) good = sorted[i] != sorted[i - 1];
    free(sorted);
    return good;
}

static void check_lists(reading *r, const json_at *at, const spec_list *lists, size_t low, size_t high,
                        const char *must)
{
    for (json_at list = json_first(at); list.node; list = json_next(&list))
        if (!is_set(&lists[list.index], low, high)) reading_add_fault(r, &list, "%s", must);
}

/* Checks a stack of images that a member of the surface describes. It is the same in all frames. */
static void check_exr(reading *r, const json_at *at)
{
    if (r->known) return;
    spec_exr *x = reading_target(r, offsetof(spec, surface.exr));
    json_at slices = json_member(at, "slices"), path = json_member(at, "path");
    int from = 0, step = 1;
    if (!surface_spec_parse_slices(x, &from, &step)) {
        reading_add_fault(
            r, &slices,
            "must be the first and the last slice, 2 to %d of them, as in \"1-93\" or \"1-93x2\" "
            "(given \"%s\")",
            SURFACE_SPEC_MOST_SLICES, x->slices);
        return;
    }
    r->slices += x->count;
    r->name_bytes += x->count * strlen(x->path);
    if (r->slices > SURFACE_SPEC_MOST_SLICES || r->name_bytes > SURFACE_SPEC_MOST_NAME_BYTES)
        reading_add_fault(
            r, &slices,
            "the stacks of the spec have more than %d slices or file names of more than %d MiB: "
            "use fewer slices or shorter paths",
            SURFACE_SPEC_MOST_SLICES, SURFACE_SPEC_MOST_NAME_BYTES >> 20);
    else if (!surface_spec_name_slices(x, from, step))
        reading_add_fault(r, &path, "must contain one %s in place of the slice number", FRAMES_NOTATIONS);
}

/* Checks the members of label files: with slices, the path names a stack. */
static void check_label_files(reading *r, const json_at *at)
{
    /* `origin` has a default */
    static const char *const of_stacks[] = {"part", "channel", "origin"};
    static const char *const of_files[] = {"grid", "index", "level"};
    spec_labels *l = reading_target(r, offsetof(spec, surface.labels));
    spec_exr *x = reading_target(r, offsetof(spec, surface.exr));
    const bool stack = x->slices != NULL;
    const vec3 size = x->voxel_size, origin = x->origin;
    const bool is_default[] = {false, false, origin.x == 0 && origin.y == 0 && origin.z == 0};
    x->has_voxel_size = size.x != 1 || size.y != 1 || size.z != 1;
    for (size_t k = 0; k < sizeof of_stacks / sizeof *of_stacks; k++) {
        const json_at member = json_member(at, of_stacks[k]);
        if (!stack && member.node && !is_default[k])
            reading_add_fault(r, &member, "requires slices: add it, or remove this member");
    }
    for (size_t k = 0; k < sizeof of_files / sizeof *of_files; k++) {
        const json_at member = json_member(at, of_files[k]);
        if (stack && member.node) reading_add_fault(r, &member, "excludes slices: remove one of the two");
    }
    if (!stack || r->known) return;
    x->path = l->path;
    l->path = NULL;
    check_exr(r, at);
}

static void check_volume(reading *r, const json_at *at)
{
    spec_volume *v = reading_target(r, offsetof(spec, surface.volume));
    spec_exr *x = reading_target(r, offsetof(spec, surface.exr));
    const json_at index = json_member(at, "index"), level = json_member(at, "level");
    if (!x->has_voxel_size) x->voxel_size = vec3_make(1, 1, 1);
    if (!x->slices) return;
    if (index.node) reading_add_fault(r, &index, "excludes slices: remove one of the two");
    if (level.node) reading_add_fault(r, &level, "excludes slices: remove one of the two");
    if (r->known) return;
    x->path = v->path;
    v->path = NULL;
    check_exr(r, at);
}

static void check_labels(reading *r, const json_at *at)
{
    const json_at groups = json_member(at, "groups"), interfaces = json_member(at, "interfaces");
    const spec_labels *l = reading_target(r, offsetof(spec, surface.labels));
    check_label_files(r, at);
    if (r->known) return; /* lists of lists are the same in all frames */
    check_lists(r, &groups, l->groups, 2, SIZE_MAX, "must be two or more different labels");
    check_lists(r, &interfaces, l->interfaces, 2, 2, "must be two different labels");
}

static void check_control(reading *r, const json_at *at)
{
    const spec_control *c = reading_target(r, offsetof(spec, control));
    json_at start = json_member(at, "start_count");
    if (c->start_count > 0 && c->start_count < c->min_count)
        reading_add_fault(r, &start, "must be at least min_count, %lld (given %lld)", (long long)c->min_count,
                          (long long)c->start_count);
}

static void check_box(reading *r, const json_at *at, const spec_box *box)
{
    json_at max = json_member(at, "max"), side = json_first(&max);
    for (int axis = 0; axis < 3; axis++) {
        double low = vec3_get(box->min, axis), high = vec3_get(box->max, axis);
        if (!(low < high)) /* high is max itself if it is the default */
            reading_add_fault(r, side.node ? &side : at, "max must be above min, %.16g (given %.16g)", low,
                              high);
        if (side.node) side = json_next(&side);
    }
}

static void check_domain(reading *r, const json_at *at)
{
    check_box(r, at, reading_target(r, offsetof(spec, surface.bspline.domain)));
}

static void check_region(reading *r, const json_at *at)
{
    json_at min = json_member(at, "min"), max = json_member(at, "max");
    if (max.node && json_member(at, "inside").node)
        reading_add_fault(r, &max, "excludes inside: remove one of the two");
    else if ((min.node == NULL) != (max.node == NULL))
        reading_add_fault(r, min.node ? &max : &min,
                          "is required with %s: a box is {\"min\": [0, 0, 0], \"max\": [1, 1, 1]}",
                          min.node ? "min" : "max");
    else if (min.node)
        check_box(r, at, reading_target(r, offsetof(spec, region)));
}

static void check_bspline(reading *r, const json_at *at)
{
    const spec_bspline *b = reading_target(r, offsetof(spec, surface.bspline));
    json_at coefficients = json_member(at, "coefficients");
    double count = (double)b->dims[0] * b->dims[1] * b->dims[2];
    if (b->coefficients && (double)b->coefficient_count != count)
        reading_add_fault(r, &coefficients,
                          "must have as many numbers as dims requires, %d x %d x %d = %.0f (given %zu)",
                          b->dims[0], b->dims[1], b->dims[2], count, b->coefficient_count);
}

static void check_solver(reading *r, const json_at *at)
{
    json_at step = json_member(at, "step");
    if (step.node && strcmp(json_string(json_member(at, "minimiser"), ""), "gradient") != 0)
        reading_add_fault(r, &step, "requires the minimiser \"gradient\"");
}

void rules_check_up(reading *r, const json_at *at, const spec_camera *c)
{
    json_at up = json_member(at, "up");
    if (!(vec3_norm(vec3_cross(vec3_unit(vec3_sub(c->target, c->position)), vec3_unit(c->up))) >
          UPRIGHT_LEAST))
        reading_add_fault(r, up.node ? &up : at,
                          "up is zero or parallel to the line of sight: give another direction");
}

static void check_camera(reading *r, const json_at *at)
{
    const spec_camera *c = reading_target(r, offsetof(spec, camera));
    json_at target = json_member(at, "target");
    if (!(vec3_norm2(vec3_sub(c->target, c->position)) > 0))
        reading_add_fault(r, &target, "is equal to position: move one of them");
    else if (is_given(at, "up"))
        rules_check_up(r, at, c);
}

static void check_preview(reading *r, const json_at *at)
{
    const double *limit = *(double **)reading_target(r, offsetof(spec, preview_range));
    json_at range = json_member(at, "range");
    if (range.node && (json_size(range) != 2 || !(limit[0] < limit[1])))
        reading_add_fault(r, &range, "must be two numbers, the lower one first");
}

/* Adds a fault at a member that is true or an object, if the member `needed` is not true. */
static void check_needs(reading *r, const json_at *at, const json_at *member, const char *needed,
                        const char *must)
{
    if (member->node && json_bool(*member, true) && !json_bool(json_member(at, needed), false))
        reading_add_fault(r, member, "%s", must);
}

static void check_output(reading *r, const json_at *at)
{
    json_at usda = json_member(at, "mesh_usda"), parts = json_member(at, "label_meshes"),
            usd = json_member(at, "usd"), instancer = json_member(&usd, "instancer");
    check_needs(r, at, &instancer, "points_usda", "requires points_usda: true");
    check_needs(r, at, &usda, "mesh", "requires mesh: true");
    check_needs(r, at, &parts, "mesh", RULES_LABEL_MESHES);
}

static void check_orient(reading *r, const json_at *at)
{
    if (is_given(at, "twist") && is_given(at, "seed"))
        reading_add_fault(r, at, "may have at most one of twist, seed (given both): remove one of them");
    json_at up = json_member(at, "up");
    const spec_orient *o = reading_target(r, offsetof(spec, orient));
    if (o->has_up && !(vec3_norm2(o->up) > 0))
        reading_add_fault(r, &up, "is zero: give a direction, such as [0, 0, 1]");
}

/* Checks that a path can be written between @ or @@@ in a USD text file. */
static void check_instancer(reading *r, const json_at *at)
{
    json_at prototype = json_member(at, "prototype");
    const char *path = json_string(prototype, "");
    bool has_control = false;
    for (const char *c = path; *c; c++) has_control |= (unsigned char)*c < ' ' || *c == 127;
    if (has_control || strstr(path, "@@@"))
        reading_add_fault(r, &prototype, "must not contain control characters or \"@@@\": rename the file");
}

/* Refuses members that require another kind of array than a data set. */
static void check_files(reading *r, const json_at *at, const json_at *files)
{
    static const char *const excluded[] = {"frames", "by_frame", "coherent", "after_frames"};
    for (size_t i = 0; i < sizeof excluded / sizeof *excluded; i++) {
        json_at other = json_member(at, excluded[i]);
        if (json_type_of(other) == JSON_BOOL    ? json_bool(other, false)
            : json_type_of(other) == JSON_ARRAY ? json_size(other) > 0
                                                : other.node != NULL)
            reading_add_fault(r, files, "excludes queue.%s: remove one of the two", excluded[i]);
    }
}

static void check_frames(reading *r, const json_at *at)
{
    json_at frames = json_member(at, "frames"), after = json_member(at, "after_frames"),
            chunk = json_member(at, "chunk"), coherent = json_member(at, "coherent"),
            files = json_member(at, "files");
    const char *text = json_string(frames, NULL);
    const bool in_order = json_bool(coherent, false);
    error e = {0};
    if (files.node) {
        check_files(r, at, &files);
        return;
    }
    if (!text && (json_type_of(after) == JSON_STRING || json_size(after) > 0))
        reading_add_fault(r, &after, "requires queue.frames; for a job without frames use depends_on");
    if (json_number(chunk, 1) > 1 && (!text || in_order))
        reading_add_fault(
            r, &chunk, "%s",
            text ? "excludes queue.coherent, whose frames run one after another: remove one of the two"
                 : "requires queue.frames or queue.files: remove chunk, or add one of them");
    if (!text && in_order) reading_add_fault(r, &coherent, "requires queue.frames");
    if (!text || strcmp(text, FRAMES_ALL) == 0) return;
    int **numbers = reading_target(r, offsetof(spec, frame));
    *numbers = frames_parse(text, reading_target(r, offsetof(spec, frame_count)), &e);
    if (!*numbers) reading_add_fault(r, &frames, "%s", e.message);
}

static void check_transform(reading *r, const json_at *at)
{
    const double *m = *(double **)reading_target(r, offsetof(spec, surface.matrix));
    json_at matrix = json_member(at, "matrix");
    if (json_size(matrix) != 16) {
        reading_add_fault(r, &matrix, "must be 16 numbers (given %zu)", json_size(matrix));
        return;
    }
    if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
        reading_add_fault(r, &matrix,
                          "the last row must be 0, 0, 0, 1: give the matrix row by row, for column vectors");
    double to[3][4], back[3][4];
    for (int k = 0; k < 12; k++) to[k / 4][k % 4] = m[k];
    if (!isfinite(1 / affine_invert(to, back)))
        reading_add_fault(r, &matrix, "is singular: give an invertible matrix");
}

/* Checks the name of an attribute in the outputs of all formats. */
static void check_attribute(reading *r, const json_at *at)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789";
    static const char *const computed[] = {"part", SPEC_GEOMETRY_DIRECTION1, SPEC_GEOMETRY_DIRECTION2,
                                           SPEC_GEOMETRY_SOURCE, SPEC_GEOMETRY_WEIGHT};
    const spec_attribute *a = reading_target(r, offsetof(spec, attribute));
    json_at as = json_member(at, "as"), name = json_member(at, "name");
    if (a->as && (strspn(a->as, letters) != strlen(a->as) || (*a->as >= '0' && *a->as <= '9')))
        reading_add_fault(r, &as, "must be letters, digits and _, a letter first (given \"%s\")", a->as);
    if (!a->as && !a->name) reading_add_fault(r, &as, "is required if name is absent");
    if (strcmp(a->from, SPEC_FROM_GEOMETRY) != 0) return;
    for (size_t k = 0; k < sizeof computed / sizeof *computed; k++)
        if (a->name && strcmp(a->name, computed[k]) == 0) return;
    reading_add_fault(r, name.node ? &name : at, "must be part, direction1, direction2, source or weight");
}

unsigned rules_check_names(reading *r, const json_at *at, const char *group, const spec_row *first)
{
    check_names(r, at, group, first);
    return check_choices(r, at, first);
}

static void check_queue(reading *r, const json_at *at)
{
    check_frames(r, at);
    if (!json_member(at, "files").node) frame_values_check(r, at);
}

void rules_check_group(reading *r, const json_at *at, const char *group)
{
    static const struct {
        const char *group;
        void (*check)(reading *, const json_at *);
    } rules[] = {{"/surface/analytic", check_analytic},
                 {"/surface/bspline", check_bspline},
                 {"/surface/bspline/domain", check_domain},
                 {"/surface/volume", check_volume},
                 {"/surface/exr", check_exr},
                 {"/surface/labels", check_labels},
                 {"/surface/transform", check_transform},
                 {"/region", check_region},
                 {"/attributes", check_attribute},
                 {"/sampling", check_sampling},
                 {"/sampling/control", check_control},
                 {"/sampling/curvature", check_curvature},
                 {"/solver", check_solver},
                 {"/output", check_output},
                 {"/output/orient", check_orient},
                 {"/output/usd/instancer", check_instancer},
                 {"/output/preview", check_preview},
                 {"/output/preview/camera", check_camera},
                 {"/queue", check_queue}};
    for (size_t k = 0; *group && k < sizeof rules / sizeof rules[0]; k++)
        if (strcmp(group, rules[k].group) == 0) {
            rules[k].check(r, at);
            return;
        }
}

#include "spec/rules.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/compare.h"
#include "base/frames.h"
#include "base/memory.h"
#include "base/nearest_name.h"
#include "geometry/affine.h"
#include "geometry/vec3.h"
#include "spec/spec_table.h"
#include "spec/surface.h"
#include "spec/frame_values.h"

/* Sine of the angle between a camera's up and its line of sight, below which rounding would turn the picture. */
static const double UPRIGHT_LEAST = 1e-6;

static size_t depth(const char *pointer)
{
    size_t steps = 0;
    for (; *pointer; pointer++) steps += *pointer == '/';
    return steps;
}

/* A member of the group with nearly that name. Else the member of that name elsewhere with the fewest steps in its
 * pointer, if it is the only one. Else NULL. */
static const char *suggestion(const char *group, const char *key)
{
    const char *elsewhere = NULL;
    size_t least = SIZE_MAX;
    nearest_name nearest = nearest_name_to(key, strlen(key));
    for (size_t i = 0; i < spec_row_count; i++) {
        const char *name = spec_row_key(&spec_rows[i]), *pointer = spec_rows[i].pointer;
        if (spec_row_is_member(&spec_rows[i], group)) nearest_name_offer(&nearest, name);
        if (strcmp(key, name) != 0 || depth(pointer) > least) continue;
        elsewhere = depth(pointer) < least ? pointer : NULL;
        least = depth(pointer);
    }
    return nearest.name ? nearest.name : elsewhere;
}

/* The members of a group, or false if a message is too short for them. */
static bool list_members(const char *group, char list[READING_SHOWN_MAX])
{
    size_t count, used = 0;
    const spec_row *const *row = spec_rows_of(group, &count);
    for (size_t i = 0; i < count && used < READING_SHOWN_MAX; i++)
        used += (size_t)snprintf(list + used, READING_SHOWN_MAX - used, "%s%s", i ? ", " : "",
                                 spec_row_key(row[i]));
    return count > 0 && used < READING_SHOWN_MAX;
}

static void unknown_member(reading *r, const json_at *at, const char *group)
{
    char key[READING_SHOWN_MAX + 4], members[READING_SHOWN_MAX];
    const char *instead = suggestion(group, at->key);
    reading_shorten(at->key, key);
    if (instead)
        reading_add_fault(r, at, "unknown member '%s': did you mean '%s'?", key, instead);
    else if (list_members(group, members))
        reading_add_fault(r, at, "unknown member '%s': the members here are %s", key, members);
    else
        reading_add_fault(r, at, "unknown member '%s'", key);
}

/* Members that are unknown or not supported. An object's names differ, so after as many unknown
 * ones as there are places for faults the rest need not be looked at. */
static void check_names(reading *r, const json_at *at, const char *group)
{
    size_t unknown = 0;
    for (size_t i = 0; i < json_size(*at) && unknown < SPEC_MAX_FAULTS; i++) {
        json_at member = json_element(at, i);
        const spec_row *row = spec_row_find(group, member.key);
        if (!row) {
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

static void refuse_choice(reading *r, const json_at *at, const char *group, spec_choice choice)
{
    char all[192] = "", given[192] = "";
    size_t count = 0;
    const spec_row *const *row = spec_rows_of(group, &count);
    for (size_t i = 0; i < count; i++) {
        if (row[i]->choice != choice) continue;
        append(all, sizeof all, spec_row_key(row[i]));
        if (json_member(at, spec_row_key(row[i])).node) append(given, sizeof given, spec_row_key(row[i]));
    }
    reading_add_fault(r, at, "give %s one of %s (given %s)",
                      choice >= SPEC_CHOICE_GRADING ? "at most" : "exactly", all, *given ? given : "none");
}

/* Whether a region has a corner of a box, so that check_region names the corner that is missing. */
static bool is_half_a_box(const json_at *at, spec_choice choice)
{
    return choice == SPEC_CHOICE_REGION && json_member(at, "max").node;
}

/* Returns the choices of which more than one member is given. */
static unsigned check_choices(reading *r, const json_at *at, const char *group)
{
    size_t count = 0, rows[SPEC_CHOICE_COUNT] = {0}, given[SPEC_CHOICE_COUNT] = {0};
    const spec_row *const *row = spec_rows_of(group, &count);
    unsigned several = 0;
    for (size_t i = 0; i < count; i++) {
        if (row[i]->choice == SPEC_CHOICE_NONE) continue;
        rows[row[i]->choice]++;
        given[row[i]->choice] += json_member(at, spec_row_key(row[i])).node != NULL;
    }
    for (spec_choice c = SPEC_CHOICE_SURFACE; c < SPEC_CHOICE_COUNT; c++) {
        if (given[c] > 1) several |= 1u << c;
        if (given[c] > 1 || (rows[c] && !given[c] && c < SPEC_CHOICE_GRADING && !is_half_a_box(at, c)))
            refuse_choice(r, at, group, c);
    }
    return several;
}

/* What no single row can say; only of values that are good by themselves. */
static void check_analytic(reading *r, const json_at *at)
{
    const spec_analytic *a = &r->surface->analytic;
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
    const spec *s = r->s;
    json_at resolve = json_member(at, "resolve"), alpha = json_member(at, "alpha"),
            curvature = json_member(at, "curvature");
    if (resolve.node && !s->resolve)
        reading_add_fault(r, &resolve, "must be true: for another target, remove this member");
    if (s->resolve && !s->has_feature)
        reading_add_fault(r, &resolve,
                          "requires feature: add \"feature\": {} to /sampling, which has defaults");
    if (s->resolve && curvature.node)
        reading_add_fault(r, &curvature, "excludes resolve: give a count or another target");
    if ((s->has_feature || s->curve_spacing > 0) && alpha.node)
        reading_add_fault(r, &alpha, "excludes %s: use curvature, or remove one of the two",
                          s->has_feature ? "feature" : "curve_spacing");
}

static void check_points(reading *r, const json_at *at)
{
    static const char *const targets[] = {"control", "time_s", "resolve"};
    const spec *s = r->s;
    const json_at points = json_member(at, "points"), distance = json_member(&points, "distance");
    if (!s->has_points) return;
    for (size_t k = 0; k < sizeof targets / sizeof *targets; k++)
        if (json_member(at, targets[k]).node)
            reading_add_fault(r, &points, "excludes %s: give a count, spacing or density", targets[k]);
    if (s->points.mode == SPEC_POINTS_AVOID && !distance.node)
        reading_add_fault(r, &points, "mode \"avoid\" requires distance: add it");
    if (s->points.mode != SPEC_POINTS_AVOID && distance.node)
        reading_add_fault(r, &distance, "requires mode \"avoid\": remove one of the two");
}

static void check_sampling(reading *r, const json_at *at)
{
    static const char *const limits[] = {"min_spacing", "max_spacing", "gradation"};
    const spec *s = r->s;
    for (size_t k = 0; k < sizeof limits / sizeof limits[0] && !spec_is_graded(s); k++) {
        json_at limit = json_member(at, limits[k]);
        if (limit.node)
            reading_add_fault(
                r, &limit,
                "requires curvature, grid, feature or curve_spacing: add one of them, or remove this "
                "member");
    }
    check_feature(r, at);
    check_points(r, at);
    json_at most = json_member(at, "max_spacing"), curvature = json_member(at, "curvature"),
            exponent = json_member(&curvature, "exponent"), grid = json_member(at, "grid");
    json_at time = json_member(at, "time_s");
    if (time.node && (s->min_spacing > 0 || s->max_spacing > 0 || s->has_feature || s->curve_spacing > 0))
        reading_add_fault(r, &time,
                          "determines the count: remove min_spacing, max_spacing, feature and curve_spacing");
    if (s->max_spacing > 0 && s->max_spacing < s->min_spacing)
        reading_add_fault(r, &most, "must be at least min_spacing, %.16g (given %.16g)", s->min_spacing,
                          s->max_spacing);
    if (exponent.node && !(s->curvature.ratio > 0))
        reading_add_fault(r, &exponent, "requires ratio: add it, or remove this member");
    if (s->has_grid && !s->grid.path && s->surface.kind != SPEC_SURFACE_VDB)
        reading_add_fault(r, &grid, "requires a path, because the surface is not a VDB file");
}

/* Whether a list has from low to high numbers, none of them twice. */
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

static void check_lists(reading *r, const json_at *at, const spec_list *lists, size_t count, size_t low,
                        size_t high, const char *must)
{
    for (size_t k = 0; k < count; k++) {
        if (is_set(&lists[k], low, high)) continue;
        const json_at list = json_element(at, k);
        reading_add_fault(r, &list, "%s", must);
    }
}

/* A stack of images that a member of the surface describes. It is the same in all frames. */
static void check_exr(reading *r, const json_at *at)
{
    if (r->known) return;
    spec_exr *x = &r->surface->exr;
    json_at slices = json_member(at, "slices"), path = json_member(at, "path");
    if (!surface_parse_slices(x))
        reading_add_fault(
            r, &slices,
            "must be the first and the last slice, 2 to %d of them, as in \"1-93\" or \"1-93x2\" "
            "(given \"%s\")",
            SURFACE_MOST_SLICES, x->slices);
    else if (!surface_name_slices(x))
        reading_add_fault(r, &path, "must contain one %s in place of the slice number", FRAMES_NOTATIONS);
}

/* With slices the path names a stack. */
static void check_label_files(reading *r, const json_at *at)
{
    static const char *const of_stacks[] = {"part", "channel", "origin"}; /* the last has a default */
    static const char *const of_files[] = {"grid", "index", "level"};
    spec_surface *s = r->surface;
    const bool stack = s->exr.slices != NULL;
    const vec3 size = s->exr.voxel_size, origin = s->exr.origin;
    const bool is_default[] = {false, false, origin.x == 0 && origin.y == 0 && origin.z == 0};
    s->exr.has_voxel_size = size.x != 1 || size.y != 1 || size.z != 1;
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
    s->exr.path = s->labels.path;
    s->labels.path = NULL;
    check_exr(r, at);
}

static void check_volume(reading *r, const json_at *at)
{
    spec_surface *s = r->surface;
    const json_at index = json_member(at, "index"), level = json_member(at, "level");
    if (!s->exr.has_voxel_size) s->exr.voxel_size = vec3_make(1, 1, 1);
    if (!s->exr.slices) return;
    if (index.node) reading_add_fault(r, &index, "excludes slices: remove one of the two");
    if (level.node) reading_add_fault(r, &level, "excludes slices: remove one of the two");
    if (r->known) return;
    s->exr.path = s->volume.path;
    s->volume.path = NULL;
    check_exr(r, at);
}

static void check_labels(reading *r, const json_at *at)
{
    const json_at groups = json_member(at, "groups"), interfaces = json_member(at, "interfaces");
    const spec_labels *l = &r->surface->labels;
    check_label_files(r, at);
    if (r->known) return; /* lists of lists are the same in all frames */
    check_lists(r, &groups, l->groups, l->group_count, 2, SIZE_MAX, "must be two or more different labels");
    check_lists(r, &interfaces, l->interfaces, l->interface_count, 2, 2, "must be two different labels");
}

static void check_control(reading *r, const json_at *at)
{
    const spec_control *c = &r->s->control;
    json_at start = json_member(at, "start_count");
    if (c->start_count > 0 && c->start_count < c->min_count)
        reading_add_fault(r, &start, "must be at least min_count, %lld (given %lld)", (long long)c->min_count,
                          (long long)c->start_count);
}

static void check_box(reading *r, const json_at *at, const spec_box *box)
{
    json_at max = json_member(at, "max");
    for (int axis = 0; axis < 3; axis++) {
        double low = vec3_get(box->min, axis), high = vec3_get(box->max, axis);
        if (low < high) continue;
        json_at side = json_element(&max, (size_t)axis); /* max itself where it is the default */
        reading_add_fault(r, side.node ? &side : at, "max must be above min, %.16g (given %.16g)", low, high);
    }
}

static void check_domain(reading *r, const json_at *at)
{
    check_box(r, at, &r->surface->bspline.domain);
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
        check_box(r, at, &r->s->region);
}

static bool has_mesh(const spec_surface *s)
{
    bool found = s->kind == SPEC_SURFACE_MESH;
    for (size_t k = 0; k < s->part_count; k++) found |= has_mesh(s->parts[k]);
    return found;
}

/* Points that are attached are not computed: what concerns their number, their neighbours or their order is refused. */
static void check_attach(reading *r, const json_at *at)
{
    static const char *const excluded[][2] = {
        {"sampling", "alpha"},         {"sampling", "curvature"},   {"sampling", "grid"},
        {"sampling", "feature"},       {"sampling", "min_spacing"}, {"sampling", "max_spacing"},
        {"sampling", "curve_spacing"}, {"output", "mesh"},          {"output", "convergence"},
        {"output", "order"},           {"queue", "coherent"},       {"outcome", "require"}};
    json_at sampling = json_member(at, "sampling"), attach = json_member(&sampling, "attach");
    if (!r->s->attach) return;
    if (!has_mesh(&r->s->surface))
        reading_add_fault(r, &attach, "requires a surface that is a mesh, or has one as a part");
    for (size_t k = 0; k < sizeof excluded / sizeof *excluded; k++) {
        json_at group = json_member(at, excluded[k][0]), member = json_member(&group, excluded[k][1]);
        if (member.node && (json_type_of(member) != JSON_BOOL || json_bool(member, true)))
            reading_add_fault(
                r, &member,
                "excludes sampling.attach, which places points that are given: remove one of the two");
    }
}

static bool has_labels(const spec_surface *s)
{
    bool found = s->kind == SPEC_SURFACE_LABELS;
    for (size_t k = 0; k < s->part_count; k++) found |= has_labels(s->parts[k]);
    return found;
}

/* Blue noise has no packing, no points on curves and no given points: what concerns these is refused. */
static void check_pattern(reading *r, const json_at *at)
{
    static const char *const excluded[][2] = {
        {"sampling", "control"},       {"sampling", "alpha"},  {"sampling", "resolve"},
        {"sampling", "points"},        {"sampling", "attach"}, {"sampling", "time_s"},
        {"sampling", "curve_spacing"}, {"", "features"},       {"queue", "coherent"}};
    static const char *const fixed[] = {"method", "init", "energy", "minimiser", "sigma"};
    const spec *s = r->s;
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
static void check_whole_labels(reading *r, const json_at *at)
{
    const json_at surface = json_member(at, "surface"), region = json_member(at, "region");
    if (!has_labels(&r->s->surface)) return;
    if (region.node)
        reading_add_fault(
            r, &region,
            "excludes surface.labels, whose interfaces do not bound one solid: remove it, or crop the "
            "file of labels");
    if (r->s->surface.part_count > 0)
        reading_add_fault(
            r, &surface,
            "contains labels, whose interfaces do not bound one solid: make surface.labels the whole "
            "surface, without a combination, offset or transform");
}

static void check_whole(reading *r, const json_at *at)
{
    json_at surface = json_member(at, "surface");
    const spec *s = r->s;
    bool cut = s->region_inside ? spec_surface_is_bounded(s->region_inside) : s->has_region;
    if (!cut && !spec_surface_is_bounded(&s->surface))
        reading_add_fault(
            r, &surface,
            "is unbounded, because it contains a halfspace: give a region, or intersect it with "
            "a bounded shape");
    check_attach(r, at);
    check_pattern(r, at);
    check_whole_labels(r, at);
    json_at output = json_member(at, "output"), order = json_member(&output, "order");
    if (s->has_order && s->order == SPEC_ORDER_ID && !s->coherent)
        reading_add_fault(
            r, &order,
            "\"id\" requires queue.coherent, because only points of coherent sequences have ids: "
            "use \"progressive\" or \"spatial\", or remove it");
}

static void check_bspline(reading *r, const json_at *at)
{
    const spec_bspline *b = &r->surface->bspline;
    json_at coefficients = json_member(at, "coefficients");
    double count = (double)b->dims[0] * b->dims[1] * b->dims[2];
    if (b->coefficients && (double)b->coefficient_count != count)
        reading_add_fault(r, &coefficients,
                          "must have as many numbers as dims requires, %d x %d x %d = %.0f (given %zu)",
                          b->dims[0], b->dims[1], b->dims[2], count, b->coefficient_count);
}

static void check_solver(reading *r, const json_at *at)
{
    json_at method = json_member(at, "method"), step = json_member(at, "step"),
            init = json_member(at, "init");
    if (step.node && r->s->minimiser != SPEC_MINIMISER_GRADIENT)
        reading_add_fault(r, &step, "requires the minimiser \"gradient\"");
    if (r->s->has_alpha && r->s->method == SPEC_METHOD_SIZED)
        reading_add_fault(
            r, &method,
            "sampling.alpha requires the method \"paper\" or \"witkin-heckbert\" (given \"sized\")");
    if (spec_is_graded(r->s) && r->s->method != SPEC_METHOD_SIZED)
        reading_add_fault(r, &method, "sampling.%s requires the method \"sized\"",
                          r->s->has_feature     ? "feature"
                          : r->s->has_grid      ? "grid"
                          : r->s->has_curvature ? "curvature"
                                                : "curve_spacing");
    if (r->s->has_points && r->s->method != SPEC_METHOD_SIZED)
        reading_add_fault(r, &method,
                          "sampling.points requires the method \"sized\", which excludes sampling.alpha");
    if (r->s->has_points && r->s->init != SPEC_INIT_SURFACE)
        reading_add_fault(r, &init, "excludes sampling.points: remove one of the two");
    if (r->s->has_control && r->s->method == SPEC_METHOD_WITKIN_HECKBERT)
        reading_add_fault(
            r, &method,
            "sampling.control requires the method \"sized\" or \"paper\" (given \"witkin-heckbert\")");
}

static void check_camera(reading *r, const json_at *at)
{
    const spec_camera *c = &r->s->camera;
    json_at target = json_member(at, "target"), up = json_member(at, "up");
    vec3 sight = vec3_sub(c->target, c->position);
    if (!(vec3_norm2(sight) > 0))
        reading_add_fault(r, &target, "is equal to position: move one of them");
    else if (!(vec3_norm(vec3_cross(vec3_unit(sight), vec3_unit(c->up))) > UPRIGHT_LEAST))
        reading_add_fault(r, up.node ? &up : at,
                          "up is zero or parallel to the line of sight: give another direction");
}

static void check_preview(reading *r, const json_at *at)
{
    const spec *s = r->s;
    json_at range = json_member(at, "range");
    if (s->preview_range_count == 0 && !range.node) return;
    if (s->preview_range_count != 2 || !(s->preview_range[0] < s->preview_range[1]))
        reading_add_fault(r, &range, "must be two numbers, the lower one first");
}

static void check_output(reading *r, const json_at *at)
{
    json_at mesh = json_member(at, "mesh"), usda = json_member(at, "mesh_usda"),
            parts = json_member(at, "label_meshes");
    json_at usd = json_member(at, "usd"), instancer = json_member(&usd, "instancer");
    if (r->s->has_instancer && !r->s->has_points_usda)
        reading_add_fault(r, &instancer, "requires points_usda: true");
    if (r->s->has_mesh_usda && !r->s->has_mesh) reading_add_fault(r, &usda, "requires mesh: true");
    if (r->s->has_mesh && r->s->has_points && r->s->points.mode == SPEC_POINTS_AVOID)
        reading_add_fault(r, &mesh, "excludes sampling.points with mode \"avoid\": remove one of the two");
    if (r->s->has_label_meshes && !(r->s->has_mesh && r->s->surface.kind == SPEC_SURFACE_LABELS))
        reading_add_fault(r, &parts, "requires mesh: true, and surface.labels");
}

static void check_orient(reading *r, const json_at *at)
{
    if (r->s->orient.twist && r->s->orient.has_seed)
        reading_add_fault(r, at, "may have at most one of twist, seed (given both): remove one of them");
}

/* What a path between @ or @@@ cannot hold in a USD file of text. */
static void check_instancer(reading *r, const json_at *at)
{
    const char *path = r->s->instancer.prototype;
    json_at prototype = json_member(at, "prototype");
    bool has_control = false;
    for (const char *c = path; c && *c; c++) has_control |= (unsigned char)*c < ' ' || *c == 127;
    if (has_control || (path && strstr(path, "@@@")))
        reading_add_fault(r, &prototype, "must not contain control characters or \"@@@\": rename the file");
}

void rules_check_coherent(reading *r, const json_at *at)
{
    const spec *s = r->s;
    json_at coherent = json_member(at, "coherent");
    if (!s->coherent) return;
    if (!s->frames) reading_add_fault(r, &coherent, "requires queue.frames");
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
    if (s->time_s > 0)
        reading_add_fault(
            r, &coherent,
            "excludes sampling.time_s, because the count would differ from frame to frame: give "
            "a count or spacing");
}

static void check_frames(reading *r, const json_at *at)
{
    spec *s = r->s;
    json_at frames = json_member(at, "frames");
    error e = {0};
    bool any = false, all;
    if (!s->frames && s->after_frames_count) {
        json_at after = json_member(at, "after_frames");
        reading_add_fault(r, &after, "requires queue.frames; for a job without frames use depends_on");
    }
    if (s->chunk > 1 && (!s->frames || s->coherent)) {
        json_at chunk = json_member(at, "chunk");
        reading_add_fault(
            r, &chunk, "%s",
            s->frames ? "excludes queue.coherent, whose frames run one after another: remove one of the two"
                      : "requires queue.frames: remove chunk, or add frames");
    }
    if (!s->frames) return;
    all = strcmp(s->frames, FRAMES_ALL) == 0;
    if (!all && !(s->frame = frames_parse(s->frames, &s->frame_count, &e))) {
        reading_add_fault(r, &frames, "%s", e.message);
        return;
    }
    spec_input input;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) any |= frames_is_pattern(input.path);
    if (!any && all)
        reading_add_fault(
            r, &frames, "\"" FRAMES_ALL "\" requires the path of a file with %s in place of the frame number",
            FRAMES_NOTATIONS);
    else if (!any && !s->has_frame_values)
        reading_add_fault(r, &frames,
                          "all frames are equal: write %s in place of the frame number into a path "
                          "of the surface, or add by_frame",
                          FRAMES_NOTATIONS);
    if (s->directory && !frames_is_pattern(s->directory))
        reading_add_fault(
            r, &frames,
            "output.directory is the same for all frames, which would overwrite each other: add %s "
            "in place of the frame number",
            FRAMES_NOTATIONS);
}

static void check_transform(reading *r, const json_at *at)
{
    const double *m = r->surface->matrix;
    json_at matrix = json_member(at, "matrix");
    if (r->surface->matrix_count != 16) {
        reading_add_fault(r, &matrix, "must be 16 numbers (given %zu)", r->surface->matrix_count);
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

/* The name in the outputs, which are of many kinds. */
static void check_attribute(reading *r, const json_at *at)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789";
    static const char *const computed[] = {"part", "direction1", "direction2", SPEC_GEOMETRY_SOURCE};
    const spec_attribute *a = &r->s->attribute;
    json_at as = json_member(at, "as"), name = json_member(at, "name");
    if (a->as && (strspn(a->as, letters) != strlen(a->as) || (*a->as >= '0' && *a->as <= '9')))
        reading_add_fault(r, &as, "must be letters, digits and _, a letter first (given \"%s\")", a->as);
    if (!a->as && !a->name) reading_add_fault(r, &as, "is required if name is absent");
    if (strcmp(a->from, SPEC_FROM_GEOMETRY) != 0) return;
    for (size_t k = 0; k < sizeof computed / sizeof *computed; k++)
        if (a->name && strcmp(a->name, computed[k]) == 0) return;
    reading_add_fault(r, name.node ? &name : at, "must be part, direction1, direction2 or source");
}

unsigned rules_check_names(reading *r, const json_at *at, const char *group)
{
    check_names(r, at, group);
    return check_choices(r, at, group);
}

/* The surface and the method are read before the queue, which depends on them. */
static void check_queue(reading *r, const json_at *at)
{
    check_frames(r, at);
    frame_values_check(r, at);
    rules_check_coherent(r, at);
}

void rules_check_values(reading *r, const json_at *at, const char *group)
{
    static const struct {
        const char *group;
        void (*check)(reading *, const json_at *);
    } rules[] = {{"", check_whole},
                 {"/surface/analytic", check_analytic},
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
                 {"/solver", check_solver},
                 {"/output", check_output},
                 {"/output/orient", check_orient},
                 {"/output/usd/instancer", check_instancer},
                 {"/output/preview", check_preview},
                 {"/output/preview/camera", check_camera},
                 {"/queue", check_queue}};
    for (size_t k = 0; k < sizeof rules / sizeof rules[0]; k++)
        if (strcmp(group, rules[k].group) == 0) rules[k].check(r, at);
}

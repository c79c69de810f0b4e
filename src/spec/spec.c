#include "spec/spec.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "base/frames.h"
#include "base/memory.h"
#include "geometry/affine.h"
#include "spec/spec_table.h"
#include "spec/surface.h"

_Static_assert(sizeof(spec_shape) == sizeof(int), "words are stored as int");

enum { SHOWN_MAX = 64 }; /* bytes of a given text that a message repeats */

/* Sine of the angle between a camera's up and its line of sight, below which rounding would turn the picture. */
static const double UPRIGHT_LEAST = 1e-6;

typedef struct reading {
    spec *s;
    spec_surface *surface; /* the spec's, or the part of it that is being read */
    int depth;             /* surfaces within surfaces */
    size_t surfaces;       /* read so far */
    spec_faults faults;
    size_t total;           /* faults found, kept or not */
    char method[SHOWN_MAX]; /* the name of s->method, when it was asked for */
    bool shape_known;       /* s->analytic.shape holds what was given */
} reading;

static void read_group(reading *r, const json_at *at, const char *group, json *normal);

/* ---- faults ---- */

static void add_fault(reading *r, const json_at *at, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

static void add_fault(reading *r, const json_at *at, const char *format, ...)
{
    r->total++;
    if (r->faults.count == SPEC_MAX_FAULTS) return;
    spec_fault *fault = &r->faults.item[r->faults.count++];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(fault->detail, sizeof fault->detail, format, arguments);
    va_end(arguments);
    json_pointer(at, fault->pointer, sizeof fault->pointer);
    fault->code = ERROR_SPEC_INVALID;
}

/* Copies a text, at most SHOWN_MAX bytes of it and never a part of a character. */
static void shorten(const char *text, char out[SHOWN_MAX + 4])
{
    size_t n = strlen(text);
    if (n <= SHOWN_MAX) {
        memcpy(out, text, n + 1);
        return;
    }
    n = SHOWN_MAX;
    while (n > 0 && ((unsigned char)text[n] & 0xC0) == 0x80) n--;
    memcpy(out, text, n);
    memcpy(out + n, "...", 4);
}

/* "7", "\"abc\"", "an object", for the end of a message */
static void describe(json_at at, char out[SHOWN_MAX + 8])
{
    char *text;
    switch (json_type_of(at)) {
    case JSON_OBJECT:
        strcpy(out, "an object");
        return;
    case JSON_ARRAY:
        snprintf(out, SHOWN_MAX + 8, "an array of %zu", json_size(at));
        return;
    default:
        text = json_print(at.node);
        shorten(text, out);
        free(text);
    }
}

static void describe_range(const spec_row *row, char *out, size_t size)
{
    if (row->low == row->high)
        snprintf(out, size, "%.16g", row->low);
    else if (row->flags & SPEC_LOW_OPEN)
        snprintf(out, size, "above %.16g and at most %.16g", row->low, row->high);
    else
        snprintf(out, size, "from %.16g to %.16g", row->low, row->high);
}

static void wrong(reading *r, const json_at *at, const spec_row *row, const char *kind)
{
    char given[SHOWN_MAX + 8], range[96];
    describe(*at, given);
    describe_range(row, range, sizeof range);
    if (row->low == row->high)
        add_fault(r, at, "must be %s (given %s)", range, given);
    else
        add_fault(r, at, "must be %s %s (given %s)", kind, range, given);
}

/* ---- values ---- */

static void *target(reading *r, size_t offset)
{
    size_t first = offsetof(spec, surface);
    if (offset >= first && offset < first + sizeof(spec_surface))
        return (char *)r->surface + (offset - first);
    return (char *)r->s + offset;
}

static bool is_number(json_at at, const spec_row *row, bool whole)
{
    if (json_type_of(at) != JSON_NUMBER) return false;
    double value = json_number(at, 0);
    if (!isfinite(value) || value > row->high || value < row->low) return false;
    if (value == row->low && row->flags & SPEC_LOW_OPEN) return false;
    return !whole || value == floor(value);
}

static void read_number(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    bool whole = row->type != SPEC_TYPE_NUMBER;
    double value = json_number(*at, 0);
    if (!is_number(*at, row, whole)) {
        wrong(r, at, row, whole ? "an integer" : "a number");
        return;
    }
    if (value == 0) value = 0; /* -0 would print as such and be another text for the same job */
    if (row->type == SPEC_TYPE_LARGE)
        json_put_integer(normal, spec_row_key(row), (int64_t)value);
    else
        json_put_number(normal, spec_row_key(row), value);
    if (row->has != SPEC_NOWHERE) *(bool *)target(r, row->has) = true;
    if (row->offset == SPEC_NOWHERE) return;
    if (row->type == SPEC_TYPE_NUMBER) {
        memcpy(target(r, row->offset), &value, sizeof value);
    } else if (row->type == SPEC_TYPE_INTEGER) {
        int integer = (int)value;
        memcpy(target(r, row->offset), &integer, sizeof integer);
    } else {
        int64_t large = (int64_t)value;
        memcpy(target(r, row->offset), &large, sizeof large);
    }
}

/* Three numbers, or three integers. */
static void read_vector(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    bool whole = row->type == SPEC_TYPE_TRIPLE, good = true;
    if (json_type_of(*at) != JSON_ARRAY || json_size(*at) != 3) {
        wrong(r, at, row, whole ? "an array of three integers" : "an array of three numbers");
        return;
    }
    vec3 v = {0, 0, 0};
    for (int i = 0; i < 3; i++) {
        json_at element = json_element(at, (size_t)i);
        if (is_number(element, row, whole)) {
            double value = json_number(element, 0);
            vec3_set(&v, i, value == 0 ? 0 : value);
        } else {
            wrong(r, &element, row, whole ? "an integer" : "a number");
            good = false;
        }
    }
    if (!good) return;
    if (whole) {
        const int triple[3] = {(int)v.x, (int)v.y, (int)v.z};
        memcpy(target(r, row->offset), triple, sizeof triple);
    } else {
        memcpy(target(r, row->offset), &v, sizeof v);
    }
    json *list = json_put_array(normal, spec_row_key(row));
    for (int i = 0; i < 3; i++) json_append_number(list, vec3_get(v, i));
}

/* Any number of them; of the bad ones the first is named. */
static void read_numbers(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    if (json_type_of(*at) != JSON_ARRAY) {
        char given[SHOWN_MAX + 8];
        describe(*at, given);
        add_fault(r, at, "must be an array of numbers (given %s)", given);
        return;
    }
    size_t count = json_size(*at);
    double *numbers = mem_alloc((count + 1) * sizeof *numbers);
    *(double **)target(r, row->offset) = numbers; /* given to the spec at once, which frees them */
    size_t good = 0, read = json_numbers(*at, numbers, count);
    while (good < read && numbers[good] >= row->low && numbers[good] <= row->high) good++;
    if (good < count) {
        json_at element = json_element(at, good);
        wrong(r, &element, row, "a number");
        return;
    }
    *(size_t *)target(r, row->has) = count;
    json *list = json_put_array(normal, spec_row_key(row));
    for (size_t i = 0; i < count; i++) json_append_number(list, numbers[i] == 0 ? 0 : numbers[i]);
}

static void read_size(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    int size[2];
    bool pair = json_type_of(*at) == JSON_ARRAY && json_size(*at) == 2, good = true;
    if (!pair && !is_number(*at, row, true)) {
        wrong(r, at, row, "an integer, or an array [width, height] of integers,");
        return;
    }
    for (size_t i = 0; i < 2; i++) {
        json_at side = pair ? json_element(at, i) : *at;
        if (!is_number(side, row, true)) {
            wrong(r, &side, row, "an integer");
            good = false;
        } else {
            size[i] = (int)json_number(side, 0);
        }
    }
    if (!good) return;
    memcpy(target(r, row->offset), size, sizeof size);
    json *list = json_put_array(normal, spec_row_key(row));
    for (int i = 0; i < 2; i++) json_append_number(list, size[i]);
}

static void read_word(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    char word[SHOWN_MAX], allowed[256] = "", given[SHOWN_MAX + 8];
    const char *text = json_string(*at, "");
    for (int i = 0; spec_word(row->words, (size_t)i, word, sizeof word); i++) {
        if (strcmp(word, text) == 0) {
            if (row->offset != SPEC_NOWHERE) memcpy(target(r, row->offset), &i, sizeof i);
            if (row->offset == offsetof(spec, surface.analytic.shape)) r->shape_known = true;
            json_put_string(normal, spec_row_key(row), word);
            return;
        }
        size_t n = strlen(allowed);
        snprintf(allowed + n, sizeof allowed - n, "%s\"%s\"", i ? ", " : "", word);
    }
    describe(*at, given);
    add_fault(r, at, "must be %s%s (given %s)", strchr(allowed, ',') ? "one of " : "", allowed, given);
}

static void read_bool(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    if (json_type_of(*at) != JSON_BOOL) {
        char given[SHOWN_MAX + 8];
        describe(*at, given);
        add_fault(r, at, "must be true or false (given %s)", given);
        return;
    }
    bool value = json_bool(*at, false);
    memcpy(target(r, row->offset), &value, sizeof value);
    json_put_bool(normal, spec_row_key(row), value);
}

static size_t characters(const char *text)
{
    size_t n = 0;
    for (; *text; text++) n += ((unsigned char)*text & 0xC0) != 0x80;
    return n;
}

static void read_string(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    const char *text = json_string(*at, NULL);
    size_t length = text ? characters(text) : 0;
    if (!text) {
        char given[SHOWN_MAX + 8];
        describe(*at, given);
        add_fault(r, at, "must be a string (given %s)", given);
    } else if ((double)length < row->low || (double)length > row->high) {
        add_fault(r, at, "must be a string of %.16g to %.16g characters (given %zu)", row->low, row->high,
                  length);
    } else {
        *(char **)target(r, row->offset) = mem_strdup(text);
        json_put_string(normal, spec_row_key(row), text);
    }
}

static void read_labels(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    size_t count = json_size(*at);
    if (json_type_of(*at) != JSON_ARRAY || (double)count > row->high) {
        char given[SHOWN_MAX + 8];
        describe(*at, given);
        add_fault(r, at, "must be an array of at most %.16g strings (given %s)", row->high, given);
        return;
    }
    char **labels = mem_alloc(count * sizeof *labels);
    *(char ***)target(r, row->offset) = labels; /* given to the spec at once, which frees them */
    json *list = json_put_array(normal, spec_row_key(row));
    for (size_t i = 0; i < count; i++) {
        json_at element = json_element(at, i);
        const char *text = json_string(element, NULL);
        if (!text || !*text || characters(text) > SPEC_LABEL_LENGTH_MAX) {
            char given[SHOWN_MAX + 8];
            describe(element, given);
            add_fault(r, &element, "must be a string of 1 to %d characters (given %s)", SPEC_LABEL_LENGTH_MAX,
                      given);
            continue;
        }
        labels[(*(size_t *)target(r, row->has))++] = mem_strdup(text);
        json_append_string(list, text);
    }
}

/* One more part of the surface at hand. */
static void read_part(reading *r, const json_at *at, json *normal)
{
    enum { DEEPEST = 16, MOST_SURFACES = 256 };
    spec_surface *whole = r->surface, *part;
    if (r->depth == DEEPEST || r->surfaces == MOST_SURFACES) {
        add_fault(r, at, "there are more than %d surfaces, or %d within each other", MOST_SURFACES, DEEPEST);
        return;
    }
    part = mem_alloc(sizeof *part);
    whole->parts = mem_resize(whole->parts, (whole->part_count + 1) * sizeof *whole->parts);
    whole->parts[whole->part_count++] = part;
    r->surface = part;
    r->shape_known = false;
    r->depth++;
    r->surfaces++;
    read_group(r, at, "/surface", normal);
    r->depth--;
    r->surface = whole;
}

static void read_parts(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    static const struct {
        const char *key;
        spec_surface_kind kind;
    } kinds[] = {{"union", SPEC_SURFACE_UNION},
                 {"intersection", SPEC_SURFACE_INTERSECTION},
                 {"difference", SPEC_SURFACE_DIFFERENCE}};
    size_t count = json_size(*at);
    if (json_type_of(*at) != JSON_ARRAY || (double)count < row->low || (double)count > row->high) {
        char given[SHOWN_MAX + 8];
        describe(*at, given);
        add_fault(r, at, "must be an array of %.0f to %.0f surfaces (given %s)", row->low, row->high, given);
        return;
    }
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++)
        if (strcmp(spec_row_key(row), kinds[k].key) == 0) r->surface->kind = kinds[k].kind;
    json *list = json_put_array(normal, spec_row_key(row));
    for (size_t k = 0; k < count; k++) {
        json_at element = json_element(at, k);
        read_part(r, &element, json_append_object(list));
    }
}

static void read_value(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    switch (row->type) {
    case SPEC_TYPE_NUMBER:
    case SPEC_TYPE_INTEGER:
    case SPEC_TYPE_LARGE:
        read_number(r, at, row, normal);
        break;
    case SPEC_TYPE_BOOL:
        read_bool(r, at, row, normal);
        break;
    case SPEC_TYPE_WORD:
        read_word(r, at, row, normal);
        break;
    case SPEC_TYPE_STRING:
        read_string(r, at, row, normal);
        break;
    case SPEC_TYPE_VECTOR:
    case SPEC_TYPE_TRIPLE:
        read_vector(r, at, row, normal);
        break;
    case SPEC_TYPE_NUMBERS:
        read_numbers(r, at, row, normal);
        break;
    case SPEC_TYPE_SIZE:
        read_size(r, at, row, normal);
        break;
    case SPEC_TYPE_LABELS:
        read_labels(r, at, row, normal);
        break;
    case SPEC_TYPE_SURFACE:
        read_part(r, at, json_put_object(normal, spec_row_key(row)));
        break;
    case SPEC_TYPE_SURFACES:
        read_parts(r, at, row, normal);
        break;
    case SPEC_TYPE_GROUP:
        break; /* not values: see read_row and check_members */
    }
}

/* ---- members ---- */

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

/* Levenshtein's distance; texts longer than SHOWN_MAX count as far. */
static size_t edit_distance(const char *a, const char *b)
{
    size_t row[SHOWN_MAX + 1], na = strlen(a), nb = strlen(b);
    if (na > SHOWN_MAX || nb > SHOWN_MAX) return SHOWN_MAX;
    for (size_t j = 0; j <= nb; j++) row[j] = j;
    for (size_t i = 1; i <= na; i++) {
        size_t diagonal = row[0];
        row[0] = i;
        for (size_t j = 1; j <= nb; j++) {
            size_t replaced = diagonal + (a[i - 1] != b[j - 1]);
            diagonal = row[j];
            row[j] = least(replaced, 1 + least(row[j], row[j - 1]));
        }
    }
    return row[nb];
}

/* A member of the group with nearly that name, else a member of that name elsewhere, else NULL.
 * Nearly: a third of the letters may differ, and two of a short name. */
static const char *suggestion(const char *group, const char *key)
{
    const char *best = NULL, *elsewhere = NULL;
    size_t best_distance = 1 + (strlen(key) / 3 > 2 ? strlen(key) / 3 : strlen(key) > 3 ? 2 : 1);
    for (size_t i = 0; i < spec_row_count; i++) {
        const char *name = spec_row_key(&spec_rows[i]);
        size_t distance = edit_distance(key, name);
        if (spec_row_is_member(&spec_rows[i], group) && distance < best_distance) {
            best = name;
            best_distance = distance;
        }
        if (distance == 0 && !elsewhere) elsewhere = spec_rows[i].pointer;
    }
    return best ? best : elsewhere;
}

static void unknown_member(reading *r, const json_at *at, const char *group)
{
    char key[SHOWN_MAX + 4];
    const char *instead = suggestion(group, at->key);
    shorten(at->key, key);
    if (instead)
        add_fault(r, at, "unknown member '%s': did you mean '%s'?", key, instead);
    else
        add_fault(r, at, "unknown member '%s'", key);
}

/* Members that are unknown or not supported. An object's names differ, so after as many unknown
 * ones as there are places for faults the rest need not be looked at. */
static void check_members(reading *r, const json_at *at, const char *group)
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

static void check_choice(reading *r, const json_at *at, const char *group, spec_choice choice)
{
    char all[192] = "", given[192] = "";
    size_t rows = 0, count = 0;
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        if (row->choice != choice || !spec_row_is_member(row, group)) continue;
        rows++;
        append(all, sizeof all, spec_row_key(row));
        if (!json_member(at, spec_row_key(row)).node) continue;
        append(given, sizeof given, spec_row_key(row));
        count++;
    }
    bool may_be_none = choice >= SPEC_CHOICE_GRADING;
    if (rows == 0 || count == 1 || (count == 0 && may_be_none)) return;
    add_fault(r, at, "needs %s one of %s (given %s)", may_be_none ? "at most" : "exactly", all,
              count ? given : "none");
}

static const char *default_of(const reading *r, const spec_row *row)
{
    if (row->offset == offsetof(spec, method) && r->s->has_alpha) return "\"paper\"";
    if (row->offset == offsetof(spec, step) && r->s->minimiser != SPEC_MINIMISER_GRADIENT) return NULL;
    if (row->offset == offsetof(spec, curvature.exponent) && !(r->s->curvature.ratio > 0)) return NULL;
    if (row->offset == offsetof(spec, gradation) && !r->s->has_curvature && !r->s->has_grid) return NULL;
    if (row->offset == offsetof(spec, surface.mesh.resolution) && r->surface->mesh.voxel_size > 0)
        return NULL;
    if (row->offset == offsetof(spec, preview_color)) return r->s->has_alpha ? "\"alpha\"" : "\"curvature\"";
    return row->otherwise;
}

static void read_default(reading *r, const json_at *group, const spec_row *row, json *normal)
{
    const char *otherwise = default_of(r, row);
    if (!otherwise) return;
    json *root = json_parse(otherwise, strlen(otherwise), NULL);
    json_at at = {root, group, spec_row_key(row), 0};
    read_value(r, &at, row, normal);
    json_free(root);
}

static void read_member_group(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    bool on = at->node || !(row->flags & SPEC_OPTIONAL);
    json_at place = *at;
    if (row->flags & SPEC_SWITCH && json_type_of(*at) == JSON_BOOL) {
        on = json_bool(*at, true);
        place.node = NULL; /* true: an object without members */
        if (!on) json_put_bool(normal, spec_row_key(row), false);
    }
    if (row->has != SPEC_NOWHERE) *(bool *)target(r, row->has) = on;
    if (!on) return;
    if (!place.node && row->flags & SPEC_REQUIRED) {
        add_fault(r, at, "is required");
        return;
    }
    read_group(r, &place, row->pointer, json_put_object(normal, spec_row_key(row)));
}

static const char *method_name(reading *r)
{
    spec_word(spec_row_find("/solver", "method")->words, r->s->method, r->method, sizeof r->method);
    return r->method;
}

static void read_row(reading *r, const json_at *group, const spec_row *row, json *normal)
{
    json_at at = json_member(group, spec_row_key(row));
    if (row->methods && !(row->methods & 1u << r->s->method)) {
        if (at.node) add_fault(r, &at, "is no member of the method \"%s\"", method_name(r));
        return;
    }
    if (row->type == SPEC_TYPE_GROUP) {
        read_member_group(r, &at, row, normal);
        return;
    }
    if (row->shapes) {
        if (!r->shape_known) return; /* what belongs here is not known; the shape's fault says so */
        if (!(row->shapes & 1u << r->surface->analytic.shape)) {
            char shape[SHOWN_MAX] = "";
            spec_word(spec_row_find("/surface/analytic", "shape")->words, r->surface->analytic.shape, shape,
                      sizeof shape);
            if (at.node) add_fault(r, &at, "is no member of the shape \"%s\"", shape);
            return;
        }
    }
    if (at.node)
        read_value(r, &at, row, normal);
    else if (row->flags & SPEC_REQUIRED)
        add_fault(r, &at, "is required");
    else
        read_default(r, group, row, normal);
}

/* What no single row can say; only of values that are good by themselves. */
static void check_analytic(reading *r, const json_at *at)
{
    const spec_analytic *a = &r->surface->analytic;
    json_at minor = json_member(at, "minor_radius"), axis = json_member(at, "axis"),
            rounding = json_member(at, "rounding");
    double smallest = fmin(a->half_size.x, fmin(a->half_size.y, a->half_size.z));
    if (a->shape == SPEC_SHAPE_TORUS && a->minor_radius >= a->major_radius)
        add_fault(r, &minor, "must be less than major_radius, %.16g (given %.16g)", a->major_radius,
                  a->minor_radius);
    if (a->shape == SPEC_SHAPE_TORUS && !(vec3_norm2(a->axis) > 0))
        add_fault(r, &axis, "must not be the zero vector");
    if (a->shape == SPEC_SHAPE_BOX && a->rounding > smallest)
        add_fault(r, &rounding, "must be at most the smallest half size, %.16g (given %.16g)", smallest,
                  a->rounding);
}

static void check_sampling(reading *r, const json_at *at)
{
    static const char *const limits[] = {"min_spacing", "max_spacing", "gradation"};
    const spec *s = r->s;
    for (size_t k = 0; k < sizeof limits / sizeof limits[0] && !s->has_curvature && !s->has_grid; k++) {
        json_at limit = json_member(at, limits[k]);
        if (limit.node) add_fault(r, &limit, "belongs to a grading: give curvature or grid, or leave it out");
    }
    json_at most = json_member(at, "max_spacing"), curvature = json_member(at, "curvature"),
            exponent = json_member(&curvature, "exponent"), grid = json_member(at, "grid");
    json_at time = json_member(at, "time_s");
    if (time.node && (s->min_spacing > 0 || s->max_spacing > 0))
        add_fault(r, &time, "needs to choose the count: leave out min_spacing and max_spacing");
    if (s->max_spacing > 0 && s->max_spacing < s->min_spacing)
        add_fault(r, &most, "must be at least min_spacing, %.16g (given %.16g)", s->min_spacing,
                  s->max_spacing);
    if (exponent.node && !(s->curvature.ratio > 0)) add_fault(r, &exponent, "belongs to ratio");
    if (s->has_grid && s->surface.kind != SPEC_SURFACE_VDB)
        add_fault(r, &grid, "is a grid of the surface's VDB file: this surface has none");
}

static void check_control(reading *r, const json_at *at)
{
    const spec_control *c = &r->s->control;
    json_at start = json_member(at, "start_count");
    if (c->start_count > 0 && c->start_count < c->min_count)
        add_fault(r, &start, "must be at least min_count, %lld (given %lld)", (long long)c->min_count,
                  (long long)c->start_count);
}

static void check_box(reading *r, const json_at *at, const spec_box *box)
{
    json_at max = json_member(at, "max");
    for (int axis = 0; axis < 3; axis++) {
        double low = vec3_get(box->min, axis), high = vec3_get(box->max, axis);
        if (low < high) continue;
        json_at side = json_element(&max, (size_t)axis); /* max itself where it is the default */
        add_fault(r, side.node ? &side : at,
                  "the box begins at %.16g and ends at %.16g: max must be above min", low, high);
    }
}

static void check_bspline(reading *r, const json_at *at)
{
    const spec_bspline *b = &r->surface->bspline;
    json_at coefficients = json_member(at, "coefficients");
    double count = (double)b->dims[0] * b->dims[1] * b->dims[2];
    if (b->coefficients && (double)b->coefficient_count != count)
        add_fault(r, &coefficients, "must be as many as dims says, %d x %d x %d = %.0f (given %zu)",
                  b->dims[0], b->dims[1], b->dims[2], count, b->coefficient_count);
}

static void check_solver(reading *r, const json_at *at)
{
    json_at method = json_member(at, "method"), step = json_member(at, "step");
    if (step.node && r->s->minimiser != SPEC_MINIMISER_GRADIENT)
        add_fault(r, &step, "belongs to the minimiser \"gradient\"");
    if (r->s->has_alpha && r->s->method == SPEC_METHOD_SIZED)
        add_fault(
            r, &method,
            "sampling.alpha belongs to the methods \"paper\" and \"witkin-heckbert\" (given \"sized\")");
    if ((r->s->has_curvature || r->s->has_grid) && r->s->method != SPEC_METHOD_SIZED)
        add_fault(r, &method, "sampling.%s belongs to the method \"sized\"",
                  r->s->has_grid ? "grid" : "curvature");
    if (r->s->has_control && r->s->method == SPEC_METHOD_WITKIN_HECKBERT)
        add_fault(
            r, &method,
            "sampling.control belongs to the methods \"sized\" and \"paper\" (given \"witkin-heckbert\")");
}

static void check_camera(reading *r, const json_at *at)
{
    const spec_camera *c = &r->s->camera;
    json_at target = json_member(at, "target"), up = json_member(at, "up");
    vec3 sight = vec3_sub(c->target, c->position);
    if (!(vec3_norm2(sight) > 0))
        add_fault(r, &target, "must be another place than position");
    else if (!(vec3_norm(vec3_cross(vec3_unit(sight), vec3_unit(c->up))) > UPRIGHT_LEAST))
        add_fault(r, up.node ? &up : at,
                  "up must not be zero, nor point along the line from position to target");
}

static void check_coherent(reading *r, const json_at *at)
{
    const spec *s = r->s;
    json_at coherent = json_member(at, "coherent");
    if (!s->coherent) return;
    if (!s->frames) add_fault(r, &coherent, "goes with queue.frames, which the job does not have");
    if (s->method != SPEC_METHOD_SIZED)
        add_fault(r, &coherent,
                  "goes with the method \"sized\" only (which alpha does not): grade by sampling.curvature "
                  "or grid");
    if (s->time_s > 0)
        add_fault(r, &coherent,
                  "does not go with sampling.time_s, as frames would differ in their counts: give a count or "
                  "spacing");
}

static void check_frames(reading *r, const json_at *at)
{
    spec *s = r->s;
    json_at frames = json_member(at, "frames");
    error e = {0};
    bool any = false;
    if (!s->frames) return;
    if (!(s->frame = frames_parse(s->frames, &s->frame_count, &e))) {
        add_fault(r, &frames, "%s", e.message);
        return;
    }
    spec_input input;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) any |= frames_is_pattern(input.path);
    if (!any)
        add_fault(r, &frames,
                  "no path of the surface has a place for the frame's number: write it as #### or %%04d");
    if (s->directory && !frames_is_pattern(s->directory))
        add_fault(
            r, &frames,
            "output.directory has no place for the frame's number, so that frames would replace each other:"
            " write it as #### or %%04d");
}

static void check_exr(reading *r, const json_at *at)
{
    spec_exr *x = &r->surface->exr;
    json_at slices = json_member(at, "slices"), path = json_member(at, "path");
    if (!surface_parse_slices(x))
        add_fault(r, &slices,
                  "must be the first and the last slice, 2 to %d of them, as in \"1-93\" or \"1-93x2\" "
                  "(given \"%s\")",
                  SURFACE_MOST_SLICES, x->slices);
    else if (!surface_name_slices(x))
        add_fault(r, &path, "must have one #### or %%04d, the number of the slice");
}

static void check_transform(reading *r, const json_at *at)
{
    const double *m = r->surface->matrix;
    json_at matrix = json_member(at, "matrix");
    if (r->surface->matrix_count != 16) {
        add_fault(r, &matrix, "must be 16 numbers (given %zu)", r->surface->matrix_count);
        return;
    }
    if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
        add_fault(r, &matrix, "must end in 0, 0, 0, 1: it is row by row, for column vectors");
    double to[3][4], back[3][4];
    for (int k = 0; k < 12; k++) to[k / 4][k % 4] = m[k];
    if (!isfinite(1 / affine_invert(to, back))) add_fault(r, &matrix, "cannot be inverted");
}

/* What a member of /surface is, and what no single row can say of it. */
static void finish_surface(reading *r, const json_at *at, const char *group, bool good)
{
    static const struct {
        const char *group;
        spec_surface_kind kind;
        void (*check)(reading *, const json_at *);
    } kinds[] = {{"/surface/vdb", SPEC_SURFACE_VDB, NULL},
                 {"/surface/mesh", SPEC_SURFACE_MESH, NULL},
                 {"/surface/analytic", SPEC_SURFACE_ANALYTIC, check_analytic},
                 {"/surface/bspline", SPEC_SURFACE_BSPLINE, check_bspline},
                 {"/surface/volume", SPEC_SURFACE_VOLUME, NULL},
                 {"/surface/exr", SPEC_SURFACE_EXR, check_exr},
                 {"/surface/offset", SPEC_SURFACE_OFFSET, NULL},
                 {"/surface/transform", SPEC_SURFACE_TRANSFORM, check_transform}};
    json_at path = json_member(at, "path");
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
        if (strcmp(group, kinds[k].group) != 0) continue;
        r->surface->kind = kinds[k].kind;
        if (good && kinds[k].check) kinds[k].check(r, at);
        if (!path.node || r->surface->input_pointer) return;
        r->surface->input_pointer = mem_alloc(sizeof((spec_fault *)0)->pointer);
        json_pointer(&path, r->surface->input_pointer, sizeof((spec_fault *)0)->pointer);
    }
}

/* Reads the members of a group; a place without a node stands for an object without members. */
static void read_group(reading *r, const json_at *at, const char *group, json *normal)
{
    size_t before = r->total;
    if (at->node && json_type_of(*at) != JSON_OBJECT) {
        char given[SHOWN_MAX + 8];
        describe(*at, given);
        add_fault(r, at, "must be an object (given %s)", given);
        return;
    }
    check_members(r, at, group);
    for (spec_choice c = SPEC_CHOICE_SURFACE; c < SPEC_CHOICE_COUNT; c++) check_choice(r, at, group, c);
    for (size_t i = 0; i < spec_row_count; i++)
        if (spec_row_is_member(&spec_rows[i], group)) read_row(r, at, &spec_rows[i], normal);
    finish_surface(r, at, group, r->total == before);
    if (strcmp(group, "/sampling") == 0 && r->total == before) check_sampling(r, at);
    if (strcmp(group, "/sampling/control") == 0 && r->total == before) check_control(r, at);
    if (strcmp(group, "/surface/bspline/domain") == 0 && r->total == before)
        check_box(r, at, &r->surface->bspline.domain);
    if (strcmp(group, "/region") == 0 && r->total == before) check_box(r, at, &r->s->region);
    if (strcmp(group, "/solver") == 0 && r->total == before) check_solver(r, at);
    if (strcmp(group, "/output/preview/camera") == 0 && r->total == before) check_camera(r, at);
    if (strcmp(group, "/queue") == 0 && r->total == before) { /* the surface and the method stand before it */
        check_frames(r, at);
        check_coherent(r, at);
    }
}

/* ---- the whole ---- */

static void sum_up(const reading *r, error *e)
{
    const spec_fault *fault = &r->faults.item[0];
    const char *where = *fault->pointer ? fault->pointer : "the spec";
    if (r->total > 1)
        error_set(e, fault->code, "%s: %s (and %zu more)", where, fault->detail, r->total - 1);
    else
        error_set(e, fault->code, "%s: %s", where, fault->detail);
}

spec *spec_parse(const json *document, spec_faults *faults, error *e)
{
    reading r = {.s = mem_alloc(sizeof(spec))};
    r.surface = &r.s->surface;
    json_at root = json_root(document);
    r.s->normalised = json_new_object();
    if (document)
        read_group(&r, &root, "", r.s->normalised);
    else
        add_fault(&r, &root, "must be an object (given nothing)");
    if (faults) *faults = r.faults;
    if (r.total == 0) return r.s;
    sum_up(&r, e);
    spec_free(r.s);
    return NULL;
}

bool spec_input_at(const spec *s, size_t index, spec_input *out)
{
    return surface_input_at(&s->surface, &index, out);
}

void spec_set_frame(spec *s, int frame)
{
    surface_set_frame(&s->surface, frame);
}

void spec_free(spec *s)
{
    if (!s) return;
    free(s->name);
    surface_free_parts(&s->surface);
    free(s->grid.name);
    for (size_t i = 0; i < s->label_count; i++) free(s->labels[i]);
    free(s->labels);
    for (size_t i = 0; i < s->depends_on_count; i++) free(s->depends_on[i]);
    free(s->depends_on);
    free(s->frames);
    free(s->frame);
    free(s->directory);
    free(s->webhook);
    json_free(s->normalised);
    free(s);
}

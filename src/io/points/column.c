// SPDX-License-Identifier: Apache-2.0
#include "io/points/column.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/core/memory.h"
#include "io/points/property.h"

/* The columns of the points' own properties, in the order of output. */
typedef struct own_column {
    const char *name;
    property_own of;
    int component;
    enum { BY_NAME, IN_ALL, GRADED, BY_DEFAULT } use; /* GRADED: by default if the requested spacing varies */
} own_column;

static const own_column own[] = {
    {"x", PROPERTY_OWN_POSITION, 0, BY_DEFAULT},
    {"y", PROPERTY_OWN_POSITION, 1, BY_DEFAULT},
    {"z", PROPERTY_OWN_POSITION, 2, BY_DEFAULT},
    {"nx", PROPERTY_OWN_NORMAL, 0, BY_DEFAULT},
    {"ny", PROPERTY_OWN_NORMAL, 1, BY_DEFAULT},
    {"nz", PROPERTY_OWN_NORMAL, 2, BY_DEFAULT},
    {"kappa", PROPERTY_OWN_KAPPA, 0, IN_ALL},
    {"kappa1", PROPERTY_OWN_KAPPA1, 0, IN_ALL},
    {"kappa2", PROPERTY_OWN_KAPPA2, 0, IN_ALL},
    {"alpha", PROPERTY_OWN_ALPHA, 0, IN_ALL},
    {"energy", PROPERTY_OWN_ENERGY, 0, IN_ALL},
    {"spacing", PROPERTY_OWN_SPACING, 0, GRADED},
    {"spacing_local", PROPERTY_OWN_SPACING_LOCAL, 0, BY_DEFAULT},
    {"kappa_scale", PROPERTY_OWN_KAPPA_SCALE, 0, IN_ALL},
    {"red", PROPERTY_OWN_COLOR, 0, BY_DEFAULT},
    {"green", PROPERTY_OWN_COLOR, 1, BY_DEFAULT},
    {"blue", PROPERTY_OWN_COLOR, 2, BY_DEFAULT},
    {"s", PROPERTY_OWN_UV, 0, BY_DEFAULT},
    {"t", PROPERTY_OWN_UV, 1, BY_DEFAULT},
    {"radius", PROPERTY_OWN_RADIUS, 0, BY_NAME},
    {"pscale", PROPERTY_OWN_RADIUS, 0, BY_NAME},
    {"quality", PROPERTY_OWN_KAPPA, 0, BY_NAME},
    {"orient_x", PROPERTY_OWN_ORIENT, 0, BY_DEFAULT},
    {"orient_y", PROPERTY_OWN_ORIENT, 1, BY_DEFAULT},
    {"orient_z", PROPERTY_OWN_ORIENT, 2, BY_DEFAULT},
    {"orient_w", PROPERTY_OWN_ORIENT, 3, BY_DEFAULT},
    {"id", PROPERTY_OWN_ID, 0, BY_DEFAULT},
    {"velocity_x", PROPERTY_OWN_VELOCITY, 0, BY_DEFAULT},
    {"velocity_y", PROPERTY_OWN_VELOCITY, 1, BY_DEFAULT},
    {"velocity_z", PROPERTY_OWN_VELOCITY, 2, BY_DEFAULT},
};
enum { OWN = sizeof own / sizeof *own, AXES = 3, IN_SEQUENCES = OWN - 4 };

/* Names that stand for several columns. "attributes": all attributes. Columns that a set lacks are
 * skipped. */
static const struct application {
    const char *name;
    const char *columns[16]; /* terminated by NULL */
} applications[] = {
    {"minimal", {"x", "y", "z", "nx", "ny", "nz"}},
    {"blender", {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "radius", "s", "t", "attributes"}},
    {"houdini", {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "pscale", "id", "attributes"}},
    {"meshlab", {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "radius", "quality", "attributes"}},
};
enum { APPLICATIONS = sizeof applications / sizeof *applications };

static column_type type_of(const own_column *o)
{
    return o->of == PROPERTY_OWN_ID ? COLUMN_UINT : o->of == PROPERTY_OWN_COLOR ? COLUMN_UCHAR : COLUMN_REAL;
}

/* Sets a column of the points' own properties. False: the set does not have it. */
static bool fill_own(const points *s, const own_column *o, column *out)
{
    const property_array *of = &property_arrays[o->of];
    const void *array = property_array_of(s, o->of);
    *out = (column){.type = type_of(o), .stride = (size_t)of->components, .scale = of->scale};
    snprintf(out->name, sizeof out->name, "%s", o->name);
    if (out->type == COLUMN_UCHAR) out->scale *= UINT8_MAX;
    if (out->type == COLUMN_UINT)
        out->whole = array;
    else if (array)
        out->values = (const double *)array + o->component;
    return array || out->type == COLUMN_UINT; /* without ids, ids are the indices of the points */
}

/* Whether the column is among all columns, or among those of the default. */
static bool is_written(const points *s, const own_column *o, bool all)
{
    bool has_color = false;
    for (size_t k = 0; k < s->attribute_count; k++)
        has_color |= s->attributes[k].kind == POINT_ATTRIBUTE_COLOR;
    if (o->of == PROPERTY_OWN_ID) return s->id != NULL;
    if (o->of == PROPERTY_OWN_COLOR) return has_color;
    return o->use == BY_DEFAULT || (o->use == GRADED && s->is_graded) || (all && o->use != BY_NAME);
}

column_type column_type_of_range(double least, double most)
{
    if (least >= INT32_MIN && most <= INT32_MAX) return COLUMN_INT;
    return least >= 0 && most <= UINT32_MAX ? COLUMN_UINT : COLUMN_DOUBLE;
}

/* COLUMN_INT if there are no values yet. */
static column_type whole_type(const point_attribute *a, int component, size_t count)
{
    double least = 0, most = 0;
    for (size_t i = 0; a->values && i < count; i++) {
        const double value = a->values[(size_t)a->components * i + (size_t)component];
        least = fmin(least, value);
        most = fmax(most, value);
    }
    return column_type_of_range(least, most);
}

static void attribute_column(const point_attribute *a, int component, size_t count, column *out)
{
    const char *suffixes = a->kind == POINT_ATTRIBUTE_COLOR ? "rgba"
                           : a->kind == POINT_ATTRIBUTE_UV  ? "st"
                                                            : "xyzw";
    *out = (column){.type = a->kind == POINT_ATTRIBUTE_INT ? whole_type(a, component, count)
                            : a->is_double                 ? COLUMN_LONG_REAL
                                                           : COLUMN_REAL,
                    .values = a->values + component,
                    .stride = (size_t)a->components,
                    .scale = 1};
    if (a->components == 1)
        snprintf(out->name, sizeof out->name, "%s", a->name);
    else
        snprintf(out->name, sizeof out->name, "%.70s_%c", a->name, suffixes[component]);
}

/* Adds a column unless the list has it. */
static bool add(columns *list, const column *c, error *e)
{
    for (size_t k = 0; k < list->count; k++)
        if (strcmp(list->list[k].name, c->name) == 0) return true;
    if (list->count == COLUMNS_MAX)
        return error_set(e, ERROR_SPEC_INVALID,
                         "the points have more than %d columns of properties: request fewer attributes",
                         COLUMNS_MAX);
    list->list[list->count++] = *c;
    return true;
}

/* Adds the columns of the attributes with this name; NULL: of all but one with the values `without`, if that is
 * not NULL. Returns their number, or -1: too many. */
static int add_attributes(const points *s, const char *name, const double *without, columns *list, error *e)
{
    int found = 0;
    for (size_t k = 0; k < s->attribute_count; k++)
        for (int c = 0; c < s->attributes[k].components; c++) {
            if (without && s->attributes[k].values == without) continue;
            column made;
            attribute_column(&s->attributes[k], c, s->count, &made);
            if (name && strcmp(name, s->attributes[k].name) != 0 && strcmp(name, made.name) != 0) continue;
            if (!add(list, &made, e)) return -1;
            found++;
        }
    return found;
}

/* Adds all columns, or those of the default. */
static bool add_set(const points *s, bool all, columns *list, error *e)
{
    column made;
    for (int k = 0; k < IN_SEQUENCES; k++)
        if (is_written(s, &own[k], all) && fill_own(s, &own[k], &made) && !add(list, &made, e)) return false;
    if (add_attributes(s, NULL, all ? NULL : s->kappa_defined, list, e) < 0) return false;
    for (int k = IN_SEQUENCES; k < OWN; k++)
        if (is_written(s, &own[k], all) && fill_own(s, &own[k], &made) && !add(list, &made, e)) return false;
    return true;
}

/* Adds the columns of a name. Returns their number, 0: the name is unknown, -1: too many. */
static int add_named(const points *s, const char *name, columns *list, error *e)
{
    column made;
    if (strcmp(name, "attributes") == 0) return add_attributes(s, NULL, NULL, list, e) < 0 ? -1 : 1;
    if (strcmp(name, "all") == 0) return add_set(s, true, list, e) ? 1 : -1;
    if (strcmp(name, "default") == 0) return add_set(s, false, list, e) ? 1 : -1;
    for (int k = 0; k < OWN; k++)
        if (strcmp(name, own[k].name) == 0 && fill_own(s, &own[k], &made))
            return add(list, &made, e) ? 1 : -1;
    return add_attributes(s, name, NULL, list, e);
}

static bool missing(const points *s, const char *name, error *e)
{
    char list[600] = "";
    column made;
    for (int k = 0; k < OWN; k++)
        if (fill_own(s, &own[k], &made))
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", *list ? ", " : "", made.name);
    for (size_t k = 0; k < s->attribute_count; k++)
        snprintf(list + strlen(list), sizeof list - strlen(list), ", %s", s->attributes[k].name);
    return error_set(e, ERROR_ATTRIBUTE_MISSING, "the points have no property \"%.80s\": choose from %s",
                     name, list);
}

static bool add_application(const points *s, const struct application *a, columns *list, error *e)
{
    for (const char *const *name = a->columns; *name; name++)
        if (add_named(s, *name, list, e) < 0) return false;
    return true;
}

static const struct application *find_application(const char *name)
{
    for (size_t k = 0; k < APPLICATIONS; k++)
        if (strcmp(applications[k].name, name) == 0) return &applications[k];
    return NULL;
}

bool columns_choose(const points *set, const char *const *names, size_t name_count, columns *out, error *e)
{
    static const char *const next_frame[] = {"nx", "ny", "nz", "id"};
    column made;
    out->count = 0;
    for (int k = 0; k < AXES; k++)
        if (fill_own(set, &own[k], &made)) add(out, &made, NULL);
    if (!names) return add_set(set, false, out, e);
    for (size_t k = 0; k < name_count; k++) {
        const struct application *a = find_application(names[k]);
        int found = a ? add_application(set, a, out, e) ? 1 : -1 : add_named(set, names[k], out, e);
        if (found == 0) return missing(set, names[k], e);
        if (found < 0) return false;
    }
    for (size_t k = 0; set->id && k < sizeof next_frame / sizeof *next_frame; k++)
        if (add_named(set, next_frame[k], out, e) < 0) return false;
    return true;
}

/* Whether `is` holds for one of the names, or of the columns of an application. */
static bool any_name(const char *const *names, size_t name_count, bool (*is)(const char *name))
{
    for (size_t k = 0; k < name_count; k++) {
        const struct application *a = find_application(names[k]);
        for (const char *const *name = a ? a->columns : NULL; name && *name; name++)
            if (is(*name)) return true;
        if (is(names[k])) return true;
    }
    return false;
}

static bool is_color(const char *name)
{
    for (int k = 0; k < OWN; k++)
        if (own[k].of == PROPERTY_OWN_COLOR && strcmp(name, own[k].name) == 0) return true;
    return false;
}

bool columns_need_color(const char *const *names, size_t name_count)
{
    return any_name(names, name_count, is_color);
}

static bool is_all(const char *name)
{
    return strcmp(name, "all") == 0;
}

static bool shows_curvature(const char *name)
{
    bool is = is_color(name) || is_all(name) || strcmp(name, POINTS_KAPPA_DEFINED) == 0 ||
              strcmp(name, "attributes") == 0;
    for (int k = 0; k < OWN; k++)
        is |= own[k].of >= PROPERTY_OWN_KAPPA && own[k].of <= PROPERTY_OWN_KAPPA2 &&
              strcmp(name, own[k].name) == 0;
    return is;
}

bool columns_have_curvature(const char *const *names, size_t name_count)
{
    return any_name(names, name_count, shows_curvature);
}

bool columns_have_all(const char *const *names, size_t name_count)
{
    return any_name(names, name_count, is_all);
}

bool columns_have_property(const columns *list, const property *p)
{
    for (size_t k = 0; k < list->count; k++) {
        const column *c = &list->list[k];
        if (p->values && c->values >= p->values && c->values < p->values + p->components &&
            c->scale == p->scale * (c->type == COLUMN_UCHAR ? UINT8_MAX : 1))
            return true;
        if (!p->values && !c->values) return true; /* ids */
    }
    return false;
}

bool columns_is_own(const char *name)
{
    /* names of VDB points, and the words for several columns */
    static const char *const others[] = {"P", "N", "attributes", "all", "default"};
    for (property_own k = PROPERTY_OWN_POSITION; k <= PROPERTY_OWN_UV; k++)
        if (strcmp(name, property_arrays[k].name) == 0) return true;
    for (int k = 0; k < OWN; k++)
        if (strcmp(name, own[k].name) == 0 && own[k].of != PROPERTY_OWN_ORIENT) return true;
    for (size_t k = 0; k < sizeof others / sizeof *others; k++)
        if (strcmp(name, others[k]) == 0) return true;
    return find_application(name) != NULL;
}

bool columns_is_of_orient(const char *name)
{
    for (int k = 0; k < OWN; k++)
        if (own[k].of == PROPERTY_OWN_ORIENT && strcmp(name, own[k].name) == 0) return true;
    return strcmp(name, property_arrays[PROPERTY_OWN_ORIENT].name) == 0;
}

bool columns_suits(const char *name, column_type type)
{
    for (int k = 0; k < OWN; k++)
        if (strcmp(name, own[k].name) == 0) return type_of(&own[k]) == type;
    return true;
}

double column_value(const column *c, size_t i)
{
    if (!c->values) return c->whole ? (double)c->whole[i] : (double)i;
    double value = c->scale * c->values[c->stride * i];
    return c->type == COLUMN_REAL || c->type == COLUMN_LONG_REAL ? value
           : c->type == COLUMN_UCHAR                             ? round(fmin(fmax(value, 0), 255))
                                                                 : round(value);
}

/* The column of the first component of a property. NULL: not all components are in the list. */
static const own_column *first_column(const columns *list, property_own of)
{
    const own_column *first = NULL;
    int found = 0;
    for (int k = 0; k < OWN; k++) {
        if (own[k].of != of || own[k].use == BY_NAME) continue;
        if (!first) first = &own[k];
        for (size_t c = 0; c < list->count; c++)
            found += list->list[c].type == type_of(&own[k]) && strcmp(list->list[c].name, own[k].name) == 0;
    }
    return first && found == property_arrays[of].components ? first : NULL;
}

bool columns_lay_out(columns *list, points *set, void **storage, error *e)
{
    double *next = mem_array(set->count, (list->count + 1) * sizeof *next, "the points of a file", e);
    *storage = next;
    for (int k = 0; next && k < OWN; k++) {
        const own_column *first = first_column(list, own[k].of);
        if (first == &own[k]) {
            memcpy((char *)set + property_arrays[own[k].of].member, &next, sizeof next);
            next += set->count * (size_t)property_arrays[own[k].of].components;
        }
        for (size_t c = 0; first && own[k].use != BY_NAME && c < list->count; c++)
            if (strcmp(list->list[c].name, own[k].name) == 0) fill_own(set, &own[k], &list->list[c]);
    }
    for (size_t c = 0; next && c < list->count; c++) {
        column *other = &list->list[c];
        if (columns_is_own(other->name) || columns_is_of_orient(other->name)) continue;
        other->values = next;
        other->stride = 1;
        other->scale = 1;
        next += set->count;
    }
    return next != NULL;
}

void column_store(const column *c, size_t i, double value)
{
    if (c->values)
        ((double *)c->values)[c->stride * i] = value / c->scale;
    else if (c->whole)
        ((uint32_t *)c->whole)[i] = (uint32_t)value;
}

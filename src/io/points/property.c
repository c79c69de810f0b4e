// SPDX-License-Identifier: Apache-2.0
#include "io/points/property.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define ARRAY(member) offsetof(points, member)

const property_array property_arrays[PROPERTIES_OWN] = {
    [PROPERTY_OWN_POSITION] = {"position", PROPERTY_POSITION, 3, ARRAY(position), 1},
    [PROPERTY_OWN_NORMAL] = {"normal", PROPERTY_NORMAL, 3, ARRAY(normal), 1},
    [PROPERTY_OWN_COLOR] = {"rgb", PROPERTY_COLOR, 3, ARRAY(color), 1},
    [PROPERTY_OWN_UV] = {"texture", PROPERTY_UV, 2, ARRAY(uv), 1},
    [PROPERTY_OWN_RADIUS] = {"radius", PROPERTY_RADIUS, 1, ARRAY(spacing_local), 0.5},
    [PROPERTY_OWN_KAPPA] = {"kappa", PROPERTY_OTHER, 1, ARRAY(kappa), 1},
    [PROPERTY_OWN_KAPPA1] = {"kappa1", PROPERTY_OTHER, 1, ARRAY(kappa1), 1},
    [PROPERTY_OWN_KAPPA2] = {"kappa2", PROPERTY_OTHER, 1, ARRAY(kappa2), 1},
    [PROPERTY_OWN_ALPHA] = {"alpha", PROPERTY_OTHER, 1, ARRAY(alpha), 1},
    [PROPERTY_OWN_ENERGY] = {"energy", PROPERTY_OTHER, 1, ARRAY(energy), 1},
    [PROPERTY_OWN_SPACING] = {"spacing", PROPERTY_OTHER, 1, ARRAY(spacing), 1},
    [PROPERTY_OWN_SPACING_LOCAL] = {"spacing_local", PROPERTY_OTHER, 1, ARRAY(spacing_local), 1},
    [PROPERTY_OWN_KAPPA_SCALE] = {"kappa_scale", PROPERTY_OTHER, 1, ARRAY(kappa_scale), 1},
    [PROPERTY_OWN_ORIENT] = {"orient", PROPERTY_ORIENT, 4, ARRAY(orient), 1},
    [PROPERTY_OWN_ID] = {"id", PROPERTY_ID, 1, ARRAY(id), 1},
    [PROPERTY_OWN_VELOCITY] = {"velocity", PROPERTY_MOTION, 3, ARRAY(velocity), 1},
};

const void *property_array_of(const points *set, property_own own)
{
    const void *array;
    memcpy(&array, (const char *)set + property_arrays[own].member, sizeof array);
    return array;
}

const point_attribute *property_find_attribute(const point_attribute *list, size_t count, const char *name)
{
    for (size_t k = 0; k < count; k++)
        if (strcmp(list[k].name, name) == 0) return &list[k];
    return NULL;
}

bool property_refuse_missing(const point_attribute *list, size_t count, const char *pointer, const char *name,
                             error *e)
{
    char names[400] = "";
    for (size_t k = 0; k < count; k++) {
        const size_t used = strlen(names);
        snprintf(names + used, sizeof names - used, "%s\"%s\"", k ? ", " : "", list[k].name);
    }
    return error_set(e, ERROR_ATTRIBUTE_MISSING, "%s: the points have no attribute \"%s\": choose one of %s",
                     pointer, name, *names ? names : "none, and add it to /attributes");
}

bool property_is_velocity(const point_attribute *a)
{
    return a->kind == POINT_ATTRIBUTE_VECTOR &&
           (strcmp(a->name, "v") == 0 || strcmp(a->name, "vel") == 0 || strcmp(a->name, "velocity") == 0);
}

static double largest_whole(const point_attribute *a, size_t count)
{
    double largest = 0;
    if (a->kind != POINT_ATTRIBUTE_INT || !a->values) return 0;
    for (size_t k = 0; k < count * (size_t)a->components; k++) largest = fmax(largest, fabs(a->values[k]));
    return largest;
}

size_t property_list(const points *s, property *list)
{
    size_t n = 0;
    const point_attribute *velocity = NULL;
    for (size_t k = s->attribute_count; k-- > 0;)
        if (property_is_velocity(&s->attributes[k])) velocity = &s->attributes[k];
    for (property_own k = 0; k < PROPERTIES_OWN; k++) {
        const property_array *a = &property_arrays[k];
        const void *array = property_array_of(s, k);
        if (!array && k != PROPERTY_OWN_ID) continue;
        list[n] =
            (property){.name = a->name, .role = a->role, .components = a->components, .scale = a->scale};
        if (k == PROPERTY_OWN_VELOCITY && velocity) list[n].role = PROPERTY_OTHER;
        list[n].whole = k == PROPERTY_OWN_ID;
        if (list[n].whole)
            list[n].ids = array;
        else
            list[n].values = array;
        n++;
    }
    for (size_t k = 0; k < s->attribute_count; k++) {
        const point_attribute *a = &s->attributes[k];
        list[n++] = (property){a->name,
                               a == velocity ? PROPERTY_VELOCITY : PROPERTY_OTHER,
                               a->kind == POINT_ATTRIBUTE_INT,
                               largest_whole(a, s->count),
                               a->components,
                               a->values,
                               1,
                               a->is_double,
                               NULL};
    }
    return n;
}

double property_value(const property *p, size_t point, int component)
{
    if (!p->values) return p->ids ? (double)p->ids[point] : (double)point;
    return p->scale * p->values[(size_t)p->components * point + (size_t)component];
}

// SPDX-License-Identifier: Apache-2.0
#include "io/points/property.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Adds a property of the set, if the set has it. */
static void add(property *list, size_t *count, const char *name, property_role role, int components,
                const void *values, double scale)
{
    if (values) list[(*count)++] = (property){name, role, false, 0, components, values, scale, false, NULL};
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
    add(list, &n, "position", PROPERTY_POSITION, 3, s->position, 1);
    add(list, &n, "normal", PROPERTY_NORMAL, 3, s->normal, 1);
    add(list, &n, "rgb", PROPERTY_COLOR, 3, s->color, 1);
    add(list, &n, "texture", PROPERTY_UV, 2, s->uv, 1);
    add(list, &n, "radius", PROPERTY_RADIUS, 1, s->spacing_local, 0.5);
    add(list, &n, "kappa", PROPERTY_OTHER, 1, s->kappa, 1);
    add(list, &n, "kappa1", PROPERTY_OTHER, 1, s->kappa1, 1);
    add(list, &n, "kappa2", PROPERTY_OTHER, 1, s->kappa2, 1);
    add(list, &n, "alpha", PROPERTY_OTHER, 1, s->alpha, 1);
    add(list, &n, "energy", PROPERTY_OTHER, 1, s->energy, 1);
    add(list, &n, "spacing", PROPERTY_OTHER, 1, s->spacing, 1);
    add(list, &n, "spacing_local", PROPERTY_OTHER, 1, s->spacing_local, 1);
    add(list, &n, "kappa_scale", PROPERTY_OTHER, 1, s->kappa_scale, 1);
    add(list, &n, "orient", PROPERTY_ORIENT, 4, s->orient, 1);
    list[n++] = (property){"id", PROPERTY_ID, true, 0, 1, NULL, 1, false, s->id};
    add(list, &n, "velocity", velocity ? PROPERTY_OTHER : PROPERTY_MOTION, 3, s->velocity, 1);
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

// SPDX-License-Identifier: Apache-2.0
#include "job/phases/instances.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/rng.h"
#include "io/points/quaternion.h"
#include "io/points/property.h"

/* The attribute of a name. NULL: the spec names none, or the points lack it. */
static const point_attribute *find(const points *set, const char *name)
{
    return name ? property_find_attribute(set->attributes, set->attribute_count, name) : NULL;
}

/* Attributes of one or three components are suitable; `use` describes them in the message. */
static bool check_attribute(const points *set, const char *pointer, const char *name, const char *use,
                            error *e)
{
    const point_attribute *a = find(set, name);
    if (!name) return true;
    if (a && (a->components == 1 || a->components == 3)) return true;
    if (a)
        return error_set(e, ERROR_SPEC_INVALID, "%s: the attribute \"%s\" has %d components: name %s",
                         pointer, name, a->components, use);
    return property_refuse_missing(set->attributes, set->attribute_count, pointer, name, e);
}

bool instances_check(const spec *s, const points *set, error *e)
{
    return check_attribute(set, "/output/orient/twist", s->orient.twist,
                           "a number, which is an angle in radians, or a vector of three components", e) &&
           check_attribute(set, "/output/usd/instancer/scale", s->instancer.scale,
                           "a number, or a vector of three components", e);
}

/* A random angle from the seed and the id: a point keeps its angle in all frames of a sequence. */
static double random_angle(uint64_t seed, uint64_t id)
{
    rng r = rng_seed(seed, id);
    return 2 * M_PI * rng_uniform(&r);
}

/* `axis`: the unit vector to which +z turns. */
static double twist_of(const spec *s, const points *set, const point_attribute *a, vec3 axis, size_t i)
{
    if (a && a->components == 1) return a->values[i];
    if (a)
        return quaternion_twist_along(
            axis, vec3_make(a->values[3 * i], a->values[3 * i + 1], a->values[3 * i + 2]));
    return s->orient.has_seed ? random_angle(s->orient.seed, set->id ? set->id[i] : i) : 0;
}

static double scale_of(const spec *s, const points *set, const point_attribute *a, size_t i, int axis)
{
    const double size = !a                   ? set->spacing_local[i]
                        : a->components == 1 ? a->values[i]
                                             : a->values[3 * i + (size_t)axis];
    return s->instancer.size * size;
}

bool instances_make(const spec *s, const points *set, instances *out, error *e)
{
    static const char what[] = "the orientations of the points";
    *out = (instances){0};
    if (!s->has_orient && !s->has_instancer) return true;
    const point_attribute *twist = find(set, s->orient.twist), *scale = find(set, s->instancer.scale);
    out->orient = mem_array(set->count, 4 * sizeof *out->orient, what, e);
    if (!out->orient) return false;
    const vec3 up = vec3_unit(s->orient.up);
    for (size_t i = 0; i < set->count; i++) {
        const vec3 axis = s->orient.has_up ? up : set->normal[i];
        quaternion_of_normal(axis, twist_of(s, set, twist, axis, i), out->orient + 4 * i);
    }
    if (!s->has_instancer) return true;
    out->scale = mem_array(set->count, 3 * sizeof *out->scale, what, e);
    if (!out->scale) return false;
    for (size_t i = 0; i < set->count; i++)
        for (int axis = 0; axis < 3; axis++)
            out->scale[3 * i + (size_t)axis] = scale_of(s, set, scale, i, axis);
    out->scene = (scene_instancer){s->instancer.prototype, out->orient, out->scale};
    return true;
}

void instances_free(instances *i)
{
    free(i->orient);
    free(i->scale);
    *i = (instances){0};
}

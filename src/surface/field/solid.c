// SPDX-License-Identifier: Apache-2.0
#include "surface/field/solid.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/space/affine.h"

/* Tolerance for equal planes: of unit normals, and of offsets in units of the solid's size. */
static const double SAME_PLANE = 1e-9;
/* Maximum nesting depth of rules. */
enum { DEEPEST = 64, ANY = -1, BOTH = -2 };

static bool leaf_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const solid_leaf *l = (const solid_leaf *)f;
    field_sample s;
    if (!field_sample_at(l->field, affine_apply(l->to_part, x.x, x.y, x.z), order, &s)) return false;
    out->value = s.value;
    out->gradient = affine_pull_gradient(l->to_part, s.gradient);
    if (order == FIELD_HESSIAN) out->hessian = affine_pull_hessian(l->to_part, s.hessian);
    return true;
}

static double leaf_side(const field *f, vec3 x)
{
    const solid_leaf *l = (const solid_leaf *)f;
    return l->field->ops->side(l->field, affine_apply(l->to_part, x.x, x.y, x.z));
}

static const field_ops leaf_ops = {.sample = leaf_sample, .side = leaf_side};

solid *solid_new(double size)
{
    solid *s = mem_alloc(sizeof *s);
    s->size = size;
    return s;
}

void solid_free(solid *s)
{
    if (!s) return;
    for (int k = 0; k < s->count; k++) analytic_free(s->leaf[k].owned);
    free(s);
}

static void add_step(solid *s, solid_rule *rule, int leaf, bool inverted)
{
    s->full |= rule->count == SOLID_STEPS;
    if (!s->full) rule->step[rule->count++] = (solid_step){(int16_t)leaf, inverted};
}

void solid_join(solid *s, solid_rule *rule, bool any)
{
    add_step(s, rule, any ? ANY : BOTH, false);
}

/* F of a plane is g x + c. 1: the two planes are equal; -1: they are equal with opposite normals; 0:
 * otherwise. */
static int same_plane(const solid *s, const field *a, const field *b)
{
    field_sample f, g;
    if (!field_sample_at(a, (vec3){0, 0, 0}, FIELD_GRADIENT, &f) ||
        !field_sample_at(b, (vec3){0, 0, 0}, FIELD_GRADIENT, &g))
        return 0;
    double over_f = 1 / vec3_norm(f.gradient), over_g = 1 / vec3_norm(g.gradient);
    for (int sign = 1; sign >= -1; sign -= 2) {
        vec3 turn = vec3_axpy(-sign * over_g, g.gradient, vec3_scale(f.gradient, over_f));
        double gap = fabs(f.value * over_f - sign * g.value * over_g);
        if (vec3_norm(turn) < SAME_PLANE && gap < SAME_PLANE * s->size) return sign;
    }
    return 0;
}

static bool is_plane(const solid_leaf *l)
{
    return l->owned && l->owned->params.shape == ANALYTIC_HALFSPACE;
}

/* Takes ownership of leaf.owned. */
static void push_leaf(solid *s, solid_rule *rule, solid_leaf leaf, bool inverted)
{
    leaf.base.ops = &leaf_ops;
    for (int k = 0; k < s->count && is_plane(&leaf); k++) {
        int same = is_plane(&s->leaf[k]) ? same_plane(s, &s->leaf[k].base, &leaf.base) : 0;
        if (same == 0) continue;
        analytic_free(leaf.owned);
        add_step(s, rule, k, inverted != (same < 0));
        return;
    }
    s->full |= s->count == SOLID_LEAVES;
    if (s->full) {
        analytic_free(leaf.owned);
        return;
    }
    s->leaf[s->count] = leaf;
    add_step(s, rule, s->count++, inverted);
}

void solid_push_field(solid *s, solid_rule *rule, const field *f, const double to_world[3][4], bool inverted)
{
    solid_leaf leaf = {.field = f};
    affine_invert(to_world, leaf.to_part);
    push_leaf(s, rule, leaf, inverted);
}

/* The complement of an intersection is the union of the complements. */
void solid_push_shape(solid *s, solid_rule *rule, const analytic_params *shape, const double to_world[3][4],
                      bool inverted)
{
    analytic_params piece[ANALYTIC_PIECES];
    int count = analytic_pieces(shape, piece);
    for (int k = 0; k < count; k++) {
        analytic *a = analytic_new_piece(&piece[k]);
        solid_leaf leaf = {.field = &a->base, .owned = a};
        affine_invert(to_world, leaf.to_part);
        push_leaf(s, rule, leaf, inverted);
        if (k > 0) solid_join(s, rule, inverted);
    }
}

bool solid_holds(const solid_rule *rule, uint64_t sides)
{
    bool stack[DEEPEST];
    int top = 0;
    if (rule->count == 0) return true;
    for (int k = 0; k < rule->count; k++) {
        const solid_step *step = &rule->step[k];
        assert(top < DEEPEST && (step->leaf >= 0 || top >= 2));
        if (step->leaf >= 0) {
            stack[top++] = (sides >> step->leaf & 1) != step->inverted;
            continue;
        }
        top--;
        stack[top - 1] = step->leaf == ANY ? stack[top - 1] || stack[top] : stack[top - 1] && stack[top];
    }
    return stack[0];
}

double solid_distance(const solid *s, int leaf, vec3 x)
{
    const field *f = &s->leaf[leaf].base;
    field_sample sample;
    double side = f->ops->side(f, x);
    if (side != 0) return copysign(s->size, side);
    if (!field_sample_at(f, x, FIELD_GRADIENT, &sample)) return s->size;
    double slope = vec3_norm(sample.gradient);
    return slope > 0 ? sample.value / slope : copysign(s->size, sample.value);
}

uint64_t solid_sides(const solid *s, vec3 x)
{
    uint64_t sides = 0;
    for (int k = 0; k < s->count; k++) sides |= (uint64_t)(solid_distance(s, k, x) < 0) << k;
    return sides;
}

int solid_surface(const solid *s, int leaf, uint64_t sides)
{
    const uint64_t bit = (uint64_t)1 << leaf;
    bool in = solid_holds(&s->inside, sides | bit), out = solid_holds(&s->inside, sides & ~bit);
    if (in == out || !solid_holds(&s->region, sides)) return 0;
    return in ? 1 : -1;
}

/* Minima and maxima of distances, as the rule joins them. */
int solid_nearest(const solid *s, vec3 x, int *sign)
{
    struct {
        double value;
        int leaf;
        bool inverted;
    } stack[DEEPEST];
    double distance[SOLID_LEAVES];
    int top = 0;
    for (int k = 0; k < s->count; k++) distance[k] = solid_distance(s, k, x);
    for (int k = 0; k < s->inside.count; k++) {
        const solid_step *step = &s->inside.step[k];
        if (step->leaf >= 0) {
            stack[top].value = step->inverted ? -distance[step->leaf] : distance[step->leaf];
            stack[top].leaf = step->leaf;
            stack[top++].inverted = step->inverted;
            continue;
        }
        top--;
        if ((stack[top].value < stack[top - 1].value) == (step->leaf == ANY)) stack[top - 1] = stack[top];
    }
    *sign = stack[0].inverted ? -1 : 1;
    return stack[0].leaf;
}

#include "solver/curves/near_curves.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/sets.h"
#include "geometry/box_tree.h"
#include "voronoi/quality.h"

static const char what[] = "the rows along curves";

/* Sides of one curve that are so many places apart may meet. */
enum { APART = 3 };
static const uint32_t NONE = UINT32_MAX;
/* Places of two rows that follow one another face each other within this: beyond, a place stands for its own row alone. */
static const double BESIDE = 1.3;

/* A side of a row, from one place to the next. */
typedef struct side {
    uint32_t from, to, curve, at; /* `at`: which of its curve */
    double low, high;             /* along the longest axis */
} side;

/* A stand that a place is to have. */
typedef struct lent {
    uint32_t place, patch, stand; /* `stand`: the one that it comes from */
    bool own;                     /* the place has it already */
} lent;

/* In spacings: a curve that begins or ends by itself does so where there is room. */
static const double LOOSE = 0.65;

typedef struct merging {
    const near_curves_input *in;
    curve_samples *rows;
    side *sides;             /* ascending along the axis */
    uint32_t (*sides_of)[2]; /* of each place of a curve: the side from it and the one to it, or NONE */
    box_tree *tree;          /* of the sides */
    size_t side_count, *first_stand;
    uint32_t *into,
        *curve_at; /* of each place: the one that stands for it, itself as a rule; which of its curve it is */
    uint32_t *ends;   /* of each corner, of curves */
    uint32_t *joined; /* of each patch: the least patch of its connected component */
    lent *lents;
    size_t lent_count, lent_room;
    int axis;
} merging;

/* ---- sides ---- */

static void add_side(merging *m, uint32_t from, uint32_t to, uint32_t curve, uint32_t at)
{
    const double a = vec3_get(m->rows->position[from], m->axis), b = vec3_get(m->rows->position[to], m->axis);
    m->sides[m->side_count++] = (side){from, to, curve, at, fmin(a, b), fmax(a, b)};
}

static int by_place(const void *left, const void *right)
{
    const side *a = left, *b = right;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    if (a->curve != b->curve) return a->curve < b->curve ? -1 : 1;
    return (a->at > b->at) - (a->at < b->at);
}

static void list_sides(merging *m)
{
    const near_curves_input *in = m->in;
    for (uint32_t c = 0; c < in->curve_count; c++) {
        const uint32_t first = (uint32_t)in->first[c], count = (uint32_t)(in->first[c + 1] - in->first[c]);
        for (uint32_t k = 0; k < count; k++) m->curve_at[first + k] = k + 1;
        for (uint32_t k = 1; k < count; k++) add_side(m, first + k - 1, first + k, c, k);
        if (in->closed[c]) {
            if (count > 2) add_side(m, first + count - 1, first, c, count);
            continue;
        }
        m->ends[in->end[c][0]]++;
        m->ends[in->end[c][1]] += in->end[c][1] != in->end[c][0];
        add_side(m, in->end[c][0], count ? first : in->end[c][1], c, 0);
        if (count) add_side(m, first + count - 1, in->end[c][1], c, count);
    }
    qsort(m->sides, m->side_count, sizeof *m->sides, by_place);
}

/* Sides are found by where their ends are, and from here on also by where what stands for an end is. */
static void move_end(merging *m, uint32_t which, uint32_t end)
{
    if (which != NONE) box_tree_extend(m->tree, which, m->rows->position[m->into[end]]);
}

static bool plant(merging *m, error *e)
{
    bbox *box = mem_array(m->side_count, sizeof *box, what, e);
    for (size_t k = 0; k < m->rows->count; k++) m->sides_of[k][0] = m->sides_of[k][1] = NONE;
    for (uint32_t k = 0; box && k < m->side_count; k++) {
        const side *s = &m->sides[k];
        const vec3 from = m->rows->position[s->from];
        box[k] = bbox_include((bbox){from, from}, m->rows->position[s->to]);
        m->sides_of[s->from][0] = m->sides_of[s->to][1] = k;
    }
    m->tree = box ? box_tree_new(box, m->side_count, e) : NULL;
    free(box);
    return m->tree;
}

/* The sides that may be as near to a place as that, ascending. */
static const uint32_t *find_sides(merging *m, uint32_t place, double reach, size_t *count)
{
    return box_tree_find(m->tree, m->rows->position[place], reach * (1 + 1e-9), count);
}

/* ---- what is near ---- */

static double distance_to(vec3 x, vec3 a, vec3 b)
{
    const vec3 along = vec3_sub(b, a);
    const double at = vec3_dot(vec3_sub(x, a), along) / fmax(vec3_norm2(along), 1e-300);
    return vec3_norm(vec3_sub(x, vec3_axpy(fmin(fmax(at, 0), 1), along, a)));
}

static double apart(const merging *m, uint32_t i, uint32_t j)
{
    return vec3_norm(vec3_sub(m->rows->position[i], m->rows->position[j]));
}

/* Whether two places belong to connected patches and are not on opposite walls. */
static bool are_of_one_side(const merging *m, uint32_t i, uint32_t j)
{
    const curve_samples *r = m->rows;
    for (size_t a = m->first_stand[i]; a < m->first_stand[i + 1]; a++)
        for (size_t b = m->first_stand[j]; b < m->first_stand[j + 1]; b++)
            if (m->joined[r->patch[a]] == m->joined[r->patch[b]] &&
                vec3_dot(r->normal[a], r->normal[b]) > QUALITY_SHEET_FACING)
                return true;
    return false;
}

/* Whether a side is of a part of a curve that a place does not belong to. */
static bool is_elsewhere(const merging *m, const side *s, uint32_t place, uint32_t curve)
{
    if (s->from == place || s->to == place) return false;
    if (s->curve != curve) return true;
    const uint32_t a = s->at, b = m->curve_at[place], away = a > b ? a - b : b - a,
                   round = (uint32_t)(m->in->first[curve + 1] - m->in->first[curve]);
    return away >= APART && (!m->in->closed[curve] || round - away >= APART);
}

static double near_curves(const merging *m)
{
    return m->in->of_scan ? NEAR_CURVES_OF_SCANS : NEAR_CURVES;
}

/* The place of an earlier row that is to stand for one, or the place itself. Sides go from what stands for their ends. */
static uint32_t find_host(merging *m, uint32_t place, uint32_t curve)
{
    const double reach = near_curves(m) * m->in->spacing[place],
                 at = vec3_get(m->rows->position[place], m->axis);
    const vec3 x = m->rows->position[place];
    double least = INFINITY;
    uint32_t host = place;
    size_t count;
    const uint32_t *near = find_sides(m, place, reach, &count);
    for (size_t k = 0; k < count; k++) {
        const side *s = &m->sides[near[k]];
        if (s->high < at - reach || s->low > at + reach || s->curve > curve ||
            !is_elsewhere(m, s, place, curve))
            continue;
        if (s->curve == curve && s->at >= m->curve_at[place]) continue;
        const uint32_t a = m->into[s->from], b = m->into[s->to];
        const double away = distance_to(x, m->rows->position[a], m->rows->position[b]);
        const uint32_t nearer = apart(m, place, a) <= apart(m, place, b) ? a : b;
        if (!(away < reach) || nearer == place || !are_of_one_side(m, place, nearer)) continue;
        if (apart(m, place, nearer) >= least) continue;
        least = apart(m, place, nearer);
        host = nearer;
    }
    return host;
}

/* A corner becomes an earlier one that is near. Of a row that passes it closely the place that is nearest to it becomes the
 * corner. */
static void join_corner(merging *m, uint32_t corner)
{
    const double reach = near_curves(m) * m->in->spacing[corner];
    const vec3 x = m->rows->position[corner];
    size_t count;
    const uint32_t *near = find_sides(m, corner, reach, &count);
    for (size_t k = 0; k < count; k++) {
        const side *s = &m->sides[near[k]];
        const uint32_t end[2] = {s->from, s->to};
        if (s->from == corner || s->to == corner) continue;
        if (!(distance_to(x, m->rows->position[s->from], m->rows->position[s->to]) < reach)) continue;
        const uint32_t place = end[apart(m, corner, end[1]) < apart(m, corner, end[0])];
        if (m->into[place] != place || m->into[corner] != corner || !are_of_one_side(m, corner, place))
            continue;
        if (place >= m->rows->corners) m->into[place] = corner;
        if (place < corner && apart(m, corner, place) < reach) m->into[corner] = place;
    }
}

/* Such an end is no corner of the surface: it is left out where another place is near. */
static void join_loose(merging *m, uint32_t corner)
{
    double least = LOOSE * m->in->spacing[corner];
    size_t count;
    const uint32_t *near = find_sides(m, corner, least, &count);
    for (size_t k = 0; k < count; k++) {
        const uint32_t end[2] = {m->sides[near[k]].from, m->sides[near[k]].to};
        for (int i = 0; i < 2; i++) {
            if (end[i] == corner || m->into[end[i]] != end[i] || !(apart(m, corner, end[i]) < least))
                continue;
            if (are_of_one_side(m, corner, end[i])) least = apart(m, corner, m->into[corner] = end[i]);
        }
    }
}

static void find_hosts(merging *m)
{
    const near_curves_input *in = m->in;
    for (uint32_t k = 0; k < m->rows->count; k++) m->into[k] = k;
    for (uint32_t k = 0; k < m->rows->corners; k++) join_corner(m, k);
    for (uint32_t k = 0; k < m->side_count; k++) {
        move_end(m, k, m->sides[k].from);
        move_end(m, k, m->sides[k].to);
    }
    for (uint32_t c = 0; c < in->curve_count; c++)
        for (uint32_t k = (uint32_t)in->first[c]; k < in->first[c + 1]; k++) {
            if (m->into[k] == k) m->into[k] = find_host(m, k, c);
            for (int i = 0; i < 2; i++) move_end(m, m->sides_of[k][i], k);
        }
    for (uint32_t k = 0; in->of_scan && k < m->rows->corners; k++)
        if (m->ends[k] <= 2 && m->into[k] == k) join_loose(m, k);
    for (uint32_t k = 0; k < m->rows->count; k++) /* earlier ones point at those that stay */
        while (m->into[m->into[k]] != m->into[k]) m->into[k] = m->into[m->into[k]];
}

/* ---- stands ---- */

static bool lend(merging *m, uint32_t place, size_t stand, bool own, error *e)
{
    lent *grown = mem_grow(m->lents, m->lent_count, &m->lent_room, 256, sizeof *grown, what, e);
    if (!grown) return false;
    m->lents = grown;
    m->lents[m->lent_count++] = (lent){place, m->rows->patch[stand], (uint32_t)stand, own};
    return true;
}

static bool lend_all(merging *m, uint32_t place, uint32_t from, error *e)
{
    for (size_t k = m->first_stand[from]; k < m->first_stand[from + 1]; k++)
        if (!lend(m, place, k, place == from, e)) return false;
    return true;
}

/* A place that stays stands for a row of which places beside it are left out. */
static bool lend_beside(merging *m, uint32_t place, error *e)
{
    const double reach = BESIDE * near_curves(m) * m->in->spacing[place];
    size_t count;
    const uint32_t *near = find_sides(m, place, reach, &count);
    for (size_t k = 0; k < count; k++) {
        const side *s = &m->sides[near[k]];
        const uint32_t end[2] = {s->from, s->to};
        if (s->from == place || s->to == place) continue;
        const double away =
            distance_to(m->rows->position[place], m->rows->position[s->from], m->rows->position[s->to]);
        for (int i = 0; i < 2 && away < reach; i++)
            if (m->into[end[i]] != end[i] && end[i] >= m->rows->corners &&
                are_of_one_side(m, place, end[i]) && !lend_all(m, place, end[i], e))
                return false;
    }
    return true;
}

static int by_stand(const void *left, const void *right)
{
    const lent *a = left, *b = right;
    if (a->place != b->place) return a->place < b->place ? -1 : 1;
    if (a->own != b->own) return a->own ? -1 : 1;
    return a->stand < b->stand ? -1 : a->stand > b->stand;
}

static bool list_lents(merging *m, error *e)
{
    bool ok = true;
    for (uint32_t k = 0; ok && k < m->rows->count; k++)
        ok = lend_all(m, m->into[k], k, e) && (m->into[k] != k || lend_beside(m, k, e));
    if (ok && m->lent_count) qsort(m->lents, m->lent_count, sizeof *m->lents, by_stand);
    return ok;
}

/* Each place once, and one stand of it for each patch: its own where it has one. */
static bool rebuild(merging *m, error *e)
{
    curve_samples *r = m->rows;
    curve_samples made = {.position = mem_array(r->count, sizeof *made.position, what, e),
                          .curve = mem_array(r->count, sizeof *made.curve, what, e),
                          .place = mem_array(m->lent_count, sizeof *made.place, what, e),
                          .patch = mem_array(m->lent_count, sizeof *made.patch, what, e),
                          .normal = mem_array(m->lent_count, sizeof *made.normal, what, e),
                          .border = r->border};
    const bool ok = made.position && made.curve && made.place && made.patch && made.normal;
    size_t at = 0;
    for (size_t k = 0; ok && k < r->copies; k++) made.border[r->patch[k]] -= m->in->half[k];
    for (uint32_t k = 0; ok && k < r->count; k++) {
        const size_t begin = made.copies;
        if (m->into[k] != k) continue;
        for (; at < m->lent_count && m->lents[at].place == k; at++) {
            const lent *l = &m->lents[at];
            bool has = false;
            for (size_t n = begin; n < made.copies; n++) has |= made.patch[n] == l->patch;
            if (has) continue;
            made.place[made.copies] = (uint32_t)made.count;
            made.patch[made.copies] = l->patch;
            made.normal[made.copies++] = r->normal[l->stand];
            made.border[l->patch] += m->in->half[l->stand];
        }
        made.corners += k < r->corners;
        made.position[made.count] = r->position[k];
        made.curve[made.count++] = r->curve[k];
    }
    curve_samples old = ok ? *r : made;
    if (ok) *r = made;
    old.border = NULL;
    curve_samples_free(&old);
    return ok;
}

/* Connected components of patches: patches that share a curve or a corner are connected. */
static void join_patches(merging *m)
{
    const curve_samples *r = m->rows;
    sets_reset(m->joined, m->in->patch_count);
    for (size_t k = 1; k < r->copies; k++)
        if (r->place[k] == r->place[k - 1]) sets_join(m->joined, r->patch[k], r->patch[k - 1]);
    for (uint32_t k = 0; k < m->in->patch_count; k++) m->joined[k] = sets_root(m->joined, k);
}

bool near_curves_merge(const near_curves_input *in, curve_samples *rows, error *e)
{
    merging m = {.in = in, .rows = rows};
    if (rows->count == 0) return true;
    const vec3 size = bbox_size(bbox_of_points(rows->position, rows->count, NULL));
    m.axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    m.sides = mem_array(rows->count + 2 * in->curve_count, sizeof *m.sides, what, e);
    m.sides_of = mem_array(rows->count, sizeof *m.sides_of, what, e);
    m.into = mem_array(rows->count, sizeof *m.into, what, e);
    m.curve_at = mem_array(rows->count, sizeof *m.curve_at, what, e);
    m.ends = mem_array(rows->count, sizeof *m.ends, what, e);
    m.first_stand = mem_array(rows->count + 1, sizeof *m.first_stand, what, e);
    m.joined = mem_array(in->patch_count, sizeof *m.joined, what, e);
    bool ok = m.sides && m.sides_of && m.into && m.curve_at && m.ends && m.first_stand && m.joined;
    if (ok) {
        join_patches(&m);
        for (size_t k = 0; k < rows->copies; k++) m.first_stand[rows->place[k] + 1] = k + 1;
        for (size_t k = 1; k <= rows->count; k++)
            if (m.first_stand[k] < m.first_stand[k - 1]) m.first_stand[k] = m.first_stand[k - 1];
        list_sides(&m);
        ok = plant(&m, e);
        if (ok) find_hosts(&m);
        ok = ok && list_lents(&m, e) && rebuild(&m, e);
    }
    free(m.sides);
    free(m.sides_of);
    box_tree_free(m.tree);
    free(m.into);
    free(m.curve_at);
    free(m.ends);
    free(m.first_stand);
    free(m.joined);
    free(m.lents);
    return ok;
}

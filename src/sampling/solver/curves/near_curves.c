// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/curves/near_curves.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/space/box_tree.h"
#include "sampling/voronoi/resolution.h"

/* The object that messages about memory name. */
static const char what[] = "the samples along curves";

static const uint32_t NONE = UINT32_MAX;
/* Within this multiple of the merge distance a remaining sample gets copies for removed samples of a parallel
 * curve. Larger: copies for samples that it does not face. */
static const double FACING_DISTANCE = 1.3;
/* Merge distance of samples at the same place, in spacings: that of coincident points in the measures. */
static const double COINCIDENT_DISTANCE = 1e-3;

/* A segment of a sampled curve, from one sample to the next. */
typedef struct segment {
    uint32_t from, to, curve, at; /* at: index of the segment along its curve */
    uint32_t component;           /* its least patch */
    double low, high;             /* range along the longest axis */
} segment;

/* The segments of a connected component of patches. Those of others are never merged with them: one tree for all would
 * find all segments of a soup of overlapping faces for each of them. */
typedef struct component {
    size_t first; /* in `segments` */
    box_tree tree;
} component;

/* A copy that a remaining sample has. */
typedef struct new_copy {
    uint32_t place, patch, source; /* place: the sample; source: the original copy */
    bool own;                      /* the original copy is one of the sample itself */
} new_copy;

/* Merge distance of a curve end that is not a corner of the surface, in spacings. Within it another sample
 * covers the end. */
static const double LOOSE_END_DISTANCE = 0.65;

typedef struct merging {
    const near_curves_input *in;
    curve_samples *samples;
    segment *segments; /* ascending by component, and along the axis */
    size_t segment_count;
    /* per sample of a curve: the segment that starts and the segment that ends there, or NONE */
    uint32_t (*segments_of)[2];
    component *component; /* per patch; without segments if it is not the least one of its component */
    bbox *box;            /* per segment */
    uint32_t *at;         /* per segment: its place in the order of its tree */
    uint32_t *found;      /* the segments that the last search found */
    size_t *first_copy;   /* per sample and one more: its first copy */
    uint32_t *target;     /* per sample: the sample it is merged into; itself if it remains */
    uint32_t *ends;       /* per corner: number of curve ends */
    uint32_t *joined;     /* per patch: the least patch of its connected component */
    new_copy *new_copies; /* ascending by sample */
    size_t new_count, new_capacity;
    size_t *first_new; /* per sample and one more: its first new copy; a sample that was merged has none */
    int axis;          /* the longest axis of the bounding box of the samples */
} merging;

/* ---- segments ---- */

/* The component of a sample. */
static uint32_t component_of(const merging *m, uint32_t place)
{
    return m->joined[m->samples->patch[m->first_copy[place]]];
}

static void add_segment(merging *m, uint32_t from, uint32_t to, uint32_t curve, uint32_t at)
{
    const double a = vec3_get(m->samples->position[from], m->axis),
                 b = vec3_get(m->samples->position[to], m->axis);
    m->segments[m->segment_count++] =
        (segment){from, to, curve, at, component_of(m, from), fmin(a, b), fmax(a, b)};
}

static int by_position(const void *left, const void *right)
{
    const segment *a = left, *b = right;
    if (a->component != b->component) return a->component < b->component ? -1 : 1;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    if (a->curve != b->curve) return a->curve < b->curve ? -1 : 1;
    return (a->at > b->at) - (a->at < b->at);
}

static void list_segments(merging *m)
{
    const near_curves_input *in = m->in;
    for (uint32_t c = 0; c < in->curve_count; c++) {
        const uint32_t first = (uint32_t)in->first[c], count = (uint32_t)(in->first[c + 1] - in->first[c]);
        for (uint32_t k = 1; k < count; k++) add_segment(m, first + k - 1, first + k, c, k);
        if (in->closed[c]) {
            /* of a single sample: a segment without length, by which samples of other curves find it */
            if (count > 2 || count == 1) add_segment(m, first + count - 1, first, c, count);
            continue;
        }
        m->ends[in->end[c][0]]++;
        m->ends[in->end[c][1]] += in->end[c][1] != in->end[c][0];
        add_segment(m, in->end[c][0], count ? first : in->end[c][1], c, 0);
        if (count) add_segment(m, first + count - 1, in->end[c][1], c, count);
    }
    qsort(m->segments, m->segment_count, sizeof *m->segments, by_position);
}

/* Extends the box of a segment to the sample that one of its ends is merged into. */
static void extend_segment(merging *m, uint32_t which, uint32_t end)
{
    const vec3 x = m->samples->position[m->target[end]];
    if (which == NONE || bbox_contains(m->box[which], x)) return;
    m->box[which] = bbox_include(m->box[which], x);
    box_tree_extend(&m->component[m->segments[which].component].tree, m->at[which], x);
}

static bbox box_of_segment(const void *context, uint32_t which)
{
    const bbox *box = context;
    return box[which];
}

static bool build_trees(merging *m, error *e)
{
    vec3 *centre = mem_array(m->segment_count, sizeof *centre, what, e);
    m->component = mem_array(m->in->patch_count, sizeof *m->component, what, e);
    m->box = mem_array(m->segment_count, sizeof *m->box, what, e);
    m->at = mem_array(m->segment_count, sizeof *m->at, what, e);
    m->found = mem_array(m->segment_count, sizeof *m->found, what, e);
    bool ok = centre && m->component && m->box && m->at && m->found;
    for (size_t k = 0; k < m->samples->count; k++) m->segments_of[k][0] = m->segments_of[k][1] = NONE;
    for (uint32_t k = 0; ok && k < m->segment_count; k++) {
        const segment *s = &m->segments[k];
        const vec3 from = m->samples->position[s->from], to = m->samples->position[s->to];
        m->box[k] = bbox_include((bbox){from, from}, to);
        centre[k] = vec3_scale(vec3_add(from, to), 0.5);
        m->segments_of[s->from][0] = m->segments_of[s->to][1] = k;
    }
    for (size_t first = 0, end = 0; ok && first < m->segment_count; first = end) {
        component *c = &m->component[m->segments[first].component];
        while (end < m->segment_count && m->segments[end].component == m->segments[first].component) end++;
        c->first = first;
        ok = box_tree_make(end - first, centre + first, box_of_segment, m->box + first, NULL, what, &c->tree,
                           e);
        for (uint32_t k = 0; ok && k < end - first; k++) m->at[first + c->tree.order[k]] = k;
    }
    free(centre);
    return ok;
}

static int compare_segments(const void *left, const void *right)
{
    const uint32_t *a = left, *b = right;
    return (*a > *b) - (*a < *b);
}

/* Segments of its component whose boxes lie within `reach` of a sample, in the order of the tree. */
static const uint32_t *find_segments(merging *m, uint32_t place, double reach, size_t *count)
{
    const vec3 x = m->samples->position[place];
    const bbox where = bbox_grow((bbox){x, x}, reach * (1 + 1e-9));
    const component *c = &m->component[component_of(m, place)];
    box_tree_walk w;
    *count = 0;
    if (c->tree.count == 0) return m->found;
    box_tree_begin(&c->tree, &w);
    while (box_tree_next_meeting(&c->tree, &w, &where))
        for (size_t k = w.first; k < w.end; k++) {
            const size_t which = c->first + c->tree.order[k];
            if (bbox_meet(&m->box[which], &where)) m->found[(*count)++] = (uint32_t)which;
        }
    return m->found;
}

/* The same segments, ascending. */
static const uint32_t *find_segments_in_order(merging *m, uint32_t place, double reach, size_t *count)
{
    find_segments(m, place, reach, count);
    if (*count > 1) qsort(m->found, *count, sizeof *m->found, compare_segments);
    return m->found;
}

/* ---- merge targets ---- */

/* Distance of x from the segment a b. */
static double distance_to(vec3 x, vec3 a, vec3 b)
{
    const vec3 along = vec3_sub(b, a);
    const double at = vec3_dot(vec3_sub(x, a), along) / fmax(vec3_norm2(along), 1e-300);
    return vec3_norm(vec3_sub(x, vec3_axpy(fmin(fmax(at, 0), 1), along, a)));
}

static double distance_between(const merging *m, uint32_t i, uint32_t j)
{
    return vec3_norm(vec3_sub(m->samples->position[i], m->samples->position[j]));
}

/* Whether two original copies belong to connected patches and are not on opposite walls. */
static bool is_one_side(const merging *m, size_t a, size_t b)
{
    const curve_samples *r = m->samples;
    return m->joined[r->patch[a]] == m->joined[r->patch[b]] &&
           vec3_dot(r->normal[a], r->normal[b]) > RESOLUTION_OPPOSITE;
}

/* Whether two samples with their original copies belong to connected patches and are not on opposite
 * walls. */
static bool were_on_one_side(const merging *m, uint32_t i, uint32_t j)
{
    for (size_t a = m->first_copy[i]; a < m->first_copy[i + 1]; a++)
        for (size_t b = m->first_copy[j]; b < m->first_copy[j + 1]; b++)
            if (is_one_side(m, a, b)) return true;
    return false;
}

/* Whether present copies of two samples are on one side. Samples on opposite walls have such copies once a
 * curve between them was merged. */
static bool are_mergeable(const merging *m, uint32_t i, uint32_t j)
{
    const uint32_t *patch = m->samples->patch;
    if (m->in->coincident_only) /* normals at a pinched place are arbitrary */
        return m->joined[patch[m->first_copy[i]]] == m->joined[patch[m->first_copy[j]]];
    for (size_t a = m->first_new[i]; a < m->first_new[i + 1]; a++)
        for (size_t b = m->first_new[j]; b < m->first_new[j + 1]; b++)
            if (is_one_side(m, m->new_copies[a].source, m->new_copies[b].source)) return true;
    return false;
}

/* Whether a sample of a curve may be merged into an end of a segment: of an earlier curve, or of the same
 * curve between earlier samples. A segment that ends at the sample counts by its other end: where the curve
 * folds back between the two, they are near. */
static bool is_earlier(const segment *s, uint32_t place, uint32_t curve)
{
    return s->curve < curve || (s->curve == curve && s->from <= place && s->to <= place);
}

static double merge_distance(const merging *m)
{
    return m->in->coincident_only ? COINCIDENT_DISTANCE : m->in->of_scan ? NEAR_CURVES_OF_SCANS : NEAR_CURVES;
}

/* The nearest sample of an earlier curve that a sample is merged into; the sample itself if there is none. Of equal
 * distances, that of the first segment counts. Segments connect the samples that their ends are merged into. */
static uint32_t find_target(merging *m, uint32_t place, uint32_t curve)
{
    const double reach = merge_distance(m) * m->in->spacing[place],
                 at = vec3_get(m->samples->position[place], m->axis);
    const vec3 x = m->samples->position[place];
    double least = INFINITY;
    uint32_t found = place, found_by = NONE;
    size_t count;
    const uint32_t *near = find_segments(m, place, reach, &count);
    for (size_t k = 0; k < count; k++) {
        const segment *s = &m->segments[near[k]];
        if (s->high < at - reach || s->low > at + reach || !is_earlier(s, place, curve)) continue;
        const uint32_t a = m->target[s->from], b = m->target[s->to];
        const bool is_end = s->from == place || s->to == place;
        const double to_a = distance_between(m, place, a), to_b = distance_between(m, place, b);
        const uint32_t nearer = is_end ? (s->from == place ? b : a) : to_a <= to_b ? a : b;
        const double distance = nearer == a ? to_a : to_b;
        if (nearer == place || distance > least || (distance == least && near[k] > found_by)) continue;
        const double away = is_end || m->in->coincident_only
                                ? distance
                                : distance_to(x, m->samples->position[a], m->samples->position[b]);
        if (!(away < reach) || !are_mergeable(m, place, nearer)) continue;
        least = distance;
        found = nearer;
        found_by = near[k];
    }
    return found;
}

/* Whether a sample that still represents itself can become one with a corner. */
static bool is_free_to_merge(const merging *m, uint32_t corner, uint32_t place)
{
    return place != corner && m->target[place] == place && m->target[corner] == corner &&
           are_mergeable(m, corner, place);
}

/* Merges a corner into a near earlier corner, also into one that a curve joins it to. The nearest sample of
 * another curve that passes within the merge distance is merged into the corner. */
static void merge_corner(merging *m, uint32_t corner)
{
    const double reach = merge_distance(m) * m->in->spacing[corner];
    const vec3 x = m->samples->position[corner];
    size_t count;
    const uint32_t *near = find_segments_in_order(m, corner, reach, &count);
    for (size_t k = 0; k < count; k++) {
        const segment *s = &m->segments[near[k]];
        const uint32_t end[2] = {s->from, s->to},
                       nearer =
                           end[distance_between(m, corner, end[1]) < distance_between(m, corner, end[0])];
        if (nearer >= m->samples->corners && s->from != corner && s->to != corner &&
            (m->in->coincident_only
                 ? distance_between(m, corner, nearer)
                 : distance_to(x, m->samples->position[s->from], m->samples->position[s->to])) < reach &&
            is_free_to_merge(m, corner, nearer))
            m->target[nearer] = corner;
        for (int i = 0; i < 2; i++)
            if (end[i] < corner && distance_between(m, corner, end[i]) < reach &&
                is_free_to_merge(m, corner, end[i]))
                m->target[corner] = end[i];
    }
}

/* Merges a curve end that is not a corner of the surface into the nearest sample within LOOSE_END_DISTANCE
 * spacings. */
static void merge_loose_end(merging *m, uint32_t corner)
{
    double least = LOOSE_END_DISTANCE * m->in->spacing[corner];
    size_t count;
    const uint32_t *near = find_segments_in_order(m, corner, least, &count);
    for (size_t k = 0; k < count; k++) {
        const uint32_t end[2] = {m->segments[near[k]].from, m->segments[near[k]].to};
        for (int i = 0; i < 2; i++) {
            if (end[i] == corner || m->target[end[i]] != end[i] ||
                !(distance_between(m, corner, end[i]) < least))
                continue;
            if (are_mergeable(m, corner, end[i]))
                least = distance_between(m, corner, m->target[corner] = end[i]);
        }
    }
}

/* One pass over all samples. Returns the number of samples that remain. */
static size_t find_targets(merging *m)
{
    const near_curves_input *in = m->in;
    size_t remaining = 0;
    for (uint32_t k = 0; k < m->samples->corners; k++)
        if (m->target[k] == k) merge_corner(m, k);
    for (uint32_t k = 0; k < m->segment_count; k++) {
        extend_segment(m, k, m->segments[k].from);
        extend_segment(m, k, m->segments[k].to);
    }
    for (uint32_t c = 0; c < in->curve_count; c++)
        for (uint32_t k = (uint32_t)in->first[c]; k < in->first[c + 1]; k++) {
            if (m->target[k] == k) m->target[k] = find_target(m, k, c);
            for (int i = 0; i < 2; i++) extend_segment(m, m->segments_of[k][i], k);
        }
    for (uint32_t k = 0; in->of_scan && k < m->samples->corners; k++)
        if (m->ends[k] <= 2 && m->target[k] == k) merge_loose_end(m, k);
    for (uint32_t k = 0; k < m->samples->count; k++) { /* path compression: targets are remaining samples */
        while (m->target[m->target[k]] != m->target[k]) m->target[k] = m->target[m->target[k]];
        remaining += m->target[k] == k;
    }
    return remaining;
}

/* ---- copies ---- */

static bool add_copy(merging *m, uint32_t place, size_t source, bool own, error *e)
{
    if (!MEM_GROW(m->new_copies, m->new_count, &m->new_capacity, what, e)) return false;
    m->new_copies[m->new_count++] = (new_copy){place, m->samples->patch[source], (uint32_t)source, own};
    return true;
}

static bool add_copies(merging *m, uint32_t place, uint32_t from, error *e)
{
    for (size_t k = m->first_copy[from]; k < m->first_copy[from + 1]; k++)
        if (!add_copy(m, place, k, place == from, e)) return false;
    return true;
}

/* A remaining sample gets copies for removed samples of a parallel curve that it faces. */
static bool add_facing_copies(merging *m, uint32_t place, error *e)
{
    const double reach = FACING_DISTANCE * merge_distance(m) * m->in->spacing[place];
    size_t count;
    const uint32_t *near = find_segments(m, place, reach, &count);
    for (size_t k = 0; k < count; k++) {
        const segment *s = &m->segments[near[k]];
        const uint32_t end[2] = {s->from, s->to};
        if (s->from == place || s->to == place) continue;
        const double away = distance_to(m->samples->position[place], m->samples->position[s->from],
                                        m->samples->position[s->to]);
        for (int i = 0; i < 2 && away < reach; i++)
            if (m->target[end[i]] != end[i] && end[i] >= m->samples->corners &&
                were_on_one_side(m, place, end[i]) && !add_copies(m, place, end[i], e))
                return false;
    }
    return true;
}

static int compare_copies(const void *left, const void *right)
{
    const new_copy *a = left, *b = right;
    if (a->place != b->place) return a->place < b->place ? -1 : 1;
    if (a->own != b->own) return a->own ? -1 : 1;
    return a->source < b->source ? -1 : a->source > b->source;
}

/* `any_merged`: some sample is merged into another. */
static bool list_copies(merging *m, bool any_merged, error *e)
{
    bool ok = true;
    m->new_count = 0;
    for (uint32_t k = 0; ok && k < m->samples->count; k++)
        ok = add_copies(m, m->target[k], k, e) &&
             (!any_merged || m->target[k] != k || add_facing_copies(m, k, e));
    if (!ok) return false;
    if (m->new_count) qsort(m->new_copies, m->new_count, sizeof *m->new_copies, compare_copies);
    for (size_t k = 0, at = 0; k <= m->samples->count; k++) {
        while (at < m->new_count && m->new_copies[at].place < k) at++;
        m->first_new[k] = at;
    }
    return true;
}

/* Merges until no two remaining samples can be merged with their present copies. */
static bool merge_all(merging *m, error *e)
{
    size_t remaining = m->samples->count, before;
    for (uint32_t k = 0; k < m->samples->count; k++) m->target[k] = k;
    do {
        if (!list_copies(m, remaining < m->samples->count, e)) return false;
        before = remaining;
        remaining = find_targets(m);
    } while (remaining < before);
    return true;
}

/* Rebuilds the arrays: each remaining sample once, with one copy per patch. Its own copy takes precedence. */
static bool rebuild(merging *m, error *e)
{
    curve_samples *r = m->samples;
    curve_samples made = {.position = mem_array(r->count, sizeof *made.position, what, e),
                          .curve = mem_array(r->count, sizeof *made.curve, what, e),
                          .place = mem_array(m->new_count, sizeof *made.place, what, e),
                          .patch = mem_array(m->new_count, sizeof *made.patch, what, e),
                          .normal = mem_array(m->new_count, sizeof *made.normal, what, e),
                          .border = r->border};
    const bool ok = made.position && made.curve && made.place && made.patch && made.normal;
    size_t at = 0;
    for (size_t k = 0; ok && k < r->copies; k++) made.border[r->patch[k]] -= m->in->half[k];
    for (uint32_t k = 0; ok && k < r->count; k++) {
        const size_t begin = made.copies;
        if (m->target[k] != k) continue;
        for (; at < m->new_count && m->new_copies[at].place == k; at++) {
            const new_copy *l = &m->new_copies[at];
            bool has = false;
            for (size_t n = begin; n < made.copies; n++) has |= made.patch[n] == l->patch;
            if (has) continue;
            made.place[made.copies] = (uint32_t)made.count;
            made.patch[made.copies] = l->patch;
            made.normal[made.copies++] = r->normal[l->source];
            made.border[l->patch] += m->in->half[l->source];
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
static void connect_patches(merging *m)
{
    const curve_samples *r = m->samples;
    sets_reset(m->joined, m->in->patch_count);
    for (size_t k = 1; k < r->copies; k++)
        if (r->place[k] == r->place[k - 1]) sets_join(m->joined, r->patch[k], r->patch[k - 1]);
    for (uint32_t k = 0; k < m->in->patch_count; k++) m->joined[k] = sets_root(m->joined, k);
}

bool near_curves_merge(const near_curves_input *in, curve_samples *samples, error *e)
{
    merging m = {.in = in, .samples = samples};
    if (samples->count == 0) return true;
    const vec3 size = bbox_size(bbox_of_points(samples->position, samples->count, NULL));
    m.axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    m.segments = mem_array(samples->count + 2 * in->curve_count, sizeof *m.segments, what, e);
    m.segments_of = mem_array(samples->count, sizeof *m.segments_of, what, e);
    m.target = mem_array(samples->count, sizeof *m.target, what, e);
    m.ends = mem_array(samples->count, sizeof *m.ends, what, e);
    m.first_copy = mem_array(samples->count + 1, sizeof *m.first_copy, what, e);
    m.first_new = mem_array(samples->count + 1, sizeof *m.first_new, what, e);
    m.joined = mem_array(in->patch_count, sizeof *m.joined, what, e);
    bool ok = m.segments && m.segments_of && m.target && m.ends && m.first_copy && m.first_new && m.joined;
    if (ok) {
        connect_patches(&m);
        for (size_t k = 0; k < samples->copies; k++) m.first_copy[samples->place[k] + 1] = k + 1;
        for (size_t k = 1; k <= samples->count; k++)
            if (m.first_copy[k] < m.first_copy[k - 1]) m.first_copy[k] = m.first_copy[k - 1];
        list_segments(&m);
        ok = build_trees(&m, e) && merge_all(&m, e) && rebuild(&m, e);
    }
    free(m.segments);
    free(m.segments_of);
    for (size_t k = 0; m.component && k < in->patch_count; k++) box_tree_free(&m.component[k].tree);
    free(m.component);
    free(m.box);
    free(m.at);
    free(m.found);
    free(m.target);
    free(m.ends);
    free(m.first_copy);
    free(m.first_new);
    free(m.joined);
    free(m.new_copies);
    return ok;
}

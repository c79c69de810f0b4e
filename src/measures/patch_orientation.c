#include "measures/patch_orientation.h"

#include <stdlib.h>

#include "base/memory.h"
#include "triangles/orientation.h"

static const char what[] = "the orientation of patches";

/* An edge of one triangle of its patch, from the end that comes first by its coordinates. */
typedef struct open_edge {
    vec3 from, to;
    uint32_t patch;
    bool forwards; /* the triangle runs along it from `from` to `to` */
} open_edge;

static int compare_places(vec3 a, vec3 b)
{
    for (int axis = 0; axis < 3; axis++) {
        const double p = vec3_get(a, axis), q = vec3_get(b, axis);
        if (p != q) return p < q ? -1 : 1;
    }
    return 0;
}

static int compare_edges(const void *a, const void *b)
{
    const open_edge *p = a, *q = b;
    const int from = compare_places(p->from, q->from), to = compare_places(p->to, q->to);
    return from != 0 ? from : to != 0 ? to : p->patch < q->patch ? -1 : p->patch > q->patch;
}

/* The half-edges of each vertex, by its number. */
typedef struct half_edges {
    size_t vertices;
    size_t *first; /* vertices + 1 */
    uint32_t *to;  /* the other vertex of each */
} half_edges;

static bool list_half_edges(const facets_input *in, half_edges *h, error *e)
{
    const uint32_t *corner = &in->triangle[0][0];
    const size_t count = 3 * in->triangle_count;
    *h = (half_edges){0};
    for (size_t k = 0; k < count; k++)
        h->vertices = corner[k] + (size_t)1 > h->vertices ? corner[k] + (size_t)1 : h->vertices;
    h->first = mem_array(h->vertices + 2, sizeof *h->first, what, e);
    h->to = h->first ? mem_array(count, sizeof *h->to, what, e) : NULL;
    if (!h->to) return false;
    for (size_t k = 0; k < count; k++) h->first[corner[k] + 2]++;
    for (size_t v = 0; v < h->vertices; v++) h->first[v + 2] += h->first[v + 1];
    for (size_t k = 0; k < count; k++)
        h->to[h->first[corner[k] + 1]++] = in->triangle[k / 3][(k % 3 + 1) % 3];
    return true;
}

static bool has_half_edge(const half_edges *h, uint32_t from, uint32_t to)
{
    for (size_t k = h->first[from]; k < h->first[from + 1]; k++)
        if (h->to[k] == to) return true;
    return false;
}

/* Triangles of a patch agree, so an edge is open if no triangle runs along it the other way. */
static size_t list_open_edges(const facets_input *in, const half_edges *h, open_edge *out)
{
    size_t count = 0;
    for (uint32_t p = 0; p < in->patch_count; p++)
        for (size_t k = in->patch_first[p]; k < in->patch_first[p + 1]; k++)
            for (int c = 0; c < 3; c++) {
                const uint32_t a = in->triangle[k][c], b = in->triangle[k][(c + 1) % 3];
                if (has_half_edge(h, b, a)) continue;
                const bool forwards = compare_places(in->vertex[a], in->vertex[b]) < 0;
                if (out)
                    out[count] =
                        (open_edge){in->vertex[forwards ? a : b], in->vertex[forwards ? b : a], p, forwards};
                count++;
            }
    return count;
}

static void join_patches(orientation *o, const open_edge *edge, size_t count)
{
    for (size_t k = 0, next; k < count; k = next) {
        for (next = k + 1; next < count && compare_places(edge[next].from, edge[k].from) == 0 &&
                           compare_places(edge[next].to, edge[k].to) == 0;)
            next++;
        if (next - k == 2 && edge[k].patch != edge[k + 1].patch)
            orientation_join(o, edge[k].patch, edge[k + 1].patch, edge[k].forwards == edge[k + 1].forwards);
    }
}

bool patch_orientation_find(const facets_input *in, bool *turned, error *e)
{
    half_edges h;
    orientation o = {0};
    open_edge *edge = NULL;
    bool ok = list_half_edges(in, &h, e) && orientation_init(&o, in->patch_count, e);
    const size_t count = ok ? list_open_edges(in, &h, NULL) : 0;
    ok = ok && (edge = mem_array(count, sizeof *edge, what, e)) != NULL;
    if (ok) {
        list_open_edges(in, &h, edge);
        qsort(edge, count, sizeof *edge, compare_edges);
        join_patches(&o, edge, count);
        for (uint32_t p = 0; p < in->patch_count; p++) orientation_find(&o, p, &turned[p]);
    }
    free(edge);
    orientation_free(&o);
    free(h.first);
    free(h.to);
    return ok;
}

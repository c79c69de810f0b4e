#include "triangles/flat_triangles.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

#define NONE UINT32_MAX

static const char what[] = "the triangles without area of the mesh";

/* Unit roundoffs of floats and doubles. */
static const double of_float = 0x1p-24, of_double = 0x1p-53;
/* Operations with rounding in an affine map of a coordinate: three products, three sums. */
static const double map_operations = 6;
/* Triangles in a chunk of work. */
enum { CHUNK = 4096 };

/* Coordinates of the mesh are off by `absolute` plus `relative` times themselves. */
typedef struct rounding {
    double absolute, relative;
} rounding;

typedef struct looking {
    const mesh *m;
    rounding r;
    atomic_bool found;      /* some triangle is flat */
    atomic_bool has_double; /* some coordinate is no float */
} looking;

typedef struct entry {
    double length2; /* of the triangle's longest side */
    uint32_t triangle;
} entry;

/* Corner c is corner c % 3 of triangle c / 3. The corners at each vertex are a list, linked both ways. */
typedef struct removing {
    mesh *m;
    rounding r;
    size_t triangle_room;
    uint32_t *next, *previous; /* of each corner */
    size_t next_room, previous_room;
    uint32_t *head, *degree; /* of each vertex: its first corner, and how many it has */
    bool *dead;              /* of each triangle */
    size_t dead_room;
    entry *heap; /* flat triangles, the one of the longest side first */
    size_t count, room;
} removing;

static double largest_coordinate(vec3 v)
{
    return fmax(fabs(v.x), fmax(fabs(v.y), fabs(v.z)));
}

/* How far from a line three points can be that are rounded places of the line. Each point is off by sqrt(3) times what its coordinates
 * are off, and the line by as much as the points on it. */
static double line_error(const rounding *r, const vec3 corner[3])
{
    const double largest = fmax(largest_coordinate(corner[0]),
                                fmax(largest_coordinate(corner[1]), largest_coordinate(corner[2])));
    return 2 * sqrt(3) * (r->absolute + r->relative * largest);
}

static void corners_of(const mesh *m, const uint32_t t[3], vec3 corner[3])
{
    for (int k = 0; k < 3; k++) corner[k] = m->vertex[t[k]];
}

static bool is_same(vec3 a, vec3 b)
{
    return a.x == b.x && a.y == b.y && a.z == b.z;
}

/* Whether three distinct corners lie on a line to within `allowed`. Side k begins at corner k. */
static bool is_flat(const vec3 corner[3], double allowed, int *longest, double *length2, int *shortest,
                    double *least2)
{
    if (is_same(corner[0], corner[1]) || is_same(corner[1], corner[2]) || is_same(corner[2], corner[0]))
        return false;
    *length2 = 0;
    *least2 = INFINITY;
    for (int k = 0; k < 3; k++) {
        const double side2 = vec3_norm2(vec3_sub(corner[(k + 1) % 3], corner[k]));
        if (side2 > *length2) {
            *length2 = side2;
            *longest = k;
        }
        if (side2 < *least2) {
            *least2 = side2;
            *shortest = k;
        }
    }
    const vec3 across = vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0]));
    return vec3_norm2(across) <= allowed * allowed * *length2;
}

/* ---- whether there are any */

static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    looking *l = context;
    bool found = false;
    (void)worker;
    for (size_t n = begin; n < end && !found; n++) {
        vec3 corner[3];
        int longest, shortest;
        double length2, least2;
        corners_of(l->m, l->m->triangle[n], corner);
        found = is_flat(corner, line_error(&l->r, corner), &longest, &length2, &shortest, &least2);
    }
    if (found) atomic_store_explicit(&l->found, true, memory_order_relaxed);
}

/* Through memory: gcc 12 drops the two conversions where it takes coordinates together. */
static bool is_float(double value)
{
    const volatile float rounded = (float)value;
    return (double)rounded == value;
}

static void precision_chunk(void *context, int worker, size_t begin, size_t end)
{
    looking *l = context;
    bool floats = true;
    (void)worker;
    for (size_t n = begin; n < end && floats; n++)
        for (int k = 0; k < 3; k++) {
            const vec3 v = l->m->vertex[l->m->triangle[n][k]];
            floats &= is_float(v.x) && is_float(v.y) && is_float(v.z);
        }
    if (!floats) atomic_store_explicit(&l->has_double, true, memory_order_relaxed);
}

static bool look(looking *l, threads *pool)
{
    atomic_store(&l->found, false);
    threads_run(pool, l->m->triangle_count, CHUNK, look_chunk, l);
    return l->found;
}

/* Coordinates may have been computed in doubles, by a map of the whole. If all are floats, they were rounded to these. */
static bool find_flat(looking *l, threads *pool)
{
    const bbox box = mesh_box(l->m, pool);
    const double largest = fmax(largest_coordinate(box.min), largest_coordinate(box.max));
    l->r = (rounding){.absolute = map_operations * of_double * largest, .relative = of_float};
    if (!look(l, pool)) return false; /* as for most meshes */
    threads_run(pool, l->m->triangle_count, CHUNK, precision_chunk, l);
    if (!l->has_double) return true;
    l->r.relative = 0;
    return look(l, pool);
}

/* ---- the mesh with its lists */

static void link_corner(removing *r, uint32_t c)
{
    const uint32_t v = r->m->triangle[c / 3][c % 3], first = r->head[v];
    r->next[c] = first;
    r->previous[c] = NONE;
    if (first != NONE) r->previous[first] = c;
    r->head[v] = c;
    r->degree[v]++;
}

static void unlink_corner(removing *r, uint32_t c)
{
    const uint32_t v = r->m->triangle[c / 3][c % 3], next = r->next[c], previous = r->previous[c];
    if (next != NONE) r->previous[next] = previous;
    if (previous != NONE)
        r->next[previous] = next;
    else
        r->head[v] = next;
    r->degree[v]--;
}

static void drop(removing *r, uint32_t t)
{
    for (uint32_t k = 0; k < 3; k++) unlink_corner(r, 3 * t + k);
    r->dead[t] = true;
}

static bool comes_before(entry a, entry b)
{
    return a.length2 > b.length2 || (a.length2 == b.length2 && a.triangle < b.triangle);
}

static bool push(removing *r, entry added, error *e)
{
    entry *heap = mem_grow(r->heap, r->count, &r->room, 256, sizeof *heap, what, e);
    if (!heap) return false;
    r->heap = heap;
    size_t k = r->count++;
    for (; k > 0 && comes_before(added, heap[(k - 1) / 2]); k = (k - 1) / 2) heap[k] = heap[(k - 1) / 2];
    heap[k] = added;
    return true;
}

static entry pop(removing *r)
{
    const entry first = r->heap[0], last = r->heap[--r->count];
    size_t k = 0, child;
    while ((child = 2 * k + 1) < r->count) {
        child += child + 1 < r->count && comes_before(r->heap[child + 1], r->heap[child]);
        if (!comes_before(r->heap[child], last)) break;
        r->heap[k] = r->heap[child];
        k = child;
    }
    r->heap[k] = last;
    return first;
}

/* What a triangle is now. */
typedef struct shape {
    bool flat;
    int longest, shortest;
    double length2, least2, error;
} shape;

static shape shape_of(const removing *r, uint32_t t)
{
    shape s = {0};
    vec3 corner[3];
    corners_of(r->m, r->m->triangle[t], corner);
    s.error = line_error(&r->r, corner);
    s.flat = is_flat(corner, s.error, &s.longest, &s.length2, &s.shortest, &s.least2);
    return s;
}

static bool push_if_flat(removing *r, uint32_t t, error *e)
{
    const shape s = shape_of(r, t);
    return !s.flat || push(r, (entry){s.length2, t}, e);
}

/* ---- removing one */

static bool add_triangle(removing *r, const uint32_t corner[3], uint32_t *number, error *e)
{
    const size_t n = r->m->triangle_count;
    if (n + 1 >= UINT32_MAX / 3)
        return error_set(e, ERROR_INPUT_UNSUPPORTED, "too many triangles for 32 bits");
    uint32_t(*triangle)[3] = mem_grow(r->m->triangle, n, &r->triangle_room, 256, sizeof *triangle, what, e);
    if (!triangle) return false;
    r->m->triangle = triangle;
    for (int side = 0; side < 2; side++) {
        uint32_t **links = side ? &r->previous : &r->next;
        size_t *room = side ? &r->previous_room : &r->next_room;
        for (size_t k = 0; k < 3; k++) {
            uint32_t *larger = mem_grow(*links, 3 * n + k, room, 768, sizeof *larger, what, e);
            if (!larger) return false;
            *links = larger;
        }
    }
    bool *dead = mem_grow(r->dead, n, &r->dead_room, 256, sizeof *dead, what, e);
    if (!dead) return false;
    r->dead = dead;
    r->dead[n] = false;
    memcpy(triangle[n], corner, sizeof *triangle);
    r->m->triangle_count++;
    *number = (uint32_t)n;
    for (uint32_t k = 0; k < 3; k++) link_corner(r, 3 * *number + k);
    return true;
}

static int corner_at(const uint32_t t[3], uint32_t v)
{
    return t[0] == v ? 0 : t[1] == v ? 1 : t[2] == v ? 2 : -1;
}

/* Triangle t, which has the side from a to b, in whichever direction, becomes two that meet at m. */
static bool split(removing *r, uint32_t t, uint32_t a, uint32_t b, uint32_t m, error *e)
{
    uint32_t *corner = r->m->triangle[t], second[3], added = 0;
    memcpy(second, corner, sizeof second);
    second[corner_at(second, a)] = m;
    const uint32_t c = 3 * t + (uint32_t)corner_at(corner, b);
    unlink_corner(r, c);
    corner[c % 3] = m;
    link_corner(r, c);
    return add_triangle(r, second, &added, e) && push_if_flat(r, t, e) && push_if_flat(r, added, e);
}

/* Corner m of triangle t lies on the side from a to b. */
static bool split_neighbours(removing *r, uint32_t t, uint32_t a, uint32_t b, uint32_t m, error *e)
{
    if (r->degree[a] > r->degree[b]) {
        const uint32_t swap = a;
        a = b;
        b = swap;
    }
    drop(r, t);
    for (uint32_t c = r->head[a], next; c != NONE; c = next) {
        const uint32_t other = c / 3;
        const uint32_t *corner = r->m->triangle[other];
        next = r->next[c];
        if (corner_at(corner, b) < 0) continue;
        if (corner_at(corner, m) >= 0) /* the same triangle once more */
            drop(r, other);
        else if (!split(r, other, a, b, m, e))
            return false;
    }
    return true;
}

/* Vertex `from` becomes vertex `to`. */
static bool collapse(removing *r, uint32_t to, uint32_t from, error *e)
{
    while (r->head[from] != NONE) {
        const uint32_t c = r->head[from], t = c / 3;
        if (corner_at(r->m->triangle[t], to) >= 0) {
            drop(r, t);
            continue;
        }
        unlink_corner(r, c);
        r->m->triangle[t][c % 3] = to;
        link_corner(r, c);
        if (!push_if_flat(r, t, e)) return false;
    }
    return true;
}

static bool remove_one(removing *r, uint32_t t, const shape *s, error *e)
{
    const uint32_t *corner = r->m->triangle[t];
    if (s->least2 <= s->error * s->error) {
        const uint32_t a = corner[s->shortest], b = corner[(s->shortest + 1) % 3];
        return r->degree[a] < r->degree[b] ? collapse(r, b, a, e) : collapse(r, a, b, e);
    }
    return split_neighbours(r, t, corner[s->longest], corner[(s->longest + 1) % 3],
                            corner[(s->longest + 2) % 3], e);
}

/* Each removal takes away a longest side, and no longer one comes of it unless a neighbour is as thin. `most` bounds the removals
 * where rounding leads in circles. */
static bool remove_all(removing *r, size_t most, error *e)
{
    while (r->count > 0 && most-- > 0) {
        const entry first = pop(r);
        if (r->dead[first.triangle]) continue;
        const shape s = shape_of(r, first.triangle);
        if (!s.flat || s.length2 != first.length2) continue; /* it has changed, and has another entry */
        if (!remove_one(r, first.triangle, &s, e)) return false;
    }
    return true;
}

/* ---- the whole */

static bool begin(removing *r, size_t *flat, error *e)
{
    const mesh *m = r->m;
    r->triangle_room = r->dead_room = m->triangle_count;
    r->next_room = r->previous_room = 3 * m->triangle_count;
    r->next = mem_array(r->next_room, sizeof *r->next, what, e);
    r->previous = mem_array(r->previous_room, sizeof *r->previous, what, e);
    r->head = mem_array(m->vertex_count, sizeof *r->head, what, e);
    r->degree = mem_array(m->vertex_count, sizeof *r->degree, what, e);
    r->dead = mem_array(m->triangle_count, sizeof *r->dead, what, e);
    if (!r->next || !r->previous || !r->head || !r->degree || !r->dead) return false;
    memset(r->head, 0xFF, m->vertex_count * sizeof *r->head);
    for (uint32_t t = 0; t < m->triangle_count; t++) {
        const uint32_t *corner = m->triangle[t];
        if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0]) continue;
        for (uint32_t k = 0; k < 3; k++) link_corner(r, 3 * t + k);
        if (!push_if_flat(r, t, e)) return false;
    }
    *flat = r->count;
    return true;
}

/* Drops what is dead. Order is kept. */
static void end(removing *r)
{
    size_t kept = 0;
    for (size_t t = 0; t < r->m->triangle_count; t++)
        if (!r->dead[t]) memmove(r->m->triangle[kept++], r->m->triangle[t], sizeof r->m->triangle[0]);
    r->m->triangle_count = kept;
}

static bool remove_flat(mesh *m, const rounding *rounded, mesh_notes *notes, error *e)
{
    enum { ROUNDS = 32, ROUNDS_MORE = 1024 };
    removing r = {.m = m, .r = *rounded};
    const size_t all = m->triangle_count;
    size_t flat = 0;
    const bool ok = begin(&r, &flat, e) && remove_all(&r, ROUNDS * flat + ROUNDS_MORE, e);
    if (r.dead) end(&r);
    free(r.next);
    free(r.previous);
    free(r.head);
    free(r.degree);
    free(r.dead);
    free(r.heap);
    if (ok && flat)
        mesh_note(
            notes,
            "%zu of %zu triangles have no area: their corners lie on a line to within rounding. They are "
            "removed, and their neighbours are joined; repair the mesh to have it as it is.",
            flat, all);
    return ok;
}

bool flat_triangles_remove(mesh *m, threads *pool, mesh_notes *notes, error *e)
{
    looking l = {.m = m};
    const bool found = m->triangle_count > 0 && find_flat(&l, pool);
    if (threads_stopped(pool)) return error_set(e, ERROR_CANCELLED, "stopped");
    return !found || (mesh_join(m, pool, e) && remove_flat(m, &l.r, notes, e));
}

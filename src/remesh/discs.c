#include "remesh/discs.h"

#include <stdlib.h>

#include "base/memory.h"

static const char what[] = "the triangles around vertices";

/* The side of a triangle opposite to one of its vertices. */
typedef struct opposite {
    uint32_t from, to;
} opposite;

/* The sides opposite of a vertex lead from one to the next: each begins where another ends, and all are passed on the way round. */
static bool is_closed_fan(const opposite *side, size_t count)
{
    size_t at = 0, passed = 0;
    do {
        size_t k = 0, found = 0;
        for (size_t other = 0; other < count; other++)
            if (side[other].from == side[at].to) {
                k = other;
                found++;
            }
        if (found != 1) return false;
        at = k;
        passed++;
    } while (at != 0 && passed < count);
    return at == 0 && passed == count;
}

bool discs_find(const uint32_t (*triangle)[3], size_t count, size_t names, bool *disc, error *e)
{
    size_t *first = mem_array(names + 2, sizeof *first, what, e);
    opposite *side = mem_array(3 * count, sizeof *side, what, e);
    const bool ok = first && side;
    for (size_t c = 0; ok && c < 3 * count; c++) first[triangle[c / 3][c % 3] + 2]++;
    for (size_t v = 2; ok && v < names + 2; v++) first[v] += first[v - 1];
    for (size_t c = 0; ok && c < 3 * count; c++) {
        const uint32_t *t = triangle[c / 3];
        side[first[t[c % 3] + 1]++] = (opposite){t[(c + 1) % 3], t[(c + 2) % 3]};
    }
    for (size_t v = 0; ok && v < names; v++)
        disc[v] = first[v + 1] > first[v] && is_closed_fan(side + first[v], first[v + 1] - first[v]);
    free(first);
    free(side);
    return ok;
}

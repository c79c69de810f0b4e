// SPDX-License-Identifier: Apache-2.0
#include "job/phases/snapshot.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "geometry/space/even_subset.h"
#include "io/points/ply.h"
#include "job/phases/upright.h"

/* Time before the first snapshot and between two. Writing one takes about 20 ms of CPU time at most, 1 % of this. */
static const int64_t INTERVAL_MS = 2000;
/* The maximum number of points that are all written: 5.6 MB, which takes 10 ms. */
static const size_t POINTS_MOST = 100000;
/* The number of points that are chosen of more: choosing them takes 8 to 15 ms. */
static const size_t POINTS_OF_MORE = 30000;

void snapshot_begin(snapshot *w, const char *directory)
{
    *w = (snapshot){.due_ms = clock_monotonic_ms() + INTERVAL_MS};
    if (!directory) return;
    w->path = mem_printf("%s/" WORKER_SNAPSHOT_NAME, directory);
    w->temporary = mem_printf("%s/" SNAPSHOT_PART_NAME, directory);
}

/* Particles of a snapshot. The caller frees `position`, whose array includes `normal`, and `spacing`. */
typedef struct selection {
    size_t count;
    vec3 *position, *normal;
    double *spacing; /* of hexagonal packings whose discs are those of the selected particles */
} selection;

/* Selects all particles, or an even subset. The spacing of a subset is that of discs which cover the surface. False: out
 * of memory. */
static bool select_particles(const solver_particles *p, const source *from, selection *out)
{
    error why = {0};
    even_subset subset = {.count = p->count};
    const even_subset_points all = {p->count, p->position, p->normal, p->spacing, p->size};
    if (p->count > POINTS_MOST && !even_subset_choose(&all, POINTS_OF_MORE, &subset, &why)) return false;
    const double spacing = subset.chosen ? sqrt(3) * subset.reach : p->spacing;
    out->count = subset.count;
    out->position = mem_array(out->count, 2 * sizeof *out->position, "a snapshot", &why);
    out->spacing = mem_array(out->count, sizeof *out->spacing, "a snapshot", &why);
    const bool ok = out->position && out->spacing;
    out->normal = out->position + out->count;
    for (size_t k = 0; ok && k < out->count; k++) {
        const size_t i = subset.chosen ? subset.chosen[k] : k;
        const vec3 x = p->position[i], n = p->normal[i];
        out->position[k] = from->turned ? placement_to_world(from->turned, x) : x;
        out->normal[k] = from->turned ? placement_turn_normal(from->turned, n) : n;
        out->spacing[k] = spacing * (p->size ? p->size[i] : 1);
    }
    free(subset.chosen);
    return ok;
}

static bool write_ply(FILE *file, const solver_particles *p, const points *set, bool y_up)
{
    static const char *const names[] = {"nx", "ny", "nz", "spacing"};
    columns what;
    error e = {0};
    char *comments = mem_printf("comment up %c\ncomment particles %zu\n", y_up ? 'y' : 'z', p->count);
    const bool ok = columns_choose(set, names, sizeof names / sizeof *names, &what, &e) &&
                    ply_write(file, set, &what, PLY_BINARY_LITTLE_ENDIAN, PLY_DOUBLE, comments, NULL, &e);
    free(comments);
    return ok;
}

static void write_file(const snapshot *w, const solver_particles *p, const points *set, bool y_up)
{
    FILE *file = fopen(w->temporary, "we");
    if (!file) return;
    bool ok = write_ply(file, p, set, y_up);
    ok &= fclose(file) == 0;
    if (!ok || rename(w->temporary, w->path) != 0) unlink(w->temporary);
}

void snapshot_offer(snapshot *w, const solver *s, const source *from, const spec *asked)
{
    if (!w->path || clock_monotonic_ms() < w->due_ms) return;
    const solver_particles p = solver_current_particles(s);
    selection chosen = {0};
    if (p.count > 0 && select_particles(&p, from, &chosen)) {
        const points set = {.count = chosen.count,
                            .position = chosen.position,
                            .normal = chosen.normal,
                            .spacing = chosen.spacing,
                            .spacing_local = chosen.spacing};
        write_file(w, &p, &set, upright_y(asked, &set));
    }
    free(chosen.position);
    free(chosen.spacing);
    w->due_ms = clock_monotonic_ms() + INTERVAL_MS;
}

/* In this order, a rename by another thread between the two calls leaves no file. */
void snapshot_end(const snapshot *w)
{
    if (!w->path) return;
    unlink(w->temporary);
    unlink(w->path);
}

void snapshot_free(snapshot *w)
{
    free(w->path);
    free(w->temporary);
    *w = (snapshot){0};
}

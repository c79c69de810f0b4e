// SPDX-License-Identifier: Apache-2.0
#include "job/phases/snapshot.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "io/points/ply.h"
#include "job/phases/upright.h"

/* Time before the first snapshot and between two. Writing one takes about 20 ms of CPU time at most, 1 % of this. */
static const int64_t INTERVAL_MS = 2000;
/* Maximum number of points: 5.6 MB. */
static const size_t POINTS_MOST = 100000;

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
    double *spacing; /* between the selected particles */
} selection;

/* Selects every step-th particle. False: out of memory. */
static bool select_particles(const solver_particles *p, const source *from, selection *out)
{
    error why = {0};
    const size_t step = (p->count + POINTS_MOST - 1) / POINTS_MOST, count = (p->count + step - 1) / step;
    *out = (selection){.count = count};
    out->position = mem_array(count, 2 * sizeof *out->position, "a snapshot", &why);
    out->spacing = mem_array(count, sizeof *out->spacing, "a snapshot", &why);
    if (!out->position || !out->spacing) return false;
    out->normal = out->position + count;
    for (size_t i = 0; i < count; i++) {
        const vec3 x = p->position[i * step], n = p->normal[i * step];
        out->position[i] = from->turned ? placement_to_world(from->turned, x) : x;
        out->normal[i] = from->turned ? placement_turn_normal(from->turned, n) : n;
        out->spacing[i] = p->spacing * (p->size ? p->size[i * step] : 1) * sqrt((double)step);
    }
    return true;
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

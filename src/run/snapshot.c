#include "run/snapshot.h"

#include <endian.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/memory.h"
#include "run/upright.h"

/* Time between two snapshots, and before the first one. Writing one takes about 4 ms of CPU time, which is 0.2 % of this. */
static const int64_t INTERVAL_MS = 2000;
/* At most this number of points is written: 0.8 MB. */
static const size_t POINTS_MOST = 20000;

void snapshot_begin(snapshot *w, const char *directory)
{
    *w = (snapshot){.due_ms = clock_monotonic_ms() + INTERVAL_MS};
    if (!directory) return;
    w->path = mem_printf("%s/" WORKER_SNAPSHOT_NAME, directory);
    w->temporary = mem_printf("%s/" SNAPSHOT_PART_NAME, directory);
}

/* Particles of a snapshot; `position`, which holds `normal`, and `spacing` are to be freed. */
typedef struct selection {
    size_t count;
    vec3 *position, *normal;
    double *spacing; /* between the selected particles */
} selection;

/* Selects every step-th particle. False: there is no memory for them. */
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

static void put_double(FILE *file, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits = htole64(bits);
    fwrite(&bits, sizeof bits, 1, file);
}

static void put_float(FILE *file, double value)
{
    const float narrow = (float)value;
    uint32_t bits;
    memcpy(&bits, &narrow, sizeof bits);
    bits = htole32(bits);
    fwrite(&bits, sizeof bits, 1, file);
}

static void write_ply(FILE *file, const solver_particles *p, const selection *s, bool y_up)
{
    fprintf(
        file,
        "ply\nformat binary_little_endian 1.0\ncomment up %c\ncomment particles %zu\nelement vertex %zu\n",
        y_up ? 'y' : 'z', p->count, s->count);
    for (const char *c = "xyz"; *c; c++) fprintf(file, "property double %c\n", *c);
    for (const char *c = "xyz"; *c; c++) fprintf(file, "property float n%c\n", *c);
    fputs("property float spacing\nend_header\n", file);
    for (size_t i = 0; i < s->count; i++) {
        for (int k = 0; k < 3; k++) put_double(file, vec3_get(s->position[i], k));
        for (int k = 0; k < 3; k++) put_float(file, vec3_get(s->normal[i], k));
        put_float(file, s->spacing[i]);
    }
}

static void write_file(const snapshot *w, const solver_particles *p, const selection *s, bool y_up)
{
    FILE *file = fopen(w->temporary, "we");
    if (!file) return;
    write_ply(file, p, s, y_up);
    bool ok = !ferror(file);
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
                            .spacing_local = chosen.spacing};
        write_file(w, &p, &chosen, upright_y(asked, &set));
    }
    free(chosen.position);
    free(chosen.spacing);
    w->due_ms = clock_monotonic_ms() + INTERVAL_MS;
}

/* In this order: a rename that comes between the two leaves nothing. */
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

// SPDX-License-Identifier: Apache-2.0
/* calls THREADS JOBS: runs many small jobs of libhexad, some of which fail or are cancelled, in several threads, for
 * valgrind and the sanitizers. It also mutates the descriptions of the arrays: `calls fuzz SEED SECONDS`, and runs the jobs
 * under locales and floating-point environments of a host: `calls host LOCALE`. Exits with 1 if a result is not as expected. */
#include <fenv.h>
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <hexad.h>

/* Arrays that are too large fail with limit_memory, as without a sanitizer. */
const char *__asan_default_options(void);
const char *__asan_default_options(void)
{
    return "allocator_may_return_null=1";
}

enum { SIDE = 12, VALUES = SIDE * SIDE * SIDE };

static const double octahedron[6][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
static const int32_t faces_of[8][3] = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                                       {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
static float ball[VALUES];
static unsigned char halves[VALUES];

static void make_volumes(void)
{
    for (int k = 0; k < VALUES; k++) {
        const double x = k / (SIDE * SIDE) - 5.5, y = k / SIDE % SIDE - 5.5, z = k % SIDE - 5.5;
        ball[k] = (float)(16 - x * x - y * y - z * z);
        halves[k] = x < 0.1 * y;
    }
}

static hexad_array grid_of(const void *data, hexad_type type, ptrdiff_t bytes)
{
    const hexad_array a = {data, type, 3, {SIDE, SIDE, SIDE}, {SIDE * SIDE * bytes, SIDE * bytes, bytes}};
    return a;
}

typedef struct expected {
    const char *spec;
    const char *code; /* "none": the job succeeds */
} expected;

static const expected jobs[] = {
    {"{\"surface\": {\"mesh\": {\"path\": \"a\"}}, \"sampling\": {\"count\": 200}, \"solver\": {\"threads\": 2}}",
     "none"},
    {"{\"surface\": {\"mesh\": {\"path\": \"a\", \"resolution\": 24}}, \"sampling\": {\"count\": 100}}",
     "none"},
    {"{\"surface\": {\"volume\": {\"path\": \"a\", \"isovalue\": 0}}, \"sampling\": {\"count\": 150}, \"output\": "
     "{\"mesh\": true}}",
     "none"},
    {"{\"surface\": {\"labels\": {\"path\": \"a\"}}, \"sampling\": {\"count\": 80}}", "none"},
    {"{\"surface\": {\"analytic\": {\"shape\": \"torus\", \"major_radius\": 1, \"minor_radius\": 0.3}}, \"sampling\": "
     "{\"count\": 200, \"pattern\": \"blue_noise\"}, \"output\": {\"order\": \"progressive\", \"orient\": true}}",
     "none"},
    {"{\"surface\": {\"mesh\": {\"path\": \"a\"}}, \"sampling\": {\"count\": 1}}", "spec_invalid"},
    {"{\"surface\": {\"mesh\": {\"path\": \"a\"}}", "spec_invalid"},
    {"{\"surface\": {\"volume\": {\"path\": \"a\", \"isovalue\": 100}}, \"sampling\": {\"count\": 50}}",
     "no_surface"},
    {"{\"surface\": {\"analytic\": {\"shape\": \"sphere\", \"radius\": 1}}, \"sampling\": {\"count\": 100}, "
     "\"output\": {\"points_npz\": true}}",
     "not_supported"},
    {"{\"surface\": {\"analytic\": {\"shape\": \"sphere\", \"radius\": 1}}, \"sampling\": {\"count\": 9000000}, "
     "\"limits\": {\"memory_mb\": 64}}",
     "limit_memory"},
    {"{\"surface\": {\"analytic\": {\"shape\": \"sphere\", \"radius\": 1}}, \"sampling\": {\"count\": 9000000}, "
     "\"limits\": {\"timeout_s\": 0.01}}",
     "limit_time"},
    {"{\"surface\": {\"analytic\": {\"shape\": \"sphere\", \"radius\": 1}}, \"sampling\": {\"count\": 9000000}}",
     "cancelled"},
};
enum { KINDS = sizeof jobs / sizeof *jobs };

/* Adds the array that the spec names. */
static int add_input(hexad_job *job, const char *spec, hexad_error *e)
{
    const hexad_array vertices = hexad_array_2d(octahedron, HEXAD_FLOAT64, 6, 3),
                      faces = hexad_array_2d(faces_of, HEXAD_INT32, 8, 3),
                      volume = grid_of(ball, HEXAD_FLOAT32, sizeof *ball),
                      labels = grid_of(halves, HEXAD_UINT8, 1);
    if (strstr(spec, "\"mesh\": {")) return hexad_job_add_mesh(job, "a", &vertices, &faces, NULL, e);
    if (strstr(spec, "\"volume\"")) return hexad_job_add_grid(job, "a", &volume, NULL, e);
    if (strstr(spec, "\"labels\"")) return hexad_job_add_grid(job, "a", &labels, NULL, e);
    return 0;
}

/* What of the state of its thread a host may set. */
typedef struct host_state {
    int rounding, traps;
    unsigned control; /* of SSE, without flags: also whether subnormals are zero */
    char point;
} host_state;

static host_state state_now(void)
{
    unsigned control = 0;
#ifdef __SSE2__
    control = __builtin_ia32_stmxcsr() & ~(unsigned)FE_ALL_EXCEPT;
#endif
    return (host_state){fegetround(), fegetexcept(), control, *localeconv()->decimal_point};
}

static int is_now(host_state s)
{
    const host_state n = state_now();
    return n.rounding == s.rounding && n.traps == s.traps && n.control == s.control && n.point == s.point;
}

/* What a job returns. */
typedef struct returned {
    char message[1024];
    size_t bytes;
    void *position;
} returned;

typedef struct heard {
    int stop;
    host_state host;
    unsigned long calls, changed;
} heard;

static int check_host(void *context, const char *phase, double fraction)
{
    heard *h = context;
    (void)phase, (void)fraction;
    h->calls++;
    h->changed += !is_now(h->host);
    return h->stop;
}

static int run_one(unsigned k, heard *h, returned *out)
{
    const expected *x = &jobs[k % KINDS];
    hexad_error e;
    hexad_array position;
    hexad_job *job = hexad_job_new(x->spec);
    h->stop = strcmp(x->code, "cancelled") == 0;
    hexad_job_set_progress(job, check_host, h);
    int failed = add_input(job, x->spec, &e) || hexad_job_run(job, &e);
    int ok = strcmp(e.code, x->code) == 0 && failed == (strcmp(x->code, "none") != 0);
    if (!failed)
        ok = ok && hexad_job_array(job, "position", &position) == 0 && position.size[0] >= 80 &&
             hexad_job_report(job);
    if (failed) ok = ok && !hexad_job_report(job) && !hexad_job_array_name(job, 0);
    if (!ok) printf("job %u: %s: %s\n", k % KINDS, e.code, e.message);
    if (out) {
        memcpy(out->message, e.message, sizeof e.message);
        out->bytes = failed ? 0 : 3 * sizeof(double) * position.size[0];
        out->position = malloc(out->bytes + 1);
        if (!failed) memcpy(out->position, position.data, out->bytes);
    }
    hexad_job_free(job);
    return ok;
}

/* ---- the state of the host's thread */

static const char *locale_name;

static int set_nothing(void)
{
    return 1;
}

static int set_locale(void)
{
    return setlocale(LC_ALL, locale_name) != NULL;
}

static locale_t own_locale;

static int set_locale_of_thread(void)
{
    own_locale = newlocale(LC_ALL_MASK, locale_name, (locale_t)0);
    return own_locale && uselocale(own_locale);
}

static int set_upward(void)
{
    return fesetround(FE_UPWARD) == 0;
}

static int set_downward(void)
{
    return fesetround(FE_DOWNWARD) == 0;
}

/* Subnormal results and arguments are zero: FTZ and DAZ. */
static int set_no_subnormals(void)
{
#ifdef __SSE2__
    __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | 0x8040);
#endif
    return 1;
}

static int set_traps(void)
{
    feclearexcept(FE_ALL_EXCEPT);
    return feenableexcept(FE_ALL_EXCEPT) != -1;
}

static int run_as(const char *name, int (*set)(void), const returned *expected, returned *out)
{
    heard h = {0};
    int failed = 0, changed = 0;
    if (!set()) {
        printf("%s: cannot be set\n", name);
        return 1;
    }
    h.host = state_now();
    for (unsigned k = 0; k < KINDS; k++) {
        failed += !run_one(k, &h, &out[k]);
        changed += !is_now(h.host);
    }
    fesetenv(FE_DFL_ENV);
    uselocale(LC_GLOBAL_LOCALE);
    setlocale(LC_ALL, "C");
    for (unsigned k = 0; expected && k < KINDS; k++) {
        const int same = strcmp(out[k].message, expected[k].message) == 0 &&
                         out[k].bytes == expected[k].bytes &&
                         memcmp(out[k].position, expected[k].position, out[k].bytes) == 0;
        if (!same) printf("%s: job %u differs: %s\n", name, k, out[k].message);
        failed += !same;
        free(out[k].position);
    }
    printf("%s: %d not as expected, %d calls of %d and %lu of progress changed the state of the host\n", name,
           failed, changed, KINDS, h.changed);
    return failed > 0 || changed > 0 || h.changed > 0 || h.calls == 0;
}

static int run_hosts(void)
{
    static returned expected[KINDS], out[KINDS];
    int failed = run_as("default", set_nothing, NULL, expected);
    failed += run_as("locale", set_locale, expected, out);
    failed += run_as("locale of the thread", set_locale_of_thread, expected, out);
    if (own_locale) freelocale(own_locale);
    failed += run_as("rounding upward", set_upward, expected, out);
    failed += run_as("rounding downward", set_downward, expected, out);
    failed += run_as("no subnormals", set_no_subnormals, expected, out);
    failed += run_as("traps", set_traps, expected, out);
    for (int k = 0; k < KINDS; k++) free(expected[k].position);
    return failed > 0;
}

typedef struct share {
    pthread_t thread;
    unsigned first, count;
    int failed;
} share;

static void *run_share(void *context)
{
    share *s = context;
    heard h = {.host = state_now()};
    for (unsigned k = 0; k < s->count; k++) s->failed += !run_one(s->first + k, &h, NULL);
    s->failed += h.changed > 0;
    return NULL;
}

static int run_threads(unsigned threads, unsigned count)
{
    share *all = calloc(threads, sizeof *all);
    int failed = 0;
    for (unsigned k = 0; k < threads; k++) {
        all[k].first = k;
        all[k].count = count;
        if (pthread_create(&all[k].thread, NULL, run_share, &all[k])) abort();
    }
    for (unsigned k = 0; k < threads; k++) {
        pthread_join(all[k].thread, NULL);
        failed += all[k].failed;
    }
    free(all);
    printf("%u threads with %u jobs each, %d not as expected\n", threads, count, failed);
    return failed > 0;
}

/* ---- mutated descriptions of arrays: each call must succeed, or fail with a message that names the argument */

static uint64_t state;

static uint64_t draw(uint64_t below)
{
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (state >> 33) % below;
}

/* Memory with numbers of all kinds, among them NaN and large indices. */
enum { POOL = 1 << 16 };
static unsigned char pool[POOL];

static const size_t odd_sizes[] = {0, 1, 2, 3, 4, 7, 12, 64, SIZE_MAX, SIZE_MAX / 2, (size_t)1 << 40};

/* The least and the largest offset of an element lie within the pool: otherwise the caller would be at fault. */
static int is_within(const hexad_array *a)
{
    static const size_t bytes[] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
    double low = 0, high = 0;
    for (int k = 0; k < a->dimensions && k < 3; k++) {
        if (a->size[k] == 0) return 1;
        const double reach = (double)(a->size[k] - 1) * (double)a->stride[k];
        if (reach < 0)
            low += reach;
        else
            high += reach;
    }
    if ((unsigned)a->type > HEXAD_FLOAT64) return 1;
    return low >= -POOL / 2 && high + (double)bytes[a->type] <= POOL / 2;
}

static hexad_array draw_array(int dimensions, size_t width, int is_whole)
{
    hexad_array a = {pool + POOL / 2,
                     (hexad_type)draw(draw(20) ? (is_whole ? 8 : 10) : 30),
                     dimensions,
                     {0, 0, 0},
                     {0, 0, 0}};
    do {
        if (draw(20) == 0) a.dimensions = (int)draw(6) - 1;
        for (int k = 0; k < 3; k++) {
            a.size[k] = draw(8) ? 2 + draw(30) : odd_sizes[draw(sizeof odd_sizes / sizeof *odd_sizes)];
            a.stride[k] = (ptrdiff_t)draw(200) - (draw(4) ? 0 : 100);
            if (draw(200) == 0) a.stride[k] = draw(2) ? PTRDIFF_MIN : PTRDIFF_MAX;
        }
        if (width && draw(10)) a.size[1] = width;
    } while (!is_within(&a) && a.size[0] < 1000 && a.size[1] < 1000 && a.size[2] < 1000);
    if (draw(50) == 0) a.data = NULL;
    return a;
}

static void fill_pool(void)
{
    for (size_t k = 0; k < POOL; k++)
        pool[k] = (unsigned char)(draw(3) ? draw(12) * (k % 8 == 0) : draw(256));
    for (int k = 0; k < 40; k++) {
        const double odd = (const double[]){NAN, 1e300, -1e30, 0.5}[draw(4)];
        memcpy(pool + 8 * draw(POOL / 8), &odd, sizeof odd);
    }
}

static int run_mutated(void)
{
    hexad_error e;
    fill_pool();
    const hexad_array vertices = draw_array(2, 3, 0), values = draw_array(3, 0, 0);
    const int has_counts = draw(2) == 0;
    const hexad_array faces = draw_array(has_counts ? 1 : 2, draw(2) ? 3 : 0, 1),
                      counts = draw_array(1, 0, 1);
    const int which = (int)draw(3);
    const char *spec =
        which == 0
            ? "{\"surface\": {\"mesh\": {\"path\": \"a\"}}, \"sampling\": {\"count\": 50}, \"limits\": "
              "{\"timeout_s\": 1}}"
        : which == 1 ? "{\"surface\": {\"volume\": {\"path\": \"a\", \"isovalue\": 1}}, \"sampling\": "
                       "{\"count\": 50}, \"limits\": {\"timeout_s\": 1}}"
                     : "{\"surface\": {\"analytic\": {\"shape\": \"sphere\", \"radius\": 2}}, \"sampling\": "
                       "{\"count\": 50, \"points\": {\"path\": \"a\"}}, \"limits\": {\"timeout_s\": 1}}";
    hexad_job *job = hexad_job_new(spec);
    const int added = which == 0
                          ? hexad_job_add_mesh(job, "a", &vertices, &faces, has_counts ? &counts : NULL, &e)
                      : which == 1 ? hexad_job_add_grid(job, "a", &values, NULL, &e)
                                   : hexad_job_add_points(job, "a", &vertices, &e);
    int ok = added == 0 || strstr(e.message, "vertices") || strstr(e.message, "faces") ||
             strstr(e.message, "counts") || strstr(e.message, "values") || strstr(e.message, "points");
    if (added == 0 && hexad_job_run(job, &e) != 0) ok = strcmp(e.code, "internal") != 0;
    if (!ok) printf("%s: %s\n", e.code, e.message);
    hexad_job_free(job);
    return ok;
}

static int run_fuzz(uint64_t seed, double seconds)
{
    const time_t end = time(NULL) + (time_t)seconds;
    unsigned long count = 0, failed = 0;
    for (state = seed; time(NULL) < end; count++) failed += !run_mutated();
    printf("seed %llu: %lu mutated calls, %lu not as expected\n", (unsigned long long)seed, count, failed);
    return failed > 0;
}

int main(int argc, char **argv)
{
    make_volumes();
    if (argc == 4 && strcmp(argv[1], "fuzz") == 0)
        return run_fuzz(strtoull(argv[2], NULL, 10), atof(argv[3]));
    if (argc == 3 && strcmp(argv[1], "host") == 0) {
        locale_name = argv[2];
        return run_hosts();
    }
    if (argc != 3) {
        fprintf(stderr, "usage: calls THREADS JOBS | calls fuzz SEED SECONDS | calls host LOCALE\n");
        return 2;
    }
    return run_threads((unsigned)atoi(argv[1]), (unsigned)atoi(argv[2]));
}

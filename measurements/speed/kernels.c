// SPDX-License-Identifier: Apache-2.0
/* What an update of a particle costs: `make bench-kernels`.
 *
 * A hundred thousand particles at rest are swept again and again by one thread, on a formula and on a
 * tricubic field, with each instruction set that the machine has. Beside the nanoseconds stands what an
 * update has to do: its operations (a multiplication, an addition, a division or a root count as one each,
 * in single precision for the forces and in double for the field), the bytes that it touches, and the
 * floor that follows from the machine's own rate of multiplications and additions, measured in the same
 * run. */
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "surface/field/analytic.h"
#include "sampling/solver/level_plan.h"
#include "sampling/solver/passes/relax.h"
#include "sampling/solver/solver.h"
#include "surface/volume/example.h"
#include "surface/volume/volume.h"

enum { COUNT = 100000, SWEEPS = 10, RUNS = 5, FLOPS = 1 << 22, CHAINS = 16, WIDTH = 16 };

/* Of one neighbour, counted in fast_kernel.c; of one sample with its gradient, counted in spline.c and for
 * the torus. */
static const double NEIGHBOUR_OPERATIONS = 69, SPLINE_OPERATIONS = 640, TORUS_OPERATIONS = 60;
/* Of the frame, the damped step and the projection. */
static const double STEP_OPERATIONS = 120;
/* Position, normal, place, size and way; where the list begins and its length, flags, the bin's item. */
static const double OWN_BYTES = 24 + 24 + 16 + 8 + 4 + 4 + 4 + 2 + 4, COEFFICIENT_BYTES = 64 * 4;
static const double SUPPORT_SKIN = 0.2;

static double cpu_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void fail(const error *e)
{
    fprintf(stderr, "bench/kernels: %s\n", e->message);
    exit(1);
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *x, int count)
{
    qsort(x, (size_t)count, sizeof *x, compare);
    return x[count / 2];
}

/* Multiplications and additions a second, in single precision, without waiting for one another. */
ISA_INLINE double rate(void)
{
    float a[CHAINS][WIDTH];
    for (int c = 0; c < CHAINS; c++)
        for (int l = 0; l < WIDTH; l++) a[c][l] = (float)(c + l);
    double begin = cpu_seconds();
    for (int k = 0; k < FLOPS; k++)
        for (int c = 0; c < CHAINS; c++)
            for (int l = 0; l < WIDTH; l++) a[c][l] = a[c][l] * 0.999f + 0.5f;
    double seconds = cpu_seconds() - begin, sum = 0;
    for (int c = 0; c < CHAINS; c++)
        for (int l = 0; l < WIDTH; l++) sum += (double)a[c][l];
    return sum > 0 ? 2.0 * FLOPS * CHAINS * WIDTH / seconds : 0;
}

static double rate_portable(void)
{
    return rate();
}

ISA_TARGET_AVX2 static double rate_avx2(void)
{
    return rate();
}

ISA_TARGET_AVX512 static double rate_avx512(void)
{
    return rate();
}

/* Particles at rest on a field. */
static void settle(const field *f, threads *pool, particles **out, double *spacing)
{
    error e = {0};
    const solver_params params = {.count = COUNT,
                                  .coarse_to_fine = true,
                                  .isa = isa_best(),
                                  .list_limit = SIZE_MAX,
                                  .max_sweeps = 5000,
                                  .step_tolerance = 0.003,
                                  .energy_tolerance = 0.02};
    surface *scan = surface_scan(f, pool, &e);
    solver *s = scan ? solver_new(f, scan, &params, pool, &e) : NULL;
    if (!s) fail(&e);
    while (!solver_ended(s))
        if (!solver_step(s, &e)) fail(&e);
    if (!solver_finalize(s, &e) || !(*out = particles_new(COUNT, &e))) fail(&e);
    const solver_points *p = solver_result_points(s);
    for (size_t i = 0; i < COUNT; i++) {
        (*out)->position[i] = p->position[i];
        (*out)->normal[i] = p->normal[i];
    }
    *spacing = solver_spacing(s);
    solver_free(s);
    surface_free(scan);
}

static void sweep(const char *name, const field *f, isa which, particles *p, double h, threads *pool,
                  double sample, double bytes, double peak)
{
    error e = {0};
    const relax_params params = {
        .field = f, .sigma = sqrt(3) * h, .spacing = h, .omega = 1.2, .fast_step = INFINITY, .gain = 1e-8};
    double update[RUNS], list[RUNS], entries;
    relax_sums sums;
    relax *r = relax_new(COUNT, &energy_cotangent, fast_kernel_for(which), SIZE_MAX, pool, &e);
    if (!r) fail(&e);
    for (int run = 0; run < RUNS; run++) {
        double begin = cpu_seconds();
        if (!relax_build(r, p, params.sigma, SUPPORT_SKIN * h, &e)) fail(&e);
        double built = cpu_seconds();
        for (int k = 0; k < SWEEPS; k++) relax_sweep(r, p, &params, &sums);
        update[run] = 1e9 * (cpu_seconds() - built) / SWEEPS / COUNT;
        list[run] = 1e9 * (built - begin) / COUNT;
    }
    entries = relax_mean_neighbours(r, p, params.sigma + SUPPORT_SKIN * h);
    double operations = entries * NEIGHBOUR_OPERATIONS + sample + STEP_OPERATIONS;
    printf("| %s | %s | %.1f | %.1f | %.1f | %.0f | %.0f | %.1f |\n", name, isa_name(which),
           median(update, RUNS), median(list, RUNS), entries, operations, OWN_BYTES + bytes + 20 * entries,
           1e9 * operations / peak);
    relax_free(r);
}

static void measure(const char *name, const field *(*open)(isa, void **), void (*close_it)(void *),
                    double sample, double bytes, const double *peak)
{
    error e = {0};
    threads *pool = threads_new(1, NULL, &e);
    if (!pool) fail(&e);
    for (isa which = ISA_PORTABLE; which < ISA_COUNT; which++) {
        if (!isa_available(which)) continue;
        void *owner;
        const field *f = open(which, &owner);
        particles *p;
        double h;
        settle(f, pool, &p, &h);
        sweep(name, f, which, p, h, pool, sample, bytes, peak[which]);
        particles_free(p);
        close_it(owner);
    }
    threads_free(pool);
}

static const field *open_formula(isa which, void **owner)
{
    error e = {0};
    const analytic_params torus = {
        .shape = ANALYTIC_TORUS, .axis = {0, 0, 1}, .major_radius = 1, .minor_radius = 0.4};
    (void)which;
    analytic *a = analytic_new(&torus, NULL, &e);
    if (!a) fail(&e);
    *owner = a;
    return &a->base;
}

static void close_formula(void *owner)
{
    analytic_free(owner);
}

static const field *open_tricubic(isa which, void **owner)
{
    error e = {0};
    int fd = memfd_create("example.vdb", 0);
    if (fd < 0 || !example_write(fd, &e)) fail(&e);
    const volume_request request = {.fd = fd, .path = "example.vdb", .memory_limit = SIZE_MAX, .isa = which};
    volume *v = volume_open(&request, &e);
    if (!v) fail(&e);
    close(fd);
    *owner = v;
    return volume_field(v);
}

static void close_tricubic(void *owner)
{
    volume_close(owner);
}

int main(void)
{
    double peak[ISA_COUNT] = {rate_portable(), 0, 0};
    if (isa_available(ISA_AVX2)) peak[ISA_AVX2] = rate_avx2();
    if (isa_available(ISA_AVX512)) peak[ISA_AVX512] = rate_avx512();
    printf("| field | instruction set | ns per update | ns per list | neighbours | operations | bytes | "
           "floor, ns |\n");
    printf("|---|---|---|---|---|---|---|---|\n");
    measure("formula (torus)", open_formula, close_formula, TORUS_OPERATIONS, 0, peak);
    measure("tricubic (level set of a trefoil)", open_tricubic, close_tricubic, SPLINE_OPERATIONS,
            COEFFICIENT_BYTES, peak);
    return 0;
}

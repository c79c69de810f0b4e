// SPDX-License-Identifier: Apache-2.0
/* Neighbour lists against all pairs, and the independence of the colours that threads rely on. */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>
#include <cmocka.h>

#include "sampling/packing/neighbours.h"
#include "shapes.h"

enum { COUNT = 900 };

/* Clumps, coincident points and a far outlier. */
static void awkward_points(vec3 *x, rng *r)
{
    for (int i = 0; i < COUNT; i++) x[i] = random_between(r, (vec3){-2, 1, 5}, (vec3){2, 3, 5.5});
    for (int i = 0; i < 60; i++) x[i] = random_between(r, (vec3){0, 2, 5}, (vec3){0.01, 2.01, 5.01});
    x[61] = x[60];
    x[COUNT - 1] = (vec3){100, -50, 7};
}

static int compare_index(const void *a, const void *b)
{
    return (int)(*(const uint32_t *)a) - (int)(*(const uint32_t *)b);
}

static void lists_hold_every_pair_within_the_cutoff(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    vec3 x[COUNT];
    error e = {0};
    threads *pool = threads_new(2, NULL, &e);
    neighbours *n = neighbours_new(COUNT, SIZE_MAX, &e);
    for (double cutoff = 0.05; cutoff < 1; cutoff *= 2.3) {
        awkward_points(x, &r);
        assert_true(neighbours_build(n, COUNT, x, NULL, cutoff, pool, &e));
        for (uint32_t i = 0; i < COUNT; i++) {
            uint32_t wanted[COUNT], count = 0;
            for (uint32_t j = 0; j < COUNT; j++)
                if (j != i && vec3_norm2(vec3_sub(x[i], x[j])) < cutoff * cutoff) wanted[count++] = j;
            uint32_t *list = n->list + n->list_begin[i];
            assert_int_equal(n->list_count[i], count);
            qsort(list, count, sizeof *list, compare_index);
            for (uint32_t k = 0; k < count; k++) assert_int_equal(list[k], wanted[k]);
        }
    }
    neighbours_free(n);
    threads_free(pool);
}

/* Adjacent sizes of 1 to 300, so that every bin has neighbours on other levels. */
static void lists_hold_every_pair_within_its_own_cutoff(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    vec3 x[COUNT];
    double size[COUNT];
    error e = {0};
    threads *pool = threads_new(2, NULL, &e);
    neighbours *n = neighbours_new(COUNT, SIZE_MAX, &e);
    for (double cutoff = 0.002; cutoff < 0.2; cutoff *= 3) {
        awkward_points(x, &r);
        for (int i = 0; i < COUNT; i++) size[i] = pow(300, rng_uniform(&r));
        assert_true(neighbours_build(n, COUNT, x, size, cutoff, pool, &e));
        assert_true(n->levels > 7);
        for (uint32_t i = 0; i < COUNT; i++) {
            uint32_t *list = n->list + n->list_begin[i], k = 0;
            qsort(list, n->list_count[i], sizeof *list, compare_index);
            for (uint32_t j = 0; j < COUNT; j++) {
                double reach = 0.5 * cutoff * (size[i] + size[j]);
                if (j == i || vec3_norm(vec3_sub(x[i], x[j])) >= reach) continue;
                assert_true(k < n->list_count[i]);
                assert_int_equal(list[k++], j);
            }
            assert_int_equal(n->list_count[i], k);
        }
    }
    neighbours_free(n);
    threads_free(pool);
}

/* Enough points to fill many bins of each level, in a plane, with the density of a packing; sizes of 1 to
 * 1.9, 9 or 40. */
static void lists_of_many_graded_points_hold_every_pair(void **state)
{
    (void)state;
    enum { MANY = 20000 };
    const double largest[] = {1.9, 9, 40};
    rng r = rng_seed(test_seed(), 3);
    error e = {0};
    threads *pool = threads_new(3, NULL, &e);
    neighbours *n = neighbours_new(MANY, SIZE_MAX, &e);
    vec3 *x = malloc(MANY * sizeof *x);
    double *size = malloc(MANY * sizeof *size);
    for (int run = 0; run < 3; run++) {
        size_t pairs = 0;
        for (size_t i = 0; i < MANY; i++) {
            x[i] = random_between(&r, (vec3){0, 0, 0}, (vec3){1, 1, 0.02});
            x[i].x = pow(x[i].x, 2);
            size[i] = 1 + (largest[run] - 1) * sqrt(x[i].x);
        }
        const double cutoff = 0.03 / largest[run];
        assert_true(neighbours_build(n, MANY, x, size, cutoff, pool, &e));
        for (uint32_t i = 0; i < MANY; i++) {
            uint32_t *list = n->list + n->list_begin[i], k = 0;
            qsort(list, n->list_count[i], sizeof *list, compare_index);
            for (uint32_t j = 0; j < MANY; j++) {
                const double reach = 0.5 * cutoff * (size[i] + size[j]);
                if (j == i || vec3_norm2(vec3_sub(x[i], x[j])) >= reach * reach) continue;
                assert_true(k < n->list_count[i]);
                assert_int_equal(list[k++], j);
            }
            assert_int_equal(n->list_count[i], k);
            pairs += k;
        }
        assert_true(pairs > 5 * MANY);
    }
    free(size);
    free(x);
    neighbours_free(n);
    threads_free(pool);
}

static void points_of_one_colour_in_two_blocks_are_not_neighbours(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    vec3 x[COUNT];
    error e = {0};
    threads *pool = threads_new(1, NULL, &e);
    neighbours *n = neighbours_new(COUNT, SIZE_MAX, &e);
    awkward_points(x, &r);
    double size[COUNT];
    for (int i = 0; i < COUNT; i++) size[i] = 1 + 20 * rng_uniform(&r);
    assert_true(neighbours_build(n, COUNT, x, size, 0.02, pool, &e));
    uint32_t seen = 0;
    for (int c = 0; c < n->colours; c++) {
        int colour[COUNT];
        for (int i = 0; i < COUNT; i++) colour[i] = -1;
        for (uint32_t block = n->colour_begin[c]; block < n->colour_begin[c + 1]; block++) {
            uint32_t begin, end;
            neighbours_block_points(n, block, block + 1, &begin, &end);
            seen += end - begin;
            for (uint32_t k = begin; k < end; k++) colour[n->bin_item[k]] = (int)block;
        }
        for (uint32_t i = 0; i < COUNT; i++)
            for (uint32_t k = 0; colour[i] >= 0 && k < n->list_count[i]; k++) {
                int other = colour[neighbours_list(n, i)[k]];
                assert_true(other == -1 || other == colour[i]);
            }
    }
    assert_int_equal(seen, COUNT);
    neighbours_free(n);
    threads_free(pool);
}

/* Clumps of points of two sizes at random places of a scene that is up to 1e9 cutoffs wide, some of them aligned along an axis. Coordinates
 * there have a rounding of up to 1e-7: pairs nearer to the cutoff than that are not compared. */
static void lists_of_clumps_far_apart_hold_every_pair(void **state)
{
    (void)state;
    enum { CLUMPS = 12 };
    const uint64_t seed = test_seed();
    rng r = rng_seed(seed, 4);
    vec3 x[COUNT], at[CLUMPS];
    double size[COUNT];
    error e = {0};
    threads *pool = threads_new(2, NULL, &e);
    neighbours *n = neighbours_new(COUNT, SIZE_MAX, &e);
    for (double extent = 1e3; extent < 1e10; extent *= 100) {
        for (int c = 0; c < CLUMPS; c++) {
            at[c] = random_between(&r, (vec3){-extent, -extent, -extent}, (vec3){extent, extent, extent});
            if (c % 3 == 0) at[c].y = at[c].z = 0;
        }
        for (int i = 0; i < COUNT; i++) {
            x[i] = vec3_add(at[i % CLUMPS], random_between(&r, (vec3){-2, -2, -1}, (vec3){2, 2, 1}));
            size[i] = i % 5 ? 1 : 0.25;
        }
        assert_true(neighbours_build(n, COUNT, x, size, 1, pool, &e));
        for (uint32_t i = 0; i < COUNT; i++) {
            uint32_t *list = n->list + n->list_begin[i], k = 0;
            qsort(list, n->list_count[i], sizeof *list, compare_index);
            for (uint32_t j = 0; j < COUNT; j++) {
                const double apart = vec3_norm(vec3_sub(x[i], x[j])) - 0.5 * (size[i] + size[j]);
                const bool is_listed = k < n->list_count[i] && list[k] == j;
                if (j != i && fabs(apart) > 1e-6) assert_int_equal(is_listed, apart < 0);
                k += is_listed;
            }
            assert_int_equal(k, n->list_count[i]);
        }
    }
    neighbours_free(n);
    threads_free(pool);
}

/* Points in a line, so near to each other that no gap between them can be narrowed. */
/* Sheets on one edge: bins hold many points of many labels, beside bins with few. */
static void lists_of_labelled_points_hold_every_pair_of_a_label(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 5);
    error e = {0};
    threads *pool = threads_new(2, NULL, &e);
    neighbours *n = neighbours_new(COUNT, SIZE_MAX, &e);
    vec3 x[COUNT];
    double size[COUNT];
    uint32_t label[COUNT];
    const uint32_t counts[] = {2, 40, COUNT, 60}, steps[] = {1, 1, 1, UINT32_MAX / 60};
    n->label = label;
    for (int run = 0; run < 8; run++) {
        for (int i = 0; i < COUNT; i++) {
            x[i] = random_between(&r, (vec3){0, 0, 0}, i % 3 ? (vec3){0.1, 0.1, 0.3} : (vec3){2, 2, 0.3});
            size[i] = run % 2 ? 1 + 3 * x[i].x : 1;
            label[i] = (uint32_t)(rng_uniform(&r) * counts[run / 2]) * steps[run / 2];
        }
        const double cutoff = 0.25;
        size_t pairs = 0;
        assert_true(neighbours_build(n, COUNT, x, run % 2 ? size : NULL, cutoff, pool, &e));
        for (uint32_t i = 0; i < COUNT; i++) {
            uint32_t *list = n->list + n->list_begin[i], k = 0;
            qsort(list, n->list_count[i], sizeof *list, compare_index);
            for (uint32_t j = 0; j < COUNT; j++) {
                const double reach = 0.5 * cutoff * (size[i] + size[j]);
                if (j == i || label[i] != label[j] || vec3_norm(vec3_sub(x[i], x[j])) >= reach) continue;
                assert_true(k < n->list_count[i]);
                assert_int_equal(list[k++], j);
            }
            assert_int_equal(n->list_count[i], k);
            pairs += k;
        }
        assert_true(pairs > 50);
    }
    neighbours_free(n);
    threads_free(pool);
}

static void more_bins_than_can_be_numbered_are_refused(void **state)
{
    (void)state;
    enum { MANY = 200000 };
    error e = {0};
    vec3 *x = malloc(MANY * sizeof *x);
    assert_non_null(x);
    for (int i = 0; i < MANY; i++) x[i] = (vec3){3.5 * i, 0, 0};
    threads *pool = threads_new(1, NULL, &e);
    neighbours *n = neighbours_new(MANY, SIZE_MAX, &e);
    assert_false(neighbours_build(n, MANY, x, NULL, 1, pool, &e));
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    neighbours_free(n);
    threads_free(pool);
    free(x);
}

static volatile sig_atomic_t stopped;

static void stop(int signal)
{
    (void)signal;
    stopped = 1;
}

/* A build that is stopped at any time reports it. A build that is not stopped has all lists. */
static void a_stopped_build_is_reported(void **state)
{
    (void)state;
    enum { MANY = 40000, STEPS = 40 };
    rng r = rng_seed(test_seed(), 4);
    vec3 *x = malloc(MANY * sizeof *x);
    error e = {0};
    threads *pool = threads_new(2, &stopped, &e);
    neighbours *n = neighbours_new(MANY, SIZE_MAX, &e);
    struct timespec begin, end;
    size_t all = 0, cancelled = 0;
    for (int i = 0; i < MANY; i++) x[i] = random_between(&r, (vec3){0, 0, 0}, (vec3){1, 1, 0.01});
    signal(SIGALRM, stop);
    clock_gettime(CLOCK_MONOTONIC, &begin);
    assert_true(neighbours_build(n, MANY, x, NULL, 0.012, pool, &e));
    clock_gettime(CLOCK_MONOTONIC, &end);
    for (size_t i = 0; i < MANY; i++) all += n->list_count[i];
    const double took_us =
        1e6 * (double)(end.tv_sec - begin.tv_sec) + 1e-3 * (double)(end.tv_nsec - begin.tv_nsec);
    for (int k = 1; k <= STEPS; k++) {
        const long after_us = 1 + (long)(took_us * k / STEPS);
        const struct itimerval timer = {.it_value = {after_us / 1000000, after_us % 1000000}}, none = {0};
        size_t listed = 0;
        stopped = 0;
        e.code = ERROR_NONE;
        setitimer(ITIMER_REAL, &timer, NULL);
        const bool ok = neighbours_build(n, MANY, x, NULL, 0.012, pool, &e);
        setitimer(ITIMER_REAL, &none, NULL);
        for (size_t i = 0; ok && i < MANY; i++) listed += n->list_count[i];
        if (ok) assert_int_equal(listed, all);
        if (!ok) assert_int_equal(e.code, ERROR_CANCELLED);
        cancelled += !ok;
    }
    assert_true(cancelled > 0);
    signal(SIGALRM, SIG_DFL);
    neighbours_free(n);
    threads_free(pool);
    free(x);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_hold_every_pair_within_the_cutoff),
        cmocka_unit_test(lists_hold_every_pair_within_its_own_cutoff),
        cmocka_unit_test(lists_of_many_graded_points_hold_every_pair),
        cmocka_unit_test(points_of_one_colour_in_two_blocks_are_not_neighbours),
        cmocka_unit_test(lists_of_clumps_far_apart_hold_every_pair),
        cmocka_unit_test(lists_of_labelled_points_hold_every_pair_of_a_label),
        cmocka_unit_test(more_bins_than_can_be_numbered_are_refused),
        cmocka_unit_test(a_stopped_build_is_reported),
    };
    return cmocka_run_group_tests_name("neighbours", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Sets that several threads join equal those that one thread joins, in any order. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "base/core/rng.h"
#include "base/core/sets.h"
#include "base/core/threads.h"
#include "shapes.h"

enum { COUNT = 100000, WORKERS = 4, RUNS = 20 };

typedef struct joining {
    uint32_t parent[COUNT], pair[COUNT][2];
} joining;

static void join_chunk(void *context, int worker, size_t begin, size_t end)
{
    joining *j = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) sets_join_shared(j->parent, j->pair[k][0], j->pair[k][1]);
}

static void flatten_chunk(void *context, int worker, size_t begin, size_t end)
{
    joining *j = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) sets_flatten_shared(j->parent, (uint32_t)k);
}

/* Run 0 has one long chain. Other runs have random pairs; later runs have more distant pairs. */
static void make_pairs(joining *j, int run, rng *r)
{
    for (uint32_t k = 0; k < COUNT; k++) {
        const uint32_t reach = 1 + (uint32_t)(rng_uniform(r) * (run < RUNS / 2 ? 10 : COUNT / 2));
        j->pair[k][0] = k;
        j->pair[k][1] = run == 0 ? (k + 1) % COUNT : (k + reach) % COUNT;
        if (run > 0 && rng_uniform(r) < 0.3) j->pair[k][1] = k;
    }
}

static void joins_do_not_depend_on_threads(void **state)
{
    (void)state;
    error e = {0};
    rng r = rng_seed(test_seed(), 0);
    threads *pool = threads_new(WORKERS, NULL, &e);
    joining *j = malloc(sizeof *j);
    uint32_t *alone = malloc(COUNT * sizeof *alone);
    for (int run = 0; run < RUNS; run++) {
        make_pairs(j, run, &r);
        sets_reset(alone, COUNT);
        sets_reset(j->parent, COUNT);
        for (size_t k = 0; k < COUNT; k++) sets_join(alone, j->pair[k][0], j->pair[k][1]);
        threads_run(pool, COUNT, 64, join_chunk, j);
        threads_run(pool, COUNT, 64, flatten_chunk, j);
        for (uint32_t k = 0; k < COUNT; k++) assert_int_equal(j->parent[k], sets_root(alone, k));
    }
    free(alone);
    free(j);
    threads_free(pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(joins_do_not_depend_on_threads)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

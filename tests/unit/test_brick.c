/* Bricks: whether those that are made when they are looked at are those that are made at once. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "samples_fixture.h"
#include "volume/brick.h"

enum { BLOCKS = 5, LOOKS = 4000, WORKERS = 4 };

typedef struct looking {
    const bricks *later, *once;
    bool has_room; /* for all of them */
    atomic_int wrong;
} looking;

/* Whether the coefficients of a cell of a brick that has no room are those of its brick. */
static bool cell_is(const bricks *b, uint32_t n, size_t k, const float *brick)
{
    float room[BRICK_CELL];
    const int cell[3] = {(int)(k % 8), (int)(k / 8 % 8), (int)(k / 64 % 8)};
    const float *got = bricks_find_cell(b, n, cell, room),
                *right = brick_cell(brick, cell[0], cell[1], cell[2]);
    bool same = true;
    for (int row = 0; row < 16; row++) {
        const int at = row / 4 * BRICK_SLAB + row % 4 * BRICK_SIDE;
        same &= memcmp(got + at, right + at, 4 * sizeof *got) == 0;
    }
    return same;
}

static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    looking *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        float room[BRICK_SIZE];
        const uint32_t n = (uint32_t)(k * 2654435761u % job->once->map->count);
        const float *brick = k % 3 ? bricks_at(job->later, n) : bricks_glance(job->later, n, room),
                    *right = bricks_at(job->once, n);
        const bool differs = brick ? memcmp(brick, right, BRICK_SIZE * sizeof *brick) != 0
                                   : job->has_room || !cell_is(job->later, n, k, right);
        if (differs) atomic_fetch_add(&job->wrong, 1);
    }
}

/* With room for so many. */
static void check_bricks(size_t share)
{
    error e = {0};
    rng one = rng_seed(1, 0), other = rng_seed(1, 0);
    samples first = samples_fixture(BLOCKS, 0, true, &one), second = samples_fixture(BLOCKS, 0, true, &other);
    block_map map;
    bricks once, later;
    threads *pool = threads_new(WORKERS, NULL, &e);
    assert_non_null(pool);
    assert_true(block_map_init(&map, 0, &e));
    for (uint32_t n = 0; n < first.map.count; n++) {
        const int32_t *at = first.map.blocks[n];
        assert_true(block_map_find_or_add(&map, at[0], at[1], at[2], NULL, &e));
    }
    const size_t room = map.count / share;
    assert_true(bricks_make(&first, &map, 0, pool, &once, &e));
    assert_true(bricks_make(&second, &map, room, pool, &later, &e));
    assert_null(first.f);
    assert_null(second.f);
    for (int round = 0; round < 3; round++) {
        looking job = {&later, &once, share == 1, 0};
        threads_run(pool, LOOKS, 8, look_chunk, &job);
        assert_int_equal(atomic_load(&job.wrong), 0);
        size_t there = 0;
        for (uint32_t n = 0; n < map.count; n++) there += atomic_load(&later.place[n]) >= BRICK_THERE;
        assert_int_equal(there, room);
        bricks_forget(&later);
        bricks_forget(&once);
        assert_int_equal(atomic_load(&later.place[map.count]), 0);
    }
    bricks_free(&once);
    bricks_free(&later);
    block_map_free(&map);
    threads_free(pool);
}

static void bricks_are_the_same_whenever_they_are_made(void **state)
{
    (void)state;
    check_bricks(1);
    check_bricks(3);
    assert_int_equal(bricks_room(1000, 10), 0);
    assert_int_equal(bricks_room(1000000, 0), 0);
    assert_true(bricks_room(1000000, 10) > 10 && bricks_room(1000000, 10) < 1000000);
    assert_int_equal(bricks_room(1000000, 900000), 1000000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bricks_are_the_same_whenever_they_are_made),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

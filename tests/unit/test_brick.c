/* Bricks: whether those that are made when they are looked at are those that are made at once. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "base/memory.h"
#include "volume/brick.h"

enum { BLOCKS = 5, LOOKS = 4000, WORKERS = 4 };

/* Blocks of random voxels, some of a cube of them missing. */
static samples random_samples(uint64_t seed)
{
    samples s = {0};
    error e = {0};
    assert_true(block_map_init(&s.map, 0, &e));
    for (int k = 0; k < BLOCKS * BLOCKS * BLOCKS; k++)
        if (k % 7 != 3)
            assert_true(block_map_find_or_add(&s.map, k / (BLOCKS * BLOCKS), k / BLOCKS % BLOCKS, k % BLOCKS,
                                              NULL, &e));
    s.f = mem_array(s.map.count, sizeof *s.f, "voxels", &e);
    s.others.f = mem_array(s.map.count, GRID_VIEW_VOXELS * sizeof *s.others.f, "voxels", &e);
    assert_true(s.f && s.others.f);
    for (size_t k = 0; k < (size_t)s.map.count * GRID_VIEW_VOXELS; k++) {
        seed = seed * 6364136223846793005u + 1442695040888963407u;
        s.f[k / GRID_VIEW_VOXELS] = s.others.f + k / GRID_VIEW_VOXELS * GRID_VIEW_VOXELS;
        s.others.f[k] = (float)(seed >> 40);
    }
    return s;
}

typedef struct looking {
    const bricks *later, *once;
    atomic_int wrong;
} looking;

static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    looking *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        float room[BRICK_SIZE];
        const uint32_t n = (uint32_t)(k * 2654435761u % job->once->map->count);
        const float *brick = k % 3 ? bricks_at(job->later, n) : bricks_glance(job->later, n, room);
        if (memcmp(brick, bricks_at(job->once, n), BRICK_SIZE * sizeof *brick) != 0)
            atomic_fetch_add(&job->wrong, 1);
    }
}

static void bricks_are_the_same_whenever_they_are_made(void **state)
{
    (void)state;
    error e = {0};
    samples first = random_samples(1), second = random_samples(1);
    block_map map;
    bricks once, later;
    threads *pool = threads_new(WORKERS, NULL, &e);
    assert_non_null(pool);
    assert_true(block_map_init(&map, 0, &e));
    for (uint32_t n = 0; n < first.map.count; n++) {
        const int32_t *at = first.map.blocks[n];
        assert_true(block_map_find_or_add(&map, at[0], at[1], at[2], NULL, &e));
    }
    assert_true(bricks_make(&first, &map, false, pool, &once, &e));
    assert_true(bricks_make(&second, &map, true, pool, &later, &e));
    assert_null(first.f);
    assert_null(second.f);
    for (int round = 0; round < 3; round++) {
        looking job = {&later, &once, 0};
        threads_run(pool, LOOKS, 8, look_chunk, &job);
        assert_int_equal(atomic_load(&job.wrong), 0);
        assert_int_equal(atomic_load(&later.place[map.count]), map.count);
        bricks_forget(&later);
        bricks_forget(&once);
        assert_int_equal(atomic_load(&later.place[map.count]), 0);
    }
    bricks_free(&once);
    bricks_free(&later);
    block_map_free(&map);
    threads_free(pool);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bricks_are_the_same_whenever_they_are_made),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Over-dense points and gaps in a plane: which points are relocated to which places, and what must not
 * change. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "shapes.h"
#include "geometry/space/cell_list.h"
#include "sampling/solver/particles/relocation.h"

enum { SIDE = 30, COUNT = SIDE * SIDE, PLACES = 5 * COUNT };

static double least_distance(const vec3 *x)
{
    double least = INFINITY;
    for (size_t i = 0; i < COUNT; i++)
        for (size_t j = 0; j < i; j++) least = fmin(least, vec3_norm(vec3_sub(x[i], x[j])));
    return least;
}

/* The largest distance of a place from the nearest point. */
static double farthest(const vec3 *x, const vec3 *place)
{
    double most = 0;
    for (size_t k = 0; k < PLACES; k++) {
        double nearest = INFINITY;
        for (size_t i = 0; i < COUNT; i++) nearest = fmin(nearest, vec3_norm(vec3_sub(x[i], place[k])));
        most = fmax(most, nearest);
    }
    return most;
}

static void move_but(const bool *held, double gap, vec3 *x, const double *size, const vec3 *place,
                     size_t *moves)
{
    error e = {0};
    relocation *chosen;
    static uint32_t near[PLACES]; /* of earlier points, or of none; the result does not depend on it */
    relocation_input in = {x, size, COUNT, 1, place, PLACES, near, gap, held, 0};
    relocation *other;
    size_t others;
    assert_true(relocation_choose(&in, NULL, &chosen, moves, &e));
    for (size_t k = 0; k < PLACES; k++) near[k] = k % 2 ? near[PLACES - 1 - k] : UINT32_MAX;
    assert_true(relocation_choose(&in, NULL, &other, &others, &e));
    assert_int_equal(others, *moves);
    assert_memory_equal(other, chosen, others * sizeof *other);
    free(other);
    for (size_t k = 0; k < *moves; k++) x[chosen[k].point] = place[chosen[k].place];
    free(chosen);
}

static void move(vec3 *x, const double *size, const vec3 *place, size_t *moves)
{
    move_but(NULL, 0, x, size, place, moves);
}

/* Some points of a square lattice are placed beside their neighbours and leave holes. */
static void displaced_points_of_a_lattice_return_to_its_holes(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    vec3 *x = malloc(COUNT * sizeof *x), *place = malloc(PLACES * sizeof *place);
    double *size = malloc(COUNT * sizeof *size);
    size_t moves, again;
    for (size_t i = 0; i < COUNT; i++) {
        x[i] = (vec3){(double)(i % SIDE), (double)(i / SIDE), 0};
        size[i] = 1;
    }
    for (size_t i = 3 * SIDE + 3; i < COUNT - 3 * SIDE; i += 97)
        x[i] = vec3_add(x[i + 1], (vec3){0.1, 0.1, 0});
    for (size_t k = 0; k < PLACES; k++)
        place[k] = random_between(&r, (vec3){0, 0, 0}, (vec3){SIDE - 1, SIDE - 1, 0});
    assert_true(least_distance(x) < 0.15 && farthest(x, place) > 0.85);
    bool *held = malloc(COUNT * sizeof *held);
    for (size_t i = 0; i < COUNT; i++) held[i] = true;
    move_but(held, 0, x, size, place, &moves);
    assert_int_equal(moves, 0); /* all points are held */
    free(held);
    move_but(NULL, 1.01, x, size, place, &moves);
    assert_int_equal(moves, 0); /* no gap has this width */
    move(x, size, place, &moves);
    assert_int_equal(moves, (COUNT - 6 * SIDE - 3 + 96) / 97);
    assert_true(least_distance(x) > RELOCATION_GAP);
    /* the lattice is restored: the centre of a square is .71 from its corners */
    move(x, size, place, &again);
    assert_int_equal(again, 0);
    free(x);
    free(size);
    free(place);
}

/* Random points: the least distance never decreases below RELOCATION_GAP or its former value, and passes
 * end. */
static void relocation_separates_random_points(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    vec3 *x = malloc(COUNT * sizeof *x), *place = malloc(PLACES * sizeof *place);
    double *size = malloc(COUNT * sizeof *size);
    size_t moves = 1;
    int passes = 0;
    for (size_t i = 0; i < COUNT; i++) {
        x[i] = random_between(&r, (vec3){0, 0, 0}, (vec3){SIDE, SIDE, 0});
        size[i] = 1;
    }
    for (size_t k = 0; k < PLACES; k++) place[k] = random_between(&r, (vec3){0, 0, 0}, (vec3){SIDE, SIDE, 0});
    double before = farthest(x, place);
    for (; moves > 0 && passes < 50; passes++) {
        double least = least_distance(x);
        move(x, size, place, &moves);
        assert_true(least_distance(x) >= fmin(least, RELOCATION_GAP));
    }
    assert_true(passes < 50 && least_distance(x) > 0.5 && farthest(x, place) < 0.6 * before);
    free(x);
    free(size);
    free(place);
}

/* Relocations do not depend on the search method: many points far away make cells over-dense, so that a tree
 * is used. */
static void points_far_away_change_nothing(void **state)
{
    (void)state;
    enum { HEAP = COUNT / 2, ALL = COUNT + HEAP };
    rng r = rng_seed(test_seed(), 2);
    vec3 *x = malloc(ALL * sizeof *x), *place = malloc(PLACES * sizeof *place);
    double *size = malloc(ALL * sizeof *size);
    uint32_t *near = calloc(PLACES, sizeof *near);
    error e = {0};
    relocation *chosen[2];
    size_t moves[2];
    for (size_t i = 0; i < ALL; i++) {
        x[i] = random_between(&r, (vec3){0, 0, 0}, (vec3){SIDE, SIDE, 0});
        size[i] = 1 + 0.3 * rng_uniform(&r);
        if (i >= COUNT) x[i] = (vec3){1e4 + (double)(i % SIDE), 1e4 + (double)(i / SIDE), 0};
        if (i >= COUNT) size[i] = 1;
    }
    for (size_t k = 0; k < PLACES; k++) place[k] = random_between(&r, (vec3){0, 0, 0}, (vec3){SIDE, SIDE, 0});
    for (int heap = 0; heap < 2; heap++) {
        const size_t count = heap ? ALL : COUNT;
        relocation_input in = {x, size, count, 1, place, PLACES, near, 0, NULL, 0};
        cell_list *cells = cell_list_new(x, count, NULL, &e);
        assert_true(cell_list_is_dense(cells) == heap);
        cell_list_free(cells);
        assert_true(relocation_choose(&in, NULL, &chosen[heap], &moves[heap], &e));
    }
    assert_true(moves[0] > 10);
    assert_int_equal(moves[0], moves[1]);
    assert_memory_equal(chosen[0], chosen[1], moves[0] * sizeof *chosen[0]);
    free(chosen[0]);
    free(chosen[1]);
    free(x);
    free(place);
    free(size);
    free(near);
}

/* A square lattice of slightly too small spacing, none of whose points is over-dense, beside a strip
 * without points. */
static void a_second_limit_fills_a_strip_beside_a_lattice(void **state)
{
    (void)state;
    enum { ROWS = 20, WIDE = 25 };
    const double side = 0.9;
    vec3 x[ROWS * WIDE], place[ROWS];
    double size[ROWS * WIDE];
    uint32_t near[ROWS] = {0};
    for (size_t i = 0; i < ROWS * WIDE; i++) {
        x[i] = (vec3){side * (double)(i % WIDE), side * (double)(i / WIDE), 0};
        size[i] = 1;
    }
    for (size_t k = 0; k < ROWS; k++) place[k] = (vec3){side * WIDE + 0.5, side * (double)k, 0};
    relocation_input in = {x, size, ROWS * WIDE, 1, place, ROWS, near, 1, NULL, 0};
    relocation *chosen;
    size_t moves;
    error e = {0};
    assert_true(relocation_choose(&in, NULL, &chosen, &moves, &e));
    assert_int_equal(moves, 0);
    free(chosen);
    in.dense = 0.95;
    assert_true(relocation_choose(&in, NULL, &chosen, &moves, &e));
    assert_int_equal(moves, ROWS);
    for (size_t k = 0; k < moves; k++) /* no two points leave the same hole */
        for (size_t j = 0; j < k; j++)
            assert_true(vec3_norm(vec3_sub(x[chosen[j].point], x[chosen[k].point])) > 0.95);
    free(chosen);
}

/* The number of pairs of gaps would be the square of the number of gaps. */
static void many_gaps_beside_few_points_give_one_relocation(void **state)
{
    (void)state;
    error e = {0};
    rng r = rng_seed(test_seed(), 1);
    const vec3 x[] = {{0, 0, 0}, {0.1, 0, 0}, {0, 1, 0}};
    const double size[] = {1, 1, 1};
    vec3 *place = malloc(PLACES * sizeof *place);
    uint32_t *near = malloc(PLACES * sizeof *near);
    for (size_t k = 0; k < PLACES; k++) {
        place[k] = random_between(&r, (vec3){3, 0, 0}, (vec3){3.1, 0.1, 0});
        near[k] = UINT32_MAX;
    }
    const relocation_input in = {x, size, 3, 1, place, PLACES, near, 0, NULL, 0};
    relocation *chosen;
    size_t moves;
    if (!relocation_choose(&in, NULL, &chosen, &moves, &e)) fail_msg("%s", e.message);
    assert_int_equal(moves, 1);
    assert_true(chosen[0].point < 2);
    double most = 0;
    for (size_t k = 0; k < PLACES; k++) most = fmax(most, place[k].x);
    assert_true(place[chosen[0].place].x > most - 0.01);
    free(chosen);
    free(place);
    free(near);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(displaced_points_of_a_lattice_return_to_its_holes),
        cmocka_unit_test(many_gaps_beside_few_points_give_one_relocation),
        cmocka_unit_test(relocation_separates_random_points),
        cmocka_unit_test(points_far_away_change_nothing),
        cmocka_unit_test(a_second_limit_fills_a_strip_beside_a_lattice),
    };
    return cmocka_run_group_tests_name("relocation", tests, NULL, NULL);
}

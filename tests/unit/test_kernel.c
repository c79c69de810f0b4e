/* The kernel in single precision against the one in double, whatever the instruction set. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "sampler/kernel.h"
#include "sampler/pair.h"
#include "shapes.h"

enum { MOST = 40, PADDED = 40 };

static const double sigma = 0.9, unit = 0x1p-24;

/* A particle at the origin and its neighbours, as both kernels want them. */
typedef struct fixture {
    neighbours_place place[MOST + 1];
    uint32_t list[MOST];
    size_t count;
    double column[5][PADDED];
    pair_list pairs;
    vec3 axis1, axis2;
} fixture;

static void random_fixture(fixture *f, size_t count, rng *r)
{
    double own = 0.7 + 0.6 * rng_uniform(r);
    memset(f, 0, sizeof *f);
    f->count = count;
    f->place[MOST].size = (float)own;
    for (size_t k = 0; k < PADDED; k++) {
        vec3 x = random_between(r, (vec3){-1, -1, -0.1}, (vec3){1, 1, 0.1});
        neighbours_place p = {(int32_t)(x.x / unit), (int32_t)(x.y / unit), (int32_t)(x.z / unit),
                              (float)(0.7 + 0.6 * rng_uniform(r))};
        double size = 0.5 * (1 + (double)p.size / (double)f->place[MOST].size);
        double entry[5] = {p.x * unit, p.y * unit, p.z * unit, k < count, size * size};
        for (int c = 0; c < 5; c++) f->column[c][k] = entry[c];
        f->place[(k * 7) % MOST] = p; /* any order */
        if (k < count) f->list[k] = (uint32_t)((k * 7) % MOST);
    }
    f->pairs = (pair_list){.blocks = PADDED / PAIR_LANES,
                           .x = f->column[0],
                           .y = f->column[1],
                           .z = f->column[2],
                           .weight = f->column[3],
                           .size2 = f->column[4]};
    vec3_frame(vec3_unit(random_between(r, (vec3){-0.2, -0.2, 1}, (vec3){0.2, 0.2, 1})), &f->axis1,
               &f->axis2);
}

static void sum(const fixture *f, isa which, kernel_forces *out)
{
    const float u[3] = {(float)f->axis1.x, (float)f->axis1.y, (float)f->axis1.z};
    const float v[3] = {(float)f->axis2.x, (float)f->axis2.y, (float)f->axis2.z};
    double own = (double)f->place[MOST].size;
    memset(out, 0, sizeof *out);
    kernel_for(which)(f->place, f->list, f->count, f->place[MOST], u, v, (float)(sigma / own / unit), out);
}

/* Two to forty neighbours, in and out of reach: the pair kernel's numbers, to what single precision has.
 * Its terms are of the size of the stiffest pair's. */
static void sums_are_those_in_double(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (size_t count = 1; count <= MOST; count++) {
        fixture f;
        kernel_forces single;
        pair_forces wide;
        random_fixture(&f, count, &r);
        sum(&f, isa_best(), &single);
        pair_forces_at(&f.pairs, &energy_cotangent, (vec3){0, 0, 0}, f.axis1, f.axis2, sigma, &wide);
        double stiff = (wide.h11 + wide.h22) * unit * unit, slope = sqrt(stiff * wide.energy);
        assert_close((double)single.energy, wide.energy, 1e-5 * wide.energy + 1e-6 * (double)count);
        assert_close((double)single.d1, wide.d1 * unit, 1e-5 * slope + 1e-12);
        assert_close((double)single.d2, wide.d2 * unit, 1e-5 * slope + 1e-12);
        assert_close((double)single.h11, wide.h11 * unit * unit, 1e-5 * stiff);
        assert_close((double)single.h12, wide.h12 * unit * unit, 1e-5 * stiff);
        assert_close((double)single.h22, wide.h22 * unit * unit, 1e-5 * stiff);
        if (isinf(wide.nearest2))
            assert_true(isinf(single.nearest2));
        else
            assert_close((double)single.nearest2, wide.nearest2 / unit / unit,
                         1e-5 * wide.nearest2 / unit / unit);
    }
}

static void every_instruction_set_gives_the_same_bits(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    int compared = 0;
    for (int round = 0; round < 200; round++) {
        fixture f;
        kernel_forces portable, other;
        random_fixture(&f, 1 + (size_t)(rng_uniform(&r) * (MOST - 1)), &r);
        sum(&f, ISA_PORTABLE, &portable);
        for (isa which = ISA_PORTABLE + 1; which < ISA_COUNT; which++) {
            if (!isa_available(which)) continue;
            sum(&f, which, &other);
            assert_memory_equal(&portable, &other, sizeof other);
            compared++;
        }
    }
    print_message("# %d comparisons on this machine\n", compared);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sums_are_those_in_double),
        cmocka_unit_test(every_instruction_set_gives_the_same_bits),
    };
    return cmocka_run_group_tests_name("kernel", tests, NULL, NULL);
}

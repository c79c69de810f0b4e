// SPDX-License-Identifier: Apache-2.0
/* plan: the number of points of a target, and their memory. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "geometry/space/packing.h"
#include "job/source/plan.h"

static const double AREA = 12.5;

static size_t count_of(const spec *s)
{
    size_t count = 0;
    error e = {0};
    assert_true(plan_count(s, AREA, 0, &count, &e));
    return count;
}

static void targets_come_to_a_count(void **state)
{
    (void)state;
    assert_int_equal(count_of(&(spec){.count = 1000}), 1000);
    assert_int_equal(count_of(&(spec){.density = 80}), 1000);
    spec spacing = {.spacing = packing_spacing(AREA, 1000)};
    assert_int_equal(count_of(&spacing), 1000);
    spec support = {.has_control = true};
    support.control.min_count = 4;
    support.control.max_sigma = 1.0001 * packing_support(packing_spacing(AREA, 1000));
    assert_int_equal(count_of(&support), 1000); /* the smallest count within the bound */
    support.control.min_count = 2000;
    assert_int_equal(count_of(&support), 2000);
}

static void a_count_out_of_range_names_its_target(void **state)
{
    (void)state;
    size_t count = 7;
    error e = {0};
    assert_false(plan_count(&(spec){.spacing = 1e-6}, AREA, 0, &count, &e));
    assert_int_equal(e.code, ERROR_SPEC_INVALID);
    assert_non_null(strstr(e.message, "/sampling/spacing"));
    assert_false(plan_count(&(spec){.density = 1e-3}, AREA, 0, &count, &e));
    assert_non_null(strstr(e.message, "/sampling/density"));
    assert_int_equal(count, 7);
}

/* The number in a message that follows these words. */
static double number_after(const char *message, const char *words)
{
    const char *at = strstr(message, words);
    if (!at) fail_msg("no \"%s\" in: %s", words, message);
    return strtod(at + strlen(words), NULL);
}

/* The value that the message recommends gives a permitted count near the bound. */
static void a_count_out_of_range_recommends_a_value_that_is_accepted(void **state)
{
    (void)state;
    spec cases[] = {
        {.spacing = 1e-6}, {.spacing = 100}, {.density = 1e9}, {.density = 1e-3}, {.has_control = true}};
    cases[4].control.min_count = 4;
    cases[4].control.max_sigma = 1e-6;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        spec *s = &cases[k];
        size_t count = 0;
        error e = {0};
        assert_false(plan_count(s, AREA, 0, &count, &e));
        const bool smallest = s->spacing > 0 ? k == 0 : k == 3 || k == 4;
        const double value = number_after(e.message, smallest ? "set it to at least " : "set it to at most ");
        *(s->spacing > 0 ? &s->spacing : s->density > 0 ? &s->density : &s->control.max_sigma) = value;
        count = count_of(s);
        if (!(count < 6 || (double)count > 0.98 * PLAN_COUNT_MAX))
            fail_msg("%zu points: %s", count, e.message);
    }
}

static bool fits(const spec *s, double count, double left, double limit, error *e)
{
    const plan_memory memory = {left, limit, 0};
    return plan_check_memory(s, (plan_particles){0}, count, &memory, e);
}

static double bytes_of(const spec *s, double count)
{
    return plan_bytes(s, (plan_particles){0}, count);
}

static void memory_is_that_of_particles_beside_source_and_pictures(void **state)
{
    (void)state;
    error e = {0};
    const spec plain = {0}, swarm = {.method = SPEC_METHOD_WITKIN_HECKBERT}, mesh = {.has_mesh = true};
    const spec pictures = {.has_preview = true, .preview_width = 512, .preview_height = 512};
    const double mib = 1 << 20, counts[] = {1e3, 1e5, 1e6};
    for (size_t k = 0; k < 3; k++) {
        const double n = counts[k], bytes = bytes_of(&plain, n);
        assert_true(bytes_of(&swarm, n) > bytes && bytes_of(&mesh, n) > bytes);
        assert_true(plan_bytes(&plain, (plan_particles){.is_continued = true}, n) > bytes);
        assert_true(plan_bytes(&plain, (plan_particles){.has_patches = true}, n) > bytes);
        assert_true(plan_bytes(&plain, (plan_particles){.more_bytes = 24}, n) - bytes == 24 * n);
        assert_true(fits(&plain, n, bytes, 2 * bytes, &e));
        assert_false(fits(&plain, n + 1, bytes, 2 * bytes, &e));
        assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
        assert_float_equal(plan_fitting(&plain, (plan_particles){0}, bytes), n, 1e-6 * n);
    }
    const double left = plan_particle_memory(&plain, (size_t)(100 * mib), 0);
    assert_true(left > 80 * mib && left < 100 * mib); /* the process takes some */
    assert_true(left - plan_particle_memory(&plain, (size_t)(100 * mib), (size_t)mib) == mib);
    assert_true(plan_particle_memory(&pictures, (size_t)(100 * mib), 0) < left);
    assert_true(plan_fitting(&plain, (plan_particles){0}, -1) == 0);
}

static void the_limit_that_a_message_recommends_is_sufficient(void **state)
{
    (void)state;
    error e = {0};
    spec plain = {0};
    const double mib = 1 << 20, limit = 64 * mib, used = 20 * mib;
    assert_false(fits(&plain, 1e6, limit - used, limit, &e));
    assert_non_null(strstr(e.message, "the surface and the preview leave 44 of 64 MiB"));
    const double enough = mib * number_after(e.message, "set it to at least ");
    assert_true(fits(&plain, 1e6, enough - used, enough, &e));
    assert_false(fits(&plain, 1e6, enough - mib - used, enough - mib, &e));
    assert_false(fits(&plain, 1e6, limit - used, limit, &e));
    assert_null(strstr(e.message, "/sampling/count")); /* the target is another one */
    plain.count = 1e6;
    assert_false(fits(&plain, 1e6, limit - used, limit, &e));
    const double fewer = number_after(e.message, "lower /sampling/count to at most ");
    assert_true(fits(&plain, fewer, limit - used, limit, &e));
    assert_false(fits(&plain, 1.01 * fewer, limit - used, limit, &e));
}

static void a_message_recommends_no_limit_that_no_job_may_have(void **state)
{
    (void)state;
    error e = {0};
    spec plain = {.count = 1e6};
    const double mib = 1 << 20, limit = 64 * mib, left = 44 * mib, most = 128 * mib;
    const plan_memory memory = {left, limit, most}, wide = {left, limit, 1e4 * mib};
    assert_false(plan_check_memory(&plain, (plan_particles){0}, 1e6, &memory, &e));
    assert_null(strstr(e.message, "set it to"));
    assert_non_null(strstr(e.message, "a job may have at most 128"));
    const double fewer = number_after(e.message, "lower /sampling/count to at most ");
    assert_true(plan_check_memory(&plain, (plan_particles){0}, fewer, &memory, &e));
    plain.count = 0;
    assert_false(plan_check_memory(&plain, (plan_particles){0}, 1e6, &memory, &e));
    assert_non_null(strstr(e.message, "a job may have at most 128, so ask for fewer points"));
    assert_false(plan_check_memory(&plain, (plan_particles){0}, 1e6, &wide, &e));
    assert_true(number_after(e.message, "set it to at least ") < 1e4);
}

static void memory_includes_defect_repair(void **state)
{
    (void)state;
    const spec plain = {.method = SPEC_METHOD_SIZED},
               graded = {.method = SPEC_METHOD_SIZED, .has_curvature = true},
               other = {.method = SPEC_METHOD_PAPER, .has_curvature = true};
    assert_true(bytes_of(&graded, 1e4) >= bytes_of(&plain, 1e4) + 150e4);
    assert_true(plan_particle_memory(&graded, 1000, 300) < plan_particle_memory(&plain, 1000, 300) - 4e6);
    assert_true(bytes_of(&other, 1e4) == bytes_of(&plain, 1e4));
}

/* If patches with a uniform spacing are requested. */
static void defects_of_patches_are_repaired(void **state)
{
    (void)state;
    const spec labels = {.method = SPEC_METHOD_SIZED, .surface.kind = SPEC_SURFACE_LABELS},
               sharp = {.method = SPEC_METHOD_SIZED, .surface.mesh.has_features = true},
               formula = {.method = SPEC_METHOD_SIZED, .features = true},
               rows = {.method = SPEC_METHOD_SIZED, .features = true, .curve_spacing = 0.5},
               resolved = {.method = SPEC_METHOD_SIZED, .surface.mesh.has_features = true, .resolve = true},
               many = {.method = SPEC_METHOD_SIZED, .features = true, .count = 8000000},
               plain = {.method = SPEC_METHOD_SIZED, .surface.kind = SPEC_SURFACE_MESH};
    assert_true(plan_repairs_defects(&labels) && plan_repairs_defects(&sharp) &&
                plan_repairs_defects(&formula));
    assert_false(plan_repairs_defects(&rows) || plan_repairs_defects(&resolved) ||
                 plan_repairs_defects(&plain));
    /* no memory is reserved for a pass that is not made */
    assert_true(bytes_of(&many, 1e4) == bytes_of(&plain, 1e4));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(targets_come_to_a_count),
        cmocka_unit_test(a_count_out_of_range_names_its_target),
        cmocka_unit_test(a_count_out_of_range_recommends_a_value_that_is_accepted),
        cmocka_unit_test(the_limit_that_a_message_recommends_is_sufficient),
        cmocka_unit_test(a_message_recommends_no_limit_that_no_job_may_have),
        cmocka_unit_test(memory_is_that_of_particles_beside_source_and_pictures),
        cmocka_unit_test(memory_includes_defect_repair),
        cmocka_unit_test(defects_of_patches_are_repaired),
    };
    return cmocka_run_group_tests_name("plan", tests, NULL, NULL);
}

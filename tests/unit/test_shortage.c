// SPDX-License-Identifier: Apache-2.0
/* Allocations that fail while a surface is made and sampled: the caller gets the error limit_memory. The
 * linker replaces mem_array (--wrap).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "surface/field/analytic.h"
#include "surface/levelset/mesh_faces.h"
#include "surface/triangles/mesh_surface.h"
#include "mesh_fixture.h"
#include "solve_fixture.h"

void *__real_mem_array(size_t count, size_t size, const char *text, error *e);
void *__wrap_mem_array(size_t count, size_t size, const char *text, error *e);

static atomic_long calls, failing = -1; /* of the attempt; the failing one */

void *__wrap_mem_array(size_t count, size_t size, const char *text, error *e)
{
    if (atomic_fetch_add(&calls, 1) != atomic_load(&failing)) return __real_mem_array(count, size, text, e);
    error_set(e, ERROR_LIMIT_MEMORY, "not enough memory for %s", text);
    return NULL;
}

/* Makes and frees an object repeatedly; each of its allocations fails once. */
static void check(bool (*make)(error *e))
{
    long count = 1;
    for (long k = -1; k < count; k++) {
        error e = {0};
        atomic_store(&failing, k);
        atomic_store(&calls, 0);
        const bool ok = make(&e);
        if (k < 0) count = atomic_load(&calls);
        if (ok != (k < 0) || (!ok && e.code != ERROR_LIMIT_MEMORY))
            fail_msg("allocation %ld of %ld: %s, %s", k, count, ok ? "true" : "false", e.message);
    }
    atomic_store(&failing, -1);
    assert_true(count > 5);
}

static mesh box;

static mesh_surface *new_surface(error *e)
{
    mesh m = {0};
    mesh_patches patches = {0};
    mesh_notes notes = {0};
    const mesh_patches_params how = {.weld = 1e-6, .feature_angle = 0.7};
    mesh_surface *s = NULL;
    if (mesh_copy(&box, mesh_fixture_pool(), &m, e) && mesh_patches_make(&m, &how, &notes, &patches, e))
        s = mesh_surface_new(&patches, 0.5, (size_t)1 << 30, NULL, e);
    mesh_patches_free(&patches);
    return s;
}

static bool make_surface(error *e)
{
    mesh_surface *s = new_surface(e);
    if (!s) return false;
    mesh_surface_free(s);
    return true;
}

static void surface_of_a_mesh_without_memory_is_an_error(void **state)
{
    (void)state;
    check(make_surface);
}

static bool make_faces(error *e)
{
    const double to_world[16] = {0.5, 0, 0, -3, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1};
    mesh m = {0};
    if (!mesh_copy(&box, mesh_fixture_pool(), &m, e)) return false;
    mesh_faces *f = mesh_faces_new(&m, to_world, true, mesh_fixture_pool(), e);
    mesh_faces_free(f);
    return f;
}

static void triangles_of_a_level_set_without_memory_are_an_error(void **state)
{
    (void)state;
    check(make_faces);
}

static const field *solved_field;

static bool make_solve(error *e)
{
    solver_params params = solve_defaults;
    params.count = 60;
    params.max_sweeps = 20;
    threads *pool = mesh_fixture_pool();
    surface *scan = surface_scan(solved_field, pool, e);
    solver *s = scan ? solver_new(solved_field, scan, &params, pool, e) : NULL;
    bool ok = s;
    while (ok && !solver_ended(s)) ok = solver_step(s, e);
    ok = ok && solver_finalize(s, e);
    if (s) solver_free(s);
    if (scan) surface_free(scan);
    return ok;
}

static void solve_on_patches_without_memory_is_an_error(void **state)
{
    (void)state;
    error e = {0};
    mesh_surface *s = new_surface(&e);
    assert_non_null(s);
    solved_field = mesh_surface_field(s);
    check(make_solve);
    mesh_surface_free(s);
}

static void solve_of_a_formula_without_memory_is_an_error(void **state)
{
    (void)state;
    const analytic_params torus = {
        .shape = ANALYTIC_TORUS, .axis = {0, 0, 1}, .major_radius = 1, .minor_radius = 0.4};
    error e = {0};
    analytic *a = analytic_new(&torus, NULL, &e);
    assert_non_null(a);
    solved_field = &a->base;
    check(make_solve);
    analytic_free(a);
}

static int make_box(void **state)
{
    (void)state;
    mesh_fixture_pool(); /* made once */
    box = mesh_fixture_box(vec3_make(0, 0, 0), vec3_make(1, 1, 1), 0.3);
    return 0;
}

static int free_box(void **state)
{
    (void)state;
    mesh_free(&box);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(surface_of_a_mesh_without_memory_is_an_error),
        cmocka_unit_test(triangles_of_a_level_set_without_memory_are_an_error),
        cmocka_unit_test(solve_on_patches_without_memory_is_an_error),
        cmocka_unit_test(solve_of_a_formula_without_memory_is_an_error),
    };
    return cmocka_run_group_tests_name("shortage", tests, make_box, free_box);
}

// SPDX-License-Identifier: Apache-2.0
/* The edges of meshes, classified by the number of triangles that meet there. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "mesh_fixture.h"
#include "geometry/mesh/mesh_weld.h"
#include "geometry/mesh/mesh_edges.h"

static vec3 flat(double u, double v)
{
    return vec3_make(u, v, 0);
}

static void assert_edges(const mesh *m, size_t open, size_t odd, size_t branching, size_t against)
{
    mesh_edges edges = {0};
    error e = {0};
    assert_true(mesh_edges_list(m, mesh_fixture_pool(), &edges, &e));
    assert_int_equal(edges.open, open);
    assert_int_equal(edges.odd, odd);
    assert_int_equal(edges.branching, branching);
    assert_int_equal(edges.against, against);
    seam_edge *list;
    size_t count, found = 0;
    assert_true(mesh_edges_open(&edges, &list, &count, &e));
    assert_int_equal(count, open);
    for (size_t k = 0; k < count; k++) { /* each edge belongs to its triangle */
        const uint32_t *t = m->triangle[list[k].triangle];
        for (int c = 0; c < 3; c++) found += t[c] == list[k].from && t[(c + 1) % 3] == list[k].to;
    }
    assert_int_equal(found, count);
    free(list);
    mesh_edges_free(&edges);
}

static void kinds_are_counted(void **state)
{
    (void)state;
    mesh_notes notes = {0};
    error e = {0};
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 5); /* several chunks of work */
    assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &notes, &e));
    assert_edges(&m, 0, 0, 0, 0);
    mesh_fixture_turn(&m, 7000);
    assert_edges(&m, 0, 0, 0, 3);
    mesh_fixture_turn(&m, 7000);
    const uint32_t *t = m.triangle[7];
    mesh_fixture_add(&m, t[0], t[1], 5000); /* shares an edge of two triangles; its other edges are its own */
    assert_edges(&m, 2, 1, 1, 0);
    t = m.triangle[7];
    mesh_fixture_add(&m, t[1], t[0], 5001);
    assert_edges(&m, 4, 0, 1, 0);
    mesh_free(&m);
    mesh sheet = mesh_fixture_sheet(100, 60, flat);
    assert_edges(&sheet, 320, 0, 0, 0);
    mesh_free(&sheet);
}

/* Known edges are those of a closed mesh. They are listed again after vertices were joined. */
static void known_edges_are_kept(void **state)
{
    (void)state;
    for (int cut = 0; cut < 2; cut++) {
        mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 2);
        mesh_edges known = {0}, own = {0};
        mesh_notes notes = {0};
        error e = {0};
        assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &notes, &e));
        if (cut) { /* a separate corner at a small distance */
            mesh more = mesh_fixture_ball((vec3){1e-7, 0, 0}, 1, 2);
            const size_t first = m.vertex_count;
            mesh_fixture_append(&m, more);
            m.triangle_count /= 2;
            m.triangle[3][0] = (uint32_t)first + m.triangle[3][0];
        }
        assert_true(mesh_edges_list(&m, NULL, &known, &e));
        assert_int_equal(known.open, cut ? 4 : 0);
        const mesh_edges *edges = mesh_edges_close_seams(&m, &known, 1e-5, NULL, &own, &notes, &e);
        assert_ptr_equal(edges, cut ? &own : &known);
        assert_int_equal(edges->open, 0);
        assert_int_equal(notes.count, cut);
        mesh_edges_free(&known);
        mesh_edges_free(&own);
        mesh_free(&m);
    }
}

static vec3 below(double u, double v)
{
    return vec3_make(u, -v, 0);
}

/* Two sheets meet at a seam, where one has twice as many vertices. */
static void seams_of_many_open_edges_are_closed(void **state)
{
    (void)state;
    mesh m = mesh_fixture_sheet(16000, 1, flat);
    mesh_edges own = {0};
    mesh_notes notes = {0};
    error e = {0};
    mesh_fixture_append(&m, mesh_fixture_sheet(8000, 1, below));
    assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &notes, &e));
    const mesh_edges *edges = mesh_edges_close_seams(&m, NULL, 1e-7, NULL, &own, &notes, &e);
    assert_non_null(edges);
    assert_int_equal(edges->open, 16000 + 8000 + 4);
    mesh_edges_free(&own);
    mesh_free(&m);
}

/* Quads of 1e-3 in two sheets that meet at a seam, with vertices of their own: within the rounding that a model of size 1 has, they
 * are joined. With a part at 1e9, the tolerance is a thousand times the size of the sheets: their rims do not collapse. */
static void parts_are_joined_at_their_own_scale(void **state)
{
    (void)state;
    for (int far = 0; far < 2; far++) {
        mesh m = mesh_fixture_sheet(20, 20, flat), other = mesh_fixture_sheet(20, 20, below);
        mesh_edges own = {0};
        mesh_notes notes = {0};
        error e = {0};
        for (size_t v = 0; v < other.vertex_count; v++) other.vertex[v].z += 1e-6;
        mesh_fixture_append(&m, other);
        for (size_t v = 0; v < m.vertex_count; v++)
            m.vertex[v] = vec3_scale(m.vertex[v], 0.02); /* sides of 1e-3 */
        if (far) {
            mesh part = mesh_fixture_ball((vec3){1e9, 0, 0}, 1, 1);
            mesh_fixture_append(&m, part);
        }
        assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &notes, &e));
        const size_t triangles = m.triangle_count;
        const mesh_edges *edges = mesh_edges_close_seams(&m, NULL, far ? 1e3 : 1e-6, NULL, &own, &notes, &e);
        assert_non_null(edges);
        assert_int_equal(m.triangle_count, triangles);
        assert_int_equal(edges->open, 4 * 40 - 2 * 20);
        mesh_edges_free(&own);
        mesh_free(&m);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(kinds_are_counted),
                                       cmocka_unit_test(known_edges_are_kept),
                                       cmocka_unit_test(seams_of_many_open_edges_are_closed),
                                       cmocka_unit_test(parts_are_joined_at_their_own_scale)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

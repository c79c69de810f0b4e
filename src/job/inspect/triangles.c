// SPDX-License-Identifier: Apache-2.0
/* The contents of mesh files. */
#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "job/inspect/contents.h"
#include "job/inspect/suggestion.h"
#include "geometry/mesh/flat_triangles.h"
#include "geometry/mesh/mesh_weld.h"
#include "geometry/mesh/mesh_edges.h"
#include "io/meshes/mesh_file.h"
#include "job/report/report.h"

/* Counts the edges at which an odd number of triangles meets, and finds their box. */
static bool find_open_edges(const mesh *m, size_t *count, bbox *box, error *e)
{
    mesh_edges edges = {0};
    const bool listed = mesh_edges_list(m, NULL, &edges, e);
    *count = edges.open + edges.odd;
    *box = bbox_empty();
    for (size_t v = 0; listed && *count > 0 && v < edges.vertex_count; v++)
        for (size_t k = edges.first[v], n; k < edges.first[v + 1]; k += n) {
            n = mesh_edges_width(&edges, v, k);
            if (n % 2) *box = bbox_include(bbox_include(*box, m->vertex[v]), m->vertex[edges.sides[k].other]);
        }
    mesh_edges_free(&edges);
    return listed;
}

/* Counts the sets of triangles that are connected by vertices. Every vertex belongs to a triangle. */
static bool count_components(const mesh *m, size_t *count, error *e)
{
    uint32_t *parent = mem_array(m->vertex_count, sizeof *parent, "the parts of the mesh", e);
    if (!parent) return false;
    sets_reset(parent, m->vertex_count);
    *count = m->vertex_count;
    for (size_t k = 0; k < m->triangle_count; k++)
        for (int i = 1; i < 3; i++) *count -= sets_join(parent, m->triangle[k][0], m->triangle[k][i]);
    free(parent);
    return true;
}

static bool describe(const mesh *m, json *o, error *e)
{
    size_t open = 0, parts = 0;
    bbox box = bbox_empty(), open_box;
    if (!find_open_edges(m, &open, &open_box, e) || !count_components(m, &parts, e)) return false;
    for (size_t k = 0; k < m->vertex_count; k++) box = bbox_include(box, m->vertex[k]);
    json_put_integer(o, "vertices", (int64_t)m->vertex_count);
    json_put_integer(o, "triangles", (int64_t)m->triangle_count);
    json_put_integer(o, "components", (int64_t)parts);
    json_put_bool(o, "closed", open == 0);
    json_put_integer(o, "open_edges", (int64_t)open);
    if (open > 0) report_put_box(json_put_object(o, "open_at"), open_box);
    json_put_number(o, "area", mesh_area(m));
    report_put_box(o, box);
    return true;
}

/* Lists the values of the vertices with the smallest and the largest one of each component, for attributes and maps of
 * spacings. A file whose values are not read has no list. */
static void describe_values(const mesh_file *file, json *o)
{
    mesh m;
    mesh_values values;
    if (!mesh_file_read_values(file, &m, &values, NULL, NULL)) return;
    json *list = json_put_array(o, "values");
    for (size_t k = 0; k < values.count; k++) {
        const size_t width = values.head[k].components;
        json *one = json_append_object(list);
        json_put_string(one, "name", values.head[k].name);
        json *minimum = json_put_array(one, "minimum"), *maximum = json_put_array(one, "maximum");
        for (size_t c = 0; c < width; c++) {
            double low = INFINITY, high = -INFINITY;
            for (size_t n = c; n < width * m.vertex_count; n += width) {
                const double value = values.value[k][n];
                if (isfinite(value)) low = fmin(low, value);
                if (isfinite(value)) high = fmax(high, value);
            }
            json_append_number(minimum, low);
            json_append_number(maximum, high);
        }
    }
    mesh_values_free(&values);
    mesh_free(&m);
}

/* Describes a mesh file. The mesh is freed here; suggestions are tried on a mesh that the job reads again. */
static bool describe_file(const contents_input *in, json *o, error *e)
{
    const mesh_file file = {in->fd, in->path, NULL, run_options_memory(in->options, 0)};
    mesh m;
    mesh_notes notes = {0};
    if (!mesh_file_read(&file, &m, &notes, e)) return error_prefix(e, "%s", in->path);
    bool ok = flat_triangles_remove(&m, NULL, &notes, e) && mesh_weld(&m, MESH_DROP_IF_CLOSED, &notes, e) &&
              describe(&m, o, e);
    json *told = json_put_array(o, "notes");
    for (size_t k = 0; k < notes.count; k++) json_append_string(told, notes.text[k]);
    mesh_free(&m);
    if (ok) describe_values(&file, o);
    return ok;
}

bool contents_read_mesh(const contents_input *in, json *inspection, error *e)
{
    if (!describe_file(in, json_put_object(inspection, "mesh"), e)) return false;
    json *shape = json_new_object();
    json_put_string(json_put_object(shape, "mesh"), "path", in->path);
    return suggestion_append(json_find(inspection, "/suggestions"), shape, 0, in->options, e);
}

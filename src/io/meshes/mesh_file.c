// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/mesh_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/file_format.h"
#include "base/core/memory.h"
#include "base/core/reader.h"
#include "io/meshes/mesh_check.h"
#include "io/meshes/mesh_reader.h"

/* CPU limit of the reading process: seconds_at_least plus 1 s for each MiB of the file. Text is read at 10
 * MB/s or more. */
static const unsigned seconds_at_least = 60;
static const off_t bytes_per_second = 1 << 20;

/* The letters and digits after the last dot of the file's name, in lower case, at most 15. */
static void ending_of(const char *path, char out[16])
{
    const char *dot = strrchr(path, '.');
    size_t n = 0;
    if (dot && !strchr(dot, '/'))
        for (const char *p = dot + 1; *p && n < 15; p++) {
            char c = *p >= 'A' && *p <= 'Z' ? (char)(*p + 'a' - 'A') : *p;
            if (!((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'))) break;
            out[n++] = c;
        }
    out[n] = '\0';
}

/* Starts the process with the file as its input. */
static bool start(const mesh_file *file, const char *command, off_t size, reader *out, error *e)
{
    char ending[16];
    ending_of(file->path, ending);
    const reader_params params = {file->program,
                                  command,
                                  ending,
                                  file->fd,
                                  file->memory_limit,
                                  seconds_at_least + (unsigned)(size / bytes_per_second)};
    return reader_start(&params, out, e);
}

/* Checks that the answer ends here. */
static bool check_end(reader *r, error *e)
{
    return fgetc(r->stream) == EOF ||
           error_set(e, ERROR_INPUT_DAMAGED,
                     "the file made its reader return more data than announced: save it in another format");
}

/* *text receives the warnings, one a line. */
static bool read_header(reader *r, mesh_reader_header *h, char **text, error *e)
{
    if (!reader_get_answer(r, h, sizeof *h, text, MESH_READER_TEXT_MAX, e)) return false;
    reader_blank(*text, "\n");
    return true;
}

static bool read_triangles(reader *r, mesh *m, error *e)
{
    if (!reader_get(r, m->triangle, sizeof m->triangle[0], m->triangle_count, e)) return false;
    for (size_t n = 0; n < m->triangle_count; n++)
        for (int k = 0; k < 3; k++)
            if (m->triangle[n][k] >= m->vertex_count)
                return error_set(
                    e, ERROR_INPUT_DAMAGED,
                    "triangle %zu: a corner is not among the %zu vertices of the mesh: repair the mesh", n,
                    m->vertex_count);
    return true;
}

static bool read_array(reader *r, size_t vertices, size_t *left, mesh_reader_values *head, double **value,
                       error *e)
{
    if (!reader_get(r, head, sizeof *head, 1, e)) return false;
    if (!memchr(head->name, 0, sizeof head->name) || head->kind >= MESH_VALUES_KINDS ||
        head->components < 1 || head->components > MESH_VALUES_COMPONENTS)
        return reader_invalid(e);
    for (char *p = head->name; *p; p++) /* the name comes from the file */
        if ((unsigned char)*p < ' ' || *p == 0x7F) *p = '?';
    const size_t each = head->components * sizeof **value;
    if (vertices > *left / each)
        return error_set(
            e, ERROR_LIMIT_MEMORY,
            "the values of its %zu vertices require more memory than is left: raise limits.memory_mb",
            vertices);
    *left -= vertices * each;
    *value = mem_array(vertices, each, "the values of the vertices", e);
    return *value && reader_get(r, *value, each, vertices, e);
}

static bool read_values(reader *r, const mesh *m, size_t limit, mesh_values *out, error *e)
{
    uint32_t count;
    if (!reader_get(r, &count, sizeof count, 1, e)) return false;
    if (count > MESH_VALUES_MOST) return reader_invalid(e);
    out->head = mem_alloc(count * sizeof *out->head);
    out->value = mem_alloc(count * sizeof *out->value);
    for (; out->count < count; out->count++)
        if (!read_array(r, m->vertex_count, &limit, &out->head[out->count], &out->value[out->count], e)) {
            free(out->value[out->count]);
            return false;
        }
    return true;
}

/* Checks that the polygons have the triangles and the vertices of the mesh. */
static bool check_polygons(const mesh *m, mesh_polygons *p, error *e)
{
    size_t triangles = 0;
    p->first[0] = 0;
    for (size_t k = 0; k < p->count; k++) {
        if (p->size[k] > p->corners - p->first[k]) return reader_invalid(e);
        p->first[k + 1] = p->first[k] + p->size[k];
        triangles += p->size[k] > 2 ? p->size[k] - 2 : 0;
    }
    for (size_t k = 0; k < p->corners; k++)
        if (p->corner[k] >= m->vertex_count) return reader_invalid(e);
    return (p->first[p->count] == p->corners && triangles == m->triangle_count) || reader_invalid(e);
}

static bool read_polygons(reader *r, const mesh *m, size_t limit, mesh_polygons *out, error *e)
{
    static const char what[] = "the polygons of the mesh";
    uint64_t counts[2];
    if (!reader_get(r, counts, sizeof counts, 1, e)) return false;
    if (counts[0] >= UINT32_MAX || counts[1] / 8 >= UINT32_MAX) return reader_invalid(e);
    if ((counts[0] + 1) * (sizeof *out->size + sizeof *out->first) + counts[1] * sizeof *out->corner > limit)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "its %llu polygons require more memory than is left: raise limits.memory_mb",
                         (unsigned long long)counts[0]);
    out->count = counts[0];
    out->corners = counts[1];
    return (out->size = mem_array(out->count, sizeof *out->size, what, e)) &&
           (out->first = mem_array(out->count + 1, sizeof *out->first, what, e)) &&
           (out->corner = mem_array(out->corners, sizeof *out->corner, what, e)) &&
           reader_get(r, out->size, sizeof *out->size, out->count, e) &&
           reader_get(r, out->corner, sizeof *out->corner, out->corners, e) && check_polygons(m, out, e);
}

/* ---- textures */

static bool check_material(mesh_material *m, const mesh_textures *t, error *e)
{
    double sum = 0;
    if (!memchr(m->name, 0, sizeof m->name) || m->wrap[0] >= MESH_WRAPS || m->wrap[1] >= MESH_WRAPS ||
        (m->image != MESH_TEXTURES_NONE && m->image >= t->images))
        return reader_invalid(e);
    reader_blank(m->name, "");
    for (int k = 0; k < 4; k++) sum += m->factor[k];
    for (int k = 0; k < 6; k++) sum += m->transform[k / 3][k % 3];
    return isfinite(sum) ||
           error_set(e, ERROR_INPUT_DAMAGED,
                     "the material \"%s\" has a number that is not finite. Save it again.", m->name);
}

static bool read_images(reader *r, size_t limit, mesh_textures *t, error *e)
{
    size_t left = limit;
    if (!reader_get(r, t->image, sizeof *t->image, t->images, e)) return false;
    for (size_t k = 0; k < t->images; k++) {
        if (!memchr(t->image[k].name, 0, sizeof t->image[k].name)) return reader_invalid(e);
        reader_blank(t->image[k].name, "");
    }
    for (size_t k = 0; k < t->images; k++) {
        const uint64_t bytes = t->image[k].bytes;
        if (bytes > left)
            return error_set(e, ERROR_LIMIT_MEMORY,
                             "its images require more memory than is left: raise limits.memory_mb");
        left -= bytes;
        if (bytes == 0) continue;
        t->data[k] = mem_array(bytes, 1, "the images of the mesh", e);
        if (!t->data[k] || !reader_get(r, t->data[k], 1, bytes, e)) return false;
    }
    return true;
}

bool mesh_file_parse_textures(reader *r, size_t memory_limit, mesh_textures *out, error *e)
{
    mesh_textures_header h;
    if (!reader_get(r, &h, sizeof h, 1, e)) return false;
    if (h.materials > MESH_TEXTURES_MOST || h.images > MESH_TEXTURES_MOST || h.libraries > MESH_TEXTURES_MOST)
        return reader_invalid(e);
    out->material = mem_alloc(h.materials * sizeof *out->material);
    out->library = mem_alloc(h.libraries * sizeof *out->library);
    out->image = mem_alloc(h.images * sizeof *out->image);
    out->data = mem_alloc(h.images * sizeof *out->data);
    out->materials = h.materials;
    out->libraries = h.libraries;
    out->images = h.images;
    if (!reader_get(r, out->material, sizeof *out->material, out->materials, e) ||
        !reader_get(r, out->library, sizeof *out->library, out->libraries, e))
        return false;
    for (size_t k = 0; k < out->materials; k++)
        if (!check_material(&out->material[k], out, e)) return false;
    for (size_t k = 0; k < out->libraries; k++) {
        if (!memchr(out->library[k], 0, sizeof out->library[k])) return reader_invalid(e);
        reader_blank(out->library[k], "");
    }
    if (!memchr(h.warnings, 0, sizeof h.warnings)) return reader_invalid(e);
    reader_blank(h.warnings, "\n");
    memcpy(out->warnings, h.warnings, sizeof out->warnings);
    out->unlisted = h.unlisted;
    return read_images(r, memory_limit, out, e);
}

void mesh_polygons_free(mesh_polygons *polygons)
{
    free(polygons->size);
    free(polygons->first);
    free(polygons->corner);
    *polygons = (mesh_polygons){0};
}

uint32_t *mesh_polygons_of_triangles(const mesh_polygons *p, size_t triangles, error *e)
{
    uint32_t *polygon = mem_array(triangles, sizeof *polygon, "the polygons of the triangles", e),
             *next = polygon;
    for (size_t k = 0; polygon && k < p->count; k++)
        for (uint32_t n = 2; n < p->size[k]; n++) *next++ = (uint32_t)k;
    return polygon;
}

uint32_t mesh_polygons_find_corner(const mesh_polygons *p, uint32_t polygon, uint32_t vertex)
{
    const uint32_t *corner = p->corner + p->first[polygon];
    uint32_t k = 0;
    while (k + 1 < p->size[polygon] && corner[k] != vertex) k++;
    return k;
}

void mesh_values_free(mesh_values *values)
{
    for (size_t k = 0; k < values->count; k++) free(values->value[k]);
    free(values->value);
    free(values->head);
    *values = (mesh_values){0};
}

bool mesh_values_find(const mesh_values *values, const char *name, size_t *which, error *e)
{
    char list[600] = "";
    size_t found = 0;
    for (size_t k = 0; k < values->count; k++)
        if (name && strcmp(values->head[k].name, name) == 0) {
            *which = k;
            found++;
        }
    if (found > 1)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the mesh has %zu values with the name \"%s\": rename one of them", found, name);
    if (found == 1) return true;
    for (size_t k = 0; k < values->count; k++) {
        size_t used = strlen(list);
        snprintf(list + used, sizeof list - used, "%s\"%s\"", k ? ", " : "", values->head[k].name);
    }
    return error_set(e, ERROR_ATTRIBUTE_MISSING, "the mesh has no \"%s\": choose one of %s%s",
                     name ? name : "", *list ? list : "none (its vertices have positions only)",
                     values->count == MESH_VALUES_MOST ? ", which are the first ones of the file" : "");
}

static void note_lines(mesh_notes *notes, char *text)
{
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) mesh_note(notes, "%s", line);
}

/* Adds the warnings of the reader to the error of a mesh without triangles: they say what was skipped. */
static void name_skipped(char *text, error *e)
{
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) {
        const size_t length = strlen(e->message);
        snprintf(e->message + length, sizeof e->message - length, "; %s", line);
    }
}

bool mesh_file_parse(reader *r, size_t memory_limit, mesh_reader_header *header, mesh *out, mesh_notes *notes,
                     mesh_values *values, mesh_polygons *polygons, mesh_textures *textures, error *e)
{
    mesh m = {0};
    char *text = NULL;
    size_t unused = 0;
    bool ok = read_header(r, header, &text, e);
    if (ok && !mesh_check_counts(header->vertices, header->triangles, header->others, memory_limit, e)) {
        if (e->code == ERROR_NO_SURFACE) name_skipped(text, e);
        ok = false;
    }
    if (ok) {
        m.vertex_count = header->vertices;
        m.triangle_count = header->triangles;
        m.vertex = mem_array(m.vertex_count, sizeof *m.vertex, "the mesh", e);
        m.triangle = m.vertex ? mem_array(m.triangle_count, sizeof *m.triangle, "the mesh", e) : NULL;
        ok = m.triangle && reader_get(r, m.vertex, sizeof *m.vertex, m.vertex_count, e) &&
             read_triangles(r, &m, e) && mesh_check_vertices(&m, &unused, e) &&
             (!values || read_values(r, &m, memory_limit, values, e)) &&
             (!polygons || read_polygons(r, &m, memory_limit, polygons, e)) &&
             (!textures || mesh_file_parse_textures(r, memory_limit, textures, e));
    }
    ok = ok && check_end(r, e);
    if (ok) note_lines(notes, text);
    free(text);
    if (!ok) {
        mesh_free(&m);
        return false;
    }
    mesh_check_note_unused(notes, unused);
    *out = m;
    return true;
}

/* Skips the triangles of a file of points, and checks that the answer ends there. */
static bool skip_triangles(reader *r, uint64_t triangles, error *e)
{
    uint32_t corner[3];
    for (uint64_t n = 0; n < triangles; n++)
        if (!reader_get(r, corner, sizeof corner, 1, e)) return false;
    return check_end(r, e);
}

bool mesh_file_parse_points(reader *r, size_t memory_limit, vec3 **out, size_t *count, error *e)
{
    mesh_reader_header h, *header = &h;
    char *text = NULL;
    if (!read_header(r, header, &text, e)) return false;
    free(text);
    if (header->vertices == 0)
        return error_set(e, ERROR_INPUT_DAMAGED, "the file has no points: give one with points");
    if (header->vertices > memory_limit / sizeof **out)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "its %llu points require more memory than is left: raise limits.memory_mb",
                         (unsigned long long)header->vertices);
    const size_t n = (size_t)header->vertices;
    vec3 *point = mem_array(n, sizeof *point, "the given points", e);
    if (point && reader_get(r, point, sizeof *point, n, e) && skip_triangles(r, header->triangles, e) &&
        mesh_check_points(point, n, e)) {
        *out = point;
        *count = n;
        return true;
    }
    free(point);
    return false;
}

bool mesh_file_read_points(const mesh_file *file, vec3 **out, size_t *count, error *e)
{
    off_t size = 0;
    reader r;
    vec3 *point = NULL;
    size_t n = 0;
    if (!file_formats[file_format_of_name(file->path)].has_points)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the name of the file does not end in .ply or .npz: give points in one of these");
    if (!reader_check_file(file->fd, "points", &size, e) || !start(file, MESH_READER_COMMAND, size, &r, e))
        return false;
    bool ok = mesh_file_parse_points(&r, file->memory_limit, &point, &n, e);
    ok = reader_end(&r, ok, e);
    if (!ok) {
        free(point);
        return false;
    }
    *out = point;
    *count = n;
    return true;
}

static void note_header(mesh_notes *notes, const mesh_reader_header *header)
{
    if (header->others)
        mesh_note(notes, "the mesh has %llu points or lines in addition to its triangles: they are skipped",
                  (unsigned long long)header->others);
    mesh_check_note_crossed(notes, header->crossed);
    if (header->end)
        mesh_note(notes, "the file has other data after its mesh, from byte %llu on: they are not read",
                  (unsigned long long)header->end);
}

/* `notes`, `values`, `polygons`, `textures`: NULL if they are not wanted. */
static bool read_file(const mesh_file *file, const char *command, mesh *out, mesh_notes *notes,
                      mesh_values *values, mesh_polygons *polygons, mesh_textures *textures, error *e)
{
    mesh m = {0};
    mesh_values v = {0};
    mesh_polygons p = {0};
    mesh_textures t = {0};
    mesh_notes unused = {0};
    mesh_reader_header header = {0};
    off_t size = 0;
    reader r;
    if (!reader_check_file(file->fd, "mesh", &size, e) || !start(file, command, size, &r, e)) return false;
    bool ok = mesh_file_parse(&r, file->memory_limit, &header, &m, notes ? notes : &unused,
                              values ? &v : NULL, polygons ? &p : NULL, textures ? &t : NULL, e);
    ok = reader_end(&r, ok, e);
    if (!ok) {
        mesh_free(&m);
        mesh_values_free(&v);
        mesh_polygons_free(&p);
        mesh_textures_free(&t);
        return false;
    }
    if (notes) note_header(notes, &header);
    *out = m;
    if (values) *values = v;
    if (polygons) *polygons = p;
    if (textures) *textures = t;
    return true;
}

bool mesh_file_read(const mesh_file *file, mesh *out, mesh_notes *notes, error *e)
{
    return read_file(file, MESH_READER_COMMAND, out, notes, NULL, NULL, NULL, e);
}

bool mesh_file_read_values(const mesh_file *file, mesh *out, mesh_values *values, mesh_notes *notes, error *e)
{
    return read_file(file, MESH_VALUES_COMMAND, out, notes, values, NULL, NULL, e);
}

bool mesh_file_read_polygons(const mesh_file *file, mesh *out, mesh_polygons *polygons, error *e)
{
    return read_file(file, MESH_POLYGONS_COMMAND, out, NULL, NULL, polygons, NULL, e);
}

bool mesh_file_read_textures(const mesh_file *file, mesh *out, mesh_values *values, mesh_textures *textures,
                             mesh_notes *notes, error *e)
{
    return read_file(file, MESH_TEXTURES_COMMAND, out, notes, values, NULL, textures, e);
}

bool mesh_file_read_materials(const mesh_file *file, mesh_textures *textures, error *e)
{
    mesh_reader_header header = {0};
    mesh_textures found = {0};
    char *text = NULL;
    off_t size = 0;
    reader r;
    if (!reader_check_file(file->fd, "file of materials", &size, e) ||
        !start(file, MESH_MATERIALS_COMMAND, size, &r, e))
        return false;
    bool ok = read_header(&r, &header, &text, e) &&
              mesh_file_parse_textures(&r, file->memory_limit, &found, e) && check_end(&r, e);
    free(text);
    ok = reader_end(&r, ok, e);
    if (ok)
        *textures = found;
    else
        mesh_textures_free(&found);
    return ok;
}

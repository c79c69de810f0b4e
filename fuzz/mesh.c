// SPDX-License-Identifier: Apache-2.0
/* What the process that reads meshes answers: mesh_file_parse, with what vertices have, with polygons and
 * with neither, and the judgement of its triangles on the way to a level set; and the same bytes as files
 * that this process reads itself. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fuzz/target.h"
#include "surface/levelset/levelset.h"
#include "io/meshes/collada_textures.h"
#include "io/meshes/mesh_file.h"
#include "io/meshes/plain_textures.h"

static const size_t memory = (size_t)64 << 20;

static void check_grid(const vdb_grid *g)
{
    for (size_t n = 0; n < g->leaf_count * VDB_LEAF_VOXELS; n++) expect(isfinite(g->leaf_values[n]));
    for (size_t n = 0; n < g->leaf_count; n++)
        for (int k = 0; k < 3; k++) expect(g->leaf_origin[n][k] % VDB_LEAF_SIDE == 0);
    expect(g->leaf_count > 0);
}

static void make_levelset(mesh *m)
{
    error e = {0};
    mesh_notes notes = {0};
    threads *alone = threads_new(1, NULL, &e);
    expect(alone);
    levelset_params params = {
        .resolution = 16, .band_vox = 3, .weld = 1e-4, .memory_limit = memory, .pool = alone};
    vdb_grid *g = levelset_make(m, &params, &notes, NULL, &e);
    expect(g || (e.code != ERROR_INTERNAL && *e.message));
    expect(notes.count <= MESH_MAX_NOTES);
    if (g) check_grid(g);
    vdb_grid_free(g);
    threads_free(alone);
}

static void read_points(const uint8_t *data, size_t size)
{
    error e = {0};
    vec3 *point = NULL;
    size_t count = 0;
    reader from = {.stream = fmemopen((void *)data, size, "rb")};
    expect(from.stream);
    const bool ok = mesh_file_parse_points(&from, memory, &point, &count, &e);
    expect(ok ? count > 0 : *e.message != 0);
    for (size_t i = 0; i < count; i++) expect(isfinite(point[i].x + point[i].y + point[i].z));
    free(point);
    fclose(from.stream);
}

static void read_values(const uint8_t *data, size_t size)
{
    error e = {0};
    mesh m = {0};
    mesh_values values = {0};
    mesh_reader_header told = {0};
    mesh_notes notes = {0};
    reader from = {.stream = fmemopen((void *)data, size, "rb")};
    expect(from.stream);
    bool ok = mesh_file_parse(&from, memory, &told, &m, &notes, &values, NULL, NULL, &e);
    expect(ok || *e.message);
    for (size_t k = 0; ok && k < values.count; k++) {
        const mesh_reader_values *head = &values.head[k];
        expect(memchr(head->name, 0, sizeof head->name) && head->components >= 1);
        double sum = 0; /* each number is there */
        for (size_t i = 0; i < m.vertex_count * head->components; i++) sum += values.value[k][i];
        expect(sum == sum || sum != sum);
    }
    fclose(from.stream);
    mesh_values_free(&values);
    mesh_free(&m);
}

static void read_polygons(const uint8_t *data, size_t size)
{
    error e = {0};
    mesh m = {0};
    mesh_polygons polygons = {0};
    mesh_reader_header told = {0};
    mesh_notes notes = {0};
    reader from = {.stream = fmemopen((void *)data, size, "rb")};
    expect(from.stream);
    bool ok = mesh_file_parse(&from, memory, &told, &m, &notes, NULL, &polygons, NULL, &e);
    expect(ok || *e.message);
    for (size_t k = 0; ok && k < polygons.count; k++)
        for (size_t c = polygons.first[k]; c < polygons.first[k + 1]; c++)
            expect(polygons.corner[c] < m.vertex_count);
    fclose(from.stream);
    mesh_polygons_free(&polygons);
    mesh_free(&m);
}

/* A file with its polygons, with the values of its vertices, or with its textures. */
static void read_plain(file_format format, plain_mesh m, const char *data, size_t size)
{
    if (!plain_mesh_read(format, data, size, &m)) {
        expect(m.refused == ERROR_NONE ? m.needs_library : *m.text);
        return;
    }
    expect(m.rest <= size);
    for (size_t n = 0; n < m.triangles; n++)
        for (int k = 0; k < 3; k++) expect(m.triangle[n][k] < m.vertices);
    for (uint32_t k = 0; k < m.value_arrays; k++) expect(m.values[k].count == m.vertices);
    plain_mesh_free(&m);
}

/* A file with its textures, or a file of materials (FILE_FORMAT_UNKNOWN). */
static void read_textures(file_format format, const char *data, size_t size)
{
    plain_textures textures = {0};
    plain_mesh m = {.textures = &textures, .keeps_values = true};
    const mesh_textures *all = &textures.all;
    if (format != FILE_FORMAT_UNKNOWN)
        read_plain(format, m, data, size);
    else
        expect(plain_textures_read_mtl(data, size, &m) || *m.text);
    for (size_t k = 0; k < all->materials; k++)
        expect(all->material[k].image == MESH_TEXTURES_NONE || all->material[k].image < all->images);
    mesh_textures_free(&textures.all);
}

/* A COLLADA file, whose materials have the names of those in the corpus. */
static void read_collada(const char *data, size_t size)
{
    plain_textures textures = {0};
    plain_mesh m = {.textures = &textures};
    mesh_material material = mesh_textures_white();
    uint32_t index, set[2] = {0};
    for (int k = 0; k < 2; k++) {
        snprintf(material.name, sizeof material.name, "paint %d", k);
        expect(plain_textures_add_material(&m, &material, &index));
    }
    expect(collada_textures_read(data, size, &m, set) || *m.text);
    for (size_t k = 0; k < textures.all.materials; k++)
        expect(textures.all.material[k].wrap[0] < MESH_WRAPS &&
               textures.all.material[k].wrap[1] < MESH_WRAPS);
    mesh_textures_free(&textures.all);
}

/* What the process answers of textures. */
static void parse_textures(const uint8_t *data, size_t size)
{
    error e = {0};
    mesh_textures t = {0};
    reader from = {.stream = fmemopen((void *)data, size, "rb")};
    expect(from.stream);
    const bool ok = mesh_file_parse_textures(&from, memory, &t, &e);
    expect(ok || *e.message);
    for (size_t k = 0; ok && k < t.images; k++) expect(memchr(t.image[k].name, 0, sizeof t.image[k].name));
    mesh_textures_free(&t);
    fclose(from.stream);
}

/* The same bytes as files of each format. */
static void read_files(const uint8_t *data, size_t size)
{
    char *copy = malloc(size + 1); /* the sanitizers see what is read behind it */
    expect(copy);
    memcpy(copy, data, size);
    copy[size] = 0;
    for (int k = 0; k < FILE_FORMATS; k++) {
        const file_format format = (file_format)k;
        if (!plain_mesh_reads(format)) continue;
        read_plain(format, (plain_mesh){.keeps_polygons = true}, copy, size);
        read_plain(format, (plain_mesh){.keeps_values = true}, copy, size);
        if (plain_mesh_reads_textures(format)) read_textures(format, copy, size);
    }
    read_textures(FILE_FORMAT_UNKNOWN, copy, size);
    read_collada(copy, size);
    free(copy);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    error e = {0};
    mesh m = {0};
    mesh_reader_header told = {0};
    mesh_notes notes = {0};
    if (size == 0) return 0; /* not for fmemopen */
    read_values(data, size);
    read_polygons(data, size);
    read_points(data, size);
    parse_textures(data, size);
    read_files(data, size);
    reader from = {.stream = fmemopen((void *)data, size, "rb")};
    expect(from.stream);
    if (mesh_file_parse(&from, memory, &told, &m, &notes, NULL, NULL, NULL, &e))
        make_levelset(&m);
    else
        expect(*e.message);
    fclose(from.stream);
    mesh_free(&m);
    return 0;
}

// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/mesh_reader.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/error.h"
#include "base/core/file_format.h"
#include "base/core/reader.h"
#include "base/core/transfer.h"
#include "io/meshes/library_mesh.h"
#include "io/meshes/library_text.h"
#include "io/meshes/plain_textures.h"

/* A file that is being read. */
typedef struct reading {
    const char *ending; /* of the file's name */
    size_t memory;      /* limit, bytes */
    char *data;
    size_t size;
    file_format format;
    plain_mesh mesh;
    plain_textures textures;
} reading;

/* A step of reading. False: r->mesh is refused. */
typedef bool step(reading *r);

static bool load(reading *r)
{
    struct stat st;
    int64_t count = -1;
    if (fstat(STDIN_FILENO, &st) == 0 && (r->data = malloc((size_t)st.st_size + 1)))
        count = transfer_read_at(STDIN_FILENO, r->data, (size_t)st.st_size, 0);
    if (count < 0)
        return plain_mesh_refuse(&r->mesh, ERROR_LIMIT_MEMORY,
                                 "the file is larger than the memory limit: raise limits.memory_mb");
    r->size = (size_t)count;
    r->data[r->size] = 0;
    return true;
}

/* Chooses the format: that of the bytes if they are those of a mesh that is read, otherwise that of the name, otherwise that of
 * the first words. */
static bool choose_format(reading *r)
{
    const file_format found = file_format_of_bytes(r->data, r->size);
    const bool is_mesh =
        file_formats[found].kind == FILE_FORMAT_MESHES && file_formats[found].reading != FILE_FORMAT_NOT_READ;
    r->format = is_mesh ? found : file_format_of_name(r->ending);
    if (r->format == FILE_FORMAT_UNKNOWN && found == FILE_FORMAT_UNKNOWN)
        r->format = file_format_of_words(r->data, r->size);
    return true;
}

/* Converts UTF-16 and other encodings of XML. */
static bool convert_text(reading *r)
{
    const file_format f = r->format;
    if (f != FILE_FORMAT_VTP && f != FILE_FORMAT_VTK && f != FILE_FORMAT_GIFTI && f != FILE_FORMAT_COLLADA)
        return true;
    char *text = xml_in_utf8(r->data, &r->size);
    if (text) r->data = text;
    if (f == FILE_FORMAT_COLLADA) library_text_move_blanks(r->data);
    return true;
}

static bool check_textures(reading *r)
{
    return !r->mesh.textures || plain_mesh_reads_textures(r->format) || r->format == FILE_FORMAT_COLLADA ||
           plain_mesh_refuse(
               &r->mesh, ERROR_INPUT_UNSUPPORTED,
               "base_color is not read from such files: save it as glTF, OBJ, PLY, 3MF or COLLADA "
               "with its textures");
}

/* Refuses a file that is not read, by its bytes or its name. The message replaces that of a reader. */
static bool refuse_format(reading *r)
{
    const char *advice = file_format_as_mesh(r->ending, r->data, r->size);
    if (advice) r->mesh.refused = ERROR_NONE;
    return plain_mesh_refuse(
        &r->mesh, ERROR_INPUT_UNSUPPORTED, "%s",
        advice
            ? advice
            : "its format is not known, by its name and first bytes: it is neither a mesh nor a volume that is "
              "read. Save a mesh as PLY, OBJ, STL or OFF, and a volume as OpenVDB or NRRD. Convert it with Blender, "
              "or with assimp (assimp export FILE mesh.ply), and compare its size and axes.");
}

static bool read_mesh(reading *r)
{
    const bool by_library = file_formats[r->format].reading == FILE_FORMAT_READ_BY_LIBRARY;
    if (plain_mesh_reads(r->format)) {
        if (plain_mesh_read(r->format, r->data, r->size, &r->mesh)) return true;
        if (!r->mesh.needs_library) return refuse_format(r);
        if (r->mesh.textures)
            return plain_mesh_refuse(&r->mesh, ERROR_INPUT_UNSUPPORTED,
                                     "base_color is not read from glTF with Draco: save it without");
    } else if (!by_library || file_format_as_mesh(r->ending, r->data, r->size)) {
        return refuse_format(r);
    }
    return library_mesh_read(r->format, r->data, r->size, r->memory, &r->mesh);
}

/* Warns of an ending that names another format. */
static bool warn_of_ending(reading *r)
{
    if (!file_format_has_ending(r->format, r->ending) &&
        file_format_of_name(r->ending) != FILE_FORMAT_UNKNOWN)
        plain_mesh_warn(
            &r->mesh,
            "the file is read as %s, by its first bytes: the ending of its name is that of another format",
            file_formats[r->format].name);
    return true;
}

static bool read_materials(reading *r)
{
    return plain_textures_read_mtl(r->data, r->size, &r->mesh);
}

/* ---- the answer */

static bool write_values(const plain_mesh *m)
{
    bool ok = reader_write(&m->value_arrays, sizeof m->value_arrays);
    for (uint32_t k = 0; ok && k < m->value_arrays; k++) {
        const plain_values *v = &m->values[k];
        ok = reader_write(&v->head, sizeof v->head) &&
             reader_write(v->value, m->vertices * v->head.components * sizeof *v->value);
    }
    return ok;
}

static bool write_polygons(const plain_mesh *m)
{
    const uint64_t counts[2] = {m->polygons, m->polygon_corners};
    return reader_write(counts, sizeof counts) &&
           reader_write(m->polygon_size, m->polygons * sizeof *m->polygon_size) &&
           reader_write(m->polygon_corner, m->polygon_corners * sizeof *m->polygon_corner);
}

static bool answer(const plain_mesh *m)
{
    const mesh_reader_header head = {.vertices = m->vertices,
                                     .triangles = m->triangles,
                                     .others = m->others,
                                     .crossed = m->crossed,
                                     .end = m->rest};
    return reader_answer(&head, sizeof head, m->text, strlen(m->text)) &&
           reader_write(m->vertex, m->vertices * sizeof *m->vertex) &&
           reader_write(m->triangle, m->triangles * sizeof *m->triangle) &&
           (!m->keeps_values || write_values(m)) && (!m->keeps_polygons || write_polygons(m)) &&
           (!m->textures || plain_textures_answer(m));
}

__attribute__((visibility("default"))) int mesh_reader_main(int argc, char **argv)
{
    static step *const of_meshes[] = {load,      choose_format,  convert_text, check_textures,
                                      read_mesh, warn_of_ending, NULL},
                       *const of_materials[] = {load, read_materials, NULL};
    reading r = {.memory = reader_limit(argc, argv, STDERR_FILENO + 1)};
    if (!r.memory) return 2;
    const char *command = argv[0];
    const bool has_textures = strcmp(command, MESH_TEXTURES_COMMAND) == 0,
               has_materials = strcmp(command, MESH_MATERIALS_COMMAND) == 0;
    r.ending = argv[1];
    r.mesh.keeps_polygons = strcmp(command, MESH_POLYGONS_COMMAND) == 0;
    r.mesh.keeps_values = has_textures || strcmp(command, MESH_VALUES_COMMAND) == 0;
    if (has_textures || has_materials) r.mesh.textures = &r.textures;
    bool ok = true;
    for (step *const *next = has_materials ? of_materials : of_meshes; ok && *next; next++) ok = (*next)(&r);
    ok = ok ? answer(&r.mesh) : reader_refuse(r.mesh.refused, r.mesh.text);
    _exit(ok ? 0 : 1); /* _exit: freeing the memory takes time */
}

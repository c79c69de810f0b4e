// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/mesh_reader.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <assimp/cfileio.h>
#include <assimp/cimport.h>
#include <assimp/scene.h>

#include "base/core/error.h"
#include "base/core/file_format.h"
#include "base/core/reader.h"
#include "base/core/transfer.h"
#include "io/meshes/content_end.h"
#include "io/meshes/foreign_format.h"
#include "io/meshes/library_scene.h"
#include "io/meshes/library_text.h"
#include "io/meshes/library_textures.h"
#include "io/meshes/plain_textures.h"
#include "io/meshes/ply_strips.h"
#include "io/meshes/ply_values.h"

/* Maximum memory of assimp per byte of the file. Measured: 30 for binary STL (three vertices for each
 * triangle of 50 bytes, and lists of faces), less for text. If assimp exceeds this, the file states a size
 * that it does not have. */
static const size_t memory_per_byte = 64;
/* Maximum depth of the tree of nodes; mesh files have a few levels. The walk is recursive. */
static const int deepest_node = 200;

typedef struct bytes {
    char name[32]; /* the name of the file that is passed to the library */
    char *data;
    size_t size, at;
    const char *other; /* the name of the format, if it is another one than that of the ending; or NULL */
} bytes;

/* ---- I/O callbacks of the library */

static size_t read_some(struct aiFile *file, char *to, size_t size, size_t count)
{
    bytes *b = (bytes *)file->UserData;
    size_t left = size ? (b->size - b->at) / size : 0;
    if (count > left) count = left;
    memcpy(to, b->data + b->at, size * count);
    b->at += size * count;
    return count;
}

static size_t write_nothing(struct aiFile *file, const char *from, size_t size, size_t count)
{
    (void)file, (void)from, (void)size, (void)count;
    return 0;
}

static size_t tell(struct aiFile *file)
{
    return ((bytes *)file->UserData)->at;
}
static size_t file_size(struct aiFile *file)
{
    return ((bytes *)file->UserData)->size;
}
static void flush(struct aiFile *file)
{
    (void)file;
}

static enum aiReturn seek(struct aiFile *file, size_t offset, enum aiOrigin origin)
{
    bytes *b = (bytes *)file->UserData;
    size_t base = origin == aiOrigin_SET ? 0 : origin == aiOrigin_CUR ? b->at : b->size, to = base + offset;
    if (to > b->size) return aiReturn_FAILURE;
    b->at = to;
    return aiReturn_SUCCESS;
}

/* Refuses materials and other files that a mesh names: only the submitted file is read. */
static struct aiFile *open_file(struct aiFileIO *io, const char *name, const char *mode)
{
    bytes *b = (bytes *)io->UserData;
    if (strcmp(name, b->name) != 0 || mode[0] != 'r') return NULL;
    struct aiFile *file = malloc(sizeof *file);
    if (!file) return NULL;
    *file = (struct aiFile){read_some, write_nothing, tell, file_size, seek, flush, io->UserData};
    b->at = 0;
    return file;
}

static void close_file(struct aiFileIO *io, struct aiFile *file)
{
    (void)io;
    free(file);
}

/* ---- answering */

static int answer_fault(error_code code, const char *text)
{
    return reader_refuse(code, text) ? 0 : 1;
}

/* Data that a command adds to the triangles of the answer. */
typedef enum addition { NOTHING, VALUES, POLYGONS, TEXTURES } addition;

/* The state of a walk over the nodes of the scene. The answer is written in several walks: one counts, the
 * others write vertices, triangles, sizes of polygons and corners of polygons. */
typedef struct walk {
    const struct aiScene *scene;
    enum { COUNT, VERTICES, TRIANGLES, SIZES, CORNERS } pass;
    mesh_reader_header header;
    size_t skins;               /* number of meshes with a skin */
    uint64_t polygons, corners; /* corners: number of corners of all polygons */
    size_t first;               /* index of the first vertex of the current mesh */
    bool failed;
    const float (*ply_color)[4]; /* of the vertices of a PLY file, as ply_values read them; or NULL */
    bool is_gltf;                /* colours are linear, and skinned meshes are not placed by their nodes */
    struct aiMatrix4x4 to_world; /* of the root */
    unsigned group;              /* number of the visited node among those that have meshes */
    plain_mesh one; /* vertices of the current mesh, and one of its polygons with its triangles */
} walk;

/* The matrix of a mesh of a node whose matrix is `m`. */
static const struct aiMatrix4x4 *matrix_of(const walk *w, const struct aiMesh *mesh,
                                           const struct aiMatrix4x4 *m)
{
    return w->is_gltf && mesh->mNumBones > 0 ? &w->to_world : m;
}

static void visit_vertices(walk *w, const struct aiMesh *mesh, const struct aiMatrix4x4 *m)
{
    for (unsigned n = 0; !w->failed && n < mesh->mNumVertices; n++) {
        struct aiVector3D v = mesh->mVertices[n];
        aiTransformVecByMatrix4(&v, m);
        const double at[3] = {(double)v.x, (double)v.y, (double)v.z};
        w->failed = fwrite(at, sizeof at, 1, stdout) != 1;
    }
}

static void write_triangles(walk *w, const uint32_t (*triangle)[3], size_t count)
{
    for (size_t n = 0; !w->failed && n < count; n++) {
        uint32_t corner[3];
        for (int k = 0; k < 3; k++) {
            const uint64_t c = (uint64_t)w->first + triangle[n][k];
            corner[k] = triangle[n][k] != UINT32_MAX && c < UINT32_MAX ? (uint32_t)c : UINT32_MAX;
        }
        w->failed = fwrite(corner, sizeof corner, 1, stdout) != 1;
    }
}

/* Whether all corners of the polygons are vertices. write_polygon replaces invalid corners by UINT32_MAX,
 * which mesh_file refuses. */
static bool all_corners_exist(const struct aiMesh *mesh, const struct aiFace *face)
{
    bool exist = true;
    for (unsigned k = 0; k < face->mNumIndices; k++) exist &= face->mIndices[k] < mesh->mNumVertices;
    return exist;
}

/* Writes the number of corners of a polygon, or its corners. */
static void write_polygon(walk *w, const struct aiFace *face)
{
    const uint32_t size = face->mNumIndices;
    if (w->pass == SIZES) w->failed = fwrite(&size, sizeof size, 1, stdout) != 1;
    for (uint32_t k = 0; w->pass == CORNERS && !w->failed && k < size; k++) {
        const uint32_t corner = (uint32_t)w->first + face->mIndices[k];
        w->failed = fwrite(&corner, sizeof corner, 1, stdout) != 1;
    }
}

static void visit_face(walk *w, const struct aiMesh *mesh, const struct aiFace *face)
{
    static const uint32_t none[1][3] = {{UINT32_MAX, UINT32_MAX, UINT32_MAX}};
    plain_mesh *one = &w->one;
    const size_t others = one->others;
    const bool exist = all_corners_exist(mesh, face);
    if (w->pass > TRIANGLES) {
        write_polygon(w, face);
        return;
    }
    if (w->pass == COUNT) {
        w->polygons++;
        w->corners += face->mNumIndices;
    }
    one->triangles = one->polygons = one->polygon_corners = 0;
    if (exist && !plain_mesh_add_polygon(one, face->mIndices, face->mNumIndices)) {
        w->failed = true;
    } else if (w->pass == COUNT) {
        w->header.triangles += exist ? one->triangles : 1;
        w->header.others += one->others - others;
    } else {
        write_triangles(w, exist ? (const uint32_t(*)[3])one->triangle : none, exist ? one->triangles : 1);
    }
}

static void visit_faces(walk *w, const struct aiMesh *mesh)
{
    w->one.vertices = 0;
    for (unsigned n = 0; !w->failed && n < mesh->mNumVertices; n++) {
        const struct aiVector3D v = mesh->mVertices[n];
        w->failed = !plain_mesh_add_vertex(&w->one, (const double[]){(double)v.x, (double)v.y, (double)v.z});
    }
    for (unsigned n = 0; !w->failed && n < mesh->mNumFaces; n++) visit_face(w, mesh, &mesh->mFaces[n]);
}

static void visit_mesh(walk *w, const struct aiMesh *mesh, const struct aiMatrix4x4 *m)
{
    if (w->pass == VERTICES)
        visit_vertices(w, mesh, matrix_of(w, mesh, m));
    else
        visit_faces(w, mesh);
    if (w->pass == COUNT) {
        w->header.vertices += mesh->mNumVertices;
        w->skins += mesh->mNumBones > 0;
    }
    w->first += mesh->mNumVertices;
}

static void visit(walk *w, const struct aiNode *node, struct aiMatrix4x4 m, int depth)
{
    if (depth > deepest_node) w->failed = true;
    if (w->failed) return;
    aiMultiplyMatrix4(&m, &node->mTransformation);
    for (unsigned n = 0; n < node->mNumMeshes; n++)
        if (node->mMeshes[n] < w->scene->mNumMeshes) visit_mesh(w, w->scene->mMeshes[node->mMeshes[n]], &m);
    for (unsigned n = 0; n < node->mNumChildren; n++) visit(w, node->mChildren[n], m, depth + 1);
}

/* ---- attributes of vertices */

/* An attribute array: its kind, and its index among those of this kind (`slot`). */
typedef struct values {
    enum { OF_COLOR, OF_UV, OF_NORMAL, OF_MATERIAL, OF_GROUP } what;
    unsigned slot;
    mesh_reader_values head;
    bool has_opacity; /* of colours: one of them is not fully transparent */
} values;

static bool mesh_has(const struct aiMesh *mesh, const values *v)
{
    return v->what == OF_COLOR    ? mesh->mColors[v->slot] != NULL
           : v->what == OF_UV     ? mesh->mTextureCoords[v->slot] != NULL
           : v->what == OF_NORMAL ? mesh->mNormals != NULL
                                  : true;
}

/* A colour in sRGB. The library has an opacity of 0 for colours of three components. */
static void color_at(const walk *w, const struct aiMesh *mesh, const values *v, unsigned n, float out[4])
{
    if (w->ply_color && v->slot == 0) {
        memcpy(out, w->ply_color[n], 4 * sizeof *out);
        return;
    }
    const struct aiColor4D c = mesh->mColors[v->slot][n];
    memcpy(out, (const float[]){c.r, c.g, c.b, c.a}, 4 * sizeof *out);
    if (!w->is_gltf) return;
    for (int k = 0; k < 3; k++) out[k] = (float)mesh_textures_encode((double)out[k]);
    if (!v->has_opacity) out[3] = 1;
}

/* The value of vertex n; NaN if this mesh of the scene does not have the attribute. */
static void value_at(const walk *w, const struct aiMesh *mesh, const struct aiMatrix4x4 *m, const values *v,
                     unsigned n, float out[MESH_VALUES_COMPONENTS])
{
    for (int k = 0; k < MESH_VALUES_COMPONENTS; k++) out[k] = mesh_has(mesh, v) ? 0 : NAN;
    if (!mesh_has(mesh, v)) return;
    if (v->what == OF_COLOR) {
        color_at(w, mesh, v, n, out);
    } else if (v->what == OF_UV) {
        const struct aiVector3D t = mesh->mTextureCoords[v->slot][n];
        memcpy(out, (const float[]){t.x, t.y}, 2 * sizeof *out);
    } else if (v->what == OF_NORMAL) { /* transformed by the cofactor matrix of the node's matrix */
        const struct aiVector3D k = mesh->mNormals[n];
        out[0] = (m->b2 * m->c3 - m->b3 * m->c2) * k.x + (m->b3 * m->c1 - m->b1 * m->c3) * k.y +
                 (m->b1 * m->c2 - m->b2 * m->c1) * k.z;
        out[1] = (m->c2 * m->a3 - m->c3 * m->a2) * k.x + (m->c3 * m->a1 - m->c1 * m->a3) * k.y +
                 (m->c1 * m->a2 - m->c2 * m->a1) * k.z;
        out[2] = (m->a2 * m->b3 - m->a3 * m->b2) * k.x + (m->a3 * m->b1 - m->a1 * m->b3) * k.y +
                 (m->a1 * m->b2 - m->a2 * m->b1) * k.z;
    } else if (v->what == OF_MATERIAL) {
        out[0] = (float)mesh->mMaterialIndex;
    }
}

static void add_values(const struct aiScene *scene, const char *name, values v, values *list, uint32_t *count)
{
    bool any = false;
    for (unsigned k = 0; k < scene->mNumMeshes; k++) {
        const struct aiMesh *mesh = scene->mMeshes[k];
        any |= mesh_has(mesh, &v);
        for (unsigned n = 0;
             v.what == OF_COLOR && mesh_has(mesh, &v) && n < mesh->mNumVertices && !v.has_opacity; n++)
            v.has_opacity = mesh->mColors[v.slot][n].a != 0;
    }
    if (!any || *count == MESH_VALUES_MOST) return;
    if (v.slot > 0)
        snprintf(v.head.name, sizeof v.head.name, "%s%u", name, v.slot);
    else
        snprintf(v.head.name, sizeof v.head.name, "%s", name);
    list[(*count)++] = v;
}

static uint32_t list_values(const struct aiScene *scene, values *list)
{
    uint32_t count = 0;
    for (unsigned k = 0; k < AI_MAX_NUMBER_OF_COLOR_SETS; k++)
        add_values(scene, "color", (values){OF_COLOR, k, {"", MESH_VALUES_COLOR, 4}, false}, list, &count);
    for (unsigned k = 0; k < AI_MAX_NUMBER_OF_TEXTURECOORDS; k++)
        add_values(scene, "uv", (values){OF_UV, k, {"", MESH_VALUES_UV, 2}, false}, list, &count);
    add_values(scene, "normal", (values){OF_NORMAL, 0, {"", MESH_VALUES_NORMAL, 3}, false}, list, &count);
    add_values(scene, "material", (values){OF_MATERIAL, 0, {"", MESH_VALUES_WHOLE, 1}, false}, list, &count);
    add_values(scene, "group", (values){OF_GROUP, 0, {"", MESH_VALUES_WHOLE, 1}, false}, list, &count);
    return count;
}

static void visit_values(walk *w, const struct aiNode *node, struct aiMatrix4x4 m, const values *v)
{
    aiMultiplyMatrix4(&m, &node->mTransformation); /* the depth was checked in the walks before */
    for (unsigned n = 0; n < node->mNumMeshes; n++) {
        if (node->mMeshes[n] >= w->scene->mNumMeshes) continue;
        const struct aiMesh *mesh = w->scene->mMeshes[node->mMeshes[n]];
        for (unsigned k = 0; !w->failed && k < mesh->mNumVertices; k++) {
            float value[MESH_VALUES_COMPONENTS];
            value_at(w, mesh, matrix_of(w, mesh, &m), v, k, value);
            if (v->what == OF_GROUP) value[0] = (float)w->group;
            w->failed = fwrite(value, sizeof *value, v->head.components, stdout) != v->head.components;
        }
    }
    w->group += node->mNumMeshes > 0; /* the library makes one node for each group or object */
    for (unsigned n = 0; n < node->mNumChildren; n++) visit_values(w, node->mChildren[n], m, v);
}

/* Removes the attributes that have the name of a property. Returns the number of those left. */
static uint32_t remove_named(values *list, uint32_t count, const ply_values *own)
{
    uint32_t left = 0;
    for (uint32_t k = 0; k < count; k++) {
        bool is_own = false;
        for (uint32_t n = 0; n < own->count; n++) is_own |= strcmp(own->name[n], list[k].head.name) == 0;
        if (!is_own) list[left++] = list[k];
    }
    return left;
}

/* Writes the attributes of the scene, and those properties of a PLY file that the library does not read
 * (`own`). */
static void answer_values(walk *w, const ply_values *own)
{
    values list[MESH_VALUES_MOST];
    uint32_t count = list_values(w->scene, list), more = 0;
    struct aiMatrix4x4 identity;
    aiIdentityMatrix4(&identity);
    if (own->vertices == w->header.vertices) {
        more = own->count;
        if (w->scene->mNumMeshes == 1) w->ply_color = (const float(*)[4])own->color;
        count = remove_named(list, count, own);
    }
    if (more > MESH_VALUES_MOST - count) more = MESH_VALUES_MOST - count;
    const uint32_t all = count + more;
    w->failed |= fwrite(&all, sizeof all, 1, stdout) != 1;
    for (uint32_t k = 0; k < count && !w->failed; k++) {
        w->failed = fwrite(&list[k].head, sizeof list[k].head, 1, stdout) != 1;
        w->group = 0;
        visit_values(w, w->scene->mRootNode, identity, &list[k]);
    }
    for (uint32_t k = 0; k < more && !w->failed; k++) {
        mesh_reader_values head = {"", MESH_VALUES_NUMBER, 1};
        memcpy(head.name, own->name[k], sizeof head.name);
        w->failed = fwrite(&head, sizeof head, 1, stdout) != 1 ||
                    fwrite(own->value[k], sizeof(float), own->vertices, stdout) != own->vertices;
    }
}

static void answer_polygons(walk *w, struct aiMatrix4x4 placed)
{
    const uint64_t counts[2] = {w->polygons, w->corners};
    w->failed |= fwrite(counts, sizeof counts, 1, stdout) != 1;
    for (w->pass = SIZES; w->pass <= CORNERS && !w->failed; w->pass++) {
        w->first = 0;
        visit(w, w->scene->mRootNode, placed, 0);
    }
}

/* Writes the answer for a scene. `own`: vertex properties of a PLY file that the library does not read, for
 * VALUES. `end`: as in the header. `known`: unit and warnings of the file, as plain_mesh found them. */
static int answer_scene(const struct aiScene *scene, file_format format, addition also, const ply_values *own,
                        size_t end, plain_mesh *known)
{
    const bool has_polygons = also == POLYGONS || also == TEXTURES;
    const double unit = known->unit > 0 ? known->unit : 1;
    walk w = {.scene = scene,
              .header = {.end = end},
              .is_gltf = format == FILE_FORMAT_GLTF,
              .one = {.keeps_polygons = has_polygons}};
    struct aiMatrix4x4 scaled;
    aiMatrix4Scaling(&scaled, &(struct aiVector3D){(float)unit, (float)unit, (float)unit});
    w.to_world = scaled;
    for (w.pass = COUNT; w.pass <= TRIANGLES && !w.failed; w.pass++) {
        w.first = 0;
        visit(&w, scene->mRootNode, scaled, 0);
        if (w.pass == COUNT && w.one.refused != ERROR_NONE) return answer_fault(w.one.refused, w.one.text);
        w.header.crossed = w.one.crossed;
        if (w.pass == COUNT && w.skins > 0 && !w.is_gltf) /* the reader of glTF has its own warning */
            plain_mesh_warn(
                known, "%zu meshes have a skin, which is not applied: export the posed mesh to sample it",
                w.skins);
        if (w.pass == COUNT)
            w.failed = !reader_answer(&w.header, sizeof w.header, known->text, strlen(known->text));
    }
    if (also == VALUES && !w.failed) answer_values(&w, own);
    if (has_polygons && !w.failed) answer_polygons(&w, scaled);
    const bool ok = !w.failed && fflush(stdout) == 0;
    return ok && (also != TEXTURES || plain_textures_answer(known)) ? 0 : 1;
}

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

/* Writes the answer for a mesh that was read without the library. `end`: as in the header. */
static int answer_plain(const plain_mesh *m, size_t end)
{
    const mesh_reader_header head = {.vertices = m->vertices,
                                     .triangles = m->triangles,
                                     .others = m->others,
                                     .crossed = m->crossed,
                                     .end = end};
    const uint64_t counts[2] = {m->polygons, m->polygon_corners};
    bool ok = reader_answer(&head, sizeof head, m->text, strlen(m->text)) &&
              reader_write(m->vertex, m->vertices * sizeof *m->vertex) &&
              reader_write(m->triangle, m->triangles * sizeof *m->triangle);
    if (m->keeps_polygons)
        ok = ok && reader_write(counts, sizeof counts) &&
             reader_write(m->polygon_size, m->polygons * sizeof *m->polygon_size) &&
             reader_write(m->polygon_corner, m->polygon_corners * sizeof *m->polygon_corner);
    if (m->keeps_values) ok = ok && write_values(m);
    if (m->textures) ok = ok && plain_textures_answer(m);
    return ok ? 0 : 1;
}

/* ---- the program */

static bool read_bytes(bytes *b)
{
    struct stat st;
    if (fstat(STDIN_FILENO, &st) != 0 || !(b->data = malloc((size_t)st.st_size + 1))) return false;
    const int64_t count = transfer_read_at(STDIN_FILENO, b->data, (size_t)st.st_size, 0);
    if (count < 0) return false;
    b->size = (size_t)count;
    b->data[b->size] = 0;
    return true;
}

/* The ending of the format: that of the first bytes if these are known and of a mesh, otherwise `named`. */
static const char *true_ending(const char *named, bytes *b)
{
    const file_format found = file_format_of_bytes(b->data, b->size);
    if (!plain_mesh_reads(found) || file_formats[found].kind != FILE_FORMAT_MESHES ||
        file_format_has_ending(found, named))
        return named;
    b->other = file_formats[found].name;
    return file_formats[found].ending[0] + 1;
}

/* Warns of an ending that names another format. */
static void warn_of_ending(const bytes *b, plain_mesh *m)
{
    if (b->other)
        plain_mesh_warn(
            m, "the file is read as %s, by its first bytes: the ending of its name is that of another format",
            b->other);
}

/* Truncates the data at the end of the content that the file declares. Returns this end, or 0 if only blanks
 * and zeros follow it. */
static size_t cut_end(const char *ending, bytes *b)
{
    const size_t end = content_end(ending, b->data, b->size);
    const bool follows = content_follows(b->data, b->size, end);
    b->size = end;
    b->data[end] = 0;
    return follows ? end : 0;
}

/* Whether the decimal point at `at` begins a number, as in "v .5 -.5 0". */
static bool lacks_zero(const bytes *b, size_t at)
{
    if (b->data[at] != '.' || at == 0 || at + 1 == b->size) return false;
    return strchr(" \t+-", b->data[at - 1]) && b->data[at - 1] && b->data[at + 1] >= '0' &&
           b->data[at + 1] <= '9';
}

/* Inserts a zero before each number that begins with a decimal point: the library's OBJ reader skips such
 * numbers. */
static bool add_zeros(bytes *b)
{
    size_t more = 0, to = 0;
    for (size_t at = 0; at < b->size; at++) more += lacks_zero(b, at);
    if (more == 0) return true;
    char *data = malloc(b->size + more + 1);
    if (!data) return false;
    for (size_t at = 0; at < b->size; at++) {
        if (lacks_zero(b, at)) data[to++] = '0';
        data[to++] = b->data[at];
    }
    free(b->data);
    b->data = data;
    b->size = to;
    return true;
}

/* Reads a file of materials. */
static int answer_materials(const bytes *b)
{
    plain_textures textures = {0};
    plain_mesh m = {.textures = &textures};
    const mesh_reader_header head = {0};
    if (!plain_textures_read_mtl(b->data, b->size, &m)) return answer_fault(m.refused, m.text);
    return reader_answer(&head, sizeof head, m.text, strlen(m.text)) && plain_textures_answer(&m) ? 0 : 1;
}

static const char file_too_large[] = "the file is larger than the memory limit: raise limits.memory_mb";

/* Converts the strips of a PLY file to triangles, or ends the process. */
static void expand_strips(const char *ending, bytes *b)
{
    if (file_format_of_name(ending) != FILE_FORMAT_PLY) return;
    switch (ply_strips_expand(&b->data, &b->size)) {
    case PLY_STRIPS_NO_MEMORY:
        _exit(answer_fault(ERROR_LIMIT_MEMORY, file_too_large));
    case PLY_STRIPS_DAMAGED:
        _exit(answer_fault(
            ERROR_INPUT_DAMAGED,
            "the triangle strips of the file are incomplete or not numbers: save it with faces"));
    case PLY_STRIPS_READ:
        break;
    }
}

/* Converts the library's error message to an answer. */
static int answer_refusal(const bytes *b, size_t memory, const char *why)
{
    char text[MESH_READER_TEXT_MAX];
    if (strstr(why, "bad_alloc") || strstr(why, "bad allocation") || strstr(why, "Out of memory")) {
        if (b->size > memory / memory_per_byte)
            return answer_fault(ERROR_LIMIT_MEMORY,
                                "reading it requires more memory than the limit: raise limits.memory_mb");
        return answer_fault(ERROR_INPUT_DAMAGED,
                            "the file announces far more data than it has: it is damaged. Save it again.");
    }
    /* the library may take a text with the name of a format in it for a file of this format */
    if (strstr(why, "No suitable reader") ||
        (file_format_of_name(b->name) == FILE_FORMAT_UNKNOWN &&
         file_format_of_bytes(b->data, b->size) == FILE_FORMAT_UNKNOWN)) {
        return answer_fault(
            ERROR_INPUT_UNSUPPORTED,
            "its format is not known, by its name and first bytes: it is neither a mesh nor a volume that is "
            "read. Save a mesh as PLY, OBJ, STL or OFF, and a volume as OpenVDB or NRRD.");
    }
    const int begin = snprintf(text, sizeof text, "the file cannot be read as a mesh: ");
    snprintf(text + begin, sizeof text - (size_t)begin, "%s", *why ? why : "it is damaged");
    /* replace the internal name by "the file" */
    for (char *own; (own = strstr(text + begin, b->name));) {
        static const char file[] = "the file";
        const size_t length = strlen(b->name), rest = strlen(own + length) + 1;
        if ((size_t)(own - text) + sizeof file - 1 + rest > sizeof text) break;
        memmove(own + sizeof file - 1, own + length, rest);
        memcpy(own, file, sizeof file - 1);
    }
    size_t used = strlen(text);
    while (used > 0 && strchr(". \n", text[used - 1])) used--;
    snprintf(text + used, sizeof text - used, ". Repair it, or save it again.");
    return answer_fault(ERROR_INPUT_DAMAGED, text);
}

/* Whether plain_mesh also parses a file of this format for its unit and warnings when the library reads
 * the mesh. */
static bool is_read_for_values(const char *ending)
{
    const file_format format = file_format_of_name(ending);
    return format == FILE_FORMAT_GLTF || format == FILE_FORMAT_3MF;
}

static bool read_plain(const char *ending, const bytes *b, addition also, plain_mesh *out)
{
    static plain_textures textures;
    if (also == VALUES && plain_mesh_reads_values(ending))
        return plain_mesh_read_values(ending, b->data, b->size, out);
    if (also == TEXTURES) {
        mesh_textures_free(&textures.all);
        return plain_mesh_read_textures(ending, b->data, b->size, &textures, out);
    }
    return also == POLYGONS ? plain_mesh_read_polygons(ending, b->data, b->size, out)
                            : plain_mesh_read(ending, b->data, b->size, out);
}

/* Ends the process if the file is read without the library, or refused. Otherwise *plain has the unit and
 * the warnings of the file. */
static void try_plain(const char *ending, const bytes *b, addition also, plain_mesh *plain)
{
    const char *foreign;
    if (also != VALUES || is_read_for_values(ending)) {
        const bool is_plain = read_plain(ending, b, also, plain);
        if (is_plain) warn_of_ending(b, plain);
        if (is_plain && also != VALUES) _exit(answer_plain(plain, 0));
        if (plain->is_quantised)
            plain_mesh_refuse(plain, ERROR_INPUT_UNSUPPORTED,
                              "the values of its vertices are not read, because its positions are quantised "
                              "(KHR_mesh_quantization). Save it with floats.");
        if (plain->has_hidden_nodes)
            plain_mesh_refuse(
                plain, ERROR_INPUT_UNSUPPORTED,
                "the values of its vertices are not read, because it has nodes that are not visible "
                "(KHR_node_visibility). Save it without them.");
        free(plain->vertex);
        free(plain->triangle);
    }
    if ((foreign = foreign_format(ending, b->data, b->size)))
        plain_mesh_refuse(plain, ERROR_INPUT_UNSUPPORTED, "%s", foreign);
    if (plain->refused != ERROR_NONE || !library_scene_accepts(ending, plain) ||
        !library_text_check(ending, b->data, b->size, plain))
        _exit(answer_fault(plain->refused, plain->text));
}

/* Reads a format that the library does not read, and writes the answer. If `warnings` is not NULL, a file that is
 * read has no answer, and its warnings are added to *warnings. If the reader refuses the file, it is read again:
 * without the data after the declared content, and with triangle strips converted to triangles. Returns the exit
 * status, or -1: there is no answer. */
static int answer_only_reader(const char *ending, addition also, plain_mesh *warnings, bytes *b)
{
    plain_mesh m;
    size_t end = 0;
    const char *foreign;
    const bytes whole = *b;
    bool read = read_plain(ending, b, also, &m);
    if (!read) {
        end = cut_end(ending, b);
        expand_strips(ending, b);
        read = (b->size != whole.size || b->data != whole.data) && read_plain(ending, b, also, &m);
    }
    if (read) warn_of_ending(b, &m);
    if (read && warnings) {
        if (*m.text) plain_mesh_warn(warnings, "%s", m.text);
        if (end)
            plain_mesh_warn(
                warnings, "the file has other data after its mesh, from byte %zu on: they are not read", end);
        plain_mesh_free(&m);
        return -1;
    }
    if (read) return answer_plain(&m, end);
    if ((foreign = foreign_format(ending, b->data, b->size)))
        return answer_fault(ERROR_INPUT_UNSUPPORTED, foreign);
    return answer_fault(m.refused, m.text);
}

__attribute__((visibility("default"))) int mesh_reader_main(int argc, char **argv)
{
    bytes b = {0};
    size_t memory = reader_limit(argc, argv, STDERR_FILENO + 1);
    if (!memory) return 2;
    plain_mesh plain = {0};
    ply_values own = {0};
    const addition also = strcmp(argv[0], MESH_VALUES_COMMAND) == 0     ? VALUES
                          : strcmp(argv[0], MESH_POLYGONS_COMMAND) == 0 ? POLYGONS
                          : strcmp(argv[0], MESH_TEXTURES_COMMAND) == 0 ? TEXTURES
                                                                        : NOTHING;
    if (!read_bytes(&b)) return answer_fault(ERROR_LIMIT_MEMORY, file_too_large);
    const char *ending = true_ending(argv[1], &b);
    const file_format format = file_format_of_name(ending);
    snprintf(b.name, sizeof b.name, "mesh%s%.20s", *ending ? "." : "", ending);
    if (also == TEXTURES && !plain_mesh_reads_textures(ending) && format != FILE_FORMAT_COLLADA)
        return answer_fault(
            ERROR_INPUT_UNSUPPORTED,
            "base_color is not read from such files: save it as glTF, OBJ, PLY, 3MF or COLLADA "
            "with its textures");
    if (format == FILE_FORMAT_VTP || format == FILE_FORMAT_VTK || format == FILE_FORMAT_GIFTI ||
        format == FILE_FORMAT_COLLADA) {
        char *text = xml_in_utf8(b.data, &b.size);
        if (text) b.data = text;
        if (format == FILE_FORMAT_COLLADA) library_text_move_blanks(b.data);
    }
    if (strcmp(argv[0], MESH_MATERIALS_COMMAND) == 0) _exit(answer_materials(&b));
    if (plain_mesh_is_only_reader(ending)) {
        /* the library reads the values of some formats, and numbers up to their comma */
        const bool is_left = also == VALUES && !plain_mesh_reads_values(ending);
        const int status = answer_only_reader(ending, also, is_left ? &plain : NULL, &b);
        if (status >= 0) _exit(status);
    }
    try_plain(ending, &b, also, &plain);
    /* readers refuse files with more data */
    const size_t whole = b.size, end = cut_end(ending, &b);
    if (b.size < whole && also != VALUES && read_plain(ending, &b, also, &plain)) {
        warn_of_ending(&b, &plain);
        _exit(answer_plain(&plain, end));
    }
    if (also == TEXTURES && format != FILE_FORMAT_COLLADA)
        _exit(answer_fault(
            ERROR_INPUT_UNSUPPORTED,
            "base_color is not read from glTF and 3MF files with contents that the library assimp reads, "
            "such as glTF with Draco: save it without"));
    expand_strips(ending, &b);
    if ((format == FILE_FORMAT_OBJ && !add_zeros(&b)) ||
        (format == FILE_FORMAT_PLY && !ply_values_read(b.data, b.size, &own)))
        return answer_fault(ERROR_LIMIT_MEMORY, file_too_large);
    if (own.refused) {
        plain_mesh_refuse(
            &plain, ERROR_INPUT_UNSUPPORTED,
            "its colours are numbers of type \"%s\", some below 0 or above 255, whose range is not known. Save "
            "them as uchar.",
            own.refused);
        _exit(answer_fault(plain.refused, plain.text));
    }
    struct aiFileIO io = {open_file, close_file, (aiUserData)&b};
    library_scene_listen(also == TEXTURES);
    const struct aiScene *scene = aiImportFileEx(b.name, 0, &io);
    if (!scene || !scene->mRootNode) _exit(answer_refusal(&b, memory, aiGetErrorString()));
    const bool is_read = library_scene_check(scene, &plain) &&
                         (also != TEXTURES || library_textures_read(scene, b.data, b.size, &plain));
    _exit(is_read
              ? answer_scene(scene, format, also, &own, end, &plain)
              : answer_fault(plain.refused, plain.text)); /* _exit: freeing the library's memory takes time */
}

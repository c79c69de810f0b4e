// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/library_mesh.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <assimp/cfileio.h>
#include <assimp/cimport.h>
#include <assimp/config.h>
#include <assimp/scene.h>

#include "geometry/space/vec3.h"
#include "io/meshes/library_scene.h"
#include "io/meshes/library_text.h"
#include "io/meshes/library_textures.h"
#include "io/meshes/plain_textures.h"

/* Maximum memory of assimp per byte of the file. Measured: 30 for binary STL (three vertices for each
 * triangle of 50 bytes, and lists of faces), less for text. If assimp exceeds this, the file states a size
 * that it does not have. */
static const size_t memory_per_byte = 64;
/* Maximum depth of the tree of nodes; mesh files have a few levels. The walk is recursive. */
static const int deepest_node = 200;

/* The file that is passed to the library. */
typedef struct bytes {
    char name[16];
    const char *data;
    size_t size, at;
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

/* ---- the scene */

/* The state of a walk over the nodes of the scene. */
typedef struct walk {
    const struct aiScene *scene;
    plain_mesh *out;
    bool is_gltf;        /* colours are linear, and skinned meshes are not placed by their nodes */
    const uint32_t *set; /* of textures: the set of coordinates of each material */
    size_t skins;        /* number of meshes with a skin */
    double group;        /* number of visited nodes that have meshes */
} walk;

/* The array `name` with the number of its set. */
static plain_values *find_set(walk *w, const char *name, unsigned set, mesh_values_kind kind,
                              size_t components)
{
    char numbered[MESH_VALUES_NAME_SIZE];
    snprintf(numbered, sizeof numbered, set > 0 ? "%s%u" : "%s", name, set);
    return plain_mesh_find_values(w->out, numbered, kind, components);
}

/* Whether a colour of the set is not fully transparent. The library has an opacity of 0 for colours of three
 * components. */
static bool has_opacity(const struct aiScene *scene, unsigned set)
{
    for (unsigned k = 0; k < scene->mNumMeshes; k++)
        for (unsigned n = 0; scene->mMeshes[k]->mColors[set] && n < scene->mMeshes[k]->mNumVertices; n++)
            if (scene->mMeshes[k]->mColors[set][n].a != 0) return true;
    return false;
}

/* Sets the colours of a set, in sRGB. */
static bool set_colors(walk *w, const struct aiMesh *mesh, unsigned set, size_t first)
{
    plain_values *v = find_set(w, "color", set, MESH_VALUES_COLOR, 4);
    const bool is_opaque = w->is_gltf && !has_opacity(w->scene, set);
    for (unsigned n = 0; n < mesh->mNumVertices; n++) {
        const struct aiColor4D c = mesh->mColors[set][n];
        double color[4] = {(double)c.r, (double)c.g, (double)c.b, is_opaque ? 1 : (double)c.a};
        for (int k = 0; w->is_gltf && k < 3; k++) color[k] = mesh_textures_encode(color[k]);
        if (!plain_mesh_set_values(w->out, v, first + n, color)) return false;
    }
    return true;
}

static bool set_coordinates(walk *w, const struct aiVector3D *at, unsigned count, plain_values *v,
                            size_t first)
{
    for (unsigned n = 0; at && n < count; n++)
        if (!plain_mesh_set_values(w->out, v, first + n, (const double[]){(double)at[n].x, (double)at[n].y}))
            return false;
    return true;
}

/* Sets the normals, transformed by the cofactor matrix of the node's matrix. */
static bool set_normals(walk *w, const struct aiMesh *mesh, const struct aiMatrix4x4 *m, size_t first)
{
    const vec3 row[3] = {{(double)m->a1, (double)m->a2, (double)m->a3},
                         {(double)m->b1, (double)m->b2, (double)m->b3},
                         {(double)m->c1, (double)m->c2, (double)m->c3}};
    plain_values *v = plain_mesh_find_values(w->out, "normal", MESH_VALUES_NORMAL, 3);
    for (unsigned n = 0; mesh->mNormals && n < mesh->mNumVertices; n++) {
        const struct aiVector3D at = mesh->mNormals[n];
        double normal[3];
        for (int k = 0; k < 3; k++)
            normal[k] = vec3_dot(vec3_cross(row[(k + 1) % 3], row[(k + 2) % 3]),
                                 (vec3){(double)at.x, (double)at.y, (double)at.z});
        if (!plain_mesh_set_values(w->out, v, first + n, normal)) return false;
    }
    return true;
}

/* Sets the values of the vertices of a mesh, which begin at `first`. */
static bool set_values(walk *w, const struct aiMesh *mesh, const struct aiMatrix4x4 *m, size_t first)
{
    plain_mesh *out = w->out;
    double material = mesh->mMaterialIndex;
    if (out->textures) {
        const bool has_material = mesh->mMaterialIndex < out->textures->all.materials;
        const struct aiVector3D *at =
            library_textures_coordinates(mesh, has_material ? w->set[mesh->mMaterialIndex] : 0);
        if (!has_material) material = -1;
        if (!set_coordinates(w, at, mesh->mNumVertices, find_set(w, MESH_TEXTURES_UV, 0, MESH_VALUES_UV, 2),
                             first))
            return false;
    }
    for (unsigned set = 0; !out->textures && set < AI_MAX_NUMBER_OF_COLOR_SETS; set++)
        if (mesh->mColors[set] && !set_colors(w, mesh, set, first)) return false;
    for (unsigned set = 0; !out->textures && set < AI_MAX_NUMBER_OF_TEXTURECOORDS; set++)
        if (mesh->mTextureCoords[set] && !set_coordinates(w, mesh->mTextureCoords[set], mesh->mNumVertices,
                                                          find_set(w, "uv", set, MESH_VALUES_UV, 2), first))
            return false;
    if (!set_normals(w, mesh, m, first)) return false;
    plain_values *materials = find_set(w, MESH_TEXTURES_MATERIAL, 0, MESH_VALUES_WHOLE, 1),
                 *groups = find_set(w, "group", 0, MESH_VALUES_WHOLE, 1);
    for (size_t n = first; n < out->vertices; n++)
        if (!plain_mesh_set_values(out, materials, n, &material) ||
            !plain_mesh_set_values(out, groups, n, &w->group))
            return false;
    return true;
}

static bool add_face(plain_mesh *out, const struct aiFace *face, size_t first)
{
    const size_t count = out->vertices - first;
    if (!plain_mesh_expect_corners(out, face->mNumIndices)) return false;
    for (unsigned k = 0; k < face->mNumIndices; k++) {
        if (face->mIndices[k] >= count)
            return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                     "a corner of a face is none of the %zu vertices of its mesh. Repair it.",
                                     count);
        out->corner[k] = (uint32_t)(first + face->mIndices[k]);
    }
    return plain_mesh_add_polygon(out, out->corner, face->mNumIndices);
}

static bool add_mesh(walk *w, const struct aiMesh *mesh, const struct aiMatrix4x4 *m)
{
    struct aiMatrix4x4 identity;
    plain_mesh *out = w->out;
    const size_t first = out->vertices;
    aiIdentityMatrix4(&identity);
    if (w->is_gltf && mesh->mNumBones > 0) m = &identity;
    w->skins += mesh->mNumBones > 0;
    for (unsigned n = 0; n < mesh->mNumVertices; n++) {
        struct aiVector3D v = mesh->mVertices[n];
        aiTransformVecByMatrix4(&v, m);
        if (!plain_mesh_add_vertex(out, (const double[]){(double)v.x, (double)v.y, (double)v.z}))
            return false;
    }
    if (out->keeps_values && !set_values(w, mesh, m, first)) return false;
    for (unsigned n = 0; n < mesh->mNumFaces; n++)
        if (!add_face(out, &mesh->mFaces[n], first)) return false;
    return true;
}

static bool visit(walk *w, const struct aiNode *node, struct aiMatrix4x4 m, int depth)
{
    if (depth > deepest_node)
        return plain_mesh_refuse(w->out, ERROR_INPUT_UNSUPPORTED,
                                 "its nodes are nested more than %d deep. Save it with fewer levels.",
                                 deepest_node);
    aiMultiplyMatrix4(&m, &node->mTransformation);
    for (unsigned n = 0; n < node->mNumMeshes; n++)
        if (node->mMeshes[n] < w->scene->mNumMeshes && !add_mesh(w, w->scene->mMeshes[node->mMeshes[n]], &m))
            return false;
    w->group += node->mNumMeshes > 0;
    for (unsigned n = 0; n < node->mNumChildren; n++)
        if (!visit(w, node->mChildren[n], m, depth + 1)) return false;
    return true;
}

static bool add_scene(const struct aiScene *scene, file_format format, const char *data, size_t size,
                      plain_mesh *out)
{
    struct aiMatrix4x4 identity;
    uint32_t *set = NULL;
    aiIdentityMatrix4(&identity);
    library_scene_warn(scene, format, out);
    bool ok = !out->textures || library_textures_read(scene, data, size, out, &set);
    walk w = {.scene = scene, .out = out, .is_gltf = format == FILE_FORMAT_GLTF, .set = set};
    ok = ok && visit(&w, scene->mRootNode, identity, 0) && plain_mesh_complete_values(out);
    if (ok && w.skins > 0 && !w.is_gltf)
        plain_mesh_warn(
            out, "%zu meshes have a skin, which is not applied: export the posed mesh to sample it", w.skins);
    free(set);
    return ok;
}

/* Refuses the file with the library's message. */
static bool refuse(const bytes *b, size_t memory, const char *why, plain_mesh *out)
{
    if (strstr(why, "bad_alloc") || strstr(why, "bad allocation") || strstr(why, "Out of memory"))
        return b->size > memory / memory_per_byte
                   ? plain_mesh_refuse_memory(out)
                   : plain_mesh_refuse(
                         out, ERROR_INPUT_DAMAGED,
                         "the file announces far more data than it has: it is damaged. Save it again.");
    /* replace the internal name by "the file" */
    const char *name = strstr(why, b->name), *rest = name ? name + strlen(b->name) : why;
    size_t length = strlen(rest);
    while (length > 0 && strchr(". \n", rest[length - 1])) length--;
    return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                             "the file cannot be read as a mesh: %.*s%s%.*s. Repair it, or save it again.",
                             name ? (int)(name - why) : 0, why, name ? "the file" : "", (int)length,
                             *why ? rest : "");
}

bool library_mesh_read(file_format format, const char *data, size_t size, size_t memory, plain_mesh *out)
{
    const bool is_text_gltf = format == FILE_FORMAT_GLTF && strncmp(data, "glTF", 4) != 0;
    bytes b = {.data = data, .size = size};
    snprintf(b.name, sizeof b.name, "mesh%s", file_formats[format].ending[is_text_gltf]);
    if (!library_text_check(format, data, size, out)) return false;
    struct aiFileIO io = {open_file, close_file, (aiUserData)&b};
    library_scene_listen(out->textures != NULL);
    struct aiPropertyStore *how = aiCreatePropertyStore();
    aiSetImportPropertyInteger(how, AI_CONFIG_IMPORT_NO_SKELETON_MESHES,
                               1); /* in the place of a scene without meshes */
    const struct aiScene *scene = aiImportFileExWithProperties(b.name, 0, &io, how);
    if (!scene || !scene->mRootNode) return refuse(&b, memory, aiGetErrorString(), out);
    /* the scene is not freed, which takes time: the process ends soon */
    return add_scene(scene, format, data, size, out);
}

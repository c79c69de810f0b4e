// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/library_textures.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <assimp/material.h>

#include "io/meshes/collada_textures.h"
#include "io/meshes/plain_textures.h"

/* Adds the image of a material's diffuse texture, if it has one. The library refuses COLLADA files with images inside. */
static bool add_image(const struct aiMaterial *from, mesh_material *material, plain_mesh *m)
{
    struct aiString path;
    if (aiGetMaterialString(from, AI_MATKEY_TEXTURE(aiTextureType_DIFFUSE, 0), &path) != aiReturn_SUCCESS)
        return true;
    return plain_textures_add_image(m, path.data, NULL, 0, &material->image);
}

/* Adds a material. Its colour is 1 if it has an image. */
static bool add_material(const struct aiMaterial *from, plain_mesh *m)
{
    mesh_material new = mesh_textures_white();
    struct aiString name;
    struct aiColor4D color;
    ai_real opacity;
    uint32_t unused;
    new.is_opaque = true;
    if (aiGetMaterialString(from, AI_MATKEY_NAME, &name) == aiReturn_SUCCESS)
        snprintf(new.name, sizeof new.name, "%.*s", (int)sizeof new.name - 1, name.data);
    if (aiGetMaterialColor(from, AI_MATKEY_COLOR_DIFFUSE, &color) == aiReturn_SUCCESS)
        memcpy(new.factor, (const double[]){(double)color.r, (double)color.g, (double)color.b},
               3 * sizeof *new.factor);
    if (aiGetMaterialFloat(from, AI_MATKEY_OPACITY, &opacity) == aiReturn_SUCCESS && opacity < 1)
        plain_textures_warn(m, "the transparency of the material \"%.60s\" is not read", new.name);
    return add_image(from, &new, m) && plain_textures_add_material(m, &new, &unused);
}

/* The coordinates that the image of the mesh's material uses, or NULL. The library numbers the sets of a mesh from 0,
 * also if the file does not. */
static const struct aiVector3D *coordinates_of(const struct aiMesh *mesh, uint32_t set)
{
    const bool is_only_set = !mesh->mTextureCoords[1];
    if (is_only_set) return mesh->mTextureCoords[0];
    return set < AI_MAX_NUMBER_OF_TEXTURECOORDS ? mesh->mTextureCoords[set] : NULL;
}

static bool add_face(const struct aiMesh *mesh, const struct aiFace *face, const struct aiVector3D *at,
                     double (*uv)[2], plain_mesh *m)
{
    const uint32_t material =
        mesh->mMaterialIndex < m->textures->all.materials ? mesh->mMaterialIndex : MESH_TEXTURES_NONE;
    for (unsigned k = 0; k < face->mNumIndices; k++) {
        const unsigned n = face->mIndices[k];
        const bool has_place = at && n < mesh->mNumVertices;
        uv[k][0] = has_place ? (double)at[n].x : (double)NAN;
        uv[k][1] = has_place ? (double)at[n].y : (double)NAN;
    }
    return plain_textures_add_polygon(m, material, (const double(*)[2])uv, NULL, face->mNumIndices);
}

static bool add_mesh(const struct aiMesh *mesh, const uint32_t *set, plain_mesh *m)
{
    const bool has_material = mesh->mMaterialIndex < m->textures->all.materials;
    const struct aiVector3D *at = coordinates_of(mesh, has_material ? set[mesh->mMaterialIndex] : 0);
    size_t corners = 0;
    for (unsigned k = 0; k < mesh->mNumFaces; k++)
        if (mesh->mFaces[k].mNumIndices > corners) corners = mesh->mFaces[k].mNumIndices;
    double(*uv)[2] = malloc((corners + 1) * sizeof *uv);
    bool ok = uv != NULL || plain_mesh_refuse_memory(m);
    for (unsigned k = 0; ok && k < mesh->mNumFaces; k++) ok = add_face(mesh, &mesh->mFaces[k], at, uv, m);
    free(uv);
    return ok;
}

static bool add_node(const struct aiScene *scene, const struct aiNode *node, const uint32_t *set,
                     plain_mesh *m)
{
    for (unsigned k = 0; k < node->mNumMeshes; k++)
        if (node->mMeshes[k] < scene->mNumMeshes && !add_mesh(scene->mMeshes[node->mMeshes[k]], set, m))
            return false;
    for (unsigned k = 0; k < node->mNumChildren; k++)
        if (!add_node(scene, node->mChildren[k], set, m)) return false;
    return true;
}

/* Whether the only material is the one that the library makes for a file without materials. */
static bool has_no_material(const struct aiScene *scene)
{
    struct aiString name;
    return scene->mNumMaterials == 1 &&
           aiGetMaterialString(scene->mMaterials[0], AI_MATKEY_NAME, &name) == aiReturn_SUCCESS &&
           strcmp(name.data, AI_DEFAULT_MATERIAL_NAME) == 0;
}

bool library_textures_read(const struct aiScene *scene, const char *data, size_t size, plain_mesh *m)
{
    for (unsigned k = 0; k < scene->mNumMaterials && !has_no_material(scene); k++)
        if (!add_material(scene->mMaterials[k], m)) return false;
    uint32_t *set = calloc(m->textures->all.materials + 1, sizeof *set);
    const bool ok = (set || plain_mesh_refuse_memory(m)) && collada_textures_read(data, size, m, set) &&
                    add_node(scene, scene->mRootNode, set, m);
    free(set);
    return ok;
}

// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/library_textures.h"

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

const struct aiVector3D *library_textures_coordinates(const struct aiMesh *mesh, uint32_t set)
{
    const bool is_only_set = !mesh->mTextureCoords[1];
    if (is_only_set) return mesh->mTextureCoords[0];
    return set < AI_MAX_NUMBER_OF_TEXTURECOORDS ? mesh->mTextureCoords[set] : NULL;
}

/* Whether the only material is the one that the library makes for a file without materials. */
static bool has_no_material(const struct aiScene *scene)
{
    struct aiString name;
    return scene->mNumMaterials == 1 &&
           aiGetMaterialString(scene->mMaterials[0], AI_MATKEY_NAME, &name) == aiReturn_SUCCESS &&
           strcmp(name.data, AI_DEFAULT_MATERIAL_NAME) == 0;
}

bool library_textures_read(const struct aiScene *scene, const char *data, size_t size, plain_mesh *m,
                           uint32_t **set)
{
    for (unsigned k = 0; k < scene->mNumMaterials && !has_no_material(scene); k++)
        if (!add_material(scene->mMaterials[k], m)) return false;
    *set = calloc(m->textures->all.materials + 1, sizeof **set);
    return (*set || plain_mesh_refuse_memory(m)) && collada_textures_read(data, size, m, *set);
}

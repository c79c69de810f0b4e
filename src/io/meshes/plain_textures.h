// SPDX-License-Identifier: Apache-2.0
/* plain_textures: collects materials and images while a reader of plain_mesh reads a file.
 * Runs in the process that reads. Functions return false if the file is refused.
 */
#ifndef HEXAD_IO_MESHES_PLAIN_TEXTURES_H
#define HEXAD_IO_MESHES_PLAIN_TEXTURES_H

#include "io/meshes/mesh_textures.h"
#include "io/meshes/plain_mesh.h"

struct plain_textures {
    mesh_textures all;
    size_t material_room, image_room, library_room;
};

/* Adds a material, an image or a library of m->textures. `data`: the bytes of an image in the file, which are copied;
 * NULL: it is a file, which is added once. Names that are too long are refused. */
bool plain_textures_add_material(plain_mesh *m, const mesh_material *material, uint32_t *index);
bool plain_textures_add_image(plain_mesh *m, const char *name, const void *data, size_t size,
                              uint32_t *index);
bool plain_textures_add_library(plain_mesh *m, const char *name);

/* Adds a warning about materials or images, unless there is no more room. */
void plain_textures_warn(plain_mesh *m, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* The index of the material with this name, or MESH_TEXTURES_NONE. */
uint32_t plain_textures_find_material(const plain_mesh *m, const char *name);

/* Writes the part of the answer that has the textures. False: the other end is closed. */
bool plain_textures_answer(const plain_mesh *m);

/* Reads a file of materials (MTL) to m->textures. data[size] is 0. */
bool plain_textures_read_mtl(const char *data, size_t size, plain_mesh *m);

#endif

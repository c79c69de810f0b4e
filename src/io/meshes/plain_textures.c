// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/plain_textures.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/reader.h"

static bool check_count(plain_mesh *m, size_t count, const char *what)
{
    return count < MESH_TEXTURES_MOST ||
           plain_mesh_refuse(m, ERROR_INPUT_UNSUPPORTED, "it has more than %d %s. Save it with fewer.",
                             MESH_TEXTURES_MOST, what);
}

static bool copy_name(plain_mesh *m, const char *name, char *to, size_t size)
{
    return (size_t)snprintf(to, size, "%s", name) < size ||
           plain_mesh_refuse(
               m, ERROR_INPUT_UNSUPPORTED,
               "its name \"%.80s...\" of a material or image is longer than %zu bytes. Shorten it.", name,
               size - 1);
}

bool plain_textures_add_material(plain_mesh *m, const mesh_material *material, uint32_t *index)
{
    plain_textures *t = m->textures;
    if (!check_count(m, t->all.materials, "materials") ||
        !plain_mesh_make_room(m, (void **)&t->all.material, &t->material_room, t->all.materials + 1,
                              sizeof *t->all.material))
        return false;
    *index = (uint32_t)t->all.materials;
    t->all.material[t->all.materials++] = *material;
    return true;
}

bool plain_textures_add_image(plain_mesh *m, const char *name, const void *data, size_t size, uint32_t *index)
{
    plain_textures *t = m->textures;
    const size_t room = t->image_room;
    for (size_t k = 0; !data && k < t->all.images; k++)
        if (!t->all.data[k] && strcmp(t->all.image[k].name, name) == 0) {
            *index = (uint32_t)k;
            return true;
        }
    mesh_image image = {.bytes = data ? size : 0};
    if (!copy_name(m, name, image.name, sizeof image.name) || !check_count(m, t->all.images, "images") ||
        !plain_mesh_make_room(m, (void **)&t->all.image, &t->image_room, t->all.images + 1,
                              sizeof *t->all.image))
        return false;
    if (t->image_room != room) {
        unsigned char **moved = realloc(t->all.data, t->image_room * sizeof *moved);
        if (!moved) return plain_mesh_refuse_memory(m);
        t->all.data = moved;
    }
    unsigned char *copy = data && size > 0 ? malloc(size) : NULL;
    if (data && size > 0 && !copy) return plain_mesh_refuse_memory(m);
    if (copy) memcpy(copy, data, size);
    *index = (uint32_t)t->all.images;
    t->all.data[t->all.images] = copy;
    t->all.image[t->all.images++] = image;
    return true;
}

bool plain_textures_add_library(plain_mesh *m, const char *name)
{
    plain_textures *t = m->textures;
    char copy[MESH_IMAGE_NAME_SIZE];
    if (!copy_name(m, name, copy, sizeof copy)) return false;
    for (size_t k = 0; k < t->all.libraries; k++)
        if (strcmp(t->all.library[k], copy) == 0) return true;
    if (!check_count(m, t->all.libraries, "files of materials") ||
        !plain_mesh_make_room(m, (void **)&t->all.library, &t->library_room, t->all.libraries + 1,
                              sizeof copy))
        return false;
    memcpy(t->all.library[t->all.libraries++], copy, sizeof copy);
    return true;
}

void plain_textures_warn(plain_mesh *m, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    m->textures->all.unlisted +=
        !plain_mesh_append(m->textures->all.warnings, sizeof m->textures->all.warnings, format, arguments);
    va_end(arguments);
}

uint32_t plain_textures_find_material(const plain_mesh *m, const char *name)
{
    const mesh_textures *t = &m->textures->all;
    for (size_t k = 0; k < t->materials; k++)
        if (strcmp(t->material[k].name, name) == 0) return (uint32_t)k;
    return MESH_TEXTURES_NONE;
}

bool plain_textures_answer(const plain_mesh *m)
{
    const mesh_textures *t = &m->textures->all;
    mesh_textures_header head = {.materials = (uint32_t)t->materials,
                                 .images = (uint32_t)t->images,
                                 .libraries = (uint32_t)t->libraries,
                                 .unlisted = t->unlisted};
    memcpy(head.warnings, t->warnings, sizeof head.warnings);
    bool ok = reader_write(&head, sizeof head) &&
              reader_write(t->material, t->materials * sizeof *t->material) &&
              reader_write(t->library, t->libraries * sizeof *t->library) &&
              reader_write(t->image, t->images * sizeof *t->image);
    for (size_t k = 0; ok && k < t->images; k++) ok = reader_write(t->data[k], t->image[k].bytes);
    return ok;
}

// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/base_color.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "geometry/space/affine.h"
#include "io/images/image_file.h"
#include "io/meshes/mesh_file.h"
#include "job/attributes/corners.h"
#include "job/attributes/texel.h"
#include "surface/triangles/triangle_tree.h"

static const char what[] = "the colours of the textures";

/* A mesh with its materials. */
typedef struct textured_mesh {
    mesh m;
    mesh_values values;
    const double *uv, *material, *tint; /* arrays of `values`; NULL: there is none */
    mesh_textures textures;
    dense_warnings warnings;
    size_t unlisted; /* number of warnings for which `warnings` has no room */
    size_t places;   /* bytes of the places of the points */
} textured_mesh;

static void free_mesh(textured_mesh *t)
{
    mesh_free(&t->m);
    mesh_values_free(&t->values);
    mesh_textures_free(&t->textures);
}

/* Adds a warning. One of `warnings` is left for the number of unlisted ones. */
static void warn(textured_mesh *t, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void warn(textured_mesh *t, const char *format, ...)
{
    char text[DENSE_WARNING_SIZE];
    va_list arguments;
    if (t->warnings.count + 1 == DENSE_WARNINGS_MOST) {
        t->unlisted++;
        return;
    }
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    dense_warn(&t->warnings, "%s", text);
}

/* Adds the warnings of a file of a mesh or of materials. */
static void warn_of_textures(textured_mesh *t, const mesh_textures *read)
{
    for (const char *at = read->warnings; *at; at += strspn(at, "\n")) {
        const size_t length = strcspn(at, "\n");
        warn(t, "%.*s", (int)length, at);
        at += length;
    }
    t->unlisted += read->unlisted;
}

/* ---- files beside the mesh */

/* Removes "." and "name/.." from a path. */
static void normalise(char *path)
{
    const bool is_absolute = *path == '/';
    char *out = path + is_absolute, *const first = out;
    for (const char *at = out; *at;) {
        const size_t length = strcspn(at, "/");
        const char *next = at + length + strspn(at + length, "/");
        char *last = out;
        while (last > first && last[-1] != '/') last--;
        if (length == 1 && *at == '.') {
            /* nothing */
        } else if (length == 2 && memcmp(at, "..", 2) == 0 && out > first &&
                   strncmp(last, "..", (size_t)(out - last)) != 0) {
            out = last > first ? last - 1 : first;
        } else {
            if (out > first) *out++ = '/';
            memmove(out, at, length);
            out += length;
        }
        at = next;
    }
    *out = 0;
}

/* The path of a file that another file names. Backslashes separate folders, and of a path with a drive only the last
 * part is used. The caller frees it. */
static char *path_beside(const char *path, const char *name)
{
    char *copy = mem_strdup(name);
    for (char *c = copy; *c; c++)
        if (*c == '\\') *c = '/';
    const bool has_drive = *copy && copy[1] == ':';
    const char *slash = strrchr(path, '/'), *last = strrchr(copy, '/'),
               *rest = has_drive ? (last ? last + 1 : copy + 2) : copy;
    char *joined =
        *rest == '/' || !slash ? mem_strdup(rest) : mem_printf("%.*s/%s", (int)(slash - path), path, rest);
    free(copy);
    normalise(joined);
    return joined;
}

/* Opens a file that `path` names. Returns a descriptor, or -1. */
static int open_beside(const attribute_request *request, const char *path, const char *name, error *e)
{
    char *beside = path_beside(path, name);
    const int fd = request->files->open(request->files->context, beside, e);
    free(beside);
    return fd;
}

/* ---- materials */

/* Takes a material of a library, whose images are named relative to it. */
static void take_material(mesh_textures *to, uint32_t index, const mesh_textures *library, uint32_t from,
                          const uint32_t *image)
{
    mesh_material *m = &to->material[index];
    *m = library->material[from];
    if (m->image != MESH_TEXTURES_NONE) m->image = image[m->image];
}

/* Adds the images of a library to those of the mesh; image[k] receives the index of its image k. */
static uint32_t *add_images(mesh_textures *to, const mesh_textures *library)
{
    uint32_t *image = mem_alloc((library->images + 1) * sizeof *image);
    to->image = mem_resize(to->image, (to->images + library->images + 1) * sizeof *to->image);
    to->data = mem_resize(to->data, (to->images + library->images + 1) * sizeof *to->data);
    for (size_t k = 0; k < library->images; k++) {
        image[k] = (uint32_t)to->images;
        to->data[to->images] = NULL;
        to->image[to->images++] = library->image[k];
    }
    return image;
}

/* Reads a library of materials, and takes those that have not been found. Names of images in a library are relative to
 * the mesh file, as programs that write them expect. */
static bool read_library(const attribute_request *request, const char *name, bool *found, textured_mesh *t,
                         error *e)
{
    mesh_textures library = {0}, *to = &t->textures;
    if (request->is_sent)
        return error_set(
            e, ERROR_ATTRIBUTE_MISSING,
            "the materials are in the separate file \"%.200s\", which an uploaded mesh cannot name: upload "
            "a .glb file, which contains its materials and images",
            name);
    const int fd = open_beside(request, request->path, name, e);
    if (fd < 0) return false;
    const mesh_file file = {fd, name, NULL, request->memory_limit};
    const bool ok = mesh_file_read_materials(&file, &library, e) || error_prefix(e, "%s", name);
    close(fd);
    if (!ok) return false;
    warn_of_textures(t, &library);
    uint32_t *image = add_images(to, &library);
    for (size_t k = 0; k < to->materials; k++)
        for (size_t n = 0; !found[k] && n < library.materials; n++)
            if (strcmp(to->material[k].name, library.material[n].name) == 0) {
                take_material(to, (uint32_t)k, &library, (uint32_t)n, image);
                found[k] = true;
            }
    free(image);
    mesh_textures_free(&library);
    return true;
}

/* Reads the file that a line names, or if there is none, the files that its words name. */
static bool read_line_of_libraries(const attribute_request *request, const char *line, bool *found,
                                   textured_mesh *t, error *e)
{
    error fault = {0};
    if (read_library(request, line, found, t, &fault)) return true;
    char *words = mem_strdup(line), *rest = NULL, *word = strtok_r(words, " \t", &rest);
    const bool has_words = fault.code == ERROR_INPUT_MISSING && word && strcmp(word, line) != 0;
    bool ok = has_words;
    for (; ok && word; word = strtok_r(NULL, " \t", &rest)) ok = read_library(request, word, found, t, e);
    free(words);
    if (!has_words) *e = fault;
    return ok;
}

static bool read_libraries(const attribute_request *request, textured_mesh *t, error *e)
{
    mesh_textures *all = &t->textures;
    bool *found = mem_alloc(all->materials + 1), ok = true;
    for (size_t k = 0; ok && k < all->libraries; k++)
        ok = read_line_of_libraries(request, all->library[k], found, t, e);
    for (size_t k = 0; ok && all->libraries > 0 && k < all->materials; k++)
        if (!found[k])
            warn(t, "the material \"%.80s\" is in no file of materials: it is white", all->material[k].name);
    free(found);
    return ok;
}

static bool refuse_missing(error *e)
{
    return error_set(
        e, ERROR_ATTRIBUTE_MISSING,
        "the mesh has no \"" BASE_COLOR_NAME
        "\": its file has no material, and names no image. Choose another attribute, such as \"color\".");
}

static const double *find_values(const textured_mesh *t, const char *name, uint32_t components)
{
    for (size_t k = 0; k < t->values.count; k++)
        if (strcmp(t->values.head[k].name, name) == 0 && t->values.head[k].components == components)
            return t->values.value[k];
    return NULL;
}

static bool read_mesh(const attribute_request *request, textured_mesh *t, error *e)
{
    const mesh_file file = {request->fd, request->path, NULL, request->memory_limit};
    mesh_notes notes = {0};
    if (!mesh_file_read_textures(&file, &t->m, &t->values, &t->textures, &notes, e)) return false;
    t->uv = find_values(t, MESH_TEXTURES_UV, 2);
    t->material = find_values(t, MESH_TEXTURES_MATERIAL, 1);
    t->tint = find_values(t, MESH_TEXTURES_TINT, 4);
    for (size_t k = 0; k < notes.count && !request->is_of_surface; k++) warn(t, "%s", notes.text[k]);
    warn_of_textures(t, &t->textures);
    const mesh_textures *all = &t->textures;
    bool is_named = false; /* materials of OBJ have a name only, until their library is read */
    for (size_t k = 0; k < all->materials; k++)
        is_named |= all->material[k].needs_library && all->libraries == 0;
    if (all->materials == 0 || is_named) return refuse_missing(e);
    return read_libraries(request, t, e);
}

/* ---- images */

/* Bytes that are held while an image is decoded. */
static size_t held_bytes(const textured_mesh *t)
{
    const mesh_textures *all = &t->textures;
    size_t of_vertex = sizeof *t->m.vertex;
    for (size_t k = 0; k < t->values.count; k++) of_vertex += t->values.head[k].components * sizeof(double);
    size_t bytes = t->m.vertex_count * of_vertex + t->m.triangle_count * sizeof *t->m.triangle +
                   all->materials * sizeof *all->material + all->images * sizeof *all->image + t->places;
    for (size_t k = 0; k < all->images; k++) bytes += all->image[k].bytes;
    return bytes;
}

static bool is_used(const mesh_textures *t, uint32_t image)
{
    for (size_t k = 0; k < t->materials; k++)
        if (t->material[k].image == image) return true;
    return false;
}

/* Warns of an image that is not used. */
static void warn_of_image(textured_mesh *t, uint32_t image, const char *why)
{
    warn(t, "the image \"%.80s\" %.100s: the factor of its material is used alone",
         t->textures.image[image].name, why);
}

/* Opens an image. *is_there: false if it is missing, with a warning. */
static bool open_image(const attribute_request *request, uint32_t image, textured_mesh *t, image_file *out,
                       bool *is_there, error *e)
{
    const mesh_image *head = &t->textures.image[image];
    const size_t held = held_bytes(t);
    error fault = {0};
    *is_there = head->bytes > 0;
    if (held >= request->memory_limit)
        return error_set(
            e, ERROR_LIMIT_MEMORY,
            "the mesh and its %zu images require %zu MiB, which leaves no memory for the pixels of an image: raise "
            "limits.memory_mb",
            t->textures.images, held >> 20);
    *out =
        (image_file){.fd = -1,
                     .data = t->textures.data[image],
                     .size = head->bytes,
                     .name = head->name,
                     .limits = {request->image_pixels, request->image_scans, request->memory_limit - held}};
    if (*is_there) return true;
    if (request->is_sent) {
        warn_of_image(t, image, "is a separate file, which an uploaded mesh cannot name");
        return true;
    }
    out->fd = open_beside(request, request->path, head->name, &fault);
    *is_there = out->fd >= 0;
    if (*is_there) return true;
    if (fault.code != ERROR_INPUT_MISSING && fault.code != ERROR_PATH_FORBIDDEN) {
        *e = fault;
        return false;
    }
    warn_of_image(t, image, fault.code == ERROR_INPUT_MISSING ? "is missing" : "is not below an input root");
    return true;
}

/* Checks an image, or with `pixels` decodes it: *pixels stays NULL if it is missing or of a format that is not read. */
static bool read_image(const attribute_request *request, uint32_t image, textured_mesh *t, image_facts *facts,
                       void **pixels, error *e)
{
    image_file file;
    bool is_there;
    if (!open_image(request, image, t, &file, &is_there, e)) return false;
    if (!is_there) return true;
    const bool ok = (pixels ? image_file_read(&file, facts, pixels, e) : image_file_check(&file, facts, e)) ||
                    error_prefix(e, "the image \"%.200s\"", file.name);
    if (file.fd >= 0) close(file.fd);
    if (!ok) return false;
    char why[64];
    snprintf(why, sizeof why, "is %s, which is not read", facts->unread);
    if (*facts->unread) warn_of_image(t, image, why);
    if (facts->has_profile)
        warn(t, "the image \"%.80s\" has a colour profile (ICC), which is not applied", file.name);
    if (facts->has_exif)
        warn(t, "the image \"%.80s\" has EXIF data, whose orientation is not applied", file.name);
    return true;
}

bool base_color_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e)
{
    textured_mesh t = {0};
    image_facts facts;
    bool ok = read_mesh(request, &t, e);
    for (uint32_t k = 0; ok && k < t.textures.images; k++)
        if (is_used(&t.textures, k)) ok = read_image(request, k, &t, &facts, NULL, e);
    free_mesh(&t);
    *kind = POINT_ATTRIBUTE_COLOR;
    *components = 4;
    return ok;
}

/* ---- points */

/* The material and the image coordinates at a point. */
typedef struct texture_place {
    double uv[2]; /* NaN: none */
    uint32_t material;
} texture_place;

/* The material of a vertex, or MESH_TEXTURES_NONE. */
static uint32_t material_of(const textured_mesh *t, uint32_t vertex)
{
    const double index = t->material ? t->material[vertex] : -1;
    return index >= 0 && index < (double)t->textures.materials ? (uint32_t)index : MESH_TEXTURES_NONE;
}

/* Sets the place of a point and the product of the factor and the colours of the vertices. */
static void locate(const textured_mesh *t, const uint32_t corner[3], const double weight[3],
                   texture_place *out, double color[4])
{
    const mesh_material white = mesh_textures_white();
    double uv[2] = {0, 0}, tint[4] = {0, 0, 0, 0};
    out->material = material_of(t, corner[0]);
    const mesh_material *m =
        out->material == MESH_TEXTURES_NONE ? &white : &t->textures.material[out->material];
    for (int k = 0; k < 3; k++) {
        for (int c = 0; c < 2; c++)
            uv[c] += weight[k] * (t->uv ? t->uv[2 * (size_t)corner[k] + (size_t)c] : (double)NAN);
        for (int c = 0; c < 4; c++) {
            const double vertex_tint = t->tint ? t->tint[4 * (size_t)corner[k] + (size_t)c] : 1;
            tint[c] += weight[k] * (isnan(vertex_tint) ? 1 : vertex_tint);
        }
    }
    for (int c = 0; c < 2; c++)
        out->uv[c] = m->transform[c][0] * uv[0] + m->transform[c][1] * uv[1] + m->transform[c][2];
    for (int c = 0; c < 4; c++) color[c] = m->factor[c] * (t->tint ? tint[c] : 1);
}

static bool locate_points(const attribute_request *request, const textured_mesh *t, size_t count,
                          const vec3 *position, texture_place *places, double *values, size_t *far, error *e)
{
    double to_file[3][4];
    triangle_tree *tree = triangle_tree_new(&t->m, NULL, e);
    affine_invert(request->from_file, to_file);
    for (size_t i = 0; tree && i < count; i++) {
        double weight[3];
        const vec3 x = affine_apply((const double(*)[4])to_file, position[i].x, position[i].y, position[i].z);
        const uint32_t nearest = (uint32_t)triangle_tree_find(tree, x, weight);
        locate(t, t->m.triangle[nearest], weight, &places[i], values + 4 * i);
        *far += corners_is_far(request, i, position[i], &t->m, t->m.triangle[nearest], weight);
    }
    const bool ok = tree != NULL;
    triangle_tree_free(tree);
    return ok;
}

/* Multiplies the values of the points whose material has the image. */
static bool apply_image(const attribute_request *request, uint32_t image, textured_mesh *t, size_t count,
                        const texture_place *places, double *values, error *e)
{
    double light[256];
    image_facts facts = {0};
    void *pixels = NULL;
    for (int k = 0; k < 256; k++) light[k] = mesh_textures_decode(k / 255.0);
    if (!read_image(request, image, t, &facts, &pixels, e)) return false;
    for (size_t i = 0; pixels && i < count; i++) {
        if (places[i].material == MESH_TEXTURES_NONE) continue;
        const mesh_material *m = &t->textures.material[places[i].material];
        const texel_image texels = {facts.width, facts.height, facts.bits, pixels,
                                    m->is_linear ? light : NULL};
        double color[4];
        if (m->image != image || !isfinite(places[i].uv[0] + places[i].uv[1]) ||
            !texel_at(&texels, m->wrap, places[i].uv, color))
            continue;
        for (int c = 0; c < 4; c++) values[4 * i + (size_t)c] *= color[c];
    }
    free(pixels);
    return true;
}

/* Warns of points whose material has an image, but whose triangle has no coordinates. */
static void warn_of_coordinates(textured_mesh *t, const texture_place *places, size_t count)
{
    size_t without = 0;
    for (size_t i = 0; i < count; i++)
        without += places[i].material != MESH_TEXTURES_NONE &&
                   t->textures.material[places[i].material].image != MESH_TEXTURES_NONE &&
                   !isfinite(places[i].uv[0] + places[i].uv[1]);
    if (without > 0)
        warn(t,
             "%zu points lie on triangles that have an image, but no coordinates on it: the factor of their "
             "material is used alone",
             without);
}

/* Converts linear light to sRGB, and sets opacities that are 1. Returns whether the numbers are finite. */
static bool finish(const textured_mesh *t, const texture_place *p, double color[4])
{
    const mesh_material *m = p->material == MESH_TEXTURES_NONE ? NULL : &t->textures.material[p->material];
    bool finite = true;
    for (int c = 0; c < 4; c++) finite &= isfinite(color[c]);
    for (int c = 0; c < 4 && !finite; c++) color[c] = 0;
    for (int c = 0; finite && m && m->is_linear && c < 3; c++) color[c] = mesh_textures_encode(color[c]);
    if (finite && m && m->is_opaque) color[3] = 1;
    return finite;
}

bool base_color_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                     attribute_counts *counts, error *e)
{
    textured_mesh t = {.places = count * sizeof(texture_place)};
    texture_place *places = mem_array(count, sizeof *places, what, e);
    bool ok = places && read_mesh(request, &t, e) &&
              locate_points(request, &t, count, position, places, values, &counts->far, e);
    for (uint32_t k = 0; ok && k < t.textures.images; k++)
        if (is_used(&t.textures, k)) ok = apply_image(request, k, &t, count, places, values, e);
    for (size_t i = 0; ok && i < count; i++) counts->not_finite += !finish(&t, &places[i], values + 4 * i);
    if (ok) warn_of_coordinates(&t, places, count);
    if (t.unlisted > 0)
        dense_warn(&t.warnings, "%zu further warnings about materials and images are not listed", t.unlisted);
    counts->warnings = t.warnings;
    free(places);
    free_mesh(&t);
    return ok;
}

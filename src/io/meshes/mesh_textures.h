// SPDX-License-Identifier: Apache-2.0
/* mesh_textures: materials and images of a mesh file, from which base_color is computed with three arrays of values
 * of the vertices: the coordinates on the image, the index of the material, and a colour that is multiplied.
 *
 * Coordinates of images are (0, 0) at the upper left corner and (1, 1) at the lower right one. A material maps
 * the coordinates of the file to them.
 */
#ifndef HEXAD_IO_MESHES_MESH_TEXTURES_H
#define HEXAD_IO_MESHES_MESH_TEXTURES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Sizes of names with their byte 0; maximum numbers. A file with more is refused. */
enum { MESH_MATERIAL_NAME_SIZE = 256, MESH_IMAGE_NAME_SIZE = 1024, MESH_TEXTURES_MOST = 4096 };

/* Size of the warnings with their byte 0. */
enum { MESH_TEXTURES_TEXT_SIZE = 1024 };

#define MESH_TEXTURES_NONE UINT32_MAX /* instead of the index of a material or an image */

/* How an image continues beyond its sides. */
typedef enum mesh_wrap {
    MESH_WRAP_REPEAT,
    MESH_WRAP_MIRROR,
    MESH_WRAP_CLAMP,   /* the texels of the sides */
    MESH_WRAP_NOTHING, /* the material's factor alone */
    MESH_WRAPS
} mesh_wrap;

typedef struct mesh_material {
    char name[MESH_MATERIAL_NAME_SIZE];
    double factor[4];       /* red, green, blue, opacity; in linear light if is_linear */
    double transform[2][3]; /* image coordinates = transform (u, v, 1) */
    uint32_t image;         /* or MESH_TEXTURES_NONE */
    uint32_t wrap[2];       /* a mesh_wrap for each coordinate */
    uint32_t is_linear;     /* texels are converted to linear light, and the product is converted to sRGB */
    uint32_t is_opaque;     /* the opacity is 1 */
    uint32_t needs_library; /* only the name is known, until a library is read */
} mesh_material;

/* An image. With `bytes`, it is in the mesh file; otherwise it is the file `name`, relative to the mesh file. */
typedef struct mesh_image {
    char name[MESH_IMAGE_NAME_SIZE];
    uint64_t bytes;
} mesh_image;

/* Names of the arrays. A vertex that no array has a value for has no coordinates, no material, and the colour 1. */
#define MESH_TEXTURES_UV "uv"
#define MESH_TEXTURES_MATERIAL "material"
#define MESH_TEXTURES_TINT "tint"

typedef struct mesh_textures {
    size_t materials, images, libraries;
    mesh_material *material;
    mesh_image *image;
    unsigned char **data;                   /* per image: its bytes, or NULL */
    char (*library)[MESH_IMAGE_NAME_SIZE];  /* files with materials, relative to the mesh file */
    char warnings[MESH_TEXTURES_TEXT_SIZE]; /* one a line */
    uint32_t unlisted;                      /* number of further warnings */
} mesh_textures;

void mesh_textures_free(mesh_textures *t); /* accepts a zeroed object */

/* From sRGB to linear light, and back (IEC 61966-2-1), 0 to 1. */
double mesh_textures_decode(double encoded);
double mesh_textures_encode(double linear);

/* A white material without an image, whose image coordinates are those of the file with v upwards. */
mesh_material mesh_textures_white(void);

/* Heads of the part of the reader's answer that has the textures (mesh_reader.h). */
typedef struct mesh_textures_header {
    uint32_t materials, images, libraries, unlisted;
    char warnings[MESH_TEXTURES_TEXT_SIZE];
} mesh_textures_header;

#endif

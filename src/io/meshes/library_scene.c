// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/library_scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <assimp/cimport.h>

#include "io/meshes/plain_textures.h"

/* Maximum number of the library's warnings that are kept of a file. */
enum { MOST_WARNINGS = 3 };
/* Relative deviation of a length of 1 that is rounding of the library's floats. */
static const double rounding = 1e-4;

/* ---- warnings of the library */

static char *kept[MOST_WARNINGS];

/* Whether the warnings about materials and images are kept, and not the others. */
static bool keeps_textures;

static bool is_about_textures(const char *text)
{
    return strcasestr(text, "material") || strcasestr(text, "texture") || strcasestr(text, "image");
}

/* Whether the text is about something that is not read anyway, or about the structure of an FBX file that the
 * library completes by its defaults. */
static bool is_unrelated(const char *text)
{
    static const char *const words[] = {"anim",      "light",  "Definitions",
                                        "hierarchy", "camera", "property table"};
    if (is_about_textures(text)) return true;
    for (size_t k = 0; k < sizeof words / sizeof *words; k++)
        if (strcasestr(text, words[k])) return true;
    return false;
}

/* Keeps the text of a line such as "Warn,  T0: text". */
static void keep(const char *line, char *unused)
{
    const char *text = strstr(line, ": ");
    (void)unused;
    if (!text || (strncmp(line, "Warn", 4) != 0 && strncmp(line, "Error", 5) != 0)) return;
    /* the set of coordinates is determined by collada_textures */
    const bool is_kept =
        keeps_textures ? is_about_textures(line) && !strstr(line, "UV channel") : !is_unrelated(line);
    if (!is_kept) return;
    char *copy = strndup(text + 2, strcspn(text + 2, "\n"));
    for (int k = 0; copy && k < MOST_WARNINGS; k++) {
        if (kept[k] && strcmp(kept[k], copy) == 0) break;
        if (!kept[k]) {
            kept[k] = copy;
            return;
        }
    }
    free(copy);
}

void library_scene_listen(bool textures)
{
    keeps_textures = textures;
    static const struct aiLogStream stream = {keep, NULL};
    aiAttachLogStream(&stream);
}

/* ---- what is not applied */

static const struct aiMetadataEntry *entry_of(const struct aiMetadata *data, const char *key,
                                              enum aiMetadataType type)
{
    for (unsigned k = 0; data && k < data->mNumProperties; k++)
        if (strcmp(data->mKeys[k].data, key) == 0 && data->mValues[k].mType == type) return &data->mValues[k];
    return NULL;
}

static int32_t integer_of(const struct aiMetadata *data, const char *key, int32_t otherwise)
{
    const struct aiMetadataEntry *entry = entry_of(data, key, AI_INT32);
    if (entry) memcpy(&otherwise, entry->mData, sizeof otherwise);
    return otherwise;
}

static void warn_of_axes_and_unit(const struct aiMetadata *data, plain_mesh *m)
{
    const struct aiMetadataEntry *unit = entry_of(data, "UnitScaleFactor", AI_FLOAT);
    const int32_t up = integer_of(data, "UpAxis", 1), sign = integer_of(data, "UpAxisSign", 1);
    float centimetres = 1;
    if (unit) memcpy(&centimetres, unit->mData, sizeof centimetres);
    if (centimetres != 1)
        plain_mesh_warn(m, "the unit of the file is %g cm: coordinates are not converted",
                        (double)centimetres);
    if ((up != 1 || sign != 1) && up >= 0 && up < 3)
        plain_mesh_warn(m, "the up axis of the file is %s%c: coordinates are not converted",
                        sign < 0 ? "-" : "", "xyz"[up]);
}

/* Length of a column of the linear part. */
static double scale_of(const struct aiMatrix4x4 *t, int column)
{
    const float *m = &t->a1;
    double sum = 0;
    for (int row = 0; row < 3; row++) sum += (double)m[4 * row + column] * (double)m[4 * row + column];
    return sqrt(sum);
}

static bool has_scale(const struct aiMatrix4x4 *t)
{
    for (int column = 0; column < 3; column++)
        if (fabs(scale_of(t, column) - 1) > rounding) return true;
    return false;
}

typedef struct nodes {
    size_t hidden, uninherited;
    bool *is_placed; /* by the number of the mesh */
} nodes;

/* Walks over the nodes, to a depth that mesh_reader accepts. */
static void count_nodes(const struct aiScene *scene, const struct aiNode *node, nodes *n)
{
    const struct aiMetadataEntry *show = entry_of(node->mMetaData, "Show", AI_BOOL);
    n->hidden += show && !*(const bool *)show->mData;
    /* 1: the transform of the parent applies. The library applies it always. */
    n->uninherited += integer_of(node->mMetaData, "InheritType", 1) != 1 && node->mParent &&
                      has_scale(&node->mParent->mTransformation);
    for (unsigned k = 0; k < node->mNumMeshes; k++)
        if (node->mMeshes[k] < scene->mNumMeshes) n->is_placed[node->mMeshes[k]] = true;
    for (unsigned k = 0; k < node->mNumChildren; k++) count_nodes(scene, node->mChildren[k], n);
}

static void warn_of_nodes(const struct aiScene *scene, plain_mesh *m)
{
    size_t unplaced = 0;
    nodes n = {.is_placed = calloc(scene->mNumMeshes + 1, sizeof *n.is_placed)};
    if (!n.is_placed) return;
    count_nodes(scene, scene->mRootNode, &n);
    for (unsigned k = 0; k < scene->mNumMeshes; k++) unplaced += !n.is_placed[k];
    free(n.is_placed);
    if (unplaced > 0)
        plain_mesh_warn(m, "%zu of %u meshes are not placed by a node, and are not read", unplaced,
                        scene->mNumMeshes);
    if (n.hidden > 0) plain_mesh_warn(m, "%zu nodes are hidden: they are read like the others", n.hidden);
    if (n.uninherited > 0)
        plain_mesh_warn(m, "%zu nodes have an InheritType other than 1: the scale of their parents applies",
                        n.uninherited);
}

void library_scene_warn(const struct aiScene *scene, file_format format, plain_mesh *m)
{
    if (file_formats[format].reading != FILE_FORMAT_READ_BY_LIBRARY) return;
    warn_of_axes_and_unit(scene->mMetaData, m);
    warn_of_nodes(scene, m);
    for (int k = 0; k < MOST_WARNINGS && kept[k]; k++)
        (keeps_textures ? plain_textures_warn
                        : plain_mesh_warn)(m, "the library that reads the format reports: %s", kept[k]);
}

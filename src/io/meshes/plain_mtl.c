// SPDX-License-Identifier: Apache-2.0
/* Wavefront MTL: newmtl, Kd, d, Tr, and map_Kd with the options -s, -o and -clamp. Other lines do not change the
 * base colour. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io/meshes/plain_textures.h"

/* The options of map_Kd that are not read, and their numbers of arguments. */
typedef struct mtl_option {
    const char *name;
    int arguments;
} mtl_option;

static const mtl_option ignored_options[] = {
    {"-blendu", 1}, {"-blendv", 1},  {"-boost", 1}, {"-cc", 1},         {"-bm", 1}, {"-mm", 2},
    {"-texres", 1}, {"-imfchan", 1}, {"-type", 1},  {"-colorspace", 1}, {"-t", 3}};

static const char *skip_blanks(const char *at)
{
    return at + strspn(at, " \t");
}

/* Reads up to `most` numbers; returns their count. */
static int read_numbers(const char **at, double *out, int most)
{
    int count = 0;
    while (count < most) {
        const char *next = *at;
        double number;
        if (!plain_mesh_number(&next, &number)) break;
        out[count++] = number;
        *at = next;
    }
    return count;
}

static bool is_word(const char *at, const char *word)
{
    const size_t length = strlen(word);
    return strncmp(at, word, length) == 0 && (at[length] == ' ' || at[length] == '\t' || !at[length]);
}

/* Reads -s, -o or -clamp at *at. False: it is another option. */
static bool read_option(const char **at, mesh_material *material, double scale[2], double offset[2])
{
    double number[3] = {0, 0, 0};
    const bool is_scale = is_word(*at, "-s"), is_offset = is_word(*at, "-o");
    if (is_scale || is_offset) {
        *at += 2;
        const int count = read_numbers(at, number, 3);
        for (int k = 0; k < 2; k++) (is_scale ? scale : offset)[k] = k < count ? number[k] : is_scale ? 1 : 0;
        return true;
    }
    if (!is_word(*at, "-clamp")) return false;
    *at = skip_blanks(*at + strlen("-clamp"));
    material->wrap[0] = material->wrap[1] = strncmp(*at, "on", 2) == 0 ? MESH_WRAP_NOTHING : MESH_WRAP_REPEAT;
    *at += strcspn(*at, " \t");
    return true;
}

/* Skips an option that is not read, with its arguments. False: the word is the name of the file. */
static bool skip_option(const char **at, plain_mesh *m)
{
    for (size_t k = 0; k < sizeof ignored_options / sizeof *ignored_options; k++) {
        const mtl_option *o = &ignored_options[k];
        double number;
        if (!is_word(*at, o->name)) continue;
        plain_mesh_warn(m, "the option %s of map_Kd is not applied", o->name);
        *at = skip_blanks(*at + strlen(o->name));
        for (int n = 0; n < o->arguments; n++) {
            const char *next = *at;
            if (n > 0 && !plain_mesh_number(&next, &number)) break;
            *at = skip_blanks(*at + strcspn(*at, " \t"));
        }
        return true;
    }
    return false;
}

static bool read_map(const char *at, mesh_material *material, plain_mesh *m)
{
    double scale[2] = {1, 1}, offset[2] = {0, 0};
    for (at = skip_blanks(at); *at == '-'; at = skip_blanks(at))
        if (!read_option(&at, material, scale, offset) && !skip_option(&at, m)) break;
    if (!*at) {
        plain_mesh_warn(m, "map_Kd of the material \"%.60s\" names no file", material->name);
        return true;
    }
    /* v is upwards in the file, and downwards in images */
    const double transform[2][3] = {{scale[0], 0, offset[0]}, {0, -scale[1], 1 - offset[1]}};
    memcpy(material->transform, transform, sizeof transform);
    return plain_textures_add_image(m, at, NULL, 0, &material->image);
}

static bool begin_material(const char *at, mesh_material **material, plain_mesh *m)
{
    mesh_material new = mesh_textures_white();
    uint32_t index;
    if ((size_t)snprintf(new.name, sizeof new.name, "%s", at) >= sizeof new.name)
        return plain_mesh_refuse(m, ERROR_INPUT_UNSUPPORTED,
                                 "its name \"%.80s...\" of a material is too long. Shorten it.", at);
    if (!plain_textures_add_material(m, &new, &index)) return false;
    *material = &m->textures->all.material[index];
    return true;
}

static bool take_line(const char *at, mesh_material **material, plain_mesh *m)
{
    double number[3];
    if (is_word(at, "newmtl")) return begin_material(skip_blanks(at + strlen("newmtl")), material, m);
    if (!*material) return true;
    if (is_word(at, "Kd")) {
        at += 2;
        const int count = read_numbers(&at, number, 3);
        for (int k = 0; k < 3 && count > 0; k++) (*material)->factor[k] = number[count == 3 ? k : 0];
        if (count == 0)
            plain_mesh_warn(m, "Kd of the material \"%.60s\" is not numbers: it is 1", (*material)->name);
    } else if (is_word(at, "d") || is_word(at, "Tr")) {
        const bool is_opacity = *at == 'd';
        at = skip_blanks(at + (is_opacity ? 1 : 2));
        if (is_word(at, "-halo")) at += strlen("-halo");
        if (read_numbers(&at, number, 1) == 1)
            (*material)->factor[3] = is_opacity ? number[0] : 1 - number[0];
    } else if (is_word(at, "map_Kd")) {
        return read_map(at + strlen("map_Kd"), *material, m);
    } else if (is_word(at, "map_d") || is_word(at, "disp") || is_word(at, "decal")) {
        const int length = (int)strcspn(at, " \t");
        if (length != 4)
            plain_mesh_warn(m, "%.*s of the material \"%.60s\" is not read", length, at, (*material)->name);
    }
    return true;
}

static void warn_of_black(plain_mesh *m)
{
    const mesh_textures *t = &m->textures->all;
    for (size_t k = 0; k < t->materials; k++) {
        const double *kd = t->material[k].factor;
        if (t->material[k].image != MESH_TEXTURES_NONE && kd[0] == 0 && kd[1] == 0 && kd[2] == 0)
            plain_mesh_warn(m, "Kd of the material \"%.60s\" is 0, so that its image is black",
                            t->material[k].name);
    }
}

bool plain_textures_read_mtl(const char *data, size_t size, plain_mesh *m)
{
    mesh_material *material = NULL;
    const char *at = plain_mesh_text(data, size, m);
    if (!at) return false;
    while (*at) {
        const size_t length = strcspn(at, "\r\n");
        char *line = strndup(at, length);
        if (!line) return plain_mesh_refuse_memory(m);
        size_t end = strcspn(line, "#"); /* a name may have one: a comment begins after a blank */
        while (end > 0 && line[end] && line[end - 1] != ' ' && line[end - 1] != '\t')
            end += 1 + strcspn(line + end + 1, "#");
        while (end > 0 && (line[end - 1] == ' ' || line[end - 1] == '\t')) end--;
        line[end] = 0;
        const bool ok = take_line(skip_blanks(line), &material, m);
        free(line);
        if (!ok) return false;
        at += length + (at[length] != 0);
    }
    warn_of_black(m);
    return true;
}

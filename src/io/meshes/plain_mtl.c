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
        plain_textures_warn(m, "the option %s of map_Kd is not applied", o->name);
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
        plain_textures_warn(m, "map_Kd of the material \"%.60s\" names no file", material->name);
        return true;
    }
    /* v is upwards in the file, and downwards in images */
    const double transform[2][3] = {{scale[0], 0, offset[0]}, {0, -scale[1], 1 - offset[1]}};
    memcpy(material->transform, transform, sizeof transform);
    return plain_textures_add_image(m, at, NULL, 0, &material->image);
}

/* The material that is being read. */
typedef struct reading {
    plain_mesh *m;
    mesh_material *material; /* NULL: before the first */
    bool has_color, has_opacity, has_image;
} reading;

static bool begin_material(const char *at, reading *r)
{
    mesh_material new = mesh_textures_white();
    uint32_t index;
    if ((size_t)snprintf(new.name, sizeof new.name, "%s", at) >= sizeof new.name)
        return plain_mesh_refuse(r->m, ERROR_INPUT_UNSUPPORTED,
                                 "its name \"%.80s...\" of a material is too long. Shorten it.", at);
    if (plain_textures_find_material(r->m, new.name) != MESH_TEXTURES_NONE)
        plain_textures_warn(r->m, "the material \"%.60s\" is there twice: the first one is used", new.name);
    if (!plain_textures_add_material(r->m, &new, &index)) return false;
    *r = (reading){.m = r->m, .material = &r->m->textures->all.material[index]};
    return true;
}

/* Warns if a line of a material is its second one. */
static void warn_of_second(const reading *r, const char *name, bool *has)
{
    if (*has)
        plain_textures_warn(r->m, "the material \"%.60s\" has %s twice: the last one is used",
                            r->material->name, name);
    *has = true;
}

/* Reads the numbers of a line to its end: 1, or `most`. False: it is something else, which has a warning. */
static bool read_line(const char *at, const char *name, const reading *r, double *number, int most)
{
    const int count = read_numbers(&at, number, most);
    if ((count == 1 || count == most) && !*skip_blanks(at)) {
        for (int k = count; k < most; k++) number[k] = number[0];
        return true;
    }
    plain_textures_warn(r->m, "%s of the material \"%.60s\" is not %s: it is 1", name, r->material->name,
                        most == 1 ? "a number" : "one or three numbers");
    return false;
}

static void read_opacity(const char *at, const char *name, reading *r)
{
    double number;
    at = skip_blanks(at);
    if (is_word(at, "-halo")) at += strlen("-halo");
    warn_of_second(r, "d or Tr", &r->has_opacity);
    if (read_line(at, name, r, &number, 1))
        r->material->factor[3] = strcmp(name, "d") == 0 ? number : 1 - number;
}

/* Whether the first word of a line is one of MTL that does not change the base colour. */
static bool is_without_effect(const char *at)
{
    static const char *const words[] = {
        "Ka",      "Ks",      "Ke",      "Tf",       "Ns",       "Ni",     "illum",    "map_Ka",
        "map_Ks",  "map_Ke",  "map_Ns",  "map_Bump", "map_bump", "map_Pr", "map_Pm",   "map_Ps",
        "map_RMA", "map_ORM", "map_aat", "bump",     "refl",     "norm",   "map_refl", "sharpness",
        "Pr",      "Pm",      "Ps",      "Pc",       "Pcr",      "aniso",  "anisor"};
    for (size_t k = 0; k < sizeof words / sizeof *words; k++)
        if (is_word(at, words[k])) return true;
    return !*at;
}

static bool take_line(const char *at, reading *r)
{
    double number[3];
    if (is_word(at, "newmtl")) return begin_material(skip_blanks(at + strlen("newmtl")), r);
    if (!r->material || is_without_effect(at)) return true;
    if (is_word(at, "Kd")) {
        warn_of_second(r, "Kd", &r->has_color);
        if (read_line(at + strlen("Kd"), "Kd", r, number, 3))
            memcpy(r->material->factor, number, sizeof number);
    } else if (is_word(at, "d")) {
        read_opacity(at + strlen("d"), "d", r);
    } else if (is_word(at, "Tr")) {
        read_opacity(at + strlen("Tr"), "Tr", r);
    } else if (is_word(at, "map_Kd")) {
        warn_of_second(r, "map_Kd", &r->has_image);
        return read_map(at + strlen("map_Kd"), r->material, r->m);
    } else {
        plain_textures_warn(r->m, "%.*s of the material \"%.60s\" is not read", (int)strcspn(at, " \t"), at,
                            r->material->name);
    }
    return true;
}

/* Warns of factors that leave nothing of an image. Some programs write Tr 1 for an opaque material. */
static void warn_of_zeros(plain_mesh *m)
{
    const mesh_textures *t = &m->textures->all;
    for (size_t k = 0; k < t->materials; k++) {
        const double *factor = t->material[k].factor;
        if (factor[3] == 0)
            plain_textures_warn(m, "the material \"%.60s\" has an opacity of 0 by its d or Tr",
                                t->material[k].name);
        if (t->material[k].image != MESH_TEXTURES_NONE && factor[0] == 0 && factor[1] == 0 && factor[2] == 0)
            plain_textures_warn(m, "Kd of the material \"%.60s\" is 0, so that its image is black",
                                t->material[k].name);
    }
}

bool plain_textures_read_mtl(const char *data, size_t size, plain_mesh *m)
{
    reading r = {.m = m};
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
        const bool ok = take_line(skip_blanks(line), &r);
        free(line);
        if (!ok) return false;
        at += length + (at[length] != 0);
    }
    warn_of_zeros(m);
    return true;
}

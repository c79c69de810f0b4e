// SPDX-License-Identifier: Apache-2.0
/* Wavefront OBJ: the lines v and f; if textures are read, vt, usemtl and mtllib; if values are kept, vt, vn, usemtl,
 * o and g. Free-form curves and surfaces, and lines that begin with an unknown word, are skipped with a warning. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/meshes/plain_textures.h"

typedef struct obj_facts {
    const char *text;  /* the text of the file, before continued lines are joined */
    size_t free_forms; /* curves and surfaces */
    size_t weighted;   /* vertices with a w that is not 1 */
    size_t cut;        /* vertices with a word after x y z that is not a number */
    size_t empty;      /* faces without corners */
    size_t words;      /* number of unknown words */
    char unknown[32];  /* the first unknown word */
    /* if values are kept: what the lines have, as vertices or numbers; each corner of a face becomes a vertex */
    uint32_t *vertex;
    double (*uv)[2], (*normal)[3];
    size_t vertices, uvs, normals, vertex_room, uv_room, normal_room;
    char **used; /* names of materials, in the order of their first use */
    size_t used_count, used_room;
    double material;   /* of the last usemtl: of textures its index, or -1; otherwise from 1, or 0 */
    char *group_name;  /* of the last group or object; NULL: none */
    double group;      /* number of the group of the last face, from 0 */
    bool is_new_group; /* no face has the last group */
    plain_values *values_of[5];
} obj_facts;

enum { OF_COLOR, OF_UV, OF_NORMAL, OF_MATERIAL, OF_GROUP };

/* Whether c ends a line, or its part before a comment. */
static bool is_end(char c)
{
    return c == '\n' || c == '\r' || c == 0 || c == '#';
}

static const char *skip_blanks(const char *at)
{
    while (*at == ' ' || *at == '\t' || *at == '\v' || *at == '\f') at++;
    return at;
}

/* Reads x y z, optionally followed by a weight w or by a colour of three or four numbers. The position is
 * (x, y, z) / w. A word that is not a number, such as "-1.#IND" in a colour, ends the numbers: the rest of
 * the line is skipped, and the colour has no value there. */
static bool read_vertex(const char *data, const char **at, obj_facts *facts, plain_mesh *out)
{
    const char *line = *at;
    double number[7] = {0, 0, 0, 0, 0, 0, 1};
    size_t count = 0;
    for (*at = skip_blanks(*at); !is_end(**at) && count < 7 && plain_mesh_number(at, &number[count]);
         *at = skip_blanks(*at))
        count++;
    const bool has_word = !is_end(**at) && count < 7;
    if (count < 3 && has_word)
        return plain_mesh_refuse_at(
            out, facts->text, facts->text + (line - data),
            "of the OBJ file has \"%.*s\" in place of a number. Write numbers with a decimal point.",
            (int)strcspn(*at, " \t\r\n"), *at);
    if (count < 3 || (count == 5 && !has_word) || (count == 7 && !is_end(**at)))
        return plain_mesh_refuse_at(
            out, facts->text, facts->text + (line - data),
            "of the OBJ file is a vertex of %zu%s numbers. Write three, four with a weight, or six or seven with a colour.",
            count, count == 7 ? " and more" : "");
    if (count == 4 && number[3] != 1 && !has_word) {
        for (int k = 0; k < 3; k++) number[k] /= number[3];
        facts->weighted++;
    }
    facts->cut += has_word;
    out->vertex_at = facts->text + (line - data);
    if (!plain_mesh_add_vertex(out, number)) return false;
    facts->vertices++;
    if (!out->keeps_values) return true;
    if (!plain_mesh_make_room(out, (void **)&facts->vertex, &facts->vertex_room, facts->vertices,
                              sizeof *facts->vertex))
        return false;
    facts->vertex[facts->vertices - 1] = (uint32_t)(out->vertices - 1);
    for (size_t k = count; has_word && k < 6; k++) number[k] = (double)NAN;
    if (count == 6) number[6] = (double)NAN;
    return (count < 6 && !(has_word && count > 3)) ||
           plain_mesh_set_values(out, facts->values_of[OF_COLOR], out->vertices - 1, number + 3);
}

/* Reads the numbers of a line vt or vn to the item that is added to a list. Those that are absent are 0. */
static bool read_numbers(const char *at, int numbers, void **list, size_t *count, size_t *room,
                         plain_mesh *out)
{
    double number[3] = {0, 0, 0};
    const size_t size = (size_t)numbers * sizeof *number;
    if (!plain_mesh_make_room(out, list, room, *count + 1, size)) return false;
    for (int k = 0; k < numbers && plain_mesh_number(&at, &number[k]); k++) {
    }
    memcpy((char *)*list + size * (*count)++, number, size);
    return true;
}

/* Index `which` of a corner such as 7/1/3 in a list of `count` items, from 0; -1: the corner names none of them. */
static long long find_index(const char *word, int which, size_t count)
{
    for (; which > 0; which--) {
        word += strspn(word, "-+0123456789");
        if (*word++ != '/') return -1;
    }
    const long long index = strspn(word, "-+0123456789") > 0 ? strtoll(word, NULL, 10) : 0,
                    all = (long long)count;
    return index > 0 && index <= all ? index - 1 : index < 0 && index >= -all ? all + index : -1;
}

/* Adds a vertex for a corner of a face, with its values. */
static bool add_corner(uint32_t vertex, const char *word, const obj_facts *facts, plain_mesh *out)
{
    const size_t n = out->vertices;
    const long long uv = find_index(word, 1, facts->uvs), normal = find_index(word, 2, facts->normals);
    plain_values *const *of = facts->values_of;
    return plain_mesh_copy_vertex(out, facts->vertex[vertex]) &&
           (uv < 0 || plain_mesh_set_values(out, of[OF_UV], n, facts->uv[uv])) &&
           (normal < 0 || plain_mesh_set_values(out, of[OF_NORMAL], n, facts->normal[normal])) &&
           plain_mesh_set_values(out, of[OF_MATERIAL], n, &facts->material) &&
           plain_mesh_set_values(out, of[OF_GROUP], n, &facts->group);
}

/* The rest of a line as text without blanks at its ends; the caller frees it. */
static char *rest_of_line(const char *at)
{
    at = skip_blanks(at);
    size_t length = strcspn(at, "\r\n");
    while (length > 0 && (at[length - 1] == ' ' || at[length - 1] == '\t')) length--;
    return strndup(at, length);
}

/* Sets the number of a material, by the order in which their names are first used. */
static bool number_material(const char *name, obj_facts *facts, plain_mesh *out)
{
    size_t k = 0;
    while (k < facts->used_count && strcmp(facts->used[k], name) != 0) k++;
    facts->material = (double)k + 1;
    if (k < facts->used_count) return true;
    if (!plain_mesh_make_room(out, (void **)&facts->used, &facts->used_room, k + 1, sizeof *facts->used))
        return false;
    if (!(facts->used[k] = strdup(name))) return plain_mesh_refuse_memory(out);
    facts->used_count++;
    return true;
}

/* Reads usemtl. */
static bool read_material(const char *name, obj_facts *facts, plain_mesh *out)
{
    mesh_material new = mesh_textures_white();
    uint32_t index = 0;
    if (!out->textures) return number_material(name, facts, out);
    new.needs_library = true;
    if ((size_t)snprintf(new.name, sizeof new.name, "%s", name) >= sizeof new.name)
        return plain_mesh_refuse(out, ERROR_INPUT_UNSUPPORTED,
                                 "its name \"%.80s...\" of a material is too long. Shorten it.", name);
    index = plain_textures_find_material(out, name);
    if (index == MESH_TEXTURES_NONE && !plain_textures_add_material(out, &new, &index)) return false;
    facts->material = index;
    return true;
}

static bool is_word(const char *at, const char *word)
{
    const size_t length = strlen(word);
    return strncmp(at, word, length) == 0 && (at[length] == ' ' || at[length] == '\t');
}

/* Reads a line that matters for values or textures only. */
static bool read_value_line(const char *at, obj_facts *facts, plain_mesh *out)
{
    if (is_word(at, "vt"))
        return read_numbers(at + 2, 2, (void **)&facts->uv, &facts->uvs, &facts->uv_room, out);
    if (is_word(at, "vn"))
        return read_numbers(at + 2, 3, (void **)&facts->normal, &facts->normals, &facts->normal_room, out);
    const bool is_group = is_word(at, "o") || is_word(at, "g"), is_library = is_word(at, "mtllib");
    if (!is_group && !is_library && !is_word(at, "usemtl")) return true;
    char *name = rest_of_line(at + (is_group ? 1 : strlen("usemtl")));
    if (!name) return plain_mesh_refuse_memory(out);
    const bool ok = is_group     ? true
                    : is_library ? !out->textures || !*name || plain_textures_add_library(out, name)
                                 : read_material(name, facts, out);
    if (is_group && (!facts->group_name || strcmp(facts->group_name, name) != 0)) facts->is_new_group = true;
    free(is_group ? facts->group_name : name);
    if (is_group) facts->group_name = name;
    return ok;
}

/* Reads the vertex of a corner: `7`, `7/1`, `7//3` or `7/1/3`. Negative numbers count back from the last one
 * of `vertices`. */
static bool read_corner(const char **at, size_t vertices, uint32_t *out)
{
    char *end;
    const long long index = strtoll(*at, &end, 10), count = (long long)vertices;
    const size_t more = strspn(end, "/-0123456789");
    if (end == *at || (more > 0 && *end != '/')) return false;
    *at = end + more;
    *out = (uint32_t)(index < 0 ? count + index : index - 1);
    return strchr(" \t\r\n#", **at) && index <= count && index != 0 && index >= -count;
}

static bool read_face(const char *data, const char **at, obj_facts *facts, plain_mesh *out)
{
    size_t count = 0;
    if (facts->is_new_group) facts->group++;
    facts->is_new_group = false;
    for (*at = skip_blanks(*at); !is_end(**at); *at = skip_blanks(*at)) {
        const char *word = *at;
        if (!plain_mesh_expect_corners(out, count + 1)) return false;
        if (!read_corner(at, facts->vertices, &out->corner[count]))
            return plain_mesh_refuse_at(
                out, facts->text, facts->text + (word - data),
                "of the OBJ file has a face whose corner \"%.*s\" is none of the %zu vertices before it. %s",
                (int)strcspn(word, " \t\r\n"), word, facts->vertices,
                strtoll(word, NULL, 10) == 0 ? "Count vertices from 1." : "Write vertices before faces.");
        if (out->keeps_values) {
            if (!add_corner(out->corner[count], word, facts, out)) return false;
            out->corner[count] = (uint32_t)(out->vertices - 1);
        }
        count++;
    }
    facts->empty += count == 0;
    return count == 0 || plain_mesh_add_polygon(out, out->corner, count);
}

static bool is_one_of(const char *word, size_t length, const char *const *words, size_t count)
{
    for (size_t k = 0; k < count; k++)
        if (strlen(words[k]) == length && memcmp(words[k], word, length) == 0) return true;
    return false;
}

/* Counts a line that is neither a vertex nor a face, for warnings. */
static void take_line(const char *line, obj_facts *facts, plain_mesh *out)
{
    static const char *const elements[] = {"p", "l"}, *const forms[] = {"curv", "surf"};
    static const char *const passed[] = {
        "vn",        "vt",     "vp",     "g",     "o",        "s",        "mg",   "usemtl",
        "mtllib",    "maplib", "usemap", "bevel", "c_interp", "d_interp", "lod",  "shadow_obj",
        "trace_obj", "cstype", "deg",    "bmat",  "step",     "curv2",    "parm", "trim",
        "hole",      "scrv",   "sp",     "end",   "con",      "ctech",    "stech"};
    const size_t word = strcspn(line, " \t\r\n#");
    if (word == 0 || is_one_of(line, word, passed, sizeof passed / sizeof *passed)) return;
    if (word == 1 && *line == 'f') {
        facts->empty++;
    } else if (is_one_of(line, word, elements, sizeof elements / sizeof *elements)) {
        out->others++;
    } else if (is_one_of(line, word, forms, sizeof forms / sizeof *forms)) {
        facts->free_forms++;
    } else if (!*facts->unknown) {
        snprintf(facts->unknown, sizeof facts->unknown, "%.*s", (int)word, line);
    }
}

/* Whether the line of `at` is a comment at this place, or has a name of a file or of a group, which may end in `\`. */
static bool is_text(const char *data, const char *at)
{
    static const char *const names[] = {"mtllib", "usemtl", "maplib", "usemap", "o", "g"};
    const char *line = at;
    while (line > data && line[-1] != '\n' && line[-1] != '\r') line--;
    for (const char *c = line; c < at; c++)
        if (*c == '#') return true;
    line = skip_blanks(line);
    return is_one_of(line, strcspn(line, " \t"), names, sizeof names / sizeof *names);
}

/* The bytes of a mark that continues a line: `\`, blanks and the end of the line. 0: it is none. */
static size_t continuation(const char *at)
{
    const size_t blanks = 1 + strspn(at + 1, " \t");
    return at[blanks] == '\n' ? blanks + 1 : at[blanks] == '\r' && at[blanks + 1] == '\n' ? blanks + 2 : 0;
}

/* A copy of the text in which continued lines (`\` at the end) are joined. NULL: there are none, or memory
 * is exhausted. */
static char *join_lines(const char *data)
{
    const char *first = data;
    while ((first = strchr(first, '\\')) && !continuation(first)) first++;
    char *copy = first ? strdup(data) : NULL;
    for (char *at = copy; at && (at = strchr(at, '\\')); at++) {
        const size_t length = continuation(at);
        if (length && !is_text(copy, at)) memset(at, ' ', length);
    }
    return copy;
}

static bool read_lines(const char *data, obj_facts *facts, plain_mesh *out)
{
    for (const char *at = data; *at;) {
        at = skip_blanks(at);
        const char kind = *at;
        const bool blank = kind && (at[1] == ' ' || at[1] == '\t');
        if (blank && kind == 'v') {
            at++;
            facts->words++;
            if (!read_vertex(data, &at, facts, out)) return false;
        } else if (kind == 'f' && (blank || (at[1] == 'o' && (at[2] == ' ' || at[2] == '\t')))) {
            at += 1 + !blank; /* "fo" is a face of old files */
            facts->words++;
            if (!read_face(data, &at, facts, out)) return false;
        } else {
            if (out->keeps_values && !read_value_line(at, facts, out)) return false;
            take_line(at, facts, out);
        }
        at += strcspn(at, "\r\n");
        at += *at != 0;
    }
    return facts->words > 0 || !*facts->unknown ||
           plain_mesh_refuse(
               out, ERROR_INPUT_DAMAGED,
               "the file has no line of OBJ, and begins with %s. Check that its ending names its format.",
               facts->unknown);
}

bool plain_mesh_read_obj(const char *data, size_t size, plain_mesh *out)
{
    const char *text = plain_mesh_text(data, size, out);
    obj_facts facts = {.text = text,
                       .material = out->textures ? -1 : 0,
                       .group = -1,
                       .is_new_group = true,
                       .values_of = {plain_mesh_add_values(out, "color", MESH_VALUES_COLOR, 4),
                                     plain_mesh_add_values(out, "uv", MESH_VALUES_UV, 2),
                                     plain_mesh_add_values(out, "normal", MESH_VALUES_NORMAL, 3),
                                     plain_mesh_add_values(out, "material", MESH_VALUES_WHOLE, 1),
                                     plain_mesh_add_values(out, "group", MESH_VALUES_WHOLE, 1)}};
    char *joined = text ? join_lines(text) : NULL;
    const bool read = text && read_lines(joined ? joined : text, &facts, out);
    free(joined);
    free(facts.uv);
    free(facts.vertex);
    free(facts.normal);
    free(facts.group_name);
    for (size_t k = 0; k < facts.used_count; k++) free(facts.used[k]);
    free(facts.used);
    if (!read) return false;
    if (facts.free_forms > 0)
        plain_mesh_warn(
            out, "the file has %zu free-form curves or surfaces, which are skipped: save them as polygons",
            facts.free_forms);
    if (facts.weighted > 0)
        plain_mesh_warn(out, "%zu vertices have a weight w: their coordinates are divided by it",
                        facts.weighted);
    if (facts.cut > 0)
        plain_mesh_warn(out,
                        "%zu vertices: a word after x y z is not a number; the rest of the line is skipped",
                        facts.cut);
    if (facts.empty > 0) plain_mesh_warn(out, "%zu faces have no corners: they are skipped", facts.empty);
    if (*facts.unknown)
        plain_mesh_warn(out, "lines that begin with %s are not known: they are left out", facts.unknown);
    return plain_mesh_scale_colors(out, facts.values_of[OF_COLOR], 0, "text");
}

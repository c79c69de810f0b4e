// SPDX-License-Identifier: Apache-2.0
/* Wavefront OBJ: the lines v and f, and if textures are read vt, usemtl and mtllib. Normals and groups do not
 * change the shape. Free-form curves and surfaces, and lines that begin with an unknown word, are skipped with a
 * warning. */
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
    /* if textures are read */
    double (*uv)[2]; /* of the lines vt */
    size_t uvs, uv_room;
    double (*corner)[2]; /* of the corners of a face */
    size_t corner_room;
    uint32_t material; /* of the last usemtl */
} obj_facts;

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
 * the line is skipped. */
static bool read_vertex(const char *data, const char **at, obj_facts *facts, plain_mesh *out)
{
    const char *line = *at;
    double number[7];
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
    return plain_mesh_add_vertex(out, number);
}

/* Reads the line vt: u and v; without v it is 0. */
static bool read_coordinates(const char **at, obj_facts *facts, plain_mesh *out)
{
    double number[2] = {0, 0};
    if (!plain_mesh_make_room(out, (void **)&facts->uv, &facts->uv_room, facts->uvs + 1, sizeof *facts->uv))
        return false;
    for (int k = 0; k < 2 && plain_mesh_number(at, &number[k]); k++) {
    }
    memcpy(facts->uv[facts->uvs++], number, sizeof number);
    return true;
}

/* Keeps the texture coordinates of corner k of a face, whose word begins at `word`. */
static bool keep_coordinates(const char *word, size_t k, obj_facts *facts, plain_mesh *out)
{
    const char *slash = word + strspn(word, "-+0123456789");
    const long long count = (long long)facts->uvs, index = *slash == '/' ? strtoll(slash + 1, NULL, 10) : 0;
    const bool exists = *slash == '/' && slash[1] != '/' && index != 0 && index <= count && index >= -count;
    if (!plain_mesh_make_room(out, (void **)&facts->corner, &facts->corner_room, k + 1,
                              sizeof *facts->corner))
        return false;
    for (int c = 0; c < 2; c++)
        facts->corner[k][c] = exists ? facts->uv[index < 0 ? count + index : index - 1][c] : (double)NAN;
    return true;
}

/* The rest of a line as text without blanks at its ends; the caller frees it. */
static char *rest_of_line(const char *at)
{
    at = skip_blanks(at);
    size_t length = strcspn(at, "\r\n");
    while (length > 0 && (at[length - 1] == ' ' || at[length - 1] == '\t')) length--;
    return strndup(at, length);
}

/* Reads usemtl or mtllib. */
static bool read_name(const char *at, bool is_library, obj_facts *facts, plain_mesh *out)
{
    char *name = rest_of_line(at);
    mesh_material new = mesh_textures_white();
    bool ok = true;
    new.needs_library = true;
    if (!name) return plain_mesh_refuse_memory(out);
    if (is_library) {
        ok = !*name || plain_textures_add_library(out, name);
    } else if ((size_t)snprintf(new.name, sizeof new.name, "%s", name) >= sizeof new.name) {
        ok = plain_mesh_refuse(out, ERROR_INPUT_UNSUPPORTED,
                               "its name \"%.80s...\" of a material is too long. Shorten it.", name);
    } else {
        facts->material = plain_textures_find_material(out, name);
        if (facts->material == MESH_TEXTURES_NONE)
            ok = plain_textures_add_material(out, &new, &facts->material);
    }
    free(name);
    return ok;
}

/* Reads a line that matters for textures only. */
static bool read_texture_line(const char *at, obj_facts *facts, plain_mesh *out)
{
    if (!out->textures) return true;
    if (at[0] == 'v' && at[1] == 't' && (at[2] == ' ' || at[2] == '\t')) {
        at += 2;
        return read_coordinates(&at, facts, out);
    }
    const bool uses = strncmp(at, "usemtl", 6) == 0, is_library = strncmp(at, "mtllib", 6) == 0;
    if ((uses || is_library) && (at[6] == ' ' || at[6] == '\t'))
        return read_name(at + 6, is_library, facts, out);
    return true;
}

/* Reads the vertex of a corner: `7`, `7/1`, `7//3` or `7/1/3`. Negative numbers count back from the last
 * vertex. */
static bool read_corner(const char **at, const plain_mesh *m, uint32_t *out)
{
    char *end;
    const long long index = strtoll(*at, &end, 10), count = (long long)m->vertices;
    const size_t more = strspn(end, "/-0123456789");
    if (end == *at || (more > 0 && *end != '/')) return false;
    *at = end + more;
    *out = (uint32_t)(index < 0 ? count + index : index - 1);
    return strchr(" \t\r\n#", **at) && index <= count && index != 0 && index >= -count;
}

static bool read_face(const char *data, const char **at, obj_facts *facts, plain_mesh *out)
{
    size_t count = 0;
    for (*at = skip_blanks(*at); !is_end(**at); *at = skip_blanks(*at)) {
        const char *word = *at;
        if (!plain_mesh_expect_corners(out, count + 1)) return false;
        if (!read_corner(at, out, &out->corner[count]))
            return plain_mesh_refuse_at(
                out, facts->text, facts->text + (word - data),
                "of the OBJ file has a face whose corner \"%.*s\" is none of the %zu vertices before it. %s",
                (int)strcspn(word, " \t\r\n"), word, out->vertices,
                strtoll(word, NULL, 10) == 0 ? "Count vertices from 1." : "Write vertices before faces.");
        if (out->textures && !keep_coordinates(word, count, facts, out)) return false;
        count++;
    }
    facts->empty += count == 0;
    return count == 0 ||
           (plain_mesh_add_polygon(out, out->corner, count) &&
            (!out->textures || plain_textures_add_polygon(out, facts->material,
                                                          (const double(*)[2])facts->corner, NULL, count)));
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
            if (!read_texture_line(at, facts, out)) return false;
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
    obj_facts facts = {.text = text, .material = MESH_TEXTURES_NONE};
    char *joined = text ? join_lines(text) : NULL;
    const bool read = text && read_lines(joined ? joined : text, &facts, out);
    free(joined);
    free(facts.uv);
    free(facts.corner);
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
    return true;
}

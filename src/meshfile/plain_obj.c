/* Wavefront OBJ: the lines v and f. Normals, texture coordinates, groups and materials do not change the shape. Free-form curves and
 * surfaces, and lines of words that are not known, are left out with a warning. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "meshfile/plain_mesh.h"

typedef struct obj_facts {
    size_t free_forms; /* curves and surfaces */
    size_t weighted;   /* vertices with a w that is not 1 */
    char unknown[32];  /* the first word that is not known */
} obj_facts;

/* Of a line, or of what it holds before a comment. */
static bool is_end(char c)
{
    return c == '\n' || c == 0 || c == '#';
}

static const char *skip_blanks(const char *at)
{
    while (*at == ' ' || *at == '\t' || *at == '\r') at++;
    return at;
}

/* x y z, and perhaps a weight w or a colour of three or four. The place is x/w y/w z/w. */
static bool read_vertex(const char **at, obj_facts *facts, plain_mesh *out)
{
    double number[7];
    size_t count = 0;
    for (*at = skip_blanks(*at); !is_end(**at) && count < 7; *at = skip_blanks(*at))
        if (!plain_mesh_number(at, &number[count++])) return false;
    if (count == 4 && number[3] != 1) {
        for (int k = 0; k < 3; k++) number[k] /= number[3];
        facts->weighted++;
    }
    return is_end(**at) && count != 5 && count >= 3 && plain_mesh_add_vertex(out, number);
}

/* The vertex of `7`, `7/1`, `7//3` or `7/1/3`; negative ones count from the last. */
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

static bool read_face(const char **at, plain_mesh *out)
{
    size_t count = 0;
    for (*at = skip_blanks(*at); !is_end(**at); *at = skip_blanks(*at)) {
        if (!plain_mesh_expect_corners(out, count + 1) || !read_corner(at, out, &out->corner[count]))
            return false;
        count++;
    }
    return count > 0 && plain_mesh_add_polygon(out, out->corner, count);
}

static bool is_one_of(const char *word, size_t length, const char *const *words, size_t count)
{
    for (size_t k = 0; k < count; k++)
        if (strlen(words[k]) == length && memcmp(words[k], word, length) == 0) return true;
    return false;
}

/* Takes a line that is neither a vertex nor a face. False: it begins with no word. */
static bool take_line(const char *line, obj_facts *facts, plain_mesh *out)
{
    static const char *const elements[] = {"p", "l"}, *const forms[] = {"curv", "surf"};
    static const char *const passed[] = {
        "f",          "vn",        "vt",     "vp",     "g",     "o",        "s",        "mg",
        "usemtl",     "mtllib",    "maplib", "usemap", "bevel", "c_interp", "d_interp", "lod",
        "shadow_obj", "trace_obj", "cstype", "deg",    "bmat",  "step",     "curv2",    "parm",
        "trim",       "hole",      "scrv",   "sp",     "end",   "con",      "ctech",    "stech"};
    const size_t word = strcspn(line, " \t\r\n#");
    if (word == 0 || is_one_of(line, word, passed, sizeof passed / sizeof *passed)) return true;
    if (is_one_of(line, word, elements, sizeof elements / sizeof *elements)) {
        out->others++;
    } else if (is_one_of(line, word, forms, sizeof forms / sizeof *forms)) {
        facts->free_forms++;
    } else {
        if (strspn(line, "abcdefghijklmnopqrstuvwxyz_ABCDEFGHIJKLMNOPQRSTUVWXYZ") < word) return false;
        if (!*facts->unknown) snprintf(facts->unknown, sizeof facts->unknown, "%.*s", (int)word, line);
    }
    return true;
}

static bool is_in_comment(const char *data, const char *at)
{
    while (at > data && at[-1] != '\n' && *at != '#') at--;
    return *at == '#';
}

/* The whole with lines that go on behind a `\` as one line each; NULL: there is none, or no memory. */
static char *join_lines(const char *data, size_t size)
{
    char *copy = strstr(data, "\\\n") || strstr(data, "\\\r\n") ? malloc(size + 1) : NULL;
    if (copy) memcpy(copy, data, size + 1);
    for (char *at = copy; at && (at = strchr(at, '\\')); at++) {
        const size_t length = at[1] == '\r' ? 3 : 2;
        if (at[length - 1] == '\n' && !is_in_comment(copy, at)) memset(at, ' ', length);
    }
    return copy;
}

static bool read_lines(const char *at, obj_facts *facts, plain_mesh *out)
{
    while (*at) {
        at = skip_blanks(at);
        const char kind = *at;
        const bool blank = kind && (at[1] == ' ' || at[1] == '\t');
        if (blank && kind == 'v') {
            at++;
            if (!read_vertex(&at, facts, out)) return false;
        } else if (blank && kind == 'f') {
            at++;
            if (!read_face(&at, out)) return false;
        } else if (!take_line(at, facts, out)) {
            return false;
        }
        at += strcspn(at, "\n");
        at += *at == '\n';
    }
    return true;
}

bool plain_mesh_read_obj(const char *data, size_t size, plain_mesh *out)
{
    obj_facts facts = {0};
    if (memchr(data, 0, size)) return false;
    char *joined = join_lines(data, size);
    const bool read = read_lines(joined ? joined : data, &facts, out);
    free(joined);
    if (facts.free_forms > 0)
        plain_mesh_warn(
            out, "the file has %zu free-form curves or surfaces, which are left out: save it as polygons",
            facts.free_forms);
    if (facts.weighted > 0)
        plain_mesh_warn(out, "%zu vertices have a weight w: their coordinates are divided by it",
                        facts.weighted);
    if (*facts.unknown)
        plain_mesh_warn(out, "lines that begin with %s are not known: they are left out", facts.unknown);
    return read;
}

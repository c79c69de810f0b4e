/* Wavefront OBJ: the lines v and f. Normals, texture coordinates, groups and materials say nothing of the shape; any other
 * line (curves, lines that go on in the next one) is not known here. */
#include <stdlib.h>
#include <string.h>

#include "meshfile/plain_mesh.h"

/* Of one face; larger ones are the library's. */
enum { CORNERS_MOST = 64 };

static bool is_end(char c)
{
    return c == '\n' || c == 0;
}

static const char *skip_blanks(const char *at)
{
    while (*at == ' ' || *at == '\t' || *at == '\r') at++;
    return at;
}

/* x y z, and perhaps a colour. Four numbers are a rational point. */
static bool read_vertex(const char **at, plain_mesh *out)
{
    double number[7];
    size_t count = 0;
    for (*at = skip_blanks(*at); !is_end(**at) && count < 7; *at = skip_blanks(*at))
        if (!plain_mesh_number(at, &number[count++])) return false;
    return is_end(**at) && (count == 3 || count >= 6) && plain_mesh_add_vertex(out, number);
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
    return strchr(" \t\r\n", **at) && index <= count && index != 0 && index >= -count;
}

static bool read_face(const char **at, plain_mesh *out)
{
    uint32_t corner[CORNERS_MOST];
    size_t count = 0;
    for (*at = skip_blanks(*at); !is_end(**at) && count < CORNERS_MOST; *at = skip_blanks(*at))
        if (!read_corner(at, out, &corner[count++])) return false;
    return is_end(**at) && count > 0 && plain_mesh_add_polygon(out, corner, count);
}

/* Whether the line's first word says nothing of the shape. */
static bool is_ignored(const char *line, size_t length)
{
    static const char *const words[] = {"vn", "vt", "g", "o", "s", "usemtl", "mtllib"};
    const size_t word = strcspn(line, " \t\r\n");
    if (length > 0 && (line[length - 1] == '\\' || (length > 1 && line[length - 2] == '\\'))) return false;
    if (word == 0 || *line == '#') return true;
    for (size_t k = 0; k < sizeof words / sizeof *words; k++)
        if (strlen(words[k]) == word && memcmp(words[k], line, word) == 0) return true;
    return false;
}

bool plain_mesh_read_obj(const char *data, size_t size, plain_mesh *out)
{
    const char *at = data, *end = data + size;
    if (memchr(data, 0, size)) return false;
    while (at < end) {
        at = skip_blanks(at);
        const char kind = *at;
        bool blank = kind && (at[1] == ' ' || at[1] == '\t');
        if (blank && (kind == 'v' || kind == 'f')) {
            at++;
            if (!(kind == 'v' ? read_vertex : read_face)(&at, out)) return false;
        } else {
            const size_t length = strcspn(at, "\n");
            if (!is_ignored(at, length)) return false;
            at += length;
        }
        at += *at == '\n';
    }
    return true;
}

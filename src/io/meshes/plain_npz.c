// SPDX-License-Identifier: Apache-2.0
/* NPZ: the array `position` or `points` of a NumPy archive, (N, 3) of float32 or float64, lower byte and last
 * index first. The mesh has no triangles: such files hold points only. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/number.h"
#include "io/meshes/plain_mesh.h"
#include "io/meshes/zip_entry.h"

/* Bytes of an array before its header: signature, version and, in version 1, the length of the header. */
enum { PREAMBLE = 10 };
/* Maximum number of points, so that products do not overflow. The length of the data is a tighter bound. */
static const uint64_t POINTS_MOST = UINT32_MAX;

typedef struct npy {
    const char *name; /* name of the array */
    const char *data; /* the numbers */
    size_t bytes;     /* length of `data` in bytes */
    size_t size;      /* bytes of a number, 4 or 8 */
    uint64_t count;   /* number of points */
} npy;

static bool damaged(plain_mesh *out, const char *name, const char *why)
{
    return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED, "the array \"%s\" of the NPZ file %s. Save it again.",
                             name, why);
}

/* Skips `text` if it is at *at. Returns whether it was. */
static bool skip(const char **at, const char *text)
{
    const size_t length = strlen(text);
    if (strncmp(*at, text, length) != 0) return false;
    *at += length;
    return true;
}

static bool read_type(const char **at, npy *a, plain_mesh *out)
{
    if (skip(at, "{'descr': '<f8', "))
        a->size = 8;
    else if (skip(at, "{'descr': '<f4', "))
        a->size = 4;
    else
        return plain_mesh_refuse(
            out, ERROR_INPUT_UNSUPPORTED,
            "the array \"%s\" of the NPZ file is not of little-endian float32 or float64. "
            "Convert it with astype(\"<f8\").",
            a->name);
    if (skip(at, "'fortran_order': False, ")) return true;
    return plain_mesh_refuse(out, ERROR_INPUT_UNSUPPORTED,
                             "the array \"%s\" of the NPZ file is in the order of Fortran. Convert it with "
                             "numpy.ascontiguousarray.",
                             a->name);
}

/* Reads the shape, the last member, and the blanks up to the end of the header. */
static bool read_shape(const char **at, npy *a, plain_mesh *out)
{
    const bool begins = skip(at, "'shape': (") && **at >= '1' && **at <= '9';
    for (; begins && **at >= '0' && **at <= '9' && a->count <= POINTS_MOST; ++*at)
        a->count = 10 * a->count + (uint64_t)(**at - '0');
    if (!begins || a->count > POINTS_MOST || !skip(at, ", 3), }"))
        return plain_mesh_refuse(
            out, ERROR_INPUT_UNSUPPORTED,
            "the array \"%s\" of the NPZ file has no shape (N, 3) with N from 1 to %llu. "
            "Give it one row for each point.",
            a->name, (unsigned long long)POINTS_MOST);
    while (**at == ' ') ++*at;
    return strcmp(*at, "\n") == 0 || damaged(out, a->name, "has an unknown header");
}

static bool read_header(const char *file, size_t length, npy *a, plain_mesh *out)
{
    const unsigned char *b = (const unsigned char *)file;
    if (length < PREAMBLE || memcmp(file, "\x93NUMPY\x01\x00", 8) != 0)
        return damaged(out, a->name, "is not an array of NumPy's format 1.0");
    const size_t header = (size_t)(b[8] | b[9] << 8);
    if (header > length - PREAMBLE) return damaged(out, a->name, "ends within its header");
    char *text = malloc(header + 1);
    if (!text) return plain_mesh_refuse_memory(out);
    memcpy(text, file + PREAMBLE, header);
    text[header] = 0;
    const char *at = text;
    const bool ok = strlen(text) == header ? read_type(&at, a, out) && read_shape(&at, a, out)
                                           : damaged(out, a->name, "has an unknown header");
    free(text);
    a->data = file + PREAMBLE + header;
    a->bytes = length - PREAMBLE - header;
    return ok;
}

static double number_at(const npy *a, size_t k)
{
    return number_value(a->data + k * a->size, a->size == 8 ? NUMBER_DOUBLE : NUMBER_FLOAT,
                        NUMBER_LITTLE_SWAPPED);
}

static bool read_array(const char *file, size_t length, const char *name, plain_mesh *out)
{
    npy a = {.name = name};
    if (!read_header(file, length, &a, out)) return false;
    if (a.bytes / (3 * a.size) != a.count || a.bytes % (3 * a.size) != 0)
        return damaged(out, name, "has not as many bytes as its shape requires");
    if (!plain_mesh_expect(out, (size_t)a.count, 0)) return false;
    for (size_t i = 0; i < a.count; i++) {
        const double at[3] = {number_at(&a, 3 * i), number_at(&a, 3 * i + 1), number_at(&a, 3 * i + 2)};
        if (!plain_mesh_add_vertex(out, at)) return false;
    }
    return true;
}

bool plain_mesh_read_npz(const char *data, size_t size, plain_mesh *out)
{
    static const char *const names[] = {"position", "points"};
    bool is_read = false;
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        char entry[16], *file;
        size_t length;
        snprintf(entry, sizeof entry, "%s.npy", names[k]);
        const zip_result found = zip_entry_read(data, size, entry, ZIP_NAMES_EXACT, &file, &length);
        if (found == ZIP_ENTRY_MISSING) continue;
        if (found == ZIP_ENTRY_NO_MEMORY) return plain_mesh_refuse_memory(out);
        if (found == ZIP_ENTRY_TWICE) return damaged(out, names[k], "is there twice");
        if (found == ZIP_ENTRY_DAMAGED) return damaged(out, names[k], "is damaged or no ZIP archive");
        if (is_read)
            plain_mesh_refuse(
                out, ERROR_INPUT_UNSUPPORTED,
                "the NPZ file has an array \"position\" and an array \"points\". Save it with one.");
        is_read = out->refused == ERROR_NONE && read_array(file, length, names[k], out);
        free(file);
        if (!is_read) return false;
    }
    if (is_read) return true;
    return plain_mesh_refuse(
        out, ERROR_INPUT_UNSUPPORTED,
        "the NPZ file has no array \"position\" or \"points\". Save it with numpy.savez(path, position=...).");
}

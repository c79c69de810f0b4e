// SPDX-License-Identifier: Apache-2.0
#include "io/points/vtp.h"

#include <endian.h>
#include <errno.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "io/points/property.h"

typedef struct vtp {
    FILE *file;
    size_t rows;
    uint64_t offset; /* offset of the next array in the appended data */
} vtp;

static uint64_t bytes_of(const vtp *v, int components)
{
    return (uint64_t)v->rows * (uint64_t)components * sizeof(uint64_t);
}

static void describe(vtp *v, const char *name, bool whole, int components)
{
    fprintf(
        v->file,
        "<DataArray type=\"%s\" Name=\"%s\" NumberOfComponents=\"%d\" format=\"appended\" offset=\"%llu\"/>\n",
        whole ? "Int64" : "Float64", name, components, (unsigned long long)v->offset);
    v->offset += sizeof(uint64_t) + bytes_of(v, components);
}

/* Writes the head. The first property is the position. PointData names the arrays that VTK uses for shading
 * and textures. */
static void write_head(vtp *v, const property *list, size_t count)
{
    bool has_texture = false;
    for (size_t k = 0; k < count; k++) has_texture |= list[k].role == PROPERTY_UV;
    fprintf(v->file,
            "<?xml version=\"1.0\"?>\n"
            "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
            "<PolyData>\n<Piece NumberOfPoints=\"%zu\" NumberOfVerts=\"%zu\" NumberOfLines=\"0\" "
            "NumberOfStrips=\"0\" NumberOfPolys=\"0\">\n<Points>\n",
            v->rows, v->rows);
    describe(v, list[0].name, list[0].whole, list[0].components);
    fprintf(v->file, "</Points>\n<PointData Normals=\"normal\"%s>\n",
            has_texture ? " TCoords=\"texture\"" : "");
    for (size_t k = 1; k < count; k++) describe(v, list[k].name, list[k].whole, list[k].components);
    fputs("</PointData>\n<Verts>\n", v->file);
    describe(v, "connectivity", true, 1);
    describe(v, "offsets", true, 1);
    fputs("</Verts>\n</Piece>\n</PolyData>\n<AppendedData encoding=\"raw\">\n_", v->file);
}

static void write_number(FILE *file, uint64_t bits)
{
    bits = htole64(bits);
    fwrite_unlocked(&bits, sizeof bits, 1, file);
}

static void write_property(const vtp *v, const property *p)
{
    write_number(v->file, bytes_of(v, p->components));
    for (size_t row = 0; row < v->rows; row++)
        for (int c = 0; c < p->components; c++) {
            const double value = property_value(p, row, c);
            uint64_t bits;
            memcpy(&bits, &value, sizeof bits);
            write_number(v->file, p->whole ? (uint64_t)(int64_t)value : bits);
        }
}

/* Writes the whole numbers from `first`, one per point. */
static void write_sequence(const vtp *v, uint64_t first)
{
    write_number(v->file, bytes_of(v, 1));
    for (size_t row = 0; row < v->rows; row++) write_number(v->file, first + row);
}

bool vtp_write(FILE *file, const points *set, const scene *place, error *e)
{
    vtp v = {.file = file, .rows = set->count};
    property *list = mem_alloc((PROPERTIES_OWN + set->attribute_count) * sizeof *list);
    const size_t count = property_list(set, list);
    (void)place;
    write_head(&v, list, count);
    for (size_t k = 0; k < count; k++) write_property(&v, &list[k]);
    write_sequence(&v, 0);
    write_sequence(&v, 1);
    fputs("\n</AppendedData>\n</VTKFile>\n", file);
    free(list);
    return (fflush(file) == 0 && !ferror(file)) ||
           error_set(e, error_code_of_errno(errno), "cannot write the VTK file: %s", strerror(errno));
}

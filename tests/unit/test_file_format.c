// SPDX-License-Identifier: Apache-2.0
/* The registry of file formats: each format is recognised, and tables of functions and pages agree with
 * it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/file_format.h"
#include "base/core/memory.h"
#include "files/file.h"
#include "io/meshes/plain_mesh.h"
#include "io/points/writers.h"
#include "io/volumes/volume_file.h"
#include "spec/spec_table.h"

#define FOR_EACH(k, row)                                         \
    for (int k = FILE_FORMAT_UNKNOWN + 1; k < FILE_FORMATS; k++) \
        for (const file_format_row *row = &file_formats[k]; row; row = 0)

static void each_format_has_a_name_of_its_own(void **state)
{
    (void)state;
    FOR_EACH(k, row)
    {
        assert_non_null(row->name);
        for (int other = 0; other < k; other++) assert_string_not_equal(row->name, file_formats[other].name);
    }
}

static void names_of_files_have_the_format_of_their_ending(void **state)
{
    (void)state;
    FOR_EACH(k, row)
    {
        for (int n = 0; n < FILE_FORMAT_ENDINGS && row->ending[n]; n++) {
            char *name = mem_printf("some.where/a%s", row->ending[n]), *bare = name + strlen("some.where/a.");
            assert_int_equal(row->ending[n][0], '.');
            assert_true(file_format_has_ending((file_format)k, name));
            if (n == 0) {
                assert_int_equal(file_format_of_name(name), k);
                assert_int_equal(file_format_of_name(bare), k);
                for (char *c = name; *c; c++) *c = (char)toupper(*c);
                assert_int_equal(file_format_of_name(name), k);
            }
            free(name);
        }
    }
    assert_int_equal(file_format_of_name("a.xyz"), FILE_FORMAT_UNKNOWN);
    assert_int_equal(file_format_of_name("aply"), FILE_FORMAT_UNKNOWN);
    assert_int_equal(file_format_of_name(""), FILE_FORMAT_UNKNOWN);
}

/* No format hides another one that begins with the same bytes. */
static void bytes_identify_a_format(void **state)
{
    (void)state;
    FOR_EACH(k, row)
    {
        char data[FILE_FORMAT_HEAD + 1] = "";
        for (int n = 0; n < FILE_FORMAT_BEGINNINGS && row->beginning[n].length > 0; n++) {
            const file_format_bytes *b = &row->beginning[n];
            memset(data, 0, sizeof data);
            memcpy(data + b->at, b->bytes, b->length);
            if (file_format_of_bytes(data, FILE_FORMAT_HEAD) != (file_format)k)
                fail_msg("%s, beginning %d", row->name, n);
            assert_int_not_equal(file_format_of_bytes(data, b->at + b->length - 1), k);
        }
        if (!row->within) continue;
        snprintf(data, sizeof data, "  %s", row->within);
        assert_int_equal(file_format_of_bytes(data, strlen(data)), k);
    }
    assert_int_equal(file_format_of_bytes("", 0), FILE_FORMAT_UNKNOWN);
}

static void headers_identify_a_format(void **state)
{
    (void)state;
    char nifti[400] = "\x5c\1";
    memcpy(nifti + 344, "n+1", 4);
    assert_int_equal(file_format_of_bytes(nifti, sizeof nifti - 1), FILE_FORMAT_NIFTI);
    memcpy(nifti + 344, "n+0", 4);
    assert_int_equal(file_format_of_bytes(nifti, sizeof nifti - 1), FILE_FORMAT_ANALYZE);
    static const char meta[] = "ObjectType = Image\nNDims = 3\n", tds[] = "MM\x40\0\0\0\2\0\12\0\0\0\3\0\0\0",
                      comment[] = "999\na program\n  0\nSECTION\n";
    assert_int_equal(file_format_of_bytes(meta, sizeof meta - 1), FILE_FORMAT_META_IMAGE);
    assert_int_equal(file_format_of_bytes(tds, sizeof tds - 1), FILE_FORMAT_3DS);
    assert_int_equal(file_format_of_bytes(comment, sizeof comment - 1), FILE_FORMAT_DXF);
}

static file_format format_of(const char *bytes, size_t size, const char *name)
{
    FILE *file = tmpfile();
    assert_true(file && fwrite(bytes, 1, size, file) == size && fflush(file) == 0);
    const file_format found = file_format_of_file(fileno(file), name);
    fclose(file);
    return found;
}

static void bytes_of_volumes_decide_before_the_name(void **state)
{
    (void)state;
    assert_int_equal(format_of(" BDV\0\0\0\0", 8, "a.nii"), FILE_FORMAT_VDB);
    assert_int_equal(format_of("NRRD0005\n", 9, "a"), FILE_FORMAT_NRRD);
    assert_int_equal(format_of("<VTKFile type=\"ImageData\">", 26, "a.vti"), FILE_FORMAT_VTI);
    assert_int_equal(format_of("CDF\1", 4, "a.stl"), FILE_FORMAT_STL);
    assert_int_equal(format_of("CDF\1", 4, "a"), FILE_FORMAT_NETCDF);
    assert_int_equal(format_of("", 0, "a.OBJ"), FILE_FORMAT_OBJ);
}

/* Each format that hexad reads itself has a reader, and no other format. OpenVDB files are read by io/vdb. */
static void table_of_readers_is_complete(void **state)
{
    (void)state;
    FOR_EACH(k, row)
    {
        const bool is_read = row->reading == FILE_FORMAT_READ,
                   is_mesh = row->kind == FILE_FORMAT_MESHES || row->kind == FILE_FORMAT_POINTS;
        if (plain_mesh_reads((file_format)k) != (is_read && is_mesh)) fail_msg("%s", row->name);
        if (volume_file_reads((file_format)k) != (is_read && !is_mesh && k != FILE_FORMAT_VDB))
            fail_msg("%s", row->name);
    }
}

static bool is_member(size_t offset)
{
    for (size_t k = 0; k < spec_row_count; k++)
        if (spec_rows[k].offset == offset && spec_rows[k].type == SPEC_TYPE_BOOL) return true;
    return false;
}

/* job/phases/results writes PLY and OpenVDB itself. */
static void table_of_writers_is_complete(void **state)
{
    (void)state;
    FOR_EACH(k, row)
    {
        const writer *w = &writers[k];
        const bool has_points = row->kind <= FILE_FORMAT_GRIDS && row->is_written;
        if (!w->write[0] != !(has_points && k != FILE_FORMAT_PLY && k != FILE_FORMAT_VDB))
            fail_msg("%s", row->name);
        assert_int_equal(is_member(offsetof(spec, points_in) + (size_t)k * sizeof(bool)),
                         has_points && k != FILE_FORMAT_PLY);
        assert_int_equal(is_member(offsetof(spec, mesh_in) + (size_t)k * sizeof(bool)), w->has_mesh);
    }
}

static void meshes_that_are_not_read_are_refused_with_advice(void **state)
{
    (void)state;
    FOR_EACH(k, row)
    {
        const file_format_bytes *b = &row->beginning[0];
        const char *own = row->ending[0] ? row->ending[0] + 1 : "";
        char data[FILE_FORMAT_HEAD + 1] = "";
        assert_ptr_equal(file_format_as_mesh(own, "", 0),
                         row->ending[0] && row->reading == FILE_FORMAT_NOT_READ ? row->as_mesh : NULL);
        if (!row->as_mesh || b->length == 0) continue;
        memcpy(data + b->at, b->bytes, b->length);
        assert_ptr_equal(file_format_as_mesh("ply", data, FILE_FORMAT_HEAD), row->as_mesh);
        assert_ptr_equal(file_format_as_mesh(own, data, FILE_FORMAT_HEAD), row->as_mesh);
    }
}

/* ---- pages */

static char *read_source(const char *name)
{
    const char *source = getenv("HEXAD_SOURCE");
    char *path = mem_printf("%s/%s", source ? source : ".", name);
    size_t length;
    char *text = store_file_read(path, 1 << 20, &length, NULL);
    if (!text) fail_msg("cannot read %s", path);
    free(path);
    return text;
}

static char *read_page(const char *name)
{
    char *path = mem_printf("doc/%s", name), *text = read_source(path);
    free(path);
    return text;
}

static const char *up_of(const file_format_row *row)
{
    if (row->kind != FILE_FORMAT_MESHES || row->reading == FILE_FORMAT_NOT_READ) return "";
    return row->z_up ? (row->up_varies ? "z or y" : "z") : row->up_varies ? "y or z" : "y";
}

/* The table of doc/formats.md; the caller frees it. */
static char *print_table(void)
{
    static const char *const kinds[] = {"mesh", "points", "grids, points", "dense volume", "image", "other"},
                             *const readings[] = {"no", "yes", "by assimp"};
    char *text = NULL;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    fputs(
        "| format | names end in | holds | read | written | up axis of meshes |\n|---|---|---|---|---|---|\n",
        out);
    FOR_EACH(k, row)
    {
        fprintf(out, "| %s | ", row->name);
        for (int n = 0; n < FILE_FORMAT_ENDINGS && row->ending[n]; n++)
            fprintf(out, "%s`%s`", n > 0 ? ", " : "", row->ending[n]);
        fprintf(out, " | %s%s | %s | %s | %s |\n", kinds[row->kind],
                row->has_points && row->kind == FILE_FORMAT_MESHES ? ", points" : "", readings[row->reading],
                row->is_written ? "yes" : "no", up_of(row));
    }
    fclose(out);
    return text;
}

static void page_of_formats_has_the_table(void **state)
{
    (void)state;
    char *page = read_page("formats.md"), *table = print_table();
    if (!strstr(page, table)) {
        printf("doc/formats.md must have this table:\n%s", table);
        fail();
    }
    free(table);
    free(page);
}

/* Whether a line of a table in the text names the format in its first cell and has the other text behind
 * it. */
static bool has_row(const char *text, const char *format, const char *rest)
{
    const size_t length = strcspn(format, "(");
    char *name = mem_strndup(format, length > 0 && format[length - 1] == ' ' ? length - 1 : length);
    bool found = false;
    for (const char *line = text; line && !found; line = strchr(line, '\n')) {
        line += *line == '\n';
        char *copy = mem_strndup(line, strcspn(line, "\n"));
        const char *first = strstr(copy, name), *cell = strchr(copy + (*copy == '|'), '|');
        found = *copy == '|' && first && cell && first < cell && strstr(cell, rest);
        free(copy);
    }
    free(name);
    return found;
}

static void page_of_meshes_has_the_up_axis_of_each_mesh(void **state)
{
    (void)state;
    char *page = read_page("meshes.md"), *section = strstr(page, "## Up axis"),
         *end = strstr(section, "\nThe flat base");
    *end = 0;
    FOR_EACH(k, row)
    {
        const char *cell = row->z_up ? (row->up_varies ? "| z, or y if" : "| z |")
                                     : (row->up_varies ? "| y, or z if" : "| y");
        if (*up_of(row) && !has_row(section, row->name, cell)) fail_msg("%s: %s", row->name, cell);
    }
    free(page);
}

static void page_of_meshes_names_formats_that_are_not_read(void **state)
{
    (void)state;
    char *page = read_page("meshes.md"), *section = strstr(page, "## Formats that are not read");
    FOR_EACH(k, row)
    {
        if (row->kind == FILE_FORMAT_MESHES && row->reading == FILE_FORMAT_NOT_READ && row->as_mesh &&
            !has_row(section, row->name, ""))
            fail_msg("%s", row->name);
    }
    free(page);
}

static void page_of_inspections_names_volumes(void **state)
{
    (void)state;
    char *page = read_page("inspect.md");
    FOR_EACH(k, row)
    {
        char *name = mem_printf("`%s`", row->name);
        if (row->kind >= FILE_FORMAT_GRIDS && row->reading == FILE_FORMAT_READ && !strstr(page, name))
            fail_msg("%s", name);
        free(name);
    }
    free(page);
}

/* The help, the schema and the OpenAPI document have the sentences of the table of the spec. */
static void members_of_the_spec_name_the_formats(void **state)
{
    (void)state;
    const char *up = "", *volume = "";
    for (size_t k = 0; k < spec_row_count; k++) {
        if (strcmp(spec_rows[k].pointer, "/output/preview/up") == 0) up = spec_rows[k].prose;
        if (strcmp(spec_rows[k].pointer, "/surface/volume/path") == 0) volume = spec_rows[k].prose;
    }
    FOR_EACH(k, row)
    {
        const bool is_mesh = *up_of(row) && k != FILE_FORMAT_VTP;
        if (is_mesh && (row->z_up || row->up_varies) && !strstr(up, row->name)) fail_msg("up: %s", row->name);
        if (row->kind == FILE_FORMAT_VOLUMES && row->reading == FILE_FORMAT_READ &&
            !strstr(volume, row->name))
            fail_msg("volume: %s", row->name);
    }
}

/* The client in Python chooses the member of `surface` by the ending of a name. A directory of Zarr has one, too. */
static void python_knows_the_endings_of_volumes(void **state)
{
    (void)state;
    char *text = read_source("clients/python/hexad/sample.py"), *table = strstr(text, "\nVOLUMES = (");
    assert_non_null(table);
    *strchr(table, ')') = '\0';
    size_t expected = 1, quoted = 0;
    assert_non_null(strstr(table, "\".zarr\""));
    FOR_EACH(k, row)
    {
        const bool is_volume =
            row->kind == FILE_FORMAT_VOLUMES || (row->reading == FILE_FORMAT_NOT_READ && row->as_volume);
        for (int n = 0; is_volume && n < FILE_FORMAT_ENDINGS && row->ending[n]; n++, expected++) {
            char *ending = mem_printf("\"%s\"", row->ending[n]);
            if (!strstr(table, ending)) fail_msg("sample.py: VOLUMES has no %s", ending);
            free(ending);
        }
    }
    for (const char *c = table; *c; c++) quoted += *c == '"';
    assert_int_equal(quoted, 2 * expected);
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_format_has_a_name_of_its_own),
        cmocka_unit_test(names_of_files_have_the_format_of_their_ending),
        cmocka_unit_test(bytes_identify_a_format),
        cmocka_unit_test(headers_identify_a_format),
        cmocka_unit_test(bytes_of_volumes_decide_before_the_name),
        cmocka_unit_test(table_of_readers_is_complete),
        cmocka_unit_test(table_of_writers_is_complete),
        cmocka_unit_test(meshes_that_are_not_read_are_refused_with_advice),
        cmocka_unit_test(page_of_formats_has_the_table),
        cmocka_unit_test(page_of_meshes_has_the_up_axis_of_each_mesh),
        cmocka_unit_test(page_of_meshes_names_formats_that_are_not_read),
        cmocka_unit_test(page_of_inspections_names_volumes),
        cmocka_unit_test(members_of_the_spec_name_the_formats),
        cmocka_unit_test(python_knows_the_endings_of_volumes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

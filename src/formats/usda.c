#include "formats/usda.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "formats/colormap.h"
#include "formats/property.h"

/* Digits after which a float reads back as the same, and a whole number of 32 bits is whole. */
enum { FLOAT_DIGITS = 9, WHOLE_DIGITS = 10 };

/* Widths and ids are of points only. */
static bool is_primvar(const property *p, bool of_mesh)
{
    return p->role == PROPERTY_OTHER || p->role == PROPERTY_COLOR || p->role == PROPERTY_UV ||
           (of_mesh && (p->role == PROPERTY_RADIUS || p->role == PROPERTY_ID));
}

/* How the file declares a property: "color3f[] primvars:displayColor". */
static void declare(const property *p, bool of_mesh, char out[160])
{
    static const char *const fixed[] = {[PROPERTY_POSITION] = "point3f[] points",
                                        [PROPERTY_NORMAL] = "normal3f[] normals",
                                        [PROPERTY_COLOR] = "color3f[] primvars:displayColor",
                                        [PROPERTY_UV] = "texCoord2f[] primvars:st",
                                        [PROPERTY_RADIUS] = "float[] widths",
                                        [PROPERTY_ID] = "int64[] ids",
                                        [PROPERTY_VELOCITY] = "vector3f[] velocities"};
    static const char *const types[] = {"float", "float2", "float3", "float4"};
    if (!is_primvar(p, of_mesh) || p->role == PROPERTY_COLOR || p->role == PROPERTY_UV)
        strcpy(out, fixed[p->role]);
    else
        snprintf(out, 160, "%s[] primvars:%s", p->whole ? "int" : types[p->components - 1], p->name);
}

/* As the file has it: widths are diameters, and colors in linear light. */
static double number(const property *p, bool of_mesh, size_t point, int c)
{
    double value = property_value(p, point, c);
    if (p->role == PROPERTY_RADIUS && !of_mesh) value *= 2;
    if (p->role == PROPERTY_COLOR) value = colormap_linear(fmin(fmax(value, 0), 1));
    return value;
}

static bool write_property(FILE *file, const property *p, bool of_mesh, size_t rows)
{
    char words[160];
    declare(p, of_mesh, words);
    bool good = fprintf(file, "    %s = [", words) > 0;
    for (size_t i = 0; good && i < rows; i++) {
        good = fputs(i ? ", " : "", file) >= 0 && (p->components == 1 || fputc('(', file) != EOF);
        for (int c = 0; good && c < p->components; c++) {
            double value = number(p, of_mesh, i, c);
            int digits = p->whole ? WHOLE_DIGITS : FLOAT_DIGITS;
            good =
                fprintf(file, "%s%.*g", c ? ", " : "", digits, p->whole ? value : (double)(float)value) > 0;
        }
        if (p->components > 1) good = good && fputc(')', file) != EOF;
    }
    return good && fputs(is_primvar(p, of_mesh) ? "] (\n        interpolation = \"vertex\"\n    )\n" : "]\n",
                         file) >= 0;
}

static bool write_extent(FILE *file, const points *set)
{
    vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t i = 0; i < set->count; i++)
        for (int a = 0; a < 3; a++) {
            double x = vec3_get(set->position[i], a), r = 0.5 * set->spacing_local[i];
            vec3_set(&low, a, fmin(vec3_get(low, a), x - r));
            vec3_set(&high, a, fmax(vec3_get(high, a), x + r));
        }
    return fprintf(file, "    float3[] extent = [(%.9g, %.9g, %.9g), (%.9g, %.9g, %.9g)]\n", low.x, low.y,
                   low.z, high.x, high.y, high.z) > 0;
}

static bool write_triangles(FILE *file, const points *set)
{
    bool good =
        fputs("    uniform token subdivisionScheme = \"none\"\n    int[] faceVertexCounts = [", file) >= 0;
    for (size_t k = 0; good && k < set->triangle_count; k++) good = fputs(k ? ", 3" : "3", file) >= 0;
    good = good && fputs("]\n    int[] faceVertexIndices = [", file) >= 0;
    for (size_t k = 0; good && k < set->triangle_count; k++) {
        const uint32_t *c = set->triangle[k];
        good = fprintf(file, "%s%u, %u, %u", k ? ", " : "", c[0], c[1], c[2]) > 0;
    }
    return good && fputs("]\n", file) >= 0;
}

static size_t list_properties(const points *set, property **list)
{
    *list = mem_alloc((PROPERTIES_OWN + set->attribute_count) * sizeof **list);
    return property_list(set, *list);
}

bool usda_write(FILE *file, const points *set, bool y_up, error *e)
{
    property *list;
    const bool of_mesh = set->triangle_count > 0;
    size_t count = list_properties(set, &list);
    const char *name = of_mesh ? "mesh" : "points";
    bool good =
        fprintf(file,
                "#usda 1.0\n(\n    defaultPrim = \"%s\"\n    metersPerUnit = 1\n    upAxis = \"%s\"\n)\n\n",
                name, y_up ? "Y" : "Z") > 0;
    good = good && fprintf(file, "def %s \"%s\"\n{\n", of_mesh ? "Mesh" : "Points", name) > 0;
    good = good && write_extent(file, set) && (!of_mesh || write_triangles(file, set));
    for (size_t k = 0; good && k < count; k++) good = write_property(file, &list[k], of_mesh, set->count);
    good = good && fputs("}\n", file) >= 0 && fflush(file) == 0;
    free(list);
    return good || error_set(e, error_code_of_errno(errno), "cannot write the USD file: %s", strerror(errno));
}

/* ---- reading ---- */

static bool damaged(error *e, const char *what)
{
    return error_set(e, ERROR_INPUT_DAMAGED, "USD file: %s", what);
}

/* To behind the next text of this kind; false at the end of the file. */
static bool find_text(FILE *file, const char *text)
{
    size_t matched = 0;
    for (int c; text[matched] && (c = fgetc(file)) != EOF;)
        matched = c == text[matched] ? matched + 1 : c == text[0];
    return !text[matched];
}

/* Numbers of a list, behind whatever stands between them. */
static bool read_number(FILE *file, double *out)
{
    int skipped = fgetc(file);
    while (skipped == ',' || skipped == ' ' || skipped == '(' || skipped == ')') skipped = fgetc(file);
    ungetc(skipped, file);
    return fscanf(file, "%lf", out) == 1;
}

static bool verify_property(FILE *file, const property *p, bool of_mesh, size_t rows, error *e)
{
    char words[160], start[180];
    declare(p, of_mesh, words);
    snprintf(start, sizeof start, "    %s = [", words);
    if (!find_text(file, start)) return damaged(e, "a property is not there");
    for (size_t i = 0; i < rows; i++)
        for (int c = 0; c < p->components; c++) {
            double read;
            int skipped = fgetc(file);
            while (skipped == ',' || skipped == ' ' || skipped == '(' || skipped == ')')
                skipped = fgetc(file);
            ungetc(skipped, file);
            if (fscanf(file, "%lf", &read) != 1) return damaged(e, "it ends too early");
            double meant = number(p, of_mesh, i, c);
            volatile float single = (float)meant, single_read = (float)read;
            if (p->whole ? read != meant : single_read != single)
                return error_set(e, ERROR_INPUT_DAMAGED,
                                 "USD file: the %s of point %zu is not what was written", p->name, i);
        }
    return find_text(file, "]") || damaged(e, "it ends too early");
}

static bool verify_triangles(FILE *file, const points *set, error *e)
{
    double read;
    if (!find_text(file, "faceVertexIndices = [")) return damaged(e, "it has no faces");
    for (size_t k = 0; k < 3 * set->triangle_count; k++)
        if (!read_number(file, &read) || read != set->triangle[k / 3][k % 3])
            return error_set(e, ERROR_INPUT_DAMAGED, "USD file: face %zu is not what was written", k / 3);
    return true;
}

bool usda_verify(FILE *file, const points *set, bool y_up, error *e)
{
    property *list;
    const bool of_mesh = set->triangle_count > 0;
    size_t count = list_properties(set, &list);
    rewind(file);
    bool good =
        find_text(file, y_up ? "upAxis = \"Y\"" : "upAxis = \"Z\"") || damaged(e, "it has no up axis");
    if (good && of_mesh) good = verify_triangles(file, set, e);
    for (size_t k = 0; good && k < count; k++) good = verify_property(file, &list[k], of_mesh, set->count, e);
    free(list);
    return good && (find_text(file, "}\n") || damaged(e, "it ends too early"));
}

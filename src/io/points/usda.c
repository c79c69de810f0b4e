// SPDX-License-Identifier: Apache-2.0
#include "io/points/usda.h"

#include <errno.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/precision.h"
#include "base/core/worker_contract.h"
#include "io/points/colormap.h"
#include "io/points/half.h"
#include "io/points/property.h"

/* Number of significant digits with which a float, a whole number and a double are read back exactly. */
enum { FLOAT_DIGITS = 9, WHOLE_DIGITS = 16, DOUBLE_DIGITS = 17 };
/* Time codes are frames; velocities are per second. This is USD's default rate. */
enum { FRAMES_PER_SECOND = 24 };
enum { VALUES_WORDS = 480 };
#define EXTENT "float3[] extent"
#define TRANSLATION "double3 xformOp:translate"
#define TRANSFORMS "    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n"
#define FACE_COUNTS "int[] faceVertexCounts"
#define FACE_CORNERS "int[] faceVertexIndices"
#define SUBDIVISION "    uniform token subdivisionScheme = \"none\"\n"
#define PROTOTYPES "    rel prototypes = </points/prototypes/prototype>\n"

/* The kind of the prim. */
typedef enum prim_kind { PRIM_POINTS, PRIM_MESH, PRIM_INSTANCER } prim_kind;

static prim_kind kind_of(const points *set, const scene *place)
{
    return set->triangle_count > 0 ? PRIM_MESH : place->instancer ? PRIM_INSTANCER : PRIM_POINTS;
}

static const char *name_of(prim_kind kind)
{
    return kind == PRIM_MESH ? "mesh" : "points";
}

static const char *schema_of(prim_kind kind)
{
    static const char *const names[] = {
        [PRIM_POINTS] = "Points", [PRIM_MESH] = "Mesh", [PRIM_INSTANCER] = "PointInstancer"};
    return names[kind];
}

/* Whether the property is a primvar: widths exist for points only, ids not for meshes, and normals not for
 * instances. */
static bool is_primvar(const property *p, prim_kind kind)
{
    switch (p->role) {
    case PROPERTY_OTHER:
    case PROPERTY_COLOR:
    case PROPERTY_UV:
    case PROPERTY_ORIENT:
        return true;
    case PROPERTY_ID:
        return kind == PRIM_MESH;
    case PROPERTY_RADIUS:
        return kind != PRIM_POINTS;
    case PROPERTY_NORMAL:
        return kind == PRIM_INSTANCER;
    default:
        return false;
    }
}

/* The type of a primvar that is neither a color nor a texture coordinate. */
static const char *primvar_type(const property *p)
{
    static const char *const types[] = {"float", "float2", "float3", "float4"},
                             *const doubles[] = {"double", "double2", "double3", "double4"},
                             *const whole[] = {"int", "int2", "int3", "int4"};
    if (p->role == PROPERTY_NORMAL) return "normal3f";
    if (p->role == PROPERTY_ORIENT) return "quatf";
    if (p->whole && p->components == 1 && p->largest > INT32_MAX) return "int64";
    return (p->whole ? whole : p->is_double ? doubles : types)[p->components - 1];
}

/* The declaration of a property: "color3f[] primvars:displayColor". */
static void declare(const property *p, prim_kind kind, char out[160])
{
    static const char *const fixed[] = {[PROPERTY_POSITION] = "point3f[] points",
                                        [PROPERTY_NORMAL] = "normal3f[] normals",
                                        [PROPERTY_COLOR] = "color3f[] primvars:displayColor",
                                        [PROPERTY_UV] = "texCoord2f[] primvars:st",
                                        [PROPERTY_RADIUS] = "float[] widths",
                                        [PROPERTY_ID] = "int64[] ids",
                                        [PROPERTY_VELOCITY] = "vector3f[] velocities",
                                        [PROPERTY_MOTION] = "vector3f[] velocities",
                                        [PROPERTY_INSTANCE_ORIENT] = "quatf[] orientationsf",
                                        [PROPERTY_INSTANCE_ORIENT_HALF] = "quath[] orientations",
                                        [PROPERTY_INSTANCE_SCALE] = "float3[] scales",
                                        [PROPERTY_INSTANCE_PROTOTYPE] = "int[] protoIndices"};
    if (p->role == PROPERTY_POSITION && kind == PRIM_INSTANCER)
        strcpy(out, "point3f[] positions");
    else if (!is_primvar(p, kind) || p->role == PROPERTY_COLOR || p->role == PROPERTY_UV)
        strcpy(out, fixed[p->role]);
    else
        snprintf(out, 160, "%s[] primvars:%s", primvar_type(p), p->name);
}

static bool is_quaternion(const property *p)
{
    return p->role == PROPERTY_ORIENT || p->role == PROPERTY_INSTANCE_ORIENT ||
           p->role == PROPERTY_INSTANCE_ORIENT_HALF;
}

/* A number as stored: positions relative to the origin, widths are diameters, velocities per second, colors
 * in linear light, and the real part of a quaternion first. */
static double number(const property *p, prim_kind kind, vec3 origin, size_t point, int c)
{
    double value = property_value(p, point, is_quaternion(p) ? (c + 3) % 4 : c);
    if (p->role == PROPERTY_POSITION) value -= vec3_get(origin, c);
    if (p->role == PROPERTY_RADIUS && kind == PRIM_POINTS) value *= 2;
    if (p->role == PROPERTY_MOTION) value *= FRAMES_PER_SECOND;
    if (p->role == PROPERTY_COLOR) value = colormap_linear(fmin(fmax(value, 0), 1));
    if (p->role == PROPERTY_INSTANCE_ORIENT_HALF)
        value = (double)half_to_float(half_from_float((float)value));
    return value;
}

/* The text before and after the values of a property; values of a frame are a time sample. */
static void enclose(const char *words, bool primvar, const scene *place, char before[VALUES_WORDS],
                    const char **behind)
{
    static const char vertex[] = " (\n        interpolation = \"vertex\"\n    )\n";
    if (place->frame_count > 0) {
        snprintf(before, VALUES_WORDS, "%s%s%s    %s.timeSamples = {\n        %d: [", primvar ? "    " : "",
                 primvar ? words : "", primvar ? vertex : "", words, place->frame);
        *behind = "]\n    }\n";
    } else {
        snprintf(before, VALUES_WORDS, "    %s = [", words);
        *behind = primvar ? "] (\n        interpolation = \"vertex\"\n    )\n" : "]\n";
    }
}

static bool write_property(FILE *file, const property *p, prim_kind kind, const scene *place, size_t rows)
{
    char words[160], before[VALUES_WORDS];
    const char *behind;
    declare(p, kind, words);
    enclose(words, is_primvar(p, kind), place, before, &behind);
    bool good = fputs(before, file) >= 0;
    for (size_t i = 0; good && i < rows; i++) {
        good = fputs(i ? ", " : "", file) >= 0 && (p->components == 1 || fputc('(', file) != EOF);
        for (int c = 0; good && c < p->components; c++) {
            double value = number(p, kind, place->origin, i, c);
            int digits = p->whole ? WHOLE_DIGITS : p->is_double ? DOUBLE_DIGITS : FLOAT_DIGITS;
            good = fprintf(file, "%s%.*g", c ? ", " : "", digits,
                           p->whole || p->is_double ? value : (double)(float)value) > 0;
        }
        if (p->components > 1) good = good && fputc(')', file) != EOF;
    }
    return good && fputs(behind, file) >= 0;
}

static bool write_extent(FILE *file, const points *set, const scene *place)
{
    vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    char before[VALUES_WORDS];
    const char *behind;
    for (size_t i = 0; i < set->count; i++)
        for (int a = 0; a < 3; a++) {
            double x = vec3_get(set->position[i], a) - vec3_get(place->origin, a),
                   r = 0.5 * set->spacing_local[i];
            vec3_set(&low, a, fmin(vec3_get(low, a), x - r));
            vec3_set(&high, a, fmax(vec3_get(high, a), x + r));
        }
    enclose(EXTENT, false, place, before, &behind);
    return fprintf(file, "%s(%.9g, %.9g, %.9g), (%.9g, %.9g, %.9g)%s", before, low.x, low.y, low.z, high.x,
                   high.y, high.z, behind) > 0;
}

/* Frames of a sequence always have a translation, so that all have the same properties. Instances have one,
 * too. */
static bool has_translation(const scene *place)
{
    return place->frame_count > 0 || place->instancer || vec3_norm(place->origin) > 0;
}

/* The translation; in a frame, as a time sample. */
static void print_translation(const scene *place, char out[VALUES_WORDS])
{
    const vec3 o = place->origin;
    int n = place->frame_count > 0
                ? snprintf(out, VALUES_WORDS,
                           "    " TRANSLATION ".timeSamples = {\n        %d: (%.17g, %.17g, %.17g)\n    }\n",
                           place->frame, o.x, o.y, o.z)
                : snprintf(out, VALUES_WORDS, "    " TRANSLATION " = (%.17g, %.17g, %.17g)\n", o.x, o.y, o.z);
    snprintf(out + n, VALUES_WORDS - (size_t)n, TRANSFORMS);
}

static bool write_translation(FILE *file, const scene *place)
{
    char words[VALUES_WORDS];
    if (!has_translation(place)) return true;
    print_translation(place, words);
    return fputs(words, file) >= 0;
}

static bool write_triangles(FILE *file, const points *set, const scene *place)
{
    char before[VALUES_WORDS];
    const char *behind;
    enclose(FACE_COUNTS, false, place, before, &behind);
    bool good = fprintf(file, "%s%s", SUBDIVISION, before) > 0;
    for (size_t k = 0; good && k < set->triangle_count; k++) good = fputs(k ? ", 3" : "3", file) >= 0;
    good = good && fputs(behind, file) >= 0;
    enclose(FACE_CORNERS, false, place, before, &behind);
    good = good && fputs(before, file) >= 0;
    for (size_t k = 0; good && k < set->triangle_count; k++) {
        const uint32_t *c = set->triangle[k];
        good = fprintf(file, "%s%u, %u, %u", k ? ", " : "", c[0], c[1], c[2]) > 0;
    }
    return good && fputs(behind, file) >= 0;
}

/* Number of properties that a PointInstancer has in addition; orient is omitted. */
enum { OF_INSTANCES = 4 };

static size_t list_properties(const points *set, const scene *place, property **out)
{
    property *list = mem_alloc((PROPERTIES_OWN + OF_INSTANCES + set->attribute_count) * sizeof *list);
    size_t count = property_list(set, list), kept = 0;
    *out = list;
    if (kind_of(set, place) != PRIM_INSTANCER) return count;
    for (size_t k = 0; k < count; k++)
        if (list[k].role != PROPERTY_ORIENT) list[kept++] = list[k];
    const scene_instancer *i = place->instancer;
    const property more[OF_INSTANCES] = {
        {"orientations", PROPERTY_INSTANCE_ORIENT_HALF, false, 0, 4, i->orient, 1, false, NULL},
        {"orientationsf", PROPERTY_INSTANCE_ORIENT, false, 0, 4, i->orient, 1, false, NULL},
        {"scales", PROPERTY_INSTANCE_SCALE, false, 0, 3, i->scale, 1, false, NULL},
        /* scale 0: all prototype indices are 0 */
        {"protoIndices", PROPERTY_INSTANCE_PROTOTYPE, true, 0, 1, set->spacing_local, 0, false, NULL}};
    memcpy(list + kept, more, sizeof more);
    return kept + OF_INSTANCES;
}

/* The prototype of instances: a prim that refers to the asset. To be freed. */
static char *prototype_text(const scene_instancer *i)
{
    const char *quote = strchr(i->prototype, '@') ? "@@@" : "@";
    return mem_printf(PROTOTYPES
                      "\n    def Scope \"prototypes\"\n    {\n        def \"prototype\" (\n"
                      "            prepend references = %s%s%s\n        )\n        {\n        }\n    }\n",
                      quote, i->prototype, quote);
}

static bool write_prototype(FILE *file, prim_kind kind, const scene *place)
{
    if (kind != PRIM_INSTANCER) return true;
    char *text = prototype_text(place->instancer);
    const bool good = fputs(text, file) >= 0;
    free(text);
    return good;
}

/* Writes the stage and the head of its prim, up to its name. */
static bool write_head(FILE *file, const char *name, const char *schema, const scene *place, int first,
                       int last)
{
    bool good = fprintf(file, "#usda 1.0\n(\n    defaultPrim = \"%s\"\n", name) > 0;
    if (place->frame_count > 0)
        good = good && fprintf(file,
                               "    endTimeCode = %d\n    framesPerSecond = %d\n    startTimeCode = %d\n"
                               "    timeCodesPerSecond = %d\n",
                               last, FRAMES_PER_SECOND, first, FRAMES_PER_SECOND) > 0;
    return good && fprintf(file, "    metersPerUnit = 1\n    upAxis = \"%s\"\n)\n\ndef %s \"%s\"",
                           place->y_up ? "Y" : "Z", schema, name) > 0;
}

static bool end_writing(FILE *file, bool good, error *e)
{
    return (good && fflush(file) == 0) ||
           error_set(e, error_code_of_errno(errno), "cannot write the USD file: %s", strerror(errno));
}

bool usda_write(FILE *file, const points *set, const scene *place, error *e)
{
    property *list;
    const prim_kind kind = kind_of(set, place);
    size_t count = list_properties(set, place, &list);
    bool good = write_head(file, name_of(kind), schema_of(kind), place, place->frame, place->frame) &&
                fputs("\n{\n", file) >= 0 && (kind == PRIM_INSTANCER || write_extent(file, set, place)) &&
                (kind != PRIM_MESH || write_triangles(file, set, place));
    for (size_t k = 0; good && k < count; k++) good = write_property(file, &list[k], kind, place, set->count);
    good = good && write_translation(file, place) && write_prototype(file, kind, place);
    good = good && fputs("}\n", file) >= 0;
    free(list);
    return end_writing(file, good, e);
}

/* ---- the stage of a sequence ---- */

/* Writes the value clips: the file that has the values of each time code. The stage is its own manifest of
 * the properties in the files. */
static bool write_clips(FILE *file, const char *name, const char *manifest, char *const *folders,
                        const scene *place)
{
    const size_t n = place->frame_count;
    bool good = fputs(" (\n    clips = {\n        dictionary default = {\n            double2[] active = [",
                      file) >= 0;
    for (size_t k = 0; good && k < n; k++)
        good = fprintf(file, "%s(%d, %zu)", k ? ", " : "", place->frames[k], k) > 0;
    good = good && fputs("]\n            asset[] assetPaths = [", file) >= 0;
    for (size_t k = 0; good && k < n; k++) {
        const char *quote = strchr(folders[k], '@') ? "@@@" : "@";
        good = fprintf(file, "%s%s%s/%s.usda%s", k ? ", " : "", quote, folders[k], name, quote) > 0;
    }
    good = good && fprintf(file,
                           "]\n            asset manifestAssetPath = @./%s%s@\n"
                           "            string primPath = \"/%s\"\n            double2[] times = [",
                           name, manifest, name) > 0;
    for (size_t k = 0; good && k < n; k++)
        good = fprintf(file, "%s(%d, %d)", k ? ", " : "", place->frames[k], place->frames[k]) > 0;
    return good && fputs("]\n        }\n    }\n)\n{\n", file) >= 0;
}

/* The folders are relative to that of the stage. The file is named by the prim and `ending`. */
static bool write_stage(FILE *file, const points *set, const scene *place, const char *ending,
                        char *const *folders, error *e)
{
    property *list;
    const prim_kind kind = kind_of(set, place);
    size_t count = list_properties(set, place, &list);
    const char *name = name_of(kind);
    bool good = write_head(file, name, schema_of(kind), place, place->frames[0],
                           place->frames[place->frame_count - 1]) &&
                write_clips(file, name, ending, folders, place) &&
                (kind == PRIM_INSTANCER || fputs("    " EXTENT "\n", file) >= 0);
    if (kind == PRIM_MESH)
        good = good && fputs(SUBDIVISION "    " FACE_COUNTS "\n    " FACE_CORNERS "\n", file) >= 0;
    for (size_t k = 0; good && k < count; k++) {
        char words[160];
        declare(&list[k], kind, words);
        good = fprintf(file, "    %s%s\n", words,
                       is_primvar(&list[k], kind) ? " (\n        interpolation = \"vertex\"\n    )" : "") > 0;
    }
    good = good && fputs("    " TRANSLATION "\n" TRANSFORMS, file) >= 0 &&
           write_prototype(file, kind, place) && fputs("}\n", file) >= 0;
    free(list);
    return end_writing(file, good, e);
}

bool usda_write_sequence(FILE *file, const points *set, const scene *place, error *e)
{
    return write_stage(file, set, place, "_sequence.usda", place->folders, e);
}

bool usda_write_stage(FILE *file, const points *set, const scene *place, error *e)
{
    return write_stage(file, set, place, WORKER_STAGE_ENDING, place->below, e);
}

/* source: the surface that a spec names, opened: a formula, a B-spline, a volume or mesh of a file, or what
 * is combined of such. */
#ifndef HEXAD_RUN_SOURCE_H
#define HEXAD_RUN_SOURCE_H

#include "base/error.h"
#include "base/threads.h"
#include "field/analytic.h"
#include "field/bspline.h"
#include "field/combination.h"
#include "field/field.h"
#include "field/placement.h"
#include "field/region.h"
#include "json/json.h"
#include "spec/spec.h"
#include "store/file.h"
#include "store/root.h"
#include "volume/map.h"
#include "volume/volume.h"

/* A file that was read. */
typedef struct source_input {
    char *path; /* as the spec, or a file that it names, has it */
    uint64_t bytes;
    char sha256[STORE_HASH_SIZE];
} source_input;

/* One surface of the spec, opened: a leaf of one kind, or what combines or places its parts. */
typedef struct source_part source_part;

struct source_part {
    const field *field;
    analytic *analytic; /* one of the five */
    bspline *bspline;
    volume *volume;
    combination *combination;
    placement *placement;
    double *coefficients; /* of a B-spline whose file was read */
    source_part *parts;
    size_t part_count;
};

typedef struct source {
    const field *field;
    source_part whole;
    map *map;                 /* of sampling.grid, or NULL */
    region *region;           /* the part of it that the spec asks for, or NULL */
    const store_roots *roots; /* for files, or NULL; as long as the source is being opened */
    source_input *inputs;     /* in the order in which they were first opened */
    size_t input_count;
} source;

/* `memory` bounds what the surface may hold, in bytes; it is sampled with `kernels`; the spec outlives the
 * source. Errors: those of volume_open and store_open_input, prefixed with the path. source_close accepts a
 * zeroed struct. */
bool source_open(const spec *s, const store_roots *roots, size_t memory, isa kernels, threads *pool,
                 source *out, error *e);
void source_close(source *s);

/* The report's `inputs`, a volume's members of `surface`, and what it warns of. */
void source_describe(const source *s, json *report, json *surface, json *warnings);

/* Whether random starts are drawn from the cells that the surface crosses, not from the domain. */
bool source_starts_in_cells(const source *s);

/* Bytes that the source holds; 0 for one that is not open. */
size_t source_memory(const source *s);

#endif

/* source: the surface that a spec names, opened: a formula, or a volume or mesh of a file. */
#ifndef HEXAD_RUN_SOURCE_H
#define HEXAD_RUN_SOURCE_H

#include "base/error.h"
#include "base/threads.h"
#include "field/analytic.h"
#include "field/field.h"
#include "json/json.h"
#include "spec/spec.h"
#include "store/file.h"
#include "store/root.h"
#include "volume/map.h"
#include "volume/volume.h"

typedef struct source {
    const field *field;
    analytic *analytic; /* one of the two */
    volume *volume;
    map *map; /* of sampling.grid, or NULL */
    const char *input_path; /* as the spec gives it, or NULL */
    uint64_t input_bytes;
    char input_sha256[STORE_HASH_SIZE];
} source;

/* `memory` bounds what the surface may hold, in bytes. Errors: those of volume_open and
 * store_open_input, prefixed with the path. source_close accepts a zeroed struct. */
bool source_open(const spec *s, const store_roots *roots, size_t memory, threads *pool, source *out,
                 error *e);
void source_close(source *s);

/* The report's `inputs`, the volume's members of `surface`, and what it warns of. */
void source_describe(const source *s, json *report, json *surface, json *warnings);

/* Bytes that the source holds; 0 for one that is not open. */
size_t source_memory(const source *s);

#endif

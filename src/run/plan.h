/* plan: what a job asks for before it runs: how many points, and whether they fit into its memory. Pure functions,
 * any thread. */
#ifndef HEXAD_RUN_PLAN_H
#define HEXAD_RUN_PLAN_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "spec/spec.h"

/* The range of sampling.count, which also holds for targets that come to a count. */
#define PLAN_COUNT_MIN 4.0
#define PLAN_COUNT_MAX 1e8

/* Bytes that particles may take: `limit`, of the job, less what the source holds and what its pictures take. May be
 * negative. */
double plan_particle_memory(const spec *s, size_t limit, size_t source_bytes);

/* Bytes that one particle takes at the peak. `is_continued`: the points of another frame are carried over. */
double plan_bytes_per_particle(const spec *s, bool is_continued);

/* Whether `count` particles fit into `memory` bytes. Error: limit_memory. */
bool plan_check_memory(const spec *s, bool is_continued, double count, double memory, error *e);

/* The count that the target asks for on a surface of this area; not with a time for a target. Error: spec_invalid (the
 * count is out of range). */
bool plan_count(const spec *s, double area, size_t *out, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
/* repair_region: a copy of a small region of a packing for trial changes of defect repair
 * (solver_repair_defects). Particles are deleted, inserted and relaxed, while the surrounding particles are
 * fixed. The pair forces are those of the solve. Particles of opposite walls contribute to the forces and
 * are fixed. No state is shared between worker threads. World space. */
#ifndef HEXAD_SAMPLING_SOLVER_PASSES_REPAIR_REGION_H
#define HEXAD_SAMPLING_SOLVER_PASSES_REPAIR_REGION_H

#include "sampling/packing/pair.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/passes/passes.h"

/* Capacities: members of a region, free members, pairs of one member, entries of all neighbour lists. */
enum {
    REPAIR_MAX_MEMBERS = 256,
    REPAIR_MAX_FREE = 96,
    REPAIR_MAX_PAIRS = 64,
    REPAIR_MAX_LIST = REPAIR_MAX_PAIRS * REPAIR_MAX_MEMBERS
};

typedef struct repair_region {
    const field *field; /* of its patch */
    uint32_t count;     /* members */
    uint32_t free;      /* the first `free` members may move */
    int defects;        /* evaluated members without six neighbours */
    double cost;
    vec3 x[REPAIR_MAX_MEMBERS], normal[REPAIR_MAX_MEMBERS];
    double h[REPAIR_MAX_MEMBERS];       /* requested spacing */
    bool evaluated[REPAIR_MAX_MEMBERS]; /* it counts for the cost */
    bool active[REPAIR_MAX_MEMBERS];    /* not converged */
    uint8_t degree[REPAIR_MAX_MEMBERS]; /* Voronoi neighbours of the evaluated members; else 6 */
    uint32_t hint[REPAIR_MAX_MEMBERS];  /* location on the field */
    /* neighbour lists within VORONOI_REACH, as of the last build */
    uint32_t begin[REPAIR_MAX_MEMBERS], listed[REPAIR_MAX_MEMBERS], list[REPAIR_MAX_LIST];
} repair_region;

/* Scratch memory of one worker thread. */
typedef struct repair_scratch {
    const solver *s;
    double mean; /* mean spacing of the Voronoi cells of the packing over the requested spacing */
    repair_region as_is, current, tried;
    pair_list pairs;
    double number[PAIR_LIST_ARRAYS * REPAIR_MAX_PAIRS]; /* arrays of `pairs` */
} repair_scratch;

void repair_scratch_init(repair_scratch *b, const solver *s);

/* Builds the neighbour lists of all members. */
void repair_region_list(repair_region *p);

/* Estimates the number of defects: evaluated members without six members between the first two shells. Faster
 * than repair_region_evaluate and mostly correct. */
int repair_region_estimate_defects(const repair_region *p);

/* Sets degree, defects and cost. False: the cost exceeds `limit`; the values are incomplete. */
bool repair_region_evaluate(repair_scratch *b, repair_region *p, double limit);

/* Deletes, inserts or moves one random member near a defect. False: there is no defect, or the insertion
 * failed. */
bool repair_region_modify(repair_region *p, rng *r);

/* Relaxes the active members and the members that they displace, then rebuilds the lists. False: a member
 * left its patch; the lists are stale. */
bool repair_region_relax(repair_scratch *b, repair_region *p);

#endif

/* repair_region: a small piece of a packing, taken out of it, in which particles are taken out, put in, and come to rest while all
 * around are held fast, see solver_repair_defects. Pairs push each other as in the solve, and so do those of other sheets, which are
 * held. Nothing here is shared between workers. */
#ifndef HEXAD_SOLVER_MEND_PIECE_H
#define HEXAD_SOLVER_MEND_PIECE_H

#include "packing/pair.h"
#include "solver/particles/random_streams.h"
#include "solver/passes/passes.h"

enum {
    REPAIR_REGION_MOST = 256,
    REPAIR_FREE_MOST = 96,
    REPAIR_PAIRS_MOST = 64,
    REPAIR_LIST_MOST = REPAIR_PAIRS_MOST * REPAIR_REGION_MOST
};

typedef struct repair_region {
    const field *field;   /* of its patch */
    uint32_t count, free; /* the first `free` move */
    int disordered;       /* of the judged */
    double cost;
    vec3 x[REPAIR_REGION_MOST], normal[REPAIR_REGION_MOST];
    double h[REPAIR_REGION_MOST];
    bool judged[REPAIR_REGION_MOST];
    bool awake[REPAIR_REGION_MOST];     /* it may have to move */
    uint8_t degree[REPAIR_REGION_MOST]; /* of the judged, else 6 */
    uint32_t hint[REPAIR_REGION_MOST];  /* of its place on the field */
    /* of what lies within VORONOI_REACH, as it was last looked for */
    uint32_t begin[REPAIR_REGION_MOST], listed[REPAIR_REGION_MOST], list[REPAIR_LIST_MOST];
} repair_region;

/* What a worker has. */
typedef struct repair_scratch {
    const solver *s;
    double mean; /* of the spacing that cells have over the requested one, all over the packing */
    repair_region as_is, current, tried;
    pair_list pairs;
    double number[9][REPAIR_PAIRS_MOST]; /* of `pairs` */
} repair_scratch;

void repair_scratch_begin(repair_scratch *b, const solver *s);

/* Lists of all. */
void repair_region_list(repair_region *p);

/* How many are judged that have other than six neighbours between the shells: nearly as many as are disordered, and sooner
 * found. */
int repair_region_guess(const repair_region *p);

/* Sets degrees, `disordered` and `cost`. False, where it costs more than `limit`: they are not all set then. */
bool repair_region_judge(repair_scratch *b, repair_region *p, double limit);

/* Takes one out, puts one in, or moves one to another place, somewhere near disorder. False: there is none, or no place. */
bool repair_region_change(repair_region *p, rng *r);

/* Those that are awake come to rest, and who is pushed by them; lists are of their new places. False, and lists are not: one
 * has left its patch. */
bool repair_region_settle(repair_scratch *b, repair_region *p);

#endif

/* mend_piece: a small piece of a packing, taken out of it, in which particles are taken out, put in, and come to rest while all
 * around are held fast, see sampler_mend. Pairs push each other as in the solve, and so do those of other sheets, which are
 * held. Nothing here is shared between workers. */
#ifndef HEXAD_SAMPLER_MEND_PIECE_H
#define HEXAD_SAMPLER_MEND_PIECE_H

#include "packing/pair.h"
#include "particles/random_streams.h"
#include "sampler/sampler_internal.h"

enum {
    MEND_PIECE_MOST = 256,
    MEND_FREE_MOST = 96,
    MEND_PAIRS_MOST = 64,
    MEND_LIST_MOST = MEND_PAIRS_MOST * MEND_PIECE_MOST
};

typedef struct mend_piece {
    const field *field;   /* of its patch */
    uint32_t count, free; /* the first `free` move */
    int disordered;       /* of the judged */
    double cost;
    vec3 x[MEND_PIECE_MOST], normal[MEND_PIECE_MOST];
    double h[MEND_PIECE_MOST];
    bool judged[MEND_PIECE_MOST];
    bool awake[MEND_PIECE_MOST];     /* it may have to move */
    uint8_t degree[MEND_PIECE_MOST]; /* of the judged, else 6 */
    uint32_t hint[MEND_PIECE_MOST];  /* of its place on the field */
    /* of what lies within VORONOI_REACH, as it was last looked for */
    uint32_t begin[MEND_PIECE_MOST], listed[MEND_PIECE_MOST], list[MEND_LIST_MOST];
} mend_piece;

/* What a worker has. */
typedef struct mend_bench {
    const sampler *s;
    double mean; /* of the spacing that cells have over the requested one, all over the packing */
    mend_piece as_is, current, tried;
    pair_list pairs;
    double number[9][MEND_PAIRS_MOST]; /* of `pairs` */
} mend_bench;

void mend_bench_begin(mend_bench *b, const sampler *s);

/* Lists of all. */
void mend_piece_list(mend_piece *p);

/* How many are judged that have other than six neighbours between the shells: nearly as many as are disordered, and sooner
 * found. */
int mend_piece_guess(const mend_piece *p);

/* Sets degrees, `disordered` and `cost`. False, where it costs more than `limit`: they are not all set then. */
bool mend_piece_judge(mend_bench *b, mend_piece *p, double limit);

/* Takes one out, puts one in, or moves one to another place, somewhere near disorder. False: there is none, or no place. */
bool mend_piece_change(mend_piece *p, rng *r);

/* Those that are awake come to rest, and who is pushed by them; lists are of their new places. False, and lists are not: one
 * has left its patch. */
bool mend_piece_settle(mend_bench *b, mend_piece *p);

#endif

/* random_streams: who draws random numbers. Each user has a stream of its own below the job's seed (rng_seed), so that
 * one that draws more or less changes nothing for the others. A number here is part of the results: another number
 * gives other bytes. */
#ifndef HEXAD_SOLVER_RANDOM_STREAMS_H
#define HEXAD_SOLVER_RANDOM_STREAMS_H

enum random_stream {
    RANDOM_STREAM_START = 1,       /* first places of particles */
    RANDOM_STREAM_REPLACEMENT = 2, /* new places of particles that were lost */
    RANDOM_STREAM_REFINEMENT = 3,  /* particles that no edge of the coarser packing gave */
    RANDOM_STREAM_BEND = 4,        /* where curvature is looked at to plan the levels */
    /* These two share a number and never run in one job: only the method sized has coherent sequences. */
    RANDOM_STREAM_FRAME_TRANSFER = 5, /* places where points may be born */
    RANDOM_STREAM_SWARM_LIFE = 5,     /* fission and death of Witkin and Heckbert */
    RANDOM_STREAM_SWARM_SCALE = 6,    /* where curvature is looked at for their radii */
    RANDOM_STREAM_RELOCATION = 7,     /* places for particles that crowd */
    RANDOM_STREAM_ROUND = 256,        /* insertion and deletion: plus the number of the round, from 1 */
    RANDOM_STREAM_MENDING = 65536     /* plus the pass, and 2^32 times that plus the middle of a piece */
};

#endif

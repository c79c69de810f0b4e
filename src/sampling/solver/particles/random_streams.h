// SPDX-License-Identifier: Apache-2.0
/* random_streams: the random number streams of the solver. Each user of random numbers has its own stream
 * below the job's seed (rng_seed), so that the number of draws of one user does not affect another.
 * Changing a number here changes the results. */
#ifndef HEXAD_SAMPLING_SOLVER_PARTICLES_RANDOM_STREAMS_H
#define HEXAD_SAMPLING_SOLVER_PARTICLES_RANDOM_STREAMS_H

enum random_stream {
    RANDOM_STREAM_START = 1,   /* initial positions of particles */
    RANDOM_STREAM_REPLACEMENT, /* new positions of particles whose projection failed */
    RANDOM_STREAM_REFINEMENT,  /* particles of a finer level beyond the edges of the coarser packing */
    RANDOM_STREAM_CURVATURE,   /* curvature samples for the level plan */
    /* The next two share a number, but never occur in one job. FRAME_TRANSFER is used by coherent sequences,
     * which only the method `sized` has; Witkin and Heckbert's is another method. */
    RANDOM_STREAM_FRAME_TRANSFER, /* candidate positions of new points in the next frame */
    RANDOM_STREAM_WITKIN_HECKBERT =
        RANDOM_STREAM_FRAME_TRANSFER,    /* fission and death of Witkin and Heckbert */
    RANDOM_STREAM_WITKIN_HECKBERT_RADII, /* curvature samples for the radii of Witkin and Heckbert */
    RANDOM_STREAM_RELOCATION,            /* candidate positions of over-dense particles */
    RANDOM_STREAM_AVOIDED,     /* samples of the surface, at which distances from given points are taken */
    RANDOM_STREAM_ROUND = 256, /* insertion and deletion: plus the number of the round, from 1 */
    /* defect repair: REPAIR + pass for the order of the defects; REPAIR + (pass * 2^32) + particle for the
     * repair region about a particle */
    RANDOM_STREAM_REPAIR = 65536,
    /* plus the particle: its weight at borders; blue noise has no defect repair */
    RANDOM_STREAM_BLUE_NOISE = RANDOM_STREAM_REPAIR
};

#endif

// SPDX-License-Identifier: Apache-2.0
/* worker_contract: the public interface of hexad-worker for programs that start it: the executor, a farm
 * manager, a script.
 *
 * hexad-worker and src/service/executor both include this header, so that the two sides agree.
 * ARCHITECTURE.md describes the contract. job/phases/progress.h lists the phases of progress lines. These
 * values are public: changing one breaks callers of hexad-worker.
 */
#ifndef HEXAD_BASE_CORE_WORKER_CONTRACT_H
#define HEXAD_BASE_CORE_WORKER_CONTRACT_H

/* Exit status of the commands run, estimate and inspect. */
typedef enum worker_exit {
    WORKER_EXIT_CONVERGED = 0, /* for estimate and inspect: succeeded */
    WORKER_EXIT_INTERNAL = 1,  /* any error without a code of its own */
    WORKER_EXIT_SPEC = 2,      /* the spec is invalid or requests something not supported */
    WORKER_EXIT_INPUT = 3,     /* an input file is missing, damaged, forbidden or not supported */
    WORKER_EXIT_SURFACE = 4,   /* there is no surface */
    WORKER_EXIT_LIMIT = 5,     /* a limit of memory or time was exceeded */
    WORKER_EXIT_CANCELLED = 6, /* by SIGTERM or SIGINT */
    WORKER_EXIT_STORAGE = 7,   /* a disk is full or failed */
    WORKER_EXIT_NOT_CONVERGED = 10,
    WORKER_EXIT_UNRESOLVED = 11 /* outcome unresolved: the points do not represent the surface */
} worker_exit;

/* Commands: hexad-worker COMMAND SPEC|- [OPTION VALUE]... */
#define WORKER_COMMAND_RUN "run"
#define WORKER_COMMAND_ESTIMATE "estimate"
/* has a FILE as argument; for -, standard input is {"path": FILE} */
#define WORKER_COMMAND_INSPECT "inspect"
#define WORKER_SPEC_ON_STDIN "-"

/* Names of options, without the two dashes. */
#define WORKER_OPTION_OUTPUT "output"           /* directory for the results */
#define WORKER_OPTION_PROGRESS_FD "progress-fd" /* descriptor for progress, as JSON lines */
#define WORKER_OPTION_INPUT_ROOT "input-root"   /* may be repeated */
#define WORKER_OPTION_MEMORY_MB "memory-mb"
#define WORKER_OPTION_MOST_MEMORY_MB "most-memory-mb" /* the largest limits.memory_mb that advice may name */
#define WORKER_OPTION_THREADS "threads"
#define WORKER_OPTION_FRAME "frame"
#define WORKER_OPTION_PREVIOUS "previous" /* results of the previous frame */
#define WORKER_OPTION_SANDBOX "sandbox"
/* of `run`, instead of the output directory: the descriptor to which the result, or the error, is written as arrays
 * (job/phases/result_arrays.h). The format may change: both sides must be of one build. */
#define WORKER_OPTION_ARRAYS_FD "arrays-fd"

/* Minimum memory limit: the program, its libraries, and a small job. */
#define WORKER_MEMORY_LEAST_MB 64

/* Files in the output directory. `run` writes the report last: a directory without it is not a result. */
#define WORKER_REPORT_NAME "report.json"
/* The short members of the report that the daemon reads: outcome, count, outputs, inputs, ratings,
 * outcome_reasons, advice and surface.warnings, and report_bytes and report_sha256, length and hash of the report. The worker writes the file before the report and does not flush it to disk. If it is damaged,
 * readers use the report. */
#define WORKER_SUMMARY_NAME "summary.json"
/* With WORKER_OPTION_PROGRESS_FD: some points of the running job, replaced every 2 s during the relaxation.
 * The worker removes it before it writes the report. */
#define WORKER_SNAPSHOT_NAME "snapshot.ply"
/* The end of the names of files that refer to the results of all frames. They belong in the directory that
 * contains the directories of the frames. Code that copies a result to another place puts them there. */
#define WORKER_STAGE_ENDING "_stage.usda"
/* The picture of a result; the daemon makes thumbnails from it. */
#define WORKER_PREVIEW_NAME "preview.png"
#define WORKER_ESTIMATE_NAME "estimate.json"
#define WORKER_INSPECTION_NAME "inspection.json"

#endif

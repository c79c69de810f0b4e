// SPDX-License-Identifier: Apache-2.0
/* engine_data: data shared by the tasks of the Slurm engine; internal to src/service/slurm.
 *
 * One task submits, cancels and lists (service/slurm/sbatch, service/slurm/listing) and stores the states
 * that Slurm reports. The task of the files (service/slurm/attempt_inspection) decides when an attempt has
 * ended. The supervisor starts, polls, cancels and settles attempts. `mutex` guards all members; no thread
 * holds it while it waits for a file or a command. The supervisor frees an attempt only after the task of the
 * files has ended it, or leaves it to slurm_close. Only the task of the files keeps a pointer to an attempt
 * without holding the mutex.
 */
#ifndef HEXAD_SERVICE_SLURM_ENGINE_DATA_H
#define HEXAD_SERVICE_SLURM_ENGINE_DATA_H

#include <pthread.h>
#include <sys/queue.h>

#include "service/slurm/attempt_files.h"
#include "service/slurm/slurm.h"
#include "service/slurm/state.h"

/* Maximum number of tasks of an array: one less than Slurm's default of MaxArraySize. */
#define SLURM_TASKS_MOST 1000

/* One task of a job array. */
typedef struct slurm_task {
    const slurm_state *state; /* NULL: not listed yet */
    uint64_t listing;         /* number of the listing that showed it last, or of its submission */
    int64_t seen_ms;          /* time of that listing, monotonic */
    char host[65];
    char reason[64]; /* reason why it waits */
    /* number of attempts that only this task may run and that are neither ended nor cancelled */
    size_t wanted;
} slurm_task;

typedef struct slurm_batch {
    char *name;
    size_t task_count;
    slurm_task *tasks;
    bool shared; /* any task may run any attempt, also of other shared batches with equal needs */
    /* name of the list of these attempts (service/slurm/attempt_files); NULL: none, or of an earlier
     * daemon */
    char *list;
    /* shared: number of attempts that are neither ended nor cancelled and that no task is known to have
     * claimed */
    size_t open;
    size_t wanted; /* `open` plus the attempts of all tasks */
    size_t users;  /* number of references: attempts, and a submission in progress */
    bool runs;     /* at the last inspection a task seemed to run */
    size_t waiter; /* index of a task that waited at the last inspection; task_count: none */
    LIST_ENTRY(slurm_batch) link;
} slurm_batch;

struct engine_attempt {
    slurm *place;
    /* name of the attempt; its directory in farm/; the directory of its results */
    char *name, *directory, *out;
    /* options of sbatch, one per line; attempts with equal options may be submitted together */
    char *needs;
    double timeout_s;                 /* 0: none */
    int chunk;                        /* see engine_request; -1: none */
    bool small, alone;                /* may share a task; must be submitted separately */
    int64_t since_ms;                 /* arrival, monotonic */
    bool resumed;                     /* an earlier daemon had started it */
    int64_t not_before_ms;            /* earliest time of the next submission, monotonic; 0: at once */
    slurm_batch *batch;               /* NULL: not submitted */
    size_t task;                      /* the task that has claimed it or was assigned to it */
    bool is_claimed;                  /* the task is known to have claimed it */
    bool has_predecessor;             /* the task had run other attempts before */
    bool refused;                     /* by sbatch; ending.why has the reason */
    bool cancelled, forced, notified; /* must end; must be killed; the node has been notified */
    int64_t began_ms;                 /* start of the worker, monotonic; INT64_MAX: not yet */
    char host[ENGINE_HOST_SIZE];      /* on which it began; "": not known yet */
    /* time at which the end of its task, or of its worker, was noticed; 0: not yet */
    int64_t over_ms, stopped_ms;
    /* time since which its ending cannot be read; 0: it can be read. Used by the task of the files only */
    int64_t unread_ms;
    int64_t offset;       /* number of bytes of its progress that were read */
    char reason[64];      /* why it waits, as last reported to the executor */
    char *fresh, *newest; /* progress lines: not polled yet; polled last */
    bool ended;
    bool left; /* the executor has left it and may have been freed */
    engine_ending ending;
    TAILQ_ENTRY(engine_attempt) link;
};

/* Nodes that failed before a worker started. They are excluded for some time, since such a node would fail
 * all attempts. */
#define AVOIDED_MOST 16
typedef struct slurm_avoided {
    char host[65];
    int64_t until_ms; /* monotonic */
} slurm_avoided;

struct slurm {
    slurm_settings settings;
    char *farm;   /* work_dir/farm */
    char *prefix; /* of the names of jobs; NULL until the first attempt, which supplies the instance */
    int wake_fd;  /* of the executor; -1: not known yet */
    TAILQ_HEAD(, engine_attempt) attempts; /* by arrival */
    LIST_HEAD(, slurm_batch) batches;
    size_t attempt_count;
    uint64_t listing;           /* number of the last listing */
    size_t open;                /* sum over all batches */
    bool sharing;               /* at the last inspection a task of a shared batch ran */
    uint64_t serial;            /* next serial number for names of jobs */
    int64_t newest_ms;          /* arrival of the last attempt, monotonic */
    bool more;                  /* more attempts of the chunk of the last one arrive */
    int64_t list_due_ms;        /* monotonic */
    int quiet;                  /* number of listings without attempts or jobs */
    bool away;                  /* Slurm did not answer the last command */
    attempt_files_names strays; /* jobs of this service without an attempt to run, in the last listing */
    slurm_avoided avoided[AVOIDED_MOST];
    size_t avoided_next; /* index of the oldest */
    char **trash;        /* directories to remove */
    size_t trash_count;
    pthread_mutex_t mutex;
    runner_task *commands, *files;
};

/* ---- The caller holds the mutex. */

/* Adds the attempt to the batch and assigns it to this task. */
void slurm_enter(engine_attempt *a, slurm_batch *b, size_t task);
/* Records that this task, of the attempt's batch or of another one, has claimed it. */
void slurm_take(engine_attempt *a, const attempt_files_batch *by);
/* Stops counting the attempt for its batch and task, because it has ended or was cancelled. */
void slurm_forsake(engine_attempt *a);
/* Removes the attempt from its batch. The batch is freed with its last reference. */
void slurm_leave(engine_attempt *a);
void slurm_batch_release(slurm_batch *b);
slurm_batch *slurm_batch_find(slurm *s, const char *name);
slurm_batch *slurm_batch_new(slurm *s, const char *name, bool shared);
/* Makes the next listing due at once, since there may be tasks to cancel. */
void slurm_list_soon(slurm *s);
/* The task with this number; the array of tasks is extended if necessary. */
slurm_task *slurm_batch_task(slurm *s, slurm_batch *b, size_t number);

/* ---- The caller does not hold the mutex. */

/* Submits the attempts that wait. Returns the time of the next check, monotonic. */
int64_t slurm_submit(slurm *s);

/* Lists all jobs of this service in Slurm, and cancels those without an attempt to run. */
void slurm_list(slurm *s);

/* Examines the files of all attempts, and ends the attempts that have ended. */
void slurm_inspect(slurm *s);

#endif

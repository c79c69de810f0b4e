/* place: what the threads of the Slurm engine share; of no use to others.
 *
 * The commands thread (slurm/submission, slurm/listing) fills in the states that Slurm reports. The files thread
 * (slurm/inspection) decides when an attempt has ended. The supervisor starts, polls, cancels and settles attempts.
 * `mutex` guards all members; no thread holds it while it waits for a file or a command. The supervisor frees an attempt
 * only after the files thread has ended it, or leaves it to slurm_close, and no thread but the files thread keeps a
 * pointer to one without the mutex.
 */
#ifndef HEXAD_SLURM_PLACE_H
#define HEXAD_SLURM_PLACE_H

#include <pthread.h>

#include "slurm/attempt_files.h"
#include "slurm/slurm.h"
#include "slurm/state.h"

/* Tasks of an array: one less than Slurm's default of MaxArraySize. */
#define SLURM_TASKS_MOST 1000

/* One task of a job array. */
typedef struct slurm_task {
    const slurm_state *state; /* NULL: not seen yet */
    uint64_t listing;         /* when it was seen last, or submitted */
    int64_t seen_ms;          /* the same, monotonic */
    char host[65];
    char reason[64]; /* why it waits */
    size_t wanted;   /* attempts that only it runs, and that are neither ended nor cancelled */
} slurm_task;

typedef struct slurm_batch {
    char *name;
    size_t task_count;
    slurm_task *tasks;
    bool shared; /* any task may run any attempt, also of other such batches of equal needs */
    char *list;  /* of these attempts (slurm/attempt_files); NULL: none, or of an earlier daemon */
    size_t
        open; /* shared: attempts that are neither ended nor cancelled, and that no task is known to have claimed */
    size_t wanted; /* these, and those of all tasks */
    size_t users;  /* attempts, and a submission under way */
    bool runs;     /* a task runs, for all that is known; as of the last inspection */
    size_t waiter; /* a task that waits, likewise; task_count: none does */
    struct slurm_batch *next;
} slurm_batch;

struct engine_attempt {
    slurm *place;
    char *name, *directory, *out; /* of the attempt; its directory in farm/; where its results go */
    char *needs;                  /* options of sbatch, one a line: equal ones may be submitted together */
    double timeout_s;             /* 0: none */
    bool small, alone;            /* may share a task; is not submitted with others any more */
    int64_t since_ms;             /* monotonic: when it came */
    bool resumed;                 /* it came to an earlier daemon */
    int64_t not_before_ms;        /* monotonic: when to submit again; 0: at once */
    slurm_batch *batch;           /* NULL: it waits here */
    size_t task;                  /* that has it, or was given it */
    bool taken;                   /* the task is known to have it */
    bool late;                    /* the task ran others before */
    bool refused;                 /* by sbatch, for the reason in ending.why */
    bool cancelled, forced, told; /* to end; to be killed; its node has been notified */
    int64_t began_ms;             /* monotonic; INT64_MAX: not yet */
    int64_t over_ms, stopped_ms;  /* when it was first seen so; 0: not yet */
    int64_t unread_ms;    /* since when its ending cannot be read; 0: it can. For the files thread only */
    int64_t offset;       /* of what was read of its progress */
    char reason[64];      /* why it waits, as last reported to the executor */
    char *fresh, *newest; /* progress lines: to be polled, the last that was */
    bool ended;
    bool left; /* the executor may be gone */
    engine_ending ending;
    struct engine_attempt *next;
};

/* A node that could not run an attempt: jobs go to others for a while, since it would fail them all at once. */
#define AVOIDED_MOST 16
typedef struct slurm_avoided {
    char host[65];
    int64_t until_ms; /* monotonic */
} slurm_avoided;

struct slurm {
    slurm_settings settings;
    char *farm;   /* work_dir/farm */
    char *prefix; /* of the names of jobs; NULL until the first attempt, which has the instance */
    int wake_fd;  /* the executor's; -1: not known yet */
    engine_attempt *first, **last;
    slurm_batch *batches;
    size_t attempt_count;
    uint64_t listing;           /* number of the last one */
    size_t open;                /* of all batches together */
    bool sharing;               /* a task of a shared batch runs, as of the last inspection */
    uint64_t serial;            /* of names */
    int64_t newest_ms;          /* monotonic: when the last attempt came */
    bool news;                  /* for the commands thread, since it last looked */
    int64_t list_due_ms;        /* monotonic */
    int quiet;                  /* listings since there was something to look for */
    bool away;                  /* Slurm did not answer the last command */
    attempt_files_names strays; /* our jobs without an attempt to run, in the last listing */
    slurm_avoided avoided[AVOIDED_MOST];
    size_t avoided_next; /* the oldest */
    char **trash;        /* directories to be removed */
    size_t trash_count;
    bool closing;
    pthread_mutex_t mutex;
    pthread_cond_t commands_due, files_due;
    pthread_t commands, files;
};

/* ---- all with the mutex held */

/* The attempt is one of the batch, to be run by this task. */
void slurm_enter(engine_attempt *a, slurm_batch *b, size_t task);
/* This task has taken it, of its batch or of another. */
void slurm_take(engine_attempt *a, const attempt_files_batch *by);
/* The attempt has ended or is cancelled: it no longer counts for its batch and task. */
void slurm_forsake(engine_attempt *a);
/* The attempt leaves its batch, which is freed with its last user. */
void slurm_leave(engine_attempt *a);
void slurm_batch_release(slurm *s, slurm_batch *b);
slurm_batch *slurm_batch_find(slurm *s, const char *name);
slurm_batch *slurm_batch_new(slurm *s, const char *name, bool shared);
/* The next listing is due at once: there may be tasks to cancel. */
void slurm_list_soon(slurm *s);
/* Makes room for a task with this number. */
slurm_task *slurm_batch_task(slurm *s, slurm_batch *b, size_t number);

/* ---- without it */

/* Submits what waits. Returns when to look again, monotonic. */
int64_t slurm_submit(slurm *s);

/* Lists all jobs of this service in Slurm, and cancels those without an attempt to run. */
void slurm_list(slurm *s);

/* Looks at the files of all attempts, and ends those that have ended. */
void slurm_inspect(slurm *s);

#endif

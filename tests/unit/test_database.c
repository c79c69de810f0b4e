// SPDX-License-Identifier: Apache-2.0
/* The database of the queue: durability, threads, versions, and locks. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <errno.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "service/database/database.h"
#include "service/database/filesystem.h"
#include "service/database/lock.h"
#include "queue_place.h"

/* Number of further calls that report that another process has the lock. */
static int refusals;

/* Replaces the function of the C library. */
int flock(int fd, int operation)
{
    if (refusals <= 0) return (int)syscall(SYS_flock, fd, operation);
    refusals--;
    errno = EWOULDBLOCK;
    return -1;
}

static void *put_one(void *argument)
{
    char id[ULID_SIZE];
    put(argument, "from a thread", 0, id);
    return NULL;
}

static int64_t note(void *context)
{
    sem_post(context);
    return RUNNER_WHEN_WOKEN;
}

static void test_a_change_wakes_the_tasks_that_wait(void **state)
{
    place *p = *state;
    sem_t steps;
    runner *r = runner_new();
    sem_init(&steps, 0, 0);
    queue_wake_on_change(p->q, runner_add(r, "waiting", note, &steps));
    assert_true(runner_start(r, NULL));
    sem_wait(&steps); /* the first one needs no change */
    put_one(p);
    sem_wait(&steps);
    uint64_t changes = database_change_count(queue_database(p->q));
    claim_in(p, &(queue_resources){.threads = 0, .all_threads = 1, .all_memory_mb = 1000}, NULL);
    assert_int_equal(database_change_count(queue_database(p->q)), changes); /* nothing was claimed */
    queue_signal(p->q);
    sem_wait(&steps);
    runner_stop(r);
    runner_free(r);
    sem_destroy(&steps);
}

typedef struct swarm {
    place *p;
    char id[50][ULID_SIZE];
} swarm;

static void *put_many(void *argument)
{
    swarm *s = argument;
    for (int i = 0; i < 50; i++) put(s->p, "of many", 0, s->id[i]);
    return NULL;
}

static void *put_many_at_low_priority(void *argument)
{
    return setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + 1) == 0 ? put_many(argument) : NULL;
}

/* Threads of both priorities share transactions; each of their jobs is stored once. */
static void test_many_threads_submit(void **state)
{
    place *p = *state;
    enum { THREADS = 8 };
    static swarm swarms[THREADS];
    pthread_t thread[THREADS];
    for (int i = 0; i < THREADS; i++) {
        swarms[i].p = p;
        assert_int_equal(
            pthread_create(&thread[i], NULL, i % 2 ? put_many : put_many_at_low_priority, &swarms[i]), 0);
    }
    for (int i = 0; i < THREADS; i++) assert_int_equal(pthread_join(thread[i], NULL), 0);
    reopen(p);
    for (int i = 0; i < THREADS; i++)
        for (int k = 0; k < 50; k++) expect_state(p, swarms[i].id[k], QUEUE_QUEUED);
    int64_t in_state[QUEUE_STATE_COUNT];
    assert_true(queue_count(p->q, in_state, NULL));
    assert_int_equal(in_state[QUEUE_QUEUED], THREADS * 50);
}

typedef struct noted_change {
    change change;
    database *d;
    int own_nice, nice; /* of the requesting thread, and of the thread that applies the change */
    pthread_t by;
} noted_change;

static bool note_thread(database *d, change *c)
{
    (void)d;
    noted_change *n = (noted_change *)(void *)c;
    n->nice = getpriority(PRIO_PROCESS, 0); /* of this thread (Linux) */
    n->by = pthread_self();
    return true;
}

static void *change_at_low_priority(void *argument)
{
    noted_change *n = argument;
    n->own_nice = getpriority(PRIO_PROCESS, 0) + 1;
    if (setpriority(PRIO_PROCESS, 0, n->own_nice) != 0 || !database_change(n->d, &n->change, NULL))
        return NULL;
    return n;
}

/* Otherwise changes of the usual priority would wait for a thread that rarely gets a processor. */
typedef struct recorded {
    change change;
    place *p;
    pthread_t thread;
    char name;
} recorded;

static char record[8];
static sem_t in_change, may_end;

static bool record_change(database *d, change *c)
{
    (void)d;
    record[strlen(record)] = ((recorded *)c)->name;
    if (((recorded *)c)->name != 'x') return true;
    sem_post(&in_change);
    sem_wait(&may_end);
    return true;
}

static void *run_recorded(void *argument)
{
    recorded *r = argument;
    assert_true(database_change(queue_database(r->p->q), &r->change, NULL));
    return NULL;
}

/* Starts a thread with the change, and waits until it is in a line. */
static void start_recorded(recorded *r)
{
    assert_int_equal(pthread_create(&r->thread, NULL, run_recorded, r), 0);
    while (r->change.user && !__atomic_load_n(&r->change.arrival, __ATOMIC_ACQUIRE)) sched_yield();
}

static void test_users_take_turns_with_changes_of_many_rows(void **state)
{
    place *p = *state;
    recorded all[] = {{.name = 'x'},
                      {.name = 'a', .change.user = "ann"},
                      {.name = 'b', .change.user = "ann"},
                      {.name = 'c', .change.user = "ann"},
                      {.name = 'd', .change.user = "ben"}};
    memset(record, 0, sizeof record);
    sem_init(&in_change, 0, 0);
    sem_init(&may_end, 0, 0);
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        all[i].p = p;
        all[i].change.apply = record_change;
        start_recorded(&all[i]);
        if (!i) sem_wait(&in_change); /* the others wait for this transaction */
    }
    sem_post(&may_end);
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) pthread_join(all[i].thread, NULL);
    assert_string_equal(record, "xadbc");
}

static void test_a_thread_of_low_priority_commits_nothing(void **state)
{
    place *p = *state;
    char *base = mem_printf("%s/other", p->base);
    assert_int_equal(mkdir(base, 0700), 0);
    const int connections_of_queue = connection_count;
    database *d = database_open(base, NULL);
    assert_non_null(d);
    noted_change usual = {.change.apply = note_thread, .d = d}, low = usual;
    const int nice = getpriority(PRIO_PROCESS, 0);
    assert_true(database_change(d, &usual.change, NULL));
    assert_true(pthread_equal(usual.by, pthread_self()));
    pthread_t thread;
    void *changed = NULL;
    assert_int_equal(pthread_create(&thread, NULL, change_at_low_priority, &low), 0);
    assert_int_equal(pthread_join(thread, &changed), 0);
    assert_ptr_equal(changed, &low);
    assert_int_equal(low.own_nice, nice + 1);
    assert_int_equal(low.nice, nice);
    database_close(d);
    connection_count = connections_of_queue; /* the others are closed */
    free(base);
}

typedef struct teller {
    place *p;
    int pipe;
} teller;

/* Submits jobs without end. Writes each acknowledged id to the pipe as a line, with one write. */
static void *put_and_tell(void *argument)
{
    const teller *t = argument;
    for (;;) {
        queue_receipt receipt;
        if (!queue_put(t->p->q, &plain, &receipt, NULL)) _exit(1);
        if (write(t->pipe, receipt.id, ULID_SIZE) != ULID_SIZE) _exit(1);
        bool found, accepted;
        queue_claimed claimed = {0};
        if (!queue_claim(t->p->q, &wide, &claimed, &found, NULL)) _exit(1);
        if (!found) continue;
        queue_fence fence = {claimed.job.id, claimed.task.number, claimed.task.attempt};
        if (!queue_finish(t->p->q, &fence, &success, &accepted, NULL)) _exit(1);
        queue_claimed_clear(&claimed);
    }
    return NULL;
}

static void check_integrity(place *p)
{
    queue_close(p->q);
    sqlite3 *raw = open_raw(p);
    sqlite3_stmt *s;
    assert_int_equal(sqlite3_prepare_v2(raw, "PRAGMA integrity_check", -1, &s, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_step(s), SQLITE_ROW);
    assert_string_equal((const char *)sqlite3_column_text(s, 0), "ok");
    sqlite3_finalize(s);
    /* the counts of jobs and owners equal those of their tasks */
    assert_int_equal(
        sqlite3_prepare_v2(
            raw,
            "SELECT (SELECT count(*) FROM job WHERE running != (SELECT count(*) FROM task WHERE"
            "  task.job = job.seq AND task.state = 'running')) + (SELECT count(*) FROM owner WHERE"
            "  running != (SELECT sum(running) FROM job WHERE job.owner = owner.name) OR unfinished !="
            "  (SELECT count(*) FROM job WHERE job.owner = owner.name AND finished_ms IS NULL))",
            -1, &s, NULL),
        SQLITE_OK);
    assert_int_equal(sqlite3_step(s), SQLITE_ROW);
    assert_int_equal(sqlite3_column_int(s, 0), 0);
    sqlite3_finalize(s);
    sqlite3_close(raw);
    p->q = NULL;
    reopen(p);
}

/* A process with eight threads is killed after this number of acknowledgements. All acknowledged jobs are
 * stored. */
static void test_a_killed_process_loses_nothing(void **state)
{
    place *p = *state;
    enum { THREADS = 8, ROUNDS = 2 };
    queue_close(p->q);
    p->q = NULL;
    for (int round = 0; round < ROUNDS; round++) {
        int ends[2];
        assert_int_equal(pipe(ends), 0);
        pid_t child = fork();
        if (child == 0) {
            pthread_t thread;
            teller t = {p, ends[1]};
            if (!(p->q = queue_open(p->base, NULL))) _exit(1);
            for (int i = 0; i < THREADS; i++) pthread_create(&thread, NULL, put_and_tell, &t);
            pthread_join(thread, NULL);
        }
        close(ends[1]);
        char(*id)[ULID_SIZE] = mem_alloc(100000 * sizeof *id);
        size_t count = 0, most = 20 + 74 * (size_t)round;
        while (count < 100000 && read(ends[0], id[count], ULID_SIZE) == ULID_SIZE)
            if (++count == most) kill(child, SIGKILL); /* then read the lines written until then */
        int status = 0;
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFSIGNALED(status));
        close(ends[0]);
        assert_true(count >= most);
        reopen(p);
        for (size_t i = 0; i < count; i++) queue_job_clear(&(queue_job[]){get(p, id[i])}[0]);
        check_integrity(p);
        queue_close(p->q);
        p->q = NULL;
        free(id);
    }
}

/* Removes the additions of version 22. */
#define BEFORE_22 "DROP TABLE upload;"

/* Removes the additions of version 21. */
#define BEFORE_21                                                                                                           \
    BEFORE_22                                                                                                               \
    "DROP TABLE ended; DROP INDEX job_pieces; DROP INDEX job_hidden; DROP INDEX task_uncopied; DROP INDEX removal_of_task;" \
    "DROP INDEX job_ready; ALTER TABLE job DROP COLUMN target; ALTER TABLE job DROP COLUMN target_from;"                    \
    "ALTER TABLE job DROP COLUMN target_message; ALTER TABLE job DROP COLUMN examine_from;"                                 \
    "ALTER TABLE job DROP COLUMN copy_from; ALTER TABLE owner DROP COLUMN tasks;"                                           \
    "CREATE INDEX job_ready ON job (owner, priority DESC, seq, threads, memory_mb)"                                         \
    "  WHERE ready > held AND pending = 0 AND is_paused = 0 AND"                                                            \
    "  (is_ordered = 0 OR running + delayed + first_held = 0)"                                                              \
    "  AND (max_running = 0 OR running < max_running) AND chunks_busy = 0;"

/* Removes the additions of version 20. Version 19 has the tables of version 18. */
#define BEFORE_20 \
    BEFORE_21     \
    "DROP INDEX input_of_all; ALTER TABLE input DROP COLUMN of_task; ALTER TABLE task DROP COLUMN file;"

static void test_results_of_version_18_are_not_reused(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    queue_ending ending = success;
    char id[ULID_SIZE], waits[ULID_SIZE], found_id[ULID_SIZE], *inputs = NULL;
    bool found;
    s.cache_key = ending.cache_key = "k";
    ending.cache_inputs = "[]";
    submit_for(p, &s, id);
    assert_true(finish(p, id, 0, claim(p, id), &ending));
    submit_for(p, &s, waits);
    assert_true(queue_recall(p->q, "k", found_id, &inputs, &found, NULL) && found);
    free(inputs);
    alter_database(p, BEFORE_20 "PRAGMA user_version = 18;");
    assert_true(queue_recall(p->q, "k", found_id, &inputs, &found, NULL) && !found);
    queue_claimed c = {0};
    assert_true(queue_claim_job(p->q, waits, &c, &found, NULL) && found);
    assert_null(c.cache_key);
    queue_claimed_clear(&c);
}

/* Removes the additions of version 18. */
#define BEFORE_18 BEFORE_20 "ALTER TABLE job DROP COLUMN cached_shown;"

/* Removes the additions of version 17. */
#define BEFORE_17                                                                   \
    BEFORE_18                                                                       \
    "DROP INDEX job_ready; ALTER TABLE job DROP COLUMN chunk;"                      \
    "ALTER TABLE job DROP COLUMN chunks_busy;"                                      \
    "CREATE INDEX job_ready ON job (owner, priority DESC, seq, threads, memory_mb)" \
    "  WHERE ready > held AND pending = 0 AND is_paused = 0 AND"                    \
    "  (is_ordered = 0 OR running + delayed + first_held = 0)"                      \
    "  AND (max_running = 0 OR running < max_running);"

/* Removes the additions of version 16. */
#define BEFORE_16                                                                                       \
    BEFORE_17                                                                                           \
    "DROP INDEX job_ready; DROP INDEX task_ready; DROP INDEX task_held;"                                \
    "ALTER TABLE job DROP COLUMN held; ALTER TABLE job DROP COLUMN first_held;"                         \
    "ALTER TABLE task DROP COLUMN waits; ALTER TABLE dependency DROP COLUMN by_frame;"                  \
    "CREATE INDEX task_ready ON task (job, number) WHERE state = 'queued';"                             \
    "CREATE INDEX job_ready ON job (owner, priority DESC, seq, threads, memory_mb)"                     \
    "  WHERE ready > 0 AND pending = 0 AND is_paused = 0 AND (is_ordered = 0 OR running + delayed = 0)" \
    "  AND (max_running = 0 OR running < max_running);"

/* Removes the additions of version 15. */
#define BEFORE_15                                                                   \
    BEFORE_16                                                                       \
    "DROP INDEX job_ready; ALTER TABLE job DROP COLUMN max_running;"                \
    "CREATE INDEX job_ready ON job (owner, priority DESC, seq, threads, memory_mb)" \
    "  WHERE ready > 0 AND pending = 0 AND is_paused = 0 AND (is_ordered = 0 OR running + delayed = 0);"

/* Removes the additions of version 14. */
#define BEFORE_14 BEFORE_15 "ALTER TABLE job DROP COLUMN accept;"

/* Removes the additions of version 13. */
#define BEFORE_13 BEFORE_14 "DROP INDEX job_undelivered;"

/* Removes the additions of version 12. */
#define BEFORE_12                                                                                \
    BEFORE_13                                                                                    \
    "ALTER TABLE service DROP COLUMN linked_reports; DROP TABLE output; DROP INDEX job_copying;" \
    "ALTER TABLE job DROP COLUMN copy_state; ALTER TABLE job DROP COLUMN copy_code;"             \
    "ALTER TABLE job DROP COLUMN copy_message; ALTER TABLE task DROP COLUMN copy_code;"          \
    "ALTER TABLE task DROP COLUMN copy_message;"                                                 \
    "DROP TABLE running; ALTER TABLE task DROP COLUMN wait_ms; ALTER TABLE outbox DROP COLUMN wait_ms;"

/* Restores the two outcomes of version 7. */
#define TWO_OUTCOMES(table)                                                                            \
    "ALTER TABLE " table " RENAME COLUMN outcome TO told;"                                             \
    "ALTER TABLE " table " ADD COLUMN outcome TEXT CHECK (outcome IN ('converged', 'not_converged'));" \
    "UPDATE " table " SET outcome = told; ALTER TABLE " table " DROP COLUMN told;"
#define SENT "sha256:0123456789012345678901234567890123456789012345678901234567890123"

/* In version 11 a job with a directory succeeded only if its result was copied. Reports of equal jobs were
 * one file. */
static void test_jobs_of_version_11_count_as_copied(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[2][ULID_SIZE];
    bool linked = true;
    assert_true(queue_has_linked_reports(p->q, &linked, NULL) && !linked);
    submit_for(p, &s, id[0]);
    s.directory = "/show/a";
    submit_for(p, &s, id[1]);
    for (int i = 0; i < 2; i++) assert_true(finish(p, id[i], 0, claim(p, id[i]), &success));
    alter_database(p, BEFORE_12 "PRAGMA user_version = 11;");
    assert_true(queue_has_linked_reports(p->q, &linked, NULL) && linked);
    assert_true(queue_note_own_reports(p->q, NULL) && queue_has_linked_reports(p->q, &linked, NULL));
    assert_false(linked);
    queue_job job = get(p, id[0]);
    assert_null(job.copy_state);
    queue_job_clear(&job);
    job = get(p, id[1]);
    assert_string_equal(job.copy_state, "delivered");
    queue_job_clear(&job);
}

/* In version 15 a job waited for the end of whole jobs only. */
static void test_jobs_of_version_15_wait_for_no_frames(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE];
    s.frames = (const int[]){1, 2};
    s.frame_count = 2;
    submit_for(p, &s, first);
    s.depends_on = (const char *[]){first};
    s.depends_on_count = 1;
    submit_for(p, &s, second);
    alter_database(p, BEFORE_16 "PRAGMA user_version = 15;");
    assert_true(finish(p, first, 0, claim(p, first), &success));
    expect_state(p, second, QUEUE_BLOCKED);
    assert_true(finish(p, first, 1, claim(p, first), &success));
    claim(p, second);
    claim(p, second);
}

static void expect_reason(place *p, const char *id, const char *reason)
{
    queue_attempt *attempts;
    size_t count;
    assert_true(queue_list_attempts(p->q, id, -1, 0, 9, &attempts, &count, NULL));
    assert_int_equal(count, 1);
    assert_string_equal(attempts[0].reason, reason);
    queue_attempts_free(attempts, count);
}

/* Version 17 showed every job whose result was reused. */
static void test_reused_results_of_version_17_are_shown_to_the_owner_of_both_jobs(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], gone[ULID_SIZE], later[4][ULID_SIZE];
    queue_ending ending = success;
    bool found, deleted;
    submit_for(p, &s, first);
    submit_for(p, &s, gone);
    assert_true(finish(p, first, 0, claim(p, first), &success));
    assert_true(finish(p, gone, 0, claim(p, gone), &success));
    for (int i = 0; i < 4;
         i++) { /* 0 of the same user, 1 of another one, 2 of a job that is deleted, 3 of none */
        s.owner = i == 1 ? "bob" : NULL;
        submit_for(p, &s, later[i]);
        ending.cached_from = i == 3 ? NULL : i == 2 ? gone : first;
        char *reason =
            mem_printf("the result of %s", ending.cached_from ? ending.cached_from : "an earlier attempt");
        ending.reason = reason;
        assert_true(finish(p, later[i], 0, claim(p, later[i]), &ending));
        free(reason);
    }
    assert_true(queue_delete(p->q, gone, &found, &deleted, NULL) && deleted);
    alter_database(p, BEFORE_18 "PRAGMA user_version = 17;");
    bool linked = false; /* the hashes of reports are examined */
    assert_true(queue_has_linked_reports(p->q, &linked, NULL) && linked);
    for (int i = 0; i < 4; i++) {
        queue_job job = get(p, later[i]);
        assert_int_equal(job.cached_from != NULL, i < 3);
        assert_int_equal(job.cached_shown, i == 0);
        queue_job_clear(&job);
        expect_reason(p, later[i],
                      i == 3 ? "the result of an earlier attempt" : "the result of an equal job");
    }
}

/* Version 16 claimed any tasks of an array. */
static void test_arrays_of_version_16_have_no_chunks(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[ULID_SIZE];
    s.frames = (const int[]){1, 2, 3};
    s.frame_count = 3;
    submit_for(p, &s, id);
    claim(p, id);
    alter_database(p, BEFORE_17 "PRAGMA user_version = 16;");
    claim(p, id);
    claim(p, id);
    s.chunk = 2;
    submit_for(p, &s, id);
    claim(p, id);
    claim(p, id);
    claim(p, NULL);
}

/* Version 14 did not limit the running tasks of a job. */
static void test_jobs_of_version_14_have_no_max_running(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[ULID_SIZE];
    s.frames = (const int[]){1, 2, 3};
    s.frame_count = 3;
    submit_for(p, &s, id);
    claim(p, id);
    alter_database(p, BEFORE_15 "PRAGMA user_version = 14;");
    claim(p, id);
    claim(p, id);
    s.max_running = 1;
    submit_for(p, &s, id);
    claim(p, id);
    claim(p, NULL);
}

/* In version 13 dependent jobs started with any outcome. Dependents of jobs of that version still do. */
static void test_any_outcome_of_a_job_of_version_13_is_accepted(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE];
    s.accept = QUEUE_OUTCOME_BIT(QUEUE_CONVERGED);
    submit_for(p, &s, first);
    s.depends_on = (const char *[]){first};
    s.depends_on_count = 1;
    submit_for(p, &s, second);
    alter_database(p, BEFORE_14 "PRAGMA user_version = 13;");
    queue_ending unresolved = success;
    unresolved.outcome = QUEUE_UNRESOLVED;
    assert_true(finish(p, first, 0, claim(p, first), &unresolved));
    expect_state(p, second, QUEUE_QUEUED);
}

/* A claim returns the limits and inputs of the submission. */
static void test_a_claim_returns_limits_and_inputs(void **state)
{
    place *p = *state;
    static const char *const inputs[] = {"sha256:b", "sha256:a", "sha256:b"};
    char id[ULID_SIZE];
    bool found = false;
    queue_claimed c;
    queue_submission s = plain;
    s.timeout_ms = 7;
    s.stall_ms = 9;
    s.directory = "/out";
    s.cache_key = "k";
    s.inputs = inputs;
    s.input_count = 3;
    submit_for(p, &s, id);
    assert_true(queue_claim_job(p->q, id, &c, &found, NULL) && found);
    assert_int_equal(c.timeout_ms, 7);
    assert_int_equal(c.stall_ms, 9);
    assert_string_equal(c.directory, "/out");
    assert_string_equal(c.cache_key, "k");
    assert_int_equal(c.input_count, 2);
    assert_string_equal(c.inputs[0], "sha256:a");
    assert_string_equal(c.inputs[1], "sha256:b");
    queue_claimed_clear(&c);
}

/* The reserve is the log file itself. It must never be read as the log of another database. */
static void test_the_reserve(void **state)
{
    place *p = *state;
    struct stat info, log;
    char id[ULID_SIZE], *reserve = mem_printf("%s/reserve", p->base),
                        *wal = mem_printf("%s/queue.db-wal", p->base);
    enum { BYTES = 1 << 20 };
    queue_reserve(p->q, BYTES);
    assert_int_equal(stat(reserve, &info), 0);
    assert_int_equal(stat(wal, &log), 0);
    assert_int_equal(info.st_ino, log.st_ino);
    assert_true(info.st_blocks * 512 >= BYTES);
    put(p, "first", 0, id);
    queue_close(p->q);
    p->q = NULL;
    assert_int_equal(stat(wal, &log), -1);
    ino_t kept = info.st_ino;
    reopen(p);
    assert_int_equal(stat(wal, &log), 0);
    assert_int_equal(log.st_ino, kept);
    assert_true(log.st_blocks * 512 >= BYTES);
    queue_job job = get(p, id);
    queue_job_clear(&job);
    queue_reserve(p->q, 0);
    assert_int_equal(stat(reserve, &info), -1);
    put(p, "second", 0, id);
    free(reserve);
    free(wal);
}

static size_t count_descriptors(void)
{
    size_t count = 0;
    DIR *d = opendir("/proc/self/fd");
    assert_non_null(d);
    while (readdir(d)) count++;
    closedir(d);
    return count;
}

static void test_changes_of_the_reserve_leave_no_descriptor_open(void **state)
{
    place *p = *state;
    const size_t before = count_descriptors();
    queue_reserve(p->q, 1 << 16);
    queue_reserve(p->q, 0);
    queue_reserve(p->q, 1 << 16);
    assert_int_equal(count_descriptors(), before);
}

static void test_a_job_is_refused_without_free_space(void **state)
{
    place *p = *state;
    queue_receipt receipt;
    char id[ULID_SIZE];
    put(p, "before", 0, id);
    queue_reserve(p->q, INT64_MAX / 2); /* more than any disk has */
    assert_true(queue_put(p->q, &plain, &receipt, NULL));
    assert_int_equal(receipt.admission, QUEUE_NO_SPACE);
    apply_command(p, id, QUEUE_CANCEL, true);
    bool found = false, deleted = false;
    assert_true(queue_delete(p->q, id, &found, &deleted, NULL));
    assert_true(found && deleted);
}

static void test_a_second_owner_is_refused(void **state)
{
    place *p = *state;
    error e = {0};
    assert_null(queue_open(p->base, &e));
    assert_non_null(strstr(e.message, "another hexad"));
    assert_non_null(strstr(e.message, p->base));
}

/* A restart within a second after a kill: the kernel has not ended the killed process yet. */
static void test_a_start_waits_for_the_lock_of_an_ending_process(void **state)
{
    (void)state;
    char base[] = "/tmp/hexad-lock-XXXXXX";
    error e = {0};
    bool in_use = false;
    assert_non_null(mkdtemp(base));
    refusals = 3;
    int fd = lock_take(base, NULL, &e);
    if (fd < 0) fail_msg("%s", e.message);
    close(fd);
    refusals = 1;
    assert_int_equal(lock_take(base, &in_use, NULL), -1); /* a caller with in_use does not wait */
    assert_true(in_use);
    refusals = 0;
    assert_true(store_remove(base, NULL));
}

static void test_a_newer_schema_is_refused(void **state)
{
    place *p = *state;
    queue_close(p->q);
    p->q = NULL;
    sqlite3 *raw = open_raw(p);
    assert_int_equal(sqlite3_exec(raw, "PRAGMA user_version = 99", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(raw);
    error e = {0};
    assert_null(queue_open(p->base, &e));
    assert_non_null(strstr(e.message, "version 99"));
}

static char *read_database(place *p)
{
    size_t length = 0;
    char *path = mem_printf("%s/queue.db", p->base), *text = NULL;
    FILE *from = fopen(path, "rb"), *to = open_memstream(&text, &length);
    assert_non_null(from);
    for (int c; (c = fgetc(from)) != EOF;) fprintf(to, "%02x", (unsigned)c);
    fclose(from);
    fclose(to);
    free(path);
    return text;
}

static void test_an_older_schema_is_refused_and_unchanged(void **state)
{
    place *p = *state;
    queue_close(p->q);
    p->q = NULL;
    for (int version = 1; version <= 10; version += 9) {
        sqlite3 *raw = open_raw(p);
        char *set = mem_printf("PRAGMA user_version = %d", version);
        assert_int_equal(sqlite3_exec(raw, set, NULL, NULL, NULL), SQLITE_OK);
        sqlite3_close(raw);
        char *before = read_database(p);
        error e = {0};
        assert_null(queue_open(p->base, &e));
        char *named =
            mem_printf("queue.db: the database of the queue has version %d, and this hexad converts "
                       "versions 11 to ",
                       version);
        assert_non_null(strstr(e.message, named));
        char *after = read_database(p);
        assert_string_equal(before, after);
        free(set);
        free(named);
        free(before);
        free(after);
    }
}

static void test_a_damaged_database_is_refused(void **state)
{
    place *p = *state;
    queue_close(p->q);
    p->q = NULL;
    char *path = mem_printf("%s/queue.db", p->base);
    assert_true(store_file_write(path, "this is no database, only text that stands in its place", 54, NULL));
    free(path);
    error e = {0};
    assert_null(queue_open(p->base, &e));
    assert_non_null(strstr(e.message, "queue.db"));
}

static void test_network_file_systems_are_known(void **state)
{
    place *p = *state;
    error e = {0};
    assert_string_equal(filesystem_network_name(0x6969), "NFS");
    assert_string_equal(filesystem_network_name(0xFFFFFFFFFF534D42), "CIFS"); /* the sign is extended */
    assert_null(filesystem_network_name(0xEF53));                             /* ext4 */
    assert_true(filesystem_check(p->base, &e));
    assert_false(filesystem_check("/nonexistent", &e));
    assert_non_null(strstr(e.message, "/nonexistent"));
}

static void test_ulids(void **state)
{
    (void)state;
    char early[ULID_SIZE], late[ULID_SIZE];
    ulid_make(1000, early);
    ulid_make(1001, late);
    assert_true(strcmp(early, late) < 0);
    ulid_make(1469918176385, early); /* the example of the specification */
    assert_memory_equal(early, "01aryz6s41", 10);
    assert_int_equal(ulid_time_ms(early), 1469918176385);
    assert_false(ulid_is_valid(""));
    assert_false(ulid_is_valid("../../../../etc/passwd0000"));
    assert_false(ulid_is_valid("01ARYPYB610000000000000000"));
    assert_false(ulid_is_valid("01arypyb6100000000000000000"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_a_change_wakes_the_tasks_that_wait),
        CASE(test_many_threads_submit),
        CASE(test_a_thread_of_low_priority_commits_nothing),
        CASE(test_users_take_turns_with_changes_of_many_rows),
        CASE(test_a_killed_process_loses_nothing),
        CASE(test_jobs_of_version_15_wait_for_no_frames),
        CASE(test_arrays_of_version_16_have_no_chunks),
        CASE(test_reused_results_of_version_17_are_shown_to_the_owner_of_both_jobs),
        CASE(test_jobs_of_version_14_have_no_max_running),
        CASE(test_any_outcome_of_a_job_of_version_13_is_accepted),
        CASE(test_jobs_of_version_11_count_as_copied),
        CASE(test_a_claim_returns_limits_and_inputs),
        CASE(test_the_reserve),
        CASE(test_changes_of_the_reserve_leave_no_descriptor_open),
        CASE(test_a_job_is_refused_without_free_space),
        CASE(test_a_second_owner_is_refused),
        CASE(test_a_newer_schema_is_refused),
        CASE(test_an_older_schema_is_refused_and_unchanged),
        CASE(test_results_of_version_18_are_not_reused),
        CASE(test_a_damaged_database_is_refused),
        CASE(test_network_file_systems_are_known),
        cmocka_unit_test(test_a_start_waits_for_the_lock_of_an_ending_process),
        cmocka_unit_test(test_ulids),
    };
    sqlite3_auto_extension((void (*)(void))note_connection);
    return cmocka_run_group_tests_name("database", tests, NULL, NULL);
}

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

/* A database of version 1 with one job of each state. */
static const char version_1[] =
    "CREATE TABLE job (seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, name TEXT,"
    " labels TEXT NOT NULL, state TEXT NOT NULL DEFAULT 'queued', outcome TEXT, priority INTEGER NOT NULL,"
    " created_ms INTEGER NOT NULL, started_ms INTEGER, finished_ms INTEGER, attempt INTEGER NOT NULL DEFAULT "
    "0,"
    " spent INTEGER NOT NULL DEFAULT 0, max_attempts INTEGER NOT NULL, error_code TEXT, error_message TEXT,"
    " spec TEXT NOT NULL) STRICT;"
    "CREATE INDEX job_waiting ON job (priority DESC, seq) WHERE state = 'queued';"
    "CREATE INDEX job_by_state ON job (state, seq);"
    "CREATE TABLE attempt (job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE, number INTEGER NOT "
    "NULL,"
    " started_ms INTEGER NOT NULL, finished_ms INTEGER, exit_status INTEGER, signal INTEGER,"
    " peak_memory_bytes INTEGER, reason TEXT, PRIMARY KEY (job, number)) STRICT, WITHOUT ROWID;"
    "INSERT INTO job VALUES (1, 'queued', 'n', '[\"x\"]', 'queued', NULL, 3, 10, 20, NULL, 1, 1, 3, NULL, "
    "NULL, 's');"
    "INSERT INTO job VALUES (2, 'running', NULL, '[]', 'running', NULL, 0, 10, 20, NULL, 2, 1, 3, NULL, "
    "NULL, 's');"
    "INSERT INTO job VALUES (3, 'cancelling', NULL, '[]', 'cancelling', NULL, 0, 10, 20, NULL, 1, 1, 3, "
    "NULL, NULL,"
    " 's');"
    "INSERT INTO job VALUES (4, 'succeeded', NULL, '[]', 'succeeded', 'not_converged', 0, 10, 20, 30, 1, 1, "
    "3, NULL,"
    " NULL, 's');"
    "INSERT INTO job VALUES (5, 'failed', NULL, '[]', 'failed', NULL, 0, 10, 20, 30, 1, 1, 3, 'internal', "
    "'why', 's');"
    "INSERT INTO attempt VALUES (1, 1, 20, 21, NULL, 11, NULL, 'signal 11');"
    "INSERT INTO attempt VALUES (2, 1, 20, 21, NULL, 11, NULL, NULL);"
    "INSERT INTO attempt VALUES (2, 2, 22, NULL, NULL, NULL, NULL, NULL);"
    "PRAGMA user_version = 1;";

static void test_an_older_schema_is_migrated(void **state)
{
    place *p = *state;
    queue_close(p->q);
    p->q = NULL;
    assert_true(store_remove(p->base, NULL));
    assert_true(store_directory_create(p->base, NULL));
    sqlite3 *raw = open_raw(p);
    assert_int_equal(sqlite3_exec(raw, version_1, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(raw);
    reopen(p);
    expect_state(p, "queued", QUEUE_QUEUED);
    expect_state(p, "running", QUEUE_RUNNING);
    expect_state(p, "cancelling", QUEUE_CANCELLING);
    expect_state(p, "failed", QUEUE_FAILED);
    queue_job job = get(p, "succeeded");
    assert_int_equal(job.outcome, QUEUE_NOT_CONVERGED);
    assert_string_equal(job.spec, "s");
    queue_job_clear(&job);
    assert_true(finish(p, "running", 0, 2, &success));
    queue_ending ending = {.state = QUEUE_CANCELLED, .exit_status = 6, .signal = -1};
    assert_true(finish(p, "cancelling", 0, 1, &ending));
    assert_int_equal(claim(p, "queued"), 2);
    assert_int_equal(apply_command(p, "failed", QUEUE_RETRY, true), QUEUE_QUEUED);
    queue_attempt *attempts;
    size_t count;
    assert_true(queue_list_attempts(p->q, "running", -1, 0, 100, &attempts, &count, NULL));
    assert_int_equal(count, 2);
    queue_attempts_free(attempts, count);
    char id[ULID_SIZE];
    put(p, "new", 0, id);
    expect_listed(p, &(queue_filter){.state = -1, .limit = 1}, (const char *[]){id}, 1);
    expect_listed(p, &(queue_filter){.state = -1, .limit = 9, .label = "x"}, (const char *[]){"queued"}, 1);
}

/* Removes the additions of version 18. */
#define BEFORE_18 "ALTER TABLE job DROP COLUMN cached_shown;"

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

/* Removes the additions of version 11. */
#define BEFORE_11 \
    BEFORE_12 "ALTER TABLE attempt DROP COLUMN waited_ms; ALTER TABLE attempt DROP COLUMN processor_ms;"

/* Removes the additions of version 10. */
#define BEFORE_10                                         \
    BEFORE_11                                             \
    "DROP INDEX job_by_priority; DROP INDEX job_by_name;" \
    "CREATE INDEX job_by_name ON job (name) WHERE name IS NOT NULL;"

/* Removes the additions of version 9. */
#define BEFORE_9                                                                                           \
    BEFORE_10                                                                                              \
    "DROP TRIGGER job_leaves; DROP TRIGGER job_is_adopted; DROP TRIGGER job_is_deleted; DROP TABLE usage;" \
    "DROP INDEX job_leaving; DROP INDEX job_leaving_of; DROP INDEX job_unmeasured;"                        \
    "ALTER TABLE job DROP COLUMN result_bytes; ALTER TABLE job DROP COLUMN delivered;"                     \
    "ALTER TABLE job DROP COLUMN delivered_ms; ALTER TABLE task DROP COLUMN is_delivered;"                 \
    "ALTER TABLE service DROP COLUMN results; ALTER TABLE service DROP COLUMN result_bytes;"

/* Restores the two outcomes of version 7. */
#define TWO_OUTCOMES(table)                                                                            \
    "ALTER TABLE " table " RENAME COLUMN outcome TO told;"                                             \
    "ALTER TABLE " table " ADD COLUMN outcome TEXT CHECK (outcome IN ('converged', 'not_converged'));" \
    "UPDATE " table " SET outcome = told; ALTER TABLE " table " DROP COLUMN told;"
#define BEFORE_8                              \
    BEFORE_9                                  \
    TWO_OUTCOMES("job")                       \
    TWO_OUTCOMES("task")                      \
    "ALTER TABLE job DROP COLUMN unresolved;" \
    "DROP INDEX job_by_name; DROP INDEX job_by_time; ALTER TABLE dependency DROP COLUMN any_end;"

/* Removes the additions of version 7. */
#define BEFORE_7                                                                                      \
    BEFORE_8                                                                                          \
    "DROP TABLE service; DROP TABLE owner;"                                                           \
    "CREATE TABLE owner (name TEXT PRIMARY KEY, unfinished INTEGER NOT NULL CHECK (unfinished >= 0)," \
    "  running INTEGER NOT NULL CHECK (running >= 0)) STRICT, WITHOUT ROWID;"                         \
    "INSERT INTO owner SELECT owner, count(*), sum(running) FROM job WHERE finished_ms IS NULL GROUP BY owner;"

/* Removes the additions of version 6. */
#define BEFORE_6                                                                     \
    BEFORE_7                                                                         \
    "ALTER TABLE outbox DROP COLUMN event; ALTER TABLE outbox DROP COLUMN ended_ms;" \
    "DROP TRIGGER job_comes; DROP TRIGGER job_turns; DROP TRIGGER job_goes; DROP TABLE state_count;"

/* Removes the additions of version 5. */
#define BEFORE_5                                                                               \
    BEFORE_6                                                                                   \
    "DROP TABLE instance; DROP TABLE removal; ALTER TABLE task DROP COLUMN interrupted;"       \
    "ALTER TABLE task DROP COLUMN storage_faults; DROP TABLE copy; DROP TABLE removed_events;" \
    "ALTER TABLE spec DROP COLUMN timeout_ms; ALTER TABLE spec DROP COLUMN stall_ms;"          \
    "ALTER TABLE spec DROP COLUMN directory; ALTER TABLE spec DROP COLUMN cache_key;"

/* Version 2 did not store paths with a spec. */
static void test_paths_are_added_to_version_2(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "before", 0, id);
    queue_close(p->q);
    p->q = NULL;
    sqlite3 *raw = open_raw(p);
    static const char as_it_was[] =
        "ALTER TABLE spec DROP COLUMN paths; ALTER TABLE task DROP COLUMN ran_ms; DROP TABLE input;" BEFORE_5
        "PRAGMA user_version = 2;";
    assert_int_equal(sqlite3_exec(raw, as_it_was, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(raw);
    reopen(p);
    queue_job job = get(p, id);
    assert_null(job.paths);
    queue_job_clear(&job);
    queue_receipt receipt;
    queue_submission s = {.labels = "[]", .spec = "{}", .paths = "[1]", .max_attempts = 1, .threads = 1};
    assert_true(queue_put(p->q, &s, &receipt, NULL));
    job = get(p, receipt.id);
    assert_string_equal(job.paths, "[1]");
    queue_job_clear(&job);
}

#define SENT "sha256:0123456789012345678901234567890123456789012345678901234567890123"

static void test_times_and_inputs_are_added_to_version_3(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    bool wanted = false;
    queue_submission s = plain;
    s.spec = "{\"surface\":{\"mesh\":{\"path\":\"" SENT ".obj\"}}}";
    submit_for(p, &s, id);
    assert_true(queue_wants_input(p->q, SENT, &wanted, NULL));
    assert_false(wanted); /* this version did not store it */
    queue_close(p->q);
    p->q = NULL;
    sqlite3 *raw = open_raw(p);
    static const char as_it_was[] =
        "ALTER TABLE task DROP COLUMN ran_ms; DROP TABLE input;" BEFORE_5 "PRAGMA user_version = 3;";
    assert_int_equal(sqlite3_exec(raw, as_it_was, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(raw);
    reopen(p);
    assert_int_equal(get_task(p, id, 0).ran_ms, 0);
    assert_true(queue_wants_input(p->q, SENT, &wanted, NULL));
    assert_true(wanted);
    apply_command(p, id, QUEUE_CANCEL, true);
    assert_true(queue_wants_input(p->q, SENT, &wanted, NULL));
    assert_false(wanted);
}

/* Version 4 did not record removed events; their numbers are missing. Of three jobs with one event each, the
 * given number of newest ones is removed, or the middle one. */
static void test_removed_events_are_found_in_version_4(void **state)
{
    place *p = *state;
    static const struct {
        const char *which;
        int64_t up_to;
    } cases[] = {{"0", 0}, {"seq = 2", 2}, {"seq = 3", 3}, {"1", 3}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char id[ULID_SIZE];
        queue_close(p->q);
        p->q = NULL;
        assert_true(store_remove(p->base, NULL));
        assert_true(store_directory_create(p->base, NULL));
        reopen(p);
        for (int k = 0; k < 3; k++) put(p, NULL, 0, id);
        char *as_it_was =
            mem_printf("DELETE FROM event WHERE %s; " BEFORE_5 "PRAGMA user_version = 4;", cases[i].which);
        alter_database(p, as_it_was);
        free(as_it_was);
        assert_int_equal(look_at_events(p).removed_up_to, cases[i].up_to);
    }
}

static void test_storage_is_added_to_version_4(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_copy *copies = NULL;
    size_t count = 0;
    put(p, "before", 0, id);
    queue_close(p->q);
    p->q = NULL;
    sqlite3 *raw = open_raw(p);
    assert_int_equal(sqlite3_exec(raw, BEFORE_5 "PRAGMA user_version = 4;", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(raw);
    reopen(p);
    assert_int_equal(get_task(p, id, 0).storage_faults, 0);
    assert_true(queue_list_copies(p->q, &copies, &count, NULL));
    assert_int_equal(count, 0);
    queue_copies_free(copies, count);
}

/* Version 8 stored neither the disk space of jobs nor deliveries. */
static void test_usage_is_added_to_version_8(void **state)
{
    place *p = *state;
    char kept[ULID_SIZE], failed[ULID_SIZE], id[ULID_SIZE];
    bool found = false;
    put(p, "kept", 0, kept);
    assert_true(finish(p, kept, 0, claim(p, kept), &success));
    put(p, "failed", 0, failed);
    assert_true(finish(p, failed, 0, claim(p, failed), &crash));
    alter_database(p, BEFORE_9 "PRAGMA user_version = 8;");
    for (int i = 0; i < 2; i++) {
        assert_true(queue_next_unmeasured(p->q, id, &found, NULL) && found);
        assert_true(queue_note_bytes(p->q, id, 10, NULL));
    }
    queue_usage usage;
    assert_true(queue_get_usage(p->q, &usage, NULL));
    assert_true(usage.all.bytes == 20 && usage.all.results == 2 && usage.count == 1);
    free(usage.user);
    queue_bound(p->q, &(queue_bounds){.all = {1, 1}, .user = {INT64_MAX, INT64_MAX}});
    assert_true(queue_next_leaving(p->q, id, &found, NULL) && found);
    assert_string_equal(id, failed);
}

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

/* Version 9 did not sort lists. */
static void test_orders_are_added_to_version_9(void **state)
{
    place *p = *state;
    char id[2][ULID_SIZE];
    put(p, "b", 0, id[0]);
    put(p, "A", 0, id[1]);
    alter_database(p, BEFORE_10 "PRAGMA user_version = 9;");
    queue_filter f = {.state = -1, .limit = 9, .order = QUEUE_BY_NAME, .rising = true};
    expect_listed(p, &f, (const char *[]){id[1], id[0]}, 2);
}

/* Version 6 had no turns: the oldest job was claimed first, whatever its owner. */
static void test_turns_are_added_to_version_6(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char ann[3][ULID_SIZE], bob[ULID_SIZE];
    s.owner = "ann";
    s.most_waiting = 3;
    for (int i = 0; i < 3; i++) submit_for(p, &s, ann[i]);
    s.owner = "bob";
    submit_for(p, &s, bob);
    int attempt = claim(p, ann[0]);
    alter_database(p, BEFORE_7 "PRAGMA user_version = 6;");
    s.owner = "ann";
    assert_int_equal(submit(p, &s).admission, QUEUE_TOO_MANY);
    assert_true(finish(p, ann[0], 0, attempt, &success));
    claim(p, ann[1]);
    claim(p, bob);
    claim(p, ann[2]);
    claim(p, NULL);
}

/* In version 7 jobs depended on success only. These jobs still do. */
static void test_dependencies_of_version_7_are_on_success(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE];
    submit_for(p, &s, first);
    const char *needs[] = {first};
    s.depends_on = needs;
    s.depends_on_count = 1;
    submit_for(p, &s, second);
    alter_database(p, BEFORE_8 "PRAGMA user_version = 7;");
    assert_true(finish(p, first, 0, claim(p, first), &crash));
    expect_state(p, second, QUEUE_FAILED);
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

/* In version 5 the id of a notification was its number, which other queues used, too. */
static void test_notifications_of_version_5_get_ids(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[2][ULID_SIZE], event[2][ULID_SIZE];
    s.webhook = "https://farm/done";
    for (int i = 0; i < 2; i++) {
        submit_for(p, &s, id[i]);
        assert_true(finish(p, id[i], 0, claim(p, id[i]), &success));
    }
    alter_database(p, BEFORE_6 "PRAGMA user_version = 5;");
    for (int i = 0; i < 2; i++) {
        queue_delivery delivery = {0};
        bool found = false;
        assert_true(queue_next_delivery(p->q, "[]", &delivery, &found, NULL) && found);
        queue_job job = get(p, delivery.id);
        assert_true(delivery.ended_ms == job.finished_ms && job.finished_ms > 0);
        memcpy(event[i], delivery.event, ULID_SIZE);
        assert_true(queue_end_delivery(p->q, delivery.number, 0, NULL));
        queue_job_clear(&job);
        queue_delivery_clear(&delivery);
    }
    assert_int_equal(strlen(event[0]), ULID_SIZE - 1);
    assert_string_not_equal(event[0], event[1]);
}

/* Version 7 had two outcomes. */
static void test_outcome_unresolved_is_added_to_version_7(void **state)
{
    place *p = *state;
    char id[2][ULID_SIZE];
    for (int i = 0; i < 2; i++) submit_for(p, &plain, id[i]);
    queue_ending end = success;
    end.outcome = QUEUE_NOT_CONVERGED;
    assert_true(finish(p, id[0], 0, claim(p, id[0]), &end));
    alter_database(p, BEFORE_8 "PRAGMA user_version = 7;");
    end.outcome = QUEUE_UNRESOLVED;
    assert_true(finish(p, id[1], 0, claim(p, id[1]), &end));
    for (int i = 0; i < 2; i++) {
        queue_job job = get(p, id[i]);
        assert_int_equal(job.outcome, i == 0 ? QUEUE_NOT_CONVERGED : QUEUE_UNRESOLVED);
        queue_job_clear(&job);
    }
}

/* Version 4 read a spec at each claim. */
static void test_limits_and_inputs_are_read_from_specs_of_version_4(void **state)
{
    static const struct {
        const char *spec;
        int64_t timeout_ms, stall_ms;
        const char *directory;
    } cases[] = {
        {"{}", 0, 0, NULL},
        {"{\"limits\":{\"timeout_s\":1.5,\"stall_s\":20},\"output\":{\"directory\":\"/a/####\"}}", 1500,
         20000, "/a/####"},
        {"no JSON", 0, 0, NULL},
    };
    place *p = *state;
    enum { COUNT = sizeof cases / sizeof *cases };
    char id[COUNT][ULID_SIZE];
    for (int i = 0; i < COUNT; i++) {
        queue_submission s = plain;
        s.spec = cases[i].spec;
        submit_for(p, &s, id[i]);
    }
    queue_close(p->q);
    p->q = NULL;
    sqlite3 *raw = open_raw(p);
    assert_int_equal(sqlite3_exec(raw, BEFORE_5 "PRAGMA user_version = 4;", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(raw);
    reopen(p);
    for (int i = 0; i < COUNT; i++) {
        bool found = false;
        queue_claimed c;
        assert_true(queue_claim_job(p->q, id[i], &c, &found, NULL) && found);
        assert_int_equal(c.timeout_ms, cases[i].timeout_ms);
        assert_int_equal(c.stall_ms, cases[i].stall_ms);
        if (cases[i].directory)
            assert_string_equal(c.directory, cases[i].directory);
        else
            assert_null(c.directory);
        assert_null(c.cache_key);
        queue_claimed_clear(&c);
    }
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

/* Version 4 had no instance ids. */
static void test_an_instance_is_added_to_version_4(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    bool found = true;
    queue_instance whose;
    assert_true(queue_get_instance(p->q, &whose, &found, NULL));
    assert_false(found); /* the database is new */
    put(p, "before", 0, id);
    claim(p, id);
    queue_close(p->q);
    p->q = NULL;
    sqlite3 *raw = open_raw(p);
    static const char as_it_was[] = BEFORE_5 "PRAGMA user_version = 4;";
    assert_int_equal(sqlite3_exec(raw, as_it_was, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(raw);
    reopen(p);
    assert_true(queue_get_instance(p->q, &whose, &found, NULL));
    assert_true(found);
    assert_string_equal(whose.id, "");
    assert_string_equal(whose.boot_id, "");
    const queue_instance named = {"0123456789abcdefghjkmnpqrs", "a boot"};
    for (int times = 0; times < 2; times++) assert_true(queue_set_instance(p->q, &named, NULL));
    reopen(p);
    assert_true(queue_get_instance(p->q, &whose, &found, NULL));
    assert_string_equal(whose.id, named.id);
    assert_string_equal(whose.boot_id, named.boot_id);
    assert_int_equal(get_task(p, id, 0).interrupted, 0);
    assert_true(finish(p, id, 0, 1, &success));
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
        CASE(test_a_killed_process_loses_nothing),
        CASE(test_an_older_schema_is_migrated),
        CASE(test_storage_is_added_to_version_4),
        CASE(test_jobs_of_version_15_wait_for_no_frames),
        CASE(test_arrays_of_version_16_have_no_chunks),
        CASE(test_reused_results_of_version_17_are_shown_to_the_owner_of_both_jobs),
        CASE(test_jobs_of_version_14_have_no_max_running),
        CASE(test_any_outcome_of_a_job_of_version_13_is_accepted),
        CASE(test_dependencies_of_version_7_are_on_success),
        CASE(test_notifications_of_version_5_get_ids),
        CASE(test_turns_are_added_to_version_6),
        CASE(test_usage_is_added_to_version_8),
        CASE(test_jobs_of_version_11_count_as_copied),
        CASE(test_orders_are_added_to_version_9),
        CASE(test_outcome_unresolved_is_added_to_version_7),
        CASE(test_limits_and_inputs_are_read_from_specs_of_version_4),
        CASE(test_a_claim_returns_limits_and_inputs),
        CASE(test_the_reserve),
        CASE(test_changes_of_the_reserve_leave_no_descriptor_open),
        CASE(test_a_job_is_refused_without_free_space),
        CASE(test_paths_are_added_to_version_2),
        CASE(test_times_and_inputs_are_added_to_version_3),
        CASE(test_removed_events_are_found_in_version_4),
        CASE(test_an_instance_is_added_to_version_4),
        CASE(test_a_second_owner_is_refused),
        CASE(test_a_newer_schema_is_refused),
        CASE(test_a_damaged_database_is_refused),
        CASE(test_network_file_systems_are_known),
        cmocka_unit_test(test_a_start_waits_for_the_lock_of_an_ending_process),
        cmocka_unit_test(test_ulids),
    };
    sqlite3_auto_extension((void (*)(void))note_connection);
    return cmocka_run_group_tests_name("database", tests, NULL, NULL);
}

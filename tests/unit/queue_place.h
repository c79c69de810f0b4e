// SPDX-License-Identifier: Apache-2.0
/* queue_place: a queue in its own directory, functions for tests of it, and checks of the query plans of its
 * statements.
 */
#ifndef HEXAD_TESTS_QUEUE_PLACE_H
#define HEXAD_TESTS_QUEUE_PLACE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "service/queue/queue.h"
#include "files/file.h"

typedef struct place {
    char base[64];
    queue *q;
} place;

/* The connections of the queue whose statements are checked. The first one writes, the others read. */
enum { CONNECTIONS = 64 };
static sqlite3 *connections[CONNECTIONS];
static int connection_count;

static inline int note_connection(sqlite3 *opened, char **message, const struct sqlite3_api_routines *api)
{
    (void)message;
    (void)api;
    const char *file = sqlite3_db_filename(opened, "main");
    /* not a database that is created only for comparison */
    if (file && *file && connection_count < CONNECTIONS) connections[connection_count++] = opened;
    return SQLITE_OK;
}

/* Whether a step of a plan costs the same with 100 000 jobs as with one. Owners are those with unfinished
 * jobs; partial indexes have running, delayed and expiring rows. */
static inline bool is_cheap(const char *sql, const char *step)
{
    static const char *const harmless[] = {"SCAN owner USING INDEX owner_turn",
                                           "SCAN service", /* one row */
                                           "SCAN near",    /* at most 64 rows */
                                           "SCAN usage",   /* a row for each user with results */
                                           "SCAN copy",
                                           "SCAN json_each",
                                           "SCAN CONSTANT ROW",
                                           "SCAN (subquery",
                                           "SCAN sqlite_sequence", /* one row per table */
                                           "SCAN removed_events",  /* one row */
                                           "SCAN task USING INDEX task_running",
                                           "SCAN task USING INDEX task_delayed",
                                           "SCAN outbox USING INDEX outbox_by_time",
                                           "SCAN outbox USING COVERING INDEX", /* for a count */
                                           "SCAN state_count",
                                           "SCAN pragma_page", /* one row */
                                           "SCAN instance",
                                           "SCAN running", /* at most RUNNING_PERIODS_MOST rows */
                                           "SCAN job USING INDEX job_unmeasured",
                                           "SCAN job USING INDEX job_hidden",
                                           "SCAN job USING COVERING INDEX job_hidden",
                                           "SCAN job USING INDEX job_pieces",
                                           "SCAN job USING COVERING INDEX job_pieces",
                                           "SCAN ended", /* the first row */
                                           "SCAN job USING INDEX job_copying",
                                           "SCAN job USING INDEX job_undelivered",
                                           "SCAN task USING COVERING INDEX task_delayed"};
    if (strncmp(sql, "DELETE FROM owner", 17) == 0) return true; /* only after a user's last job has ended */
    if (strncmp(step, "USE TEMP B-TREE", 15) == 0)
        return strstr(sql, "AS near") || strstr(sql, "FROM usage") || strstr(sql, "DISTINCT value");
    if (strncmp(step, "SCAN", 4) != 0) return true;
    for (size_t i = 0; i < sizeof harmless / sizeof *harmless; i++)
        if (strncmp(step, harmless[i], strlen(harmless[i])) == 0) return true;
    return false;
}

static inline void check_plan(const char *sql)
{
    char *explain = mem_printf("EXPLAIN QUERY PLAN %s", sql);
    sqlite3_stmt *s = NULL;
    assert_int_equal(sqlite3_prepare_v2(connections[0], explain, -1, &s, NULL), SQLITE_OK);
    while (sqlite3_step(s) == SQLITE_ROW) {
        const char *step = (const char *)sqlite3_column_text(s, 3);
        if (!is_cheap(sql, step)) fail_msg("%s: %s", sql, step);
    }
    sqlite3_finalize(s);
    free(explain);
}

/* Checks the plan of every statement that a test has used. */
static inline void check_plans(void)
{
    for (int k = 0; k < connection_count; k++)
        for (sqlite3_stmt *s = NULL; (s = sqlite3_next_stmt(connections[k], s));) {
            const char *sql = sqlite3_sql(s);
            if (strncmp(sql, "SELECT", 6) == 0 || strncmp(sql, "UPDATE", 6) == 0 ||
                strncmp(sql, "DELETE", 6) == 0 || strncmp(sql, "INSERT", 6) == 0)
                check_plan(sql);
        }
}

/* Checks that the stored counts of jobs by state are correct. */
static inline void check_counts(queue *q)
{
    sqlite3_stmt *s = NULL;
    int64_t kept[QUEUE_STATE_COUNT];
    if (!queue_count(q, kept, NULL)) return; /* a test has damaged the database */
    if (sqlite3_prepare_v2(connections[0], "SELECT state, count(*) FROM job GROUP BY state", -1, &s, NULL) ==
        SQLITE_OK)
        while (sqlite3_step(s) == SQLITE_ROW) {
            queue_state in;
            assert_true(queue_state_from_name((const char *)sqlite3_column_text(s, 0), &in));
            kept[in] -= sqlite3_column_int64(s, 1);
        }
    sqlite3_finalize(s);
    for (int i = 0; i < QUEUE_STATE_COUNT; i++) assert_int_equal(kept[i], 0);
}

static inline int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-queue-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    error e = {0};
    connection_count = 0;
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
    *state = p;
    return 0;
}

static inline int tear_down(void **state)
{
    place *p = *state;
    if (p->q) check_counts(p->q);
    if (p->q) check_plans();
    queue_close(p->q);
    assert_true(store_remove(p->base, NULL));
    free(p);
    return 0;
}

static const queue_submission plain = {
    .labels = "[\"a\"]", .spec = "{\"version\":1}", .max_attempts = 3, .threads = 1, .memory_mb = 100};

static inline queue_receipt submit(place *p, const queue_submission *s)
{
    queue_receipt receipt = {0};
    error e = {0};
    if (!queue_put(p->q, s, &receipt, &e)) fail_msg("%s", e.message);
    return receipt;
}

static inline void submit_for(place *p, const queue_submission *s, char id[ULID_SIZE])
{
    queue_receipt receipt = submit(p, s);
    assert_int_equal(receipt.admission, QUEUE_CREATED);
    assert_true(ulid_is_valid(receipt.id));
    memcpy(id, receipt.id, sizeof receipt.id);
}

static inline void put(place *p, const char *name, int priority, char id[ULID_SIZE])
{
    queue_submission s = plain;
    s.name = name;
    s.priority = priority;
    submit_for(p, &s, id);
}

static inline queue_job get(place *p, const char *id)
{
    queue_job job = {0};
    bool found = false;
    assert_true(queue_get(p->q, id, &job, &found, NULL));
    assert_true(found);
    return job;
}

static inline void expect_state(place *p, const char *id, queue_state state)
{
    queue_job job = get(p, id);
    assert_string_equal(queue_state_name(job.state), queue_state_name(state));
    queue_job_clear(&job);
}

static inline queue_task get_task(place *p, const char *id, int number)
{
    queue_task *tasks = NULL;
    size_t count = 0;
    assert_true(queue_list_tasks(p->q, id, number - 1, 1, &tasks, &count, NULL));
    assert_int_equal(count, 1);
    queue_task task = tasks[0]; /* its texts belong to the list */
    task.error_code = task.error_message = NULL;
    queue_tasks_free(tasks, count);
    return task;
}

static const queue_resources wide = {
    .threads = 64, .all_threads = 64, .memory_mb = 100000, .all_memory_mb = 100000};

/* Claims the next task, which must be of the job `id`; NULL: there must be no task. */
static inline queue_task claim_in(place *p, const queue_resources *resources, const char *id)
{
    queue_claimed claimed = {0};
    bool found = true;
    error e = {0};
    if (!queue_claim(p->q, resources, &claimed, &found, &e)) fail_msg("%s", e.message);
    if (found && id) assert_string_equal(claimed.job.id, id);
    assert_int_equal(found, id != NULL);
    if (found) {
        assert_int_equal(claimed.job.state, QUEUE_RUNNING);
        assert_int_equal(claimed.task.state, QUEUE_RUNNING);
        assert_non_null(claimed.job.spec);
    }
    queue_task task = claimed.task;
    queue_claimed_clear(&claimed);
    return task;
}

/* Claims a task of the job; returns the number of the attempt. */
static inline int claim(place *p, const char *id)
{
    return claim_in(p, &wide, id).attempt;
}

static inline bool finish(place *p, const char *id, int task, int attempt, const queue_ending *ending)
{
    bool accepted = false;
    error e = {0};
    if (!queue_finish(p->q, &(queue_fence){id, task, attempt}, ending, &accepted, &e))
        fail_msg("%s", e.message);
    return accepted;
}

static inline bool requeue(place *p, const char *id, int attempt, bool counts, int64_t not_before_ms,
                           const queue_ending *ending)
{
    bool accepted = false;
    assert_true(
        queue_requeue(p->q, &(queue_fence){id, 0, attempt}, counts, not_before_ms, ending, &accepted, NULL));
    return accepted;
}

/* Applies a command; `expected`: whether it changes the job. Returns the new state. */
static inline queue_state apply_command(place *p, const char *id, queue_command command, bool expected)
{
    bool found = false, changed = false;
    queue_state now = QUEUE_QUEUED;
    error e = {0};
    if (!queue_apply_command(p->q, id, command, &found, &changed, &now, &e)) fail_msg("%s", e.message);
    assert_true(found);
    assert_int_equal(changed, expected);
    return now;
}

static const queue_ending success = {.state = QUEUE_SUCCEEDED,
                                     .outcome = QUEUE_CONVERGED,
                                     .exit_status = 0,
                                     .signal = -1,
                                     .peak_memory_bytes = 4096,
                                     .waited_ms = 70,
                                     .processor_ms = 90,
                                     .host = "farm1",
                                     .reason = "ended"};
static const queue_ending crash = {.state = QUEUE_FAILED,
                                   .exit_status = -1,
                                   .signal = 9,
                                   .error_code = "internal",
                                   .error_message = "killed",
                                   .reason = "signal 9"};

static inline void reopen(place *p)
{
    if (p->q) check_plans();
    queue_close(p->q);
    error e = {0};
    connection_count = 0;
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
}

static inline void expect_listed(place *p, const queue_filter *filter, const char *const *ids,
                                 size_t expected)
{
    queue_job *jobs;
    size_t count;
    assert_true(queue_list(p->q, filter, &jobs, &count, NULL));
    assert_int_equal(count, expected);
    for (size_t i = 0; i < count; i++) {
        assert_string_equal(jobs[i].id, ids[i]);
        assert_int_equal(jobs[i].spec != NULL, !jobs[i].name || !*jobs[i].name); /* all specs are short */
    }
    queue_jobs_free(jobs, count);
}

/* The caller frees the events. */
static inline queue_event_page list_events(place *p, const queue_event_filter *filter)
{
    queue_event_page page;
    error e = {0};
    if (!queue_list_events(p->q, filter, &page, &e)) fail_msg("%s", e.message);
    return page;
}

/* The positions and bounds of the events, without events. */
static inline queue_event_page look_at_events(place *p)
{
    return list_events(p, &(queue_event_filter){.after_seq = QUEUE_EVENTS_FROM_NOW});
}

static inline sqlite3 *open_raw(place *p)
{
    sqlite3 *raw;
    const int own = connection_count;
    char *path = mem_printf("%s/queue.db", p->base);
    assert_int_equal(sqlite3_open(path, &raw), SQLITE_OK);
    connection_count = own;
    free(path);
    return raw;
}

#define CASE(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

/* Changes the database while the queue is closed. */
static inline void alter_database(place *p, const char *sql)
{
    queue_close(p->q);
    p->q = NULL;
    sqlite3 *raw = open_raw(p);
    assert_int_equal(sqlite3_exec(raw, sql, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(raw);
    reopen(p);
}

#endif

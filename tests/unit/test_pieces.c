// SPDX-License-Identifier: Apache-2.0
/* Changes of many rows: bounded transactions, and kills between any two of them. */
#include "queue_place.h"

#include <pthread.h>
#include <semaphore.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "service/database/database.h"

enum { TASKS = 2 * DATABASE_PIECE_ROWS + 300 };

static int frames[TASKS];

static queue_submission large(void)
{
    queue_submission s = plain;
    for (int i = 0; i < TASKS; i++) frames[i] = i;
    s.frames = frames;
    s.frame_count = TASKS;
    s.owner = "ann";
    return s;
}

static int64_t read_number(const char *sql)
{
    sqlite3_stmt *s = NULL;
    assert_int_equal(sqlite3_prepare_v2(connections[0], sql, -1, &s, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_step(s), SQLITE_ROW);
    int64_t number = sqlite3_column_int64(s, 0);
    sqlite3_finalize(s);
    return number;
}

/* The counts of every visible job are those of its tasks, and those of users and states follow. */
static void check_all_counts(place *p)
{
    assert_int_equal(
        read_number(
            "SELECT count(*) FROM job WHERE tasks > 0 AND (ready, delayed, running, succeeded, failed,"
            " cancelled, timed_out, held, tasks) IS NOT (SELECT count(*) FILTER (WHERE state = 'queued'),"
            " count(*) FILTER (WHERE state = 'delayed'), count(*) FILTER (WHERE state = 'running'),"
            " count(*) FILTER (WHERE state = 'succeeded'), count(*) FILTER (WHERE state = 'failed'),"
            " count(*) FILTER (WHERE state = 'cancelled'), count(*) FILTER (WHERE state = 'timed_out'),"
            " count(*) FILTER (WHERE state = 'queued' AND waits > 0), count(*)"
            " FROM task WHERE task.job = seq)"),
        0);
    assert_int_equal(
        read_number("SELECT count(*) FROM owner WHERE tasks != coalesce((SELECT sum(ready + delayed +"
                    " running) FROM job WHERE job.owner = owner.name), 0)"),
        0);
    assert_int_equal(read_number("SELECT (SELECT coalesce(sum(jobs), 0) FROM state_count) -"
                                 " (SELECT count(*) FROM job WHERE tasks > 0)"),
                     0);
    (void)p;
}

/* Does what a start does after a kill, until nothing is left to do. */
static void complete_all(place *p)
{
    for (bool more = true; more;) assert_true(queue_delete_hidden(p->q, &more, NULL));
    for (bool more = true; more;) assert_true(queue_do_piece(p->q, &more, NULL));
    check_all_counts(p);
    assert_int_equal(read_number("SELECT count(*) FROM job WHERE tasks = 0"), 0);
    assert_int_equal(read_number("SELECT count(*) FROM ended"), 0);
}

/* ---- kills */

static int commits_left;

static int die_in_commit(void *unused)
{
    (void)unused;
    if (commits_left-- == 0) _exit(7);
    return 0;
}

/* Calls `act` in a process that is killed in its commit with the number `commits` (from 0). Returns whether it was
 * killed; otherwise `act` had fewer commits. The queue is open again afterwards. */
static bool kill_in_commit(place *p, int commits, void (*act)(place *p, void *data), void *data)
{
    int status = 0;
    if (p->q) check_plans();
    queue_close(p->q);
    p->q = NULL;
    pid_t child = fork();
    if (child == 0) {
        connection_count = 0;
        p->q = queue_open(p->base, NULL);
        if (!p->q) _exit(1);
        commits_left = commits;
        sqlite3_commit_hook(connections[0], die_in_commit, NULL);
        act(p, data);
        _exit(0);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status) && (WEXITSTATUS(status) == 0 || WEXITSTATUS(status) == 7));
    reopen(p);
    check_all_counts(p);
    return WEXITSTATUS(status) == 7;
}

static void store(place *p, void *unused)
{
    (void)unused;
    queue_receipt receipt;
    queue_submission s = large();
    s.key = "k";
    s.body_hash = "h";
    if (!queue_put(p->q, &s, &receipt, NULL)) _exit(1);
}

/* No list and no event has a job. */
static void expect_no_job(place *p)
{
    queue_job *jobs;
    size_t count;
    const queue_filter all = {.state = -1, .limit = 10};
    assert_true(queue_list(p->q, &all, &jobs, &count, NULL));
    assert_int_equal(count, 0);
    queue_jobs_free(jobs, count);
    queue_event_page page = list_events(p, &(queue_event_filter){.after_seq = 0, .limit = 10});
    assert_int_equal(page.count, 0);
    free(page.events);
}

static void test_a_kill_leaves_an_array_whole_or_nothing_of_it(void **state)
{
    place *p = *state;
    int kills = 0;
    while (kill_in_commit(p, kills, store, NULL)) {
        expect_no_job(p);
        claim_in(p, &wide, NULL);
        complete_all(p);
        assert_int_equal(read_number("SELECT count(*) FROM task"), 0);
        kills++;
    }
    assert_true(kills >= 3); /* pieces */
    queue_submission s = large();
    s.key = "k";
    s.body_hash = "h";
    queue_receipt receipt = submit(p, &s);
    assert_int_equal(receipt.admission, QUEUE_REPLAYED);
    assert_int_equal(read_number("SELECT count(*) FROM task"), TASKS);
}

static void begin(place *p, const char *id, queue_command command)
{
    bool found, changed;
    queue_state now;
    if (!queue_apply_command(p->q, id, command, &found, &changed, &now, NULL)) _exit(1);
}

static void cancel(place *p, void *id)
{
    begin(p, id, QUEUE_CANCEL);
}

static void retry(place *p, void *id)
{
    begin(p, id, QUEUE_RETRY);
}

static void delete (place *p, void *id)
{
    bool found, deleted;
    if (!queue_delete(p->q, id, &found, &deleted, NULL)) _exit(1);
}

static void test_a_command_survives_a_kill_in_any_commit(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_submission s = large();
    submit_for(p, &s, id);
    int kills = 0;
    for (bool killed = true; killed; kills += killed) {
        killed = kill_in_commit(p, kills, cancel, id);
        expect_state(p, id, kills || !killed ? killed ? QUEUE_CANCELLING : QUEUE_CANCELLED : QUEUE_QUEUED);
        claim_in(p, &wide, kills || !killed ? NULL : id);
        complete_all(p);
        if (kills || !killed) {
            expect_state(p, id, QUEUE_CANCELLED);
            apply_command(p, id, QUEUE_RETRY, true);
        } else {
            assert_true(finish(p, id, 0, 1, &success));
        }
        expect_state(p, id, QUEUE_RUNNING); /* one task has ended */
    }
    assert_true(kills >= 3);
    apply_command(p, id, QUEUE_CANCEL, true);
    int retries = 0;
    for (bool killed = true; killed; retries += killed) {
        killed = kill_in_commit(p, retries, retry, id);
        expect_state(p, id, retries || !killed ? QUEUE_RUNNING : QUEUE_CANCELLED);
        if (killed) claim_in(p, &wide, NULL); /* no task before the last piece */
        complete_all(p);
        if (!retries && killed) continue;
        assert_int_equal(read_number("SELECT ready FROM job"), TASKS - 1);
        apply_command(p, id, QUEUE_CANCEL, true);
    }
    assert_true(retries >= 3);
}

static void test_a_deletion_survives_a_kill_in_any_commit(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    bool killed = true;
    int kills = 0;
    for (; killed; kills += killed) {
        queue_submission s = large();
        submit_for(p, &s, id);
        apply_command(p, id, QUEUE_CANCEL, true);
        const int64_t removals = read_number("SELECT count(*) FROM removal");
        killed = kill_in_commit(p, kills, delete, id);
        if (killed && !kills) {
            expect_state(p, id, QUEUE_CANCELLED);
            delete (p, id);
        }
        expect_no_job(p);
        complete_all(p);
        assert_int_equal(read_number("SELECT count(*) FROM removal"), removals + TASKS);
        assert_int_equal(read_number("SELECT (SELECT count(*) FROM task) + (SELECT count(*) FROM event)"), 0);
    }
    assert_true(kills >= 3);
}

static void test_waiting_arrays_and_jobs_follow_a_failure_after_a_kill(void **state)
{
    place *p = *state;
    enum { SMALL = DATABASE_FEW_ROWS + 5 };
    int kills = 0;
    for (bool killed = true; killed; kills += killed) {
        char need[ULID_SIZE], array[ULID_SIZE], by_frame[ULID_SIZE], job[ULID_SIZE];
        const char *needs[] = {need};
        queue_submission s = large(), after = large(), one = plain;
        submit_for(p, &s, need);
        one.depends_on = after.depends_on = needs;
        one.depends_on_count = after.depends_on_count = 1;
        submit_for(p, &after, array);
        after.depends_on_count = 0;
        after.after_frames = needs;
        after.after_frames_count = 1;
        submit_for(p, &after, by_frame);
        for (int i = 0; i < SMALL; i++) submit_for(p, &one, job);
        expect_state(p, array, QUEUE_BLOCKED);
        expect_state(p, by_frame, QUEUE_BLOCKED);
        killed = kill_in_commit(p, kills, cancel, need);
        if (!kills && killed) apply_command(p, need, QUEUE_CANCEL, true);
        complete_all(p);
        expect_state(p, need, QUEUE_CANCELLED);
        expect_state(p, array, QUEUE_FAILED);
        expect_state(p, by_frame, QUEUE_FAILED);
        expect_state(p, job, QUEUE_FAILED);
        assert_int_equal(read_number("SELECT count(*) FROM task WHERE error_code IS NOT 'dependency_failed'"
                                     " AND state = 'failed'"),
                         0);
        delete (p, need);
        assert_int_equal(read_number("SELECT count(*) FROM dependency"), 0);
        queue_job *jobs;
        size_t count;
        assert_true(queue_list(p->q, &(queue_filter){.state = -1, .limit = SMALL + 9}, &jobs, &count, NULL));
        assert_int_equal(count, SMALL + 2);
        for (size_t i = 0; i < count; i++) delete (p, jobs[i].id);
        queue_jobs_free(jobs, count);
    }
    assert_true(kills >= 3);
}

/* The job ends with its first piece; the pieces after it, and those of the frames behind it, follow. */
static void test_frames_fail_although_their_job_is_deleted_before_the_last_piece(void **state)
{
    place *p = *state;
    int kills = 0;
    for (bool killed = true; killed; kills += killed) {
        char need[ULID_SIZE], id[ULID_SIZE];
        const char *needs[] = {need};
        queue_submission s = large();
        submit_for(p, &s, need);
        s.after_frames = needs;
        s.after_frames_count = 1;
        submit_for(p, &s, id);
        alter_database(
            p, "UPDATE task SET state = 'failed' WHERE number >= 10 AND job = (SELECT min(seq) FROM job);"
               "UPDATE owner SET tasks = tasks - (SELECT ready - 10 FROM job ORDER BY seq LIMIT 1);"
               "UPDATE job SET ready = 10, failed = tasks - 10 WHERE seq = (SELECT min(seq) FROM job)");
        killed = kill_in_commit(p, kills, cancel, need);
        if (!kills && killed) apply_command(p, need, QUEUE_CANCEL, true);
        bool more, found, deleted = false;
        while (assert_true(queue_delete(p->q, need, &found, &deleted, NULL)), !deleted)
            assert_true(queue_do_piece(p->q, &more, NULL)); /* it has not ended */
        complete_all(p);
        expect_state(p, id, QUEUE_FAILED);
        assert_int_equal(read_number("SELECT count(*) FROM task WHERE error_code = 'dependency_failed'"),
                         TASKS);
        delete (p, id);
    }
    assert_true(kills >= 3);
}

static void test_frames_are_released_piece_by_piece(void **state)
{
    place *p = *state;
    char need[ULID_SIZE], id[ULID_SIZE];
    const char *needs[] = {need};
    queue_submission s = large();
    submit_for(p, &s, need);
    for (int i = 0; i < 3; i++) assert_true(finish(p, need, i, claim(p, need), &success));
    s.after_frames = needs;
    s.after_frames_count = 1;
    submit_for(p, &s, id);
    check_all_counts(p);
    assert_int_equal(read_number("SELECT held FROM job ORDER BY seq DESC LIMIT 1"), TASKS - 3);
    apply_command(p, need, QUEUE_CANCEL, true);
    complete_all(p);
    expect_state(p, id, QUEUE_RUNNING); /* three frames may start, the others have failed */
    apply_command(p, id, QUEUE_CANCEL, true);
    apply_command(p, need, QUEUE_RETRY, true);
    apply_command(p, id, QUEUE_RETRY, true);
    check_all_counts(p);
    assert_int_equal(read_number("SELECT held FROM job ORDER BY seq DESC LIMIT 1"), TASKS - 3);
}

/* ---- bounds */

static int64_t most_rows, rows_before;

static int note_rows(void *unused)
{
    (void)unused;
    const int64_t rows = sqlite3_total_changes64(connections[0]);
    if (rows - rows_before > most_rows) most_rows = rows - rows_before;
    rows_before = rows;
    return 0;
}

static void *run_all(void *argument)
{
    place *p = argument;
    char id[ULID_SIZE];
    queue_submission s = large();
    submit_for(p, &s, id);
    apply_command(p, id, QUEUE_CANCEL, true);
    apply_command(p, id, QUEUE_RETRY, true);
    apply_command(p, id, QUEUE_CANCEL, true);
    delete (p, id);
    return NULL;
}

static void test_transactions_change_a_bounded_number_of_rows(void **state)
{
    place *p = *state;
    enum { THREADS = 4 };
    pthread_t thread[THREADS];
    large(); /* fills in `frames` before the threads read it */
    most_rows = 0;
    rows_before = sqlite3_total_changes64(connections[0]);
    sqlite3_commit_hook(connections[0], note_rows, NULL);
    for (int i = 0; i < THREADS; i++) assert_int_equal(pthread_create(&thread[i], NULL, run_all, p), 0);
    for (int i = 0; i < THREADS; i++) pthread_join(thread[i], NULL);
    sqlite3_commit_hook(connections[0], NULL, NULL);
    /* a piece of a deletion changes the tables task and removal */
    assert_in_range(most_rows, DATABASE_PIECE_ROWS,
                    2 * DATABASE_PIECE_ROWS + THREADS * 2 * DATABASE_FEW_ROWS);
    complete_all(p);
}

static sem_t reached, released;
static atomic_int commits;

static int wait_in_third_commit(void *unused)
{
    (void)unused;
    if (atomic_fetch_add(&commits, 1) != 2) return 0;
    sem_post(&reached);
    sem_wait(&released);
    return 0;
}

static void *submit_with_key(void *argument)
{
    place *p = argument;
    queue_submission s = large();
    s.key = "k";
    s.body_hash = "h";
    queue_receipt *receipt = mem_alloc(sizeof *receipt);
    *receipt = submit(p, &s);
    return receipt;
}

static void test_the_same_key_waits_for_an_array_that_is_being_stored(void **state)
{
    place *p = *state;
    pthread_t first, second;
    queue_receipt *a = NULL, *b = NULL;
    large();
    sem_init(&reached, 0, 0);
    sem_init(&released, 0, 0);
    atomic_store(&commits, 0);
    sqlite3_commit_hook(connections[0], wait_in_third_commit, NULL);
    assert_int_equal(pthread_create(&first, NULL, submit_with_key, p), 0);
    sem_wait(&reached);
    bool found = false;
    expect_no_job(p);
    assert_true(queue_has_key(p->q, "ann", "k", &found, NULL) && found);
    assert_int_equal(pthread_create(&second, NULL, submit_with_key, p), 0);
    sem_post(&released);
    pthread_join(first, (void **)&a);
    pthread_join(second, (void **)&b);
    sqlite3_commit_hook(connections[0], NULL, NULL);
    assert_int_equal(a->admission, QUEUE_CREATED);
    assert_int_equal(b->admission, QUEUE_REPLAYED);
    assert_string_equal(a->id, b->id);
    free(a);
    free(b);
}

static place *filled;

/* Then no job is stored any more. */
static int fill_in_third_commit(void *unused)
{
    (void)unused;
    if (atomic_fetch_add(&commits, 1) == 2)
        queue_bound(filled->q, &(queue_bounds){.user = {INT64_MAX, INT64_MAX}});
    return 0;
}

static void test_nothing_is_left_of_an_array_that_is_refused_late(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_submission s = large();
    submit_for(p, &s, id);
    apply_command(p, id, QUEUE_CANCEL, true);
    assert_true(kill_in_commit(p, 2, delete, id)); /* a part of an older job is there, too */
    assert_int_equal(read_number("SELECT count(*) FROM job WHERE tasks = 0"), 1);
    filled = p;
    atomic_store(&commits, 0);
    sqlite3_commit_hook(connections[0], fill_in_third_commit, NULL);
    assert_int_equal(submit(p, &s).admission, QUEUE_RESULTS_FULL);
    sqlite3_commit_hook(connections[0], NULL, NULL);
    assert_int_equal(read_number("SELECT (SELECT count(*) FROM job) + (SELECT count(*) FROM task)"), 0);
}

static void test_tasks_of_a_user_are_limited(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_submission s = large();
    s.most_tasks = TASKS + 1;
    submit_for(p, &s, id);
    assert_int_equal(submit(p, &s).admission, QUEUE_TOO_MANY_TASKS);
    s.frame_count = 2;
    assert_int_equal(submit(p, &s).admission, QUEUE_TOO_MANY_TASKS);
    s.frame_count = 1;
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED);
    apply_command(p, id, QUEUE_CANCEL, true);
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED);
    check_all_counts(p);
}

int main(void)
{
    sqlite3_auto_extension((void (*)(void))note_connection);
    const struct CMUnitTest tests[] = {
        CASE(test_a_kill_leaves_an_array_whole_or_nothing_of_it),
        CASE(test_a_command_survives_a_kill_in_any_commit),
        CASE(test_a_deletion_survives_a_kill_in_any_commit),
        CASE(test_waiting_arrays_and_jobs_follow_a_failure_after_a_kill),
        CASE(test_frames_fail_although_their_job_is_deleted_before_the_last_piece),
        CASE(test_frames_are_released_piece_by_piece),
        CASE(test_transactions_change_a_bounded_number_of_rows),
        CASE(test_the_same_key_waits_for_an_array_that_is_being_stored),
        CASE(test_nothing_is_left_of_an_array_that_is_refused_late),
        CASE(test_tasks_of_a_user_are_limited),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

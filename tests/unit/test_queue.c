#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/memory.h"
#include "queue/queue.h"
#include "store/file.h"

typedef struct place {
    char base[64];
    queue *q;
} place;

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-queue-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    error e = {0};
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    queue_close(p->q);
    assert_true(store_remove(p->base, NULL));
    free(p);
    return 0;
}

static void put(place *p, const char *name, int priority, char id[ULID_SIZE])
{
    queue_submission s = {name, "[\"a\"]", "{\"version\":1}", priority, 3};
    error e = {0};
    if (!queue_put(p->q, &s, id, &e)) fail_msg("%s", e.message);
    assert_true(ulid_is_valid(id));
}

static queue_job get(place *p, const char *id)
{
    queue_job job = {0};
    bool found = false;
    assert_true(queue_get(p->q, id, &job, &found, NULL));
    assert_true(found);
    return job;
}

static void expect_state(place *p, const char *id, queue_state state)
{
    queue_job job = get(p, id);
    assert_string_equal(queue_state_name(job.state), queue_state_name(state));
    queue_job_clear(&job);
}

/* Claims the next job, which has to be `id`; returns the attempt's number. */
static int claim(place *p, const char *id)
{
    queue_job job = {0};
    bool found = false;
    assert_true(queue_claim(p->q, &job, &found, NULL));
    assert_true(found);
    assert_string_equal(job.id, id);
    assert_int_equal(job.state, QUEUE_RUNNING);
    assert_non_null(job.spec);
    int attempt = job.attempt;
    queue_job_clear(&job);
    return attempt;
}

static const queue_ending success = {.state = QUEUE_SUCCEEDED,
                                     .outcome = QUEUE_CONVERGED,
                                     .exit_status = 0,
                                     .signal = -1,
                                     .peak_memory_bytes = 4096,
                                     .reason = "ended"};
static const queue_ending crash = {.state = QUEUE_FAILED,
                                   .exit_status = -1,
                                   .signal = 9,
                                   .error_code = "internal",
                                   .error_message = "killed",
                                   .reason = "signal 9"};

static void reopen(place *p)
{
    queue_close(p->q);
    error e = {0};
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
}

static void test_a_job_survives_a_reopening(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "näme", 7, id);
    reopen(p);
    queue_job job = get(p, id);
    assert_string_equal(job.name, "näme");
    assert_string_equal(job.labels, "[\"a\"]");
    assert_string_equal(job.spec, "{\"version\":1}");
    assert_int_equal(job.priority, 7);
    assert_int_equal(job.state, QUEUE_QUEUED);
    assert_int_equal(job.attempt, 0);
    assert_true(job.created_ms > 0);
    assert_int_equal(job.started_ms, 0);
    queue_job_clear(&job);
    bool found = true;
    assert_true(queue_get(p->q, "01aaaaaaaaaaaaaaaaaaaaaaaa", &job, &found, NULL));
    assert_false(found);
}

static void test_claims_go_by_priority_then_age(void **state)
{
    place *p = *state;
    char low[ULID_SIZE], first[ULID_SIZE], second[ULID_SIZE], high[ULID_SIZE];
    put(p, "low", -1, low);
    put(p, "first", 0, first);
    put(p, "second", 0, second);
    put(p, NULL, 5, high);
    claim(p, high);
    claim(p, first);
    claim(p, second);
    claim(p, low);
    queue_job job = {0};
    bool found = true;
    assert_true(queue_claim(p->q, &job, &found, NULL));
    assert_false(found);
    queue_job *jobs;
    size_t count;
    assert_true(queue_list_unsettled(p->q, &jobs, &count, NULL));
    assert_int_equal(count, 4);
    assert_string_equal(jobs[0].id, low);
    queue_jobs_free(jobs, count);
}

static void test_only_the_current_attempt_settles(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "fenced", 0, id);
    bool accepted = true;
    assert_true(queue_finish(p->q, id, 0, &success, &accepted, NULL)); /* not running at all */
    assert_false(accepted);
    int old = claim(p, id);
    assert_true(queue_requeue(p->q, id, old, true, &crash, &accepted, NULL));
    assert_true(accepted);
    int current = claim(p, id);
    assert_true(current > old);
    assert_true(queue_finish(p->q, id, old, &success, &accepted, NULL));
    assert_false(accepted);
    expect_state(p, id, QUEUE_RUNNING);
    assert_true(queue_finish(p->q, id, current, &success, &accepted, NULL));
    assert_true(accepted);
    assert_true(queue_finish(p->q, id, current, &crash, &accepted, NULL)); /* once is enough */
    assert_false(accepted);
    queue_job job = get(p, id);
    assert_int_equal(job.state, QUEUE_SUCCEEDED);
    assert_int_equal(job.outcome, QUEUE_CONVERGED);
    assert_int_equal(job.spent, 2);
    assert_true(job.finished_ms >= job.started_ms && job.started_ms >= job.created_ms);
    queue_job_clear(&job);
    queue_attempt *attempts;
    size_t count;
    assert_true(queue_list_attempts(p->q, id, &attempts, &count, NULL));
    assert_int_equal(count, 2);
    assert_int_equal(attempts[0].signal, 9);
    assert_int_equal(attempts[0].exit_status, -1);
    assert_string_equal(attempts[0].reason, "signal 9");
    assert_int_equal(attempts[1].exit_status, 0);
    assert_int_equal(attempts[1].peak_memory_bytes, 4096);
    queue_attempts_free(attempts, count);
}

static void test_an_attempt_given_back_does_not_count(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "drained", 0, id);
    bool accepted = false;
    int attempt = claim(p, id);
    assert_true(queue_requeue(p->q, id, attempt, false, &crash, &accepted, NULL));
    assert_true(accepted);
    queue_job job = get(p, id);
    assert_int_equal(job.spent, 0);
    assert_int_equal(job.attempt, attempt); /* the fence never goes back */
    queue_job_clear(&job);
    assert_int_equal(claim(p, id), attempt + 1);
}

static void test_cancel(void **state)
{
    place *p = *state;
    char waiting[ULID_SIZE], running[ULID_SIZE];
    put(p, "running", 1, running);
    put(p, "waiting", 0, waiting);
    int attempt = claim(p, running);
    bool found, changed, accepted;
    queue_state now;
    assert_true(queue_cancel(p->q, waiting, &found, &changed, &now, NULL));
    assert_true(found && changed && now == QUEUE_CANCELLED);
    assert_true(queue_cancel(p->q, waiting, &found, &changed, &now, NULL));
    assert_true(found && !changed && now == QUEUE_CANCELLED);
    queue_job job = get(p, waiting);
    assert_true(job.finished_ms > 0);
    queue_job_clear(&job);
    assert_true(queue_cancel(p->q, running, &found, &changed, &now, NULL));
    assert_true(found && changed && now == QUEUE_CANCELLING);
    assert_true(queue_requeue(p->q, running, attempt, true, &crash, &accepted, NULL));
    assert_false(accepted); /* would undo the cancellation */
    queue_ending ending = {.state = QUEUE_CANCELLED, .exit_status = 6, .signal = -1};
    assert_true(queue_finish(p->q, running, attempt, &ending, &accepted, NULL));
    assert_true(accepted);
    assert_true(queue_cancel(p->q, "nobody", &found, &changed, &now, NULL));
    assert_false(found || changed);
}

static void test_list_pages_newest_first(void **state)
{
    place *p = *state;
    char id[5][ULID_SIZE];
    for (int i = 0; i < 5; i++) put(p, NULL, 0, id[i]);
    claim(p, id[0]);
    queue_job *jobs;
    size_t count;
    queue_filter filter = {.state = -1, .limit = 3};
    assert_true(queue_list(p->q, &filter, &jobs, &count, NULL));
    assert_int_equal(count, 3);
    assert_string_equal(jobs[0].id, id[4]);
    assert_null(jobs[0].spec);
    filter.before_seq = jobs[2].seq;
    queue_jobs_free(jobs, count);
    assert_true(queue_list(p->q, &filter, &jobs, &count, NULL));
    assert_int_equal(count, 2);
    assert_string_equal(jobs[1].id, id[0]);
    queue_jobs_free(jobs, count);
    filter = (queue_filter){.state = QUEUE_QUEUED, .limit = 100};
    assert_true(queue_list(p->q, &filter, &jobs, &count, NULL));
    assert_int_equal(count, 4);
    queue_jobs_free(jobs, count);
}

static void test_a_second_owner_is_refused(void **state)
{
    place *p = *state;
    error e = {0};
    assert_null(queue_open(p->base, &e));
    assert_non_null(strstr(e.message, "another hexad"));
    assert_non_null(strstr(e.message, p->base));
}

/* Another program at the database neither gets in nor makes anybody wait. */
static void test_the_database_has_one_owner(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    char *path = mem_printf("%s/queue.db", p->base);
    sqlite3 *other;
    assert_int_equal(sqlite3_open(path, &other), SQLITE_OK);
    assert_int_equal(sqlite3_exec(other, "BEGIN IMMEDIATE", NULL, NULL, NULL), SQLITE_BUSY);
    put(p, "undisturbed", 0, id);
    sqlite3_close(other);
    free(path);
}

static void test_a_newer_schema_is_refused(void **state)
{
    place *p = *state;
    queue_close(p->q);
    p->q = NULL;
    char *path = mem_printf("%s/queue.db", p->base);
    sqlite3 *database;
    assert_int_equal(sqlite3_open(path, &database), SQLITE_OK);
    assert_int_equal(sqlite3_exec(database, "PRAGMA user_version = 99", NULL, NULL, NULL),
                     SQLITE_OK);
    sqlite3_close(database);
    free(path);
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
    assert_true(store_file_write(path, "this is no database, only text that stands in its place",
                                 54, NULL));
    free(path);
    error e = {0};
    assert_null(queue_open(p->base, &e));
    assert_non_null(strstr(e.message, "queue.db"));
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
        cmocka_unit_test_setup_teardown(test_a_job_survives_a_reopening, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_claims_go_by_priority_then_age, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_only_the_current_attempt_settles, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_an_attempt_given_back_does_not_count, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_cancel, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_list_pages_newest_first, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_second_owner_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_the_database_has_one_owner, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_newer_schema_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_damaged_database_is_refused, set_up, tear_down),
        cmocka_unit_test(test_ulids),
    };
    return cmocka_run_group_tests_name("queue", tests, NULL, NULL);
}

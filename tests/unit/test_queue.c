// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <inttypes.h>

#include "queue_place.h"

#include "base/core/clock.h"
#include "base/core/rng.h"

static void test_a_job_survives_a_reopening(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_submission s = plain;
    s.name = "näme";
    s.owner = "ann";
    s.trace = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";
    s.priority = 7;
    s.retention_s = 60;
    submit_for(p, &s, id);
    reopen(p);
    queue_job job = get(p, id);
    assert_string_equal(job.name, "näme");
    assert_string_equal(job.owner, "ann");
    assert_string_equal(job.labels, "[\"a\"]");
    assert_string_equal(job.trace, s.trace);
    assert_string_equal(job.spec, "{\"version\":1}");
    assert_int_equal(job.priority, 7);
    assert_int_equal(job.threads, 1);
    assert_int_equal(job.memory_mb, 100);
    assert_int_equal(job.retention_s, 60);
    assert_int_equal(job.state, QUEUE_QUEUED);
    assert_int_equal(job.tasks.all, 1);
    assert_int_equal(job.tasks.waiting, 1);
    assert_false(job.array);
    assert_int_equal(job.attempts, 0);
    assert_true(job.created_ms > 0);
    assert_int_equal(job.started_ms, 0);
    queue_job_clear(&job);
    assert_int_equal(get_task(p, id, 0).frame, QUEUE_NO_FRAME);
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
    claim(p, NULL);
    queue_claimed *left;
    size_t count;
    assert_true(queue_list_unsettled(p->q, &left, &count, NULL));
    assert_int_equal(count, 4);
    assert_string_equal(left[0].job.id, low);
    assert_int_equal(left[0].task.attempt, 1);
    assert_non_null(left[0].job.spec);
    queue_claimed_free(left, count);
}

static int count_ahead(const place *p, const char *id)
{
    int count = -1;
    queue_job job = get((place *)p, id);
    assert_true(queue_count_ahead(p->q, &job, &count, NULL));
    queue_job_clear(&job);
    return count;
}

/* The count of a job is the number of claims before its own. */
static void test_jobs_ahead_are_those_claimed_before(void **state)
{
    place *p = *state;
    enum { JOBS = 12 };
    char id[JOBS][ULID_SIZE];
    int ahead[JOBS], taken = 0;
    srand(11); /* of the priorities */
    for (int i = 0; i < JOBS; i++) put(p, NULL, rand() % 4, id[i]);
    for (int i = 0; i < JOBS; i++) ahead[i] = count_ahead(p, id[i]);
    for (; taken < JOBS; taken++) {
        int next = 0;
        while (ahead[next] != taken) assert_true(++next < JOBS);
        assert_int_equal(count_ahead(p, id[next]), 0);
        claim(p, id[next]);
    }
    claim(p, NULL);
    char many[ULID_SIZE], last[ULID_SIZE];
    for (int i = 0; i < QUEUE_AHEAD_MOST + 5; i++) put(p, NULL, 0, many);
    put(p, NULL, -1, last);
    assert_int_equal(count_ahead(p, last), QUEUE_AHEAD_MOST);
}

static void test_jobs_ahead_are_those_of_the_owner_that_may_start(void **state)
{
    place *p = *state;
    char id[3][ULID_SIZE];
    put(p, "paused", 0, id[0]);
    put(p, "second", 0, id[1]);
    queue_submission other = plain;
    other.owner = "another";
    other.priority = 7;
    submit_for(p, &other, id[2]);
    put(p, "last", 0, id[2]);
    assert_int_equal(count_ahead(p, id[2]), 2);
    bool found, changed;
    queue_state now;
    assert_true(queue_apply_command(p->q, id[0], QUEUE_PAUSE, &found, &changed, &now, NULL));
    assert_int_equal(count_ahead(p, id[2]), 1);
}

static void test_only_the_current_attempt_ends_a_task(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "fenced", 0, id);
    assert_false(finish(p, id, 0, 0, &success)); /* no attempt runs */
    int old = claim(p, id);
    assert_true(requeue(p, id, old, true, 0, &crash));
    int current = claim(p, id);
    assert_true(current > old);
    assert_false(finish(p, id, 0, old, &success));
    assert_false(finish(p, id, 1, current, &success)); /* the task does not exist */
    expect_state(p, id, QUEUE_RUNNING);
    assert_true(finish(p, id, 0, current, &success));
    assert_false(finish(p, id, 0, current, &crash)); /* the attempt has already ended */
    queue_job job = get(p, id);
    assert_int_equal(job.state, QUEUE_SUCCEEDED);
    assert_int_equal(job.outcome, QUEUE_CONVERGED);
    assert_int_equal(job.attempts, 2);
    assert_true(job.finished_ms >= job.started_ms && job.started_ms >= job.created_ms);
    queue_job_clear(&job);
    assert_int_equal(get_task(p, id, 0).spent, 2);
    queue_attempt *attempts;
    size_t count;
    assert_true(queue_list_attempts(p->q, id, -1, 0, 100, &attempts, &count, NULL));
    assert_int_equal(count, 2);
    assert_int_equal(attempts[0].signal, 9);
    assert_int_equal(attempts[0].exit_status, -1);
    assert_string_equal(attempts[0].reason, "signal 9");
    assert_int_equal(attempts[1].exit_status, 0);
    assert_int_equal(attempts[1].peak_memory_bytes, 4096);
    assert_int_equal(attempts[1].waited_ms, 70);
    assert_int_equal(attempts[1].processor_ms, 90);
    assert_string_equal(attempts[1].host, "farm1");
    queue_attempts_free(attempts, count);
}

static void test_an_attempt_given_back_does_not_count(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "drained", 0, id);
    int attempt = claim(p, id);
    assert_true(requeue(p, id, attempt, false, 0, &crash));
    queue_task task = get_task(p, id, 0);
    assert_int_equal(task.spent, 0);
    assert_int_equal(task.attempt, attempt); /* the attempt number never decreases */
    assert_int_equal(claim(p, id), attempt + 1);
}

/* Attempts that failed because of a full disk are counted separately, until the job is retried. */
static void test_faults_of_storage_are_counted_apart(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_ending full = crash;
    full.storage_fault = true;
    put(p, "on a full disk", 0, id);
    assert_true(requeue(p, id, claim(p, id), false, 0, &full));
    assert_true(requeue(p, id, claim(p, id), true, 0, &crash));
    queue_task task = get_task(p, id, 0);
    assert_int_equal(task.spent, 1);
    assert_int_equal(task.storage_faults, 1);
    assert_true(finish(p, id, 0, claim(p, id), &crash));
    apply_command(p, id, QUEUE_RETRY, true);
    assert_int_equal(get_task(p, id, 0).storage_faults, 0);
}

static size_t count_copies(place *p, const char *directory, const char *name)
{
    queue_copy *copies = NULL;
    size_t count = 0;
    assert_true(queue_list_copies(p->q, &copies, &count, NULL));
    if (count && name) assert_string_equal(copies[0].name, name);
    if (count && directory) assert_string_equal(copies[0].directory, directory);
    queue_copies_free(copies, count);
    return count;
}

/* The end of an attempt deletes the record of its copy, and no other record. */
static void test_copies_are_noted(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_ending ending = success;
    put(p, "copied", 0, id);
    int attempt = claim(p, id);
    assert_true(queue_note_copy(p->q, "/show/a", ".x.1.hexad-tmp", "/disk/a", "ann", NULL));
    assert_true(queue_note_copy(p->q, "/show/b", ".x.2.hexad-tmp", "/disk/b", "ben", NULL));
    assert_int_equal(count_copies(p, "/show/a", ".x.1.hexad-tmp"), 2);
    ending.copied = ".x.1.hexad-tmp";
    assert_false(finish(p, id, 0, attempt + 1, &ending)); /* of another attempt */
    assert_int_equal(count_copies(p, NULL, NULL), 2);
    assert_true(finish(p, id, 0, attempt, &ending));
    assert_int_equal(count_copies(p, "/show/b", ".x.2.hexad-tmp"), 1);
    reopen(p);
    assert_true(queue_forget_copy(p->q, ".x.2.hexad-tmp", NULL));
    assert_int_equal(count_copies(p, NULL, NULL), 0);
}

/* With a wait of years, and with a wait that is over. */
static void test_a_crashed_job_waits_and_does_not_block_others(void **state)
{
    place *p = *state;
    char crashed[ULID_SIZE], other[ULID_SIZE];
    int64_t due = 0, later = INT64_C(1) << 42;
    put(p, "crashed", 9, crashed);
    put(p, "other", 0, other);
    assert_true(queue_next_due(p->q, &due, NULL));
    assert_true(due == INT64_MAX);
    assert_true(requeue(p, crashed, claim(p, crashed), true, later, &crash));
    expect_state(p, crashed, QUEUE_QUEUED);
    assert_true(get_task(p, crashed, 0).not_before_ms == later);
    assert_true(queue_next_due(p->q, &due, NULL));
    assert_true(due == later);
    claim(p, other);
    claim(p, NULL);
    reopen(p); /* the wait is stored */
    claim(p, NULL);
    assert_int_equal(apply_command(p, crashed, QUEUE_CANCEL, true), QUEUE_CANCELLED);
    assert_true(queue_next_due(p->q, &due, NULL));
    assert_true(due == INT64_MAX);
    char soon[ULID_SIZE];
    put(p, "soon", 0, soon);
    assert_true(requeue(p, soon, claim(p, soon), true, 1, &crash)); /* the wait is over */
    claim(p, soon);
}

static void test_cancel(void **state)
{
    place *p = *state;
    char waiting[ULID_SIZE], running[ULID_SIZE];
    put(p, "running", 1, running);
    put(p, "waiting", 0, waiting);
    int attempt = claim(p, running);
    assert_int_equal(apply_command(p, waiting, QUEUE_CANCEL, true), QUEUE_CANCELLED);
    assert_int_equal(apply_command(p, waiting, QUEUE_CANCEL, false), QUEUE_CANCELLED);
    queue_job job = get(p, waiting);
    assert_true(job.finished_ms > 0);
    queue_job_clear(&job);
    assert_int_equal(apply_command(p, running, QUEUE_CANCEL, true), QUEUE_CANCELLING);
    assert_int_equal(apply_command(p, running, QUEUE_CANCEL, false), QUEUE_CANCELLING);
    assert_false(requeue(p, running, attempt, true, 0, &crash)); /* would undo the cancellation */
    queue_ending ending = {.state = QUEUE_CANCELLED, .exit_status = 6, .signal = -1};
    assert_true(finish(p, running, 0, attempt, &ending));
    expect_state(p, running, QUEUE_CANCELLED);
    bool found = true, changed = true;
    queue_state now;
    assert_true(queue_apply_command(p->q, "missing", QUEUE_CANCEL, &found, &changed, &now, NULL));
    assert_false(found || changed);
}

static void test_pause_and_resume(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "paused", 0, id);
    assert_int_equal(apply_command(p, id, QUEUE_PAUSE, true), QUEUE_PAUSED);
    assert_int_equal(apply_command(p, id, QUEUE_PAUSE, false), QUEUE_PAUSED);
    claim(p, NULL);
    assert_int_equal(apply_command(p, id, QUEUE_RESUME, true), QUEUE_QUEUED);
    int attempt = claim(p, id);
    /* the running attempt continues */
    assert_int_equal(apply_command(p, id, QUEUE_PAUSE, true), QUEUE_RUNNING);
    assert_true(requeue(p, id, attempt, true, 0, &crash));
    expect_state(p, id, QUEUE_PAUSED);
    claim(p, NULL);
    assert_int_equal(apply_command(p, id, QUEUE_CANCEL, true), QUEUE_CANCELLED);
    assert_int_equal(apply_command(p, id, QUEUE_PAUSE, false), QUEUE_CANCELLED);
}

static void test_the_same_key_is_the_same_job(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    s.key = "k";
    s.body_hash = "abc";
    queue_receipt first = submit(p, &s), again = submit(p, &s);
    assert_int_equal(first.admission, QUEUE_CREATED);
    assert_int_equal(again.admission, QUEUE_REPLAYED);
    assert_string_equal(again.id, first.id);
    reopen(p);
    s.body_hash = "def";
    assert_int_equal(submit(p, &s).admission, QUEUE_MISMATCH);
    s.owner = "somebody else";
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED);
    s.key = NULL;
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED);
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED);
}

static void test_unfinished_jobs_of_a_user_are_limited(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    s.owner = "ann";
    s.most_waiting = 2;
    char first[ULID_SIZE], second[ULID_SIZE];
    submit_for(p, &s, first);
    submit_for(p, &s, second);
    assert_int_equal(submit(p, &s).admission, QUEUE_TOO_MANY);
    int attempt = claim(p, first);
    assert_int_equal(submit(p, &s).admission, QUEUE_TOO_MANY);
    assert_true(finish(p, first, 0, attempt, &success));
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED);
    assert_int_equal(submit(p, &s).admission, QUEUE_TOO_MANY);
    s.owner = "bob";
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED);
}

static void test_running_tasks_of_a_user_are_limited(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char ann[3][ULID_SIZE], bob[ULID_SIZE];
    s.owner = "ann";
    for (int i = 0; i < 3; i++) submit_for(p, &s, ann[i]);
    s.owner = "bob";
    submit_for(p, &s, bob);
    queue_resources resources = wide;
    resources.most_of_owner = 1;
    queue_task task = claim_in(p, &resources, ann[0]);
    claim_in(p, &resources, bob);
    claim_in(p, &resources, NULL);
    assert_true(finish(p, ann[0], 0, task.attempt, &success));
    claim_in(p, &resources, ann[1]);
    claim_in(p, &resources, NULL);
}

static void test_fitting_jobs_overtake_a_limited_number_of_times(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char large[ULID_SIZE], hungry[ULID_SIZE], small[QUEUE_OVERTAKE_MOST + 1][ULID_SIZE];
    s.threads = 99; /* more than the host has: it gets all of them */
    submit_for(p, &s, large);
    s.threads = 1;
    for (int i = 0; i <= QUEUE_OVERTAKE_MOST; i++) submit_for(p, &s, small[i]);
    queue_resources resources = {.threads = 3, .all_threads = 4, .memory_mb = 1000, .all_memory_mb = 1000};
    for (int i = 0; i < QUEUE_OVERTAKE_MOST; i++) claim_in(p, &resources, small[i]);
    claim_in(p, &resources, NULL); /* from here on all others wait for the large job */
    resources.threads = 4;
    claim_in(p, &resources, large);
    resources.memory_mb = 99;
    claim_in(p, &resources, NULL);
    s.memory_mb = 1001;
    submit_for(p, &s, hungry);
    claim_in(p, &resources, hungry); /* it never fits, so that the executor can fail it */
}

static void test_jobs_wait_for_others(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE], third[ULID_SIZE];
    put(p, "first", 0, first);
    put(p, "second", 0, second);
    const char *needs[] = {first, second, first};
    s.depends_on = needs;
    s.depends_on_count = 3;
    queue_receipt receipt = submit(p, &s);
    assert_int_equal(receipt.state, QUEUE_BLOCKED);
    memcpy(third, receipt.id, sizeof third);
    int attempt = claim(p, first);
    claim(p, second);
    claim(p, NULL);
    assert_true(finish(p, first, 0, attempt, &success));
    reopen(p);
    expect_state(p, third, QUEUE_BLOCKED);
    assert_true(finish(p, second, 0, 1, &success));
    expect_state(p, third, QUEUE_QUEUED);
    claim(p, third);
    needs[2] = "01aaaaaaaaaaaaaaaaaaaaaaaa";
    receipt = submit(p, &s);
    assert_int_equal(receipt.admission, QUEUE_UNKNOWN_DEPENDENCY);
    assert_int_equal(receipt.dependency, 2);
    s.depends_on_count = 2; /* both have succeeded */
    assert_int_equal(submit(p, &s).state, QUEUE_QUEUED);
}

static void test_dependents_of_a_failed_job_fail(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[3][ULID_SIZE];
    put(p, "first", 0, id[0]);
    for (int i = 1; i < 3; i++) {
        const char *needs[] = {id[i - 1]};
        s.depends_on = needs;
        s.depends_on_count = 1;
        submit_for(p, &s, id[i]);
    }
    assert_true(finish(p, id[0], 0, claim(p, id[0]), &crash));
    for (int i = 1; i < 3; i++) {
        queue_job job = get(p, id[i]);
        assert_int_equal(job.state, QUEUE_FAILED);
        assert_string_equal(job.error_code, "dependency_failed");
        assert_non_null(strstr(job.error_message, id[i - 1]));
        queue_job_clear(&job);
    }
    const char *needs[] = {id[2]};
    s.depends_on = needs;
    assert_int_equal(submit(p, &s).state, QUEUE_FAILED); /* without waiting */
    assert_int_equal(apply_command(p, id[1], QUEUE_RETRY, false), QUEUE_FAILED);
    assert_int_equal(apply_command(p, id[0], QUEUE_RETRY, true), QUEUE_QUEUED);
    assert_int_equal(apply_command(p, id[1], QUEUE_RETRY, true), QUEUE_BLOCKED);
    assert_true(finish(p, id[0], 0, claim(p, id[0]), &success));
    claim(p, id[1]);
}

static void test_dependents_start_with_accepted_outcomes_only(void **state)
{
    place *p = *state;
    queue_submission s = plain, after = plain;
    char first[ULID_SIZE], second[ULID_SIZE], third[ULID_SIZE];
    static const int frames[] = {1, 2};
    s.frames = frames;
    s.frame_count = 2;
    s.accept = QUEUE_OUTCOME_BIT(QUEUE_CONVERGED) | QUEUE_OUTCOME_BIT(QUEUE_NOT_CONVERGED);
    submit_for(p, &s, first);
    after.depends_on = (const char *[]){first};
    after.depends_on_count = 1;
    submit_for(p, &after, second);
    queue_ending ending = success;
    ending.outcome = QUEUE_UNRESOLVED;
    assert_true(finish(p, first, 0, claim(p, first), &ending));
    ending.outcome = QUEUE_NOT_CONVERGED;
    assert_true(finish(p, first, 1, claim(p, first), &ending));
    queue_job job = get(p, first);
    assert_true(job.state == QUEUE_SUCCEEDED && job.outcome == QUEUE_NOT_CONVERGED && !job.accepted);
    queue_job_clear(&job);
    job = get(p, second);
    assert_int_equal(job.state, QUEUE_FAILED);
    assert_string_equal(job.error_code, "dependency_failed");
    assert_non_null(strstr(job.error_message, "queue.accept"));
    queue_job_clear(&job);
    assert_int_equal(submit(p, &after).state, QUEUE_FAILED);
    assert_int_equal(apply_command(p, second, QUEUE_RETRY, false), QUEUE_FAILED);
    after.depends_on_count = 0;
    after.after = (const char *[]){first};
    after.after_count = 1;
    submit_for(p, &after, third); /* waits for the end only */
    claim(p, third);

    const unsigned all = QUEUE_ANY_OUTCOME;
    queue_edited edited;
    assert_true(queue_change(p->q, first, -1, &(queue_edit){.accept = &all}, &edited, NULL));
    job = get(p, first);
    assert_true(job.accepted);
    queue_job_clear(&job);
    assert_int_equal(apply_command(p, second, QUEUE_RETRY, true), QUEUE_QUEUED);
    claim(p, second);
}

/* first <- second <- third. A job of bob depends on the first, which only administrators learn and retry; the
 * last one depends on it and on a job that is not retried. */
static void test_a_retry_includes_failed_dependents(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE], third[ULID_SIZE], bobs[ULID_SIZE], broken[ULID_SIZE],
        last[ULID_SIZE];
    put(p, "first", 0, first);
    put(p, "broken", 0, broken);
    s.depends_on = (const char *[]){first, broken};
    s.depends_on_count = 1;
    submit_for(p, &s, second);
    s.owner = "bob";
    submit_for(p, &s, bobs);
    s.owner = plain.owner;
    s.depends_on_count = 2;
    submit_for(p, &s, last);
    s.depends_on = (const char *[]){second, first};
    submit_for(p, &s, third);
    assert_true(finish(p, first, 0, claim(p, first), &crash));
    assert_true(finish(p, broken, 0, claim(p, broken), &crash));
    apply_command(p, first, QUEUE_RETRY, true);
    queue_retried retried = {0};
    const char *own = plain.owner ? plain.owner : "";
    assert_true(queue_retry_dependents(p->q, first, own, &retried, NULL));
    assert_int_equal(retried.count, 2);
    assert_int_equal(retried.other_count, 1);
    assert_string_equal(retried.others[0], last);
    free(retried.others);
    expect_state(p, second, QUEUE_BLOCKED);
    expect_state(p, third, QUEUE_BLOCKED);
    expect_state(p, bobs, QUEUE_FAILED);
    expect_state(p, last, QUEUE_FAILED);
    /* an administrator retries the jobs of all users */
    apply_command(p, broken, QUEUE_RETRY, true);
    assert_true(queue_retry_dependents(p->q, first, NULL, &retried, NULL));
    assert_int_equal(retried.count, 2);
    assert_int_equal(retried.other_count, 0);
    free(retried.others);
    assert_true(finish(p, first, 0, claim(p, first), &success));
    expect_state(p, second, QUEUE_QUEUED);
    expect_state(p, bobs, QUEUE_QUEUED);
    expect_state(p, third, QUEUE_BLOCKED);
    expect_state(p, last, QUEUE_BLOCKED);
}

static void test_jobs_wait_for_any_end(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE], last[ULID_SIZE];
    put(p, "first", 0, first);
    put(p, "second", 0, second);
    const char *ends[] = {first, second}, *missing[] = {"01aaaaaaaaaaaaaaaaaaaaaaaa"};
    s.after = ends;
    s.after_count = 2;
    submit_for(p, &s, last);
    expect_state(p, last, QUEUE_BLOCKED);
    assert_true(finish(p, first, 0, claim(p, first), &crash));
    expect_state(p, last, QUEUE_BLOCKED);
    apply_command(p, first, QUEUE_RETRY, true); /* it ends a second time */
    assert_true(finish(p, first, 0, claim(p, first), &crash));
    reopen(p);
    expect_state(p, last, QUEUE_BLOCKED);
    apply_command(p, second, QUEUE_CANCEL, true);
    expect_state(p, last, QUEUE_QUEUED);
    assert_int_equal(submit(p, &s).state, QUEUE_QUEUED); /* both have ended */
    s.depends_on = &ends[0];
    s.depends_on_count = 1;
    /* two dependencies on the same job: the stricter one counts */
    assert_int_equal(submit(p, &s).state, QUEUE_FAILED);
    s.after = missing;
    s.after_count = 1;
    queue_receipt receipt = submit(p, &s);
    assert_int_equal(receipt.admission, QUEUE_UNKNOWN_DEPENDENCY);
    assert_int_equal(receipt.dependency, 1);
}

static const int frames[] = {1, 3, 5};

/* Checks the attempts of the job after attempt `after` of the task: "task.number ...". */
static void expect_attempts(place *p, const char *id, int task, int after, int limit, const char *expected)
{
    queue_attempt *attempts;
    size_t count;
    char text[200] = "";
    assert_true(queue_list_attempts(p->q, id, task, after, limit, &attempts, &count, NULL));
    for (size_t i = 0; i < count; i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%d.%d ", attempts[i].task,
                 attempts[i].number);
    assert_string_equal(text, expected);
    queue_attempts_free(attempts, count);
}

static void test_attempts_come_in_pages(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[ULID_SIZE];
    s.frames = frames;
    s.frame_count = 3;
    submit_for(p, &s, id);
    for (int i = 0; i < 3; i++) claim_in(p, &wide, id);
    bool accepted = false;
    assert_true(queue_requeue(p->q, &(queue_fence){id, 1, 1}, true, 0, &crash, &accepted, NULL) && accepted);
    claim_in(p, &wide, id);
    expect_attempts(p, id, -1, 0, 9, "0.1 1.1 1.2 2.1 ");
    expect_attempts(p, id, -1, 0, 2, "0.1 1.1 ");
    expect_attempts(p, id, 1, 1, 2, "1.2 2.1 ");
    expect_attempts(p, id, 2, 1, 2, "");
}

static void test_an_array_has_one_state(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[ULID_SIZE];
    s.frames = frames;
    s.frame_count = 3;
    submit_for(p, &s, id);
    queue_task first = claim_in(p, &wide, id), second = claim_in(p, &wide, id);
    assert_int_equal(first.frame, 1);
    assert_int_equal(second.frame, 3);
    assert_true(finish(p, id, 0, first.attempt, &success));
    assert_true(finish(p, id, 1, second.attempt, &crash));
    expect_state(p, id, QUEUE_RUNNING); /* between two frames */
    queue_task third = claim_in(p, &wide, id);
    queue_ending vague = success;
    vague.outcome = QUEUE_NOT_CONVERGED;
    assert_true(finish(p, id, 2, third.attempt, &vague));
    queue_job job = get(p, id);
    assert_true(job.array);
    assert_int_equal(job.state, QUEUE_FAILED);
    assert_int_equal(job.outcome, QUEUE_NO_OUTCOME);
    assert_int_equal(job.tasks.succeeded, 2);
    assert_int_equal(job.tasks.failed, 1);
    assert_string_equal(job.error_message, "1 of 3 frames failed; frame 3: killed");
    queue_job_clear(&job);
    bool found;
    queue_task task = {0};
    assert_true(queue_get_frame(p->q, id, 3, &task, &found, NULL));
    assert_true(found);
    assert_int_equal(task.state, QUEUE_FAILED);
    assert_string_equal(task.error_message, "killed");
    queue_task_clear(&task);
    assert_true(queue_get_frame(p->q, id, 2, &task, &found, NULL));
    assert_false(found);
    /* only the failed tasks are retried, with all their attempts and new numbers */
    assert_int_equal(apply_command(p, id, QUEUE_RETRY, true), QUEUE_RUNNING);
    second = claim_in(p, &wide, id);
    assert_int_equal(second.frame, 3);
    assert_int_equal(second.attempt, 2);
    assert_int_equal(second.spent, 1);
    claim(p, NULL);
    assert_true(finish(p, id, 1, second.attempt, &success));
    job = get(p, id);
    assert_int_equal(job.state, QUEUE_SUCCEEDED);
    assert_int_equal(job.outcome, QUEUE_NOT_CONVERGED);
    assert_null(job.error_message);
    assert_int_equal(job.attempts, 4);
    queue_job_clear(&job);
    assert_int_equal(apply_command(p, id, QUEUE_RETRY, false), QUEUE_SUCCEEDED);
}

/* Submits a job with the frames 1 to 3, each after the same frame of `need` (NULL: none). */
static void submit_frames(place *p, const char *need, int priority, bool ordered, char id[ULID_SIZE])
{
    static const int numbers[] = {1, 2, 3};
    queue_submission s = plain;
    s.frames = numbers;
    s.frame_count = 3;
    s.priority = priority;
    s.ordered = ordered;
    s.after_frames = &need;
    s.after_frames_count = need != NULL;
    submit_for(p, &s, id);
}

static void expect_frame(place *p, const char *id, int frame, queue_state state, int waits)
{
    queue_task task = {0};
    bool found = false;
    assert_true(queue_get_frame(p->q, id, frame, &task, &found, NULL) && found);
    assert_int_equal(task.state, state);
    assert_int_equal(task.waits, waits);
    if (state == QUEUE_FAILED) assert_string_equal(task.error_code, "dependency_failed");
    queue_task_clear(&task);
}

static void test_frames_start_after_the_same_frames_of_another_job(void **state)
{
    place *p = *state;
    char first[ULID_SIZE], second[ULID_SIZE], third[ULID_SIZE];
    submit_frames(p, NULL, 0, false, first);
    submit_frames(p, first, 1, false, second);
    submit_frames(p, second, 2, false, third);
    expect_state(p, second, QUEUE_BLOCKED);
    for (int i = 0; i < 3; i++) claim(p, first);
    claim(p, NULL);
    reopen(p);
    assert_true(finish(p, first, 1, 1, &success));
    expect_state(p, second, QUEUE_QUEUED);
    expect_frame(p, second, 2, QUEUE_QUEUED, 0);
    expect_frame(p, second, 3, QUEUE_QUEUED, 1);
    assert_int_equal(claim_in(p, &wide, second).frame, 2);
    claim(p, NULL);
    expect_state(p, third, QUEUE_BLOCKED);
    assert_true(finish(p, second, 1, 1, &success));
    expect_state(p, second, QUEUE_RUNNING); /* between two frames */
    assert_int_equal(claim_in(p, &wide, third).frame, 2);

    assert_true(finish(p, first, 0, 1, &crash)); /* and all later frames */
    expect_frame(p, second, 1, QUEUE_FAILED, 0);
    expect_frame(p, third, 1, QUEUE_FAILED, 0);
    expect_frame(p, third, 3, QUEUE_QUEUED, 1);
    apply_command(p, first, QUEUE_CANCEL, true);
    assert_true(finish(p, first, 2, 1, &crash));
    expect_frame(p, third, 3, QUEUE_FAILED, 0);
    expect_state(p, second, QUEUE_FAILED);
    queue_job job = get(p, second);
    assert_string_equal(job.error_code, "dependency_failed");
    assert_non_null(strstr(job.error_message, first));
    assert_int_equal(job.tasks.failed, 2);
    queue_job_clear(&job);
    assert_true(finish(p, third, 1, 1, &success));
    expect_state(p, third, QUEUE_FAILED);
}

static void expect_message(place *p, const char *id, const char *format, const char *need)
{
    queue_job job = get(p, id);
    char *expected = mem_printf(format, need);
    assert_string_equal(job.error_message, expected);
    free(expected);
    queue_job_clear(&job);
}

/* The only message about a job of another user: it shows neither its state, its outcome nor queue.accept. */
#define ONLY_WHETHER "%s, which did not succeed as required: ask its owner"

static void test_frames_wait_for_frames_of_another_user_only_for_administrators(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], single[ULID_SIZE], second[ULID_SIZE];
    submit_frames(p, NULL, 0, false, first);
    put(p, "single", -1, single);
    s.owner = "bob";
    s.frames = (const int[]){2, 3, 4};
    s.after_frames_count = 1;
    const char *const needs[] = {first, single};
    for (size_t i = 0; i < 4; i++) { /* with and without all frames, and for a job without frames */
        s.frame_count = i < 2 ? 2 : 3;
        s.after_frames = &needs[i % 2];
        queue_receipt receipt = submit(p, &s);
        assert_true(receipt.admission == QUEUE_FOREIGN_DEPENDENCY && receipt.dependency == 0 &&
                    receipt.frame == 0);
    }
    s.any_frames = true;
    assert_int_equal(submit(p, &s).admission, QUEUE_UNKNOWN_FRAME);
    s.frame_count = 2;
    s.after_frames = &needs[0];
    submit_for(p, &s, second);
    reopen(p); /* such a job was accepted from anyone by earlier versions */
    expect_state(p, second, QUEUE_BLOCKED);
    for (int i = 0; i < 3; i++) claim(p, first);
    assert_true(finish(p, first, 2, 1, &success));
    assert_int_equal(claim_in(p, &wide, second).frame, 3);
    assert_true(finish(p, first, 1, 1, &crash));
    assert_true(finish(p, second, 1, 1, &success));
    expect_message(
        p, second,
        "1 of 2 frames failed; frame 2: this frame starts after the same frame of the job " ONLY_WHETHER,
        first);
    assert_true(finish(p, first, 0, 1, &success));
    apply_command(p, first, QUEUE_RETRY, true);
    apply_command(p, second, QUEUE_RETRY, true);
    expect_frame(p, second, 2, QUEUE_QUEUED, 1);
}

static void test_a_dependency_on_another_users_job_shows_whether_it_succeeded(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[3][ULID_SIZE], own[ULID_SIZE], bobs[ULID_SIZE];
    s.accept = QUEUE_OUTCOME_BIT(QUEUE_CONVERGED);
    for (int i = 0; i < 3; i++) submit_for(p, &s, id[i]);
    queue_ending ending = success;
    ending.outcome = QUEUE_UNRESOLVED;
    for (int i = 0; i < 3; i++) {
        static const char *const how[] = {"is failed: retry that job first",
                                          "is cancelled: retry that job first",
                                          "has the outcome unresolved, which its queue.accept excludes"};
        for (int k = 0; k < 2; k++) { /* before the end of the other job and after it */
            s.depends_on = (const char *[]){id[i]};
            s.depends_on_count = 1;
            s.owner = NULL;
            submit_for(p, &s, own);
            s.owner = "bob";
            submit_for(p, &s, bobs);
            if (k == 0 && i == 1) apply_command(p, id[i], QUEUE_CANCEL, true);
            if (k == 0 && i != 1)
                assert_true(finish(p, id[i], 0, claim(p, id[i]), i == 0 ? &crash : &ending));
            expect_message(p, bobs, "this job depends on the job " ONLY_WHETHER, id[i]);
            char *format = mem_printf("this job depends on the job %%s, which %s", how[i]);
            expect_message(p, own, format, id[i]);
            free(format);
        }
    }
}

static void expect_cached(place *p, const char *id, const char *from, bool shown)
{
    queue_job job = get(p, id);
    assert_string_equal(job.cached_from, from);
    assert_int_equal(job.cached_shown, shown);
    queue_job_clear(&job);
}

static void test_a_reused_result_is_shown_to_the_owner_of_both_jobs(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], own[ULID_SIZE], bobs[ULID_SIZE], deleted[ULID_SIZE];
    queue_ending ending = success;
    submit_for(p, &s, first);
    assert_true(finish(p, first, 0, claim(p, first), &success));
    submit_for(p, &s, own);
    s.owner = "bob";
    submit_for(p, &s, bobs);
    submit_for(p, &s, deleted);
    ending.cached_from = first;
    assert_true(finish(p, own, 0, claim(p, own), &ending));
    assert_true(finish(p, bobs, 0, claim(p, bobs), &ending));
    bool found, gone;
    assert_true(queue_delete(p->q, first, &found, &gone, NULL) && gone);
    assert_true(finish(p, deleted, 0, claim(p, deleted), &ending));
    expect_cached(p, own, first, true);
    expect_cached(p, bobs, first, false);
    expect_cached(p, deleted, first, false);
}

static void test_a_retried_frame_waits_again(void **state)
{
    place *p = *state;
    char first[ULID_SIZE], second[ULID_SIZE];
    submit_frames(p, NULL, 0, false, first);
    submit_frames(p, first, 1, false, second);
    for (int i = 0; i < 3; i++) claim(p, first);
    for (int i = 0; i < 3; i++) assert_true(finish(p, first, i, 1, &crash));
    expect_state(p, second, QUEUE_FAILED);
    assert_int_equal(apply_command(p, second, QUEUE_RETRY, false), QUEUE_FAILED);
    apply_command(p, first, QUEUE_RETRY, true);
    queue_retried retried = {0};
    assert_true(queue_retry_dependents(p->q, first, NULL, &retried, NULL));
    assert_true(retried.count == 1 && retried.other_count == 0);
    free(retried.others);
    expect_state(p, second, QUEUE_BLOCKED);
    for (int i = 0; i < 3; i++) claim(p, first);
    assert_true(finish(p, first, 0, 2, &success));
    assert_true(finish(p, first, 1, 2, &crash));
    assert_int_equal(claim_in(p, &wide, second).frame, 1);
    assert_true(finish(p, second, 0, 1, &success));
    assert_true(finish(p, first, 2, 2, &success));
    assert_int_equal(claim_in(p, &wide, second).frame, 3);
    assert_true(finish(p, second, 2, 1, &crash));
    expect_frame(p, second, 2, QUEUE_FAILED, 0);
    /* frame 3 can run, frame 2 fails again */
    assert_int_equal(apply_command(p, second, QUEUE_RETRY, true), QUEUE_RUNNING);
    expect_frame(p, second, 2, QUEUE_FAILED, 0);
    assert_int_equal(claim_in(p, &wide, second).frame, 3);
    claim(p, NULL);
}

static void test_frames_in_order_wait_for_the_first(void **state)
{
    place *p = *state;
    char first[ULID_SIZE], second[ULID_SIZE];
    submit_frames(p, NULL, 0, false, first);
    submit_frames(p, first, 1, true, second);
    for (int i = 0; i < 3; i++) claim(p, first);
    assert_true(finish(p, first, 1, 1, &success));
    claim(p, NULL);
    expect_state(p, second, QUEUE_BLOCKED);
    assert_true(finish(p, first, 0, 1, &success));
    assert_int_equal(claim_in(p, &wide, second).frame, 1);
    claim(p, NULL);
    assert_true(finish(p, second, 0, 1, &success));
    assert_int_equal(claim_in(p, &wide, second).frame, 2);
    assert_true(finish(p, second, 1, 1, &success));
    claim(p, NULL);
    assert_true(finish(p, first, 2, 1, &success));
    assert_int_equal(claim_in(p, &wide, second).frame, 3);
}

static void test_frames_start_after_accepted_outcomes_only(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE];
    s.frames = (const int[]){1, 2, 3};
    s.frame_count = 3;
    s.accept = QUEUE_OUTCOME_BIT(QUEUE_UNRESOLVED) | QUEUE_OUTCOME_BIT(QUEUE_CONVERGED);
    submit_for(p, &s, first);
    queue_ending ending = success;
    for (int i = 0; i < 3; i++) {
        ending.outcome = (queue_outcome)(QUEUE_CONVERGED + i);
        assert_true(finish(p, first, i, claim(p, first), &ending));
    }
    submit_frames(p, first, 0, false, second); /* all frames have ended before */
    expect_frame(p, second, 1, QUEUE_QUEUED, 0);
    expect_frame(p, second, 2, QUEUE_QUEUED, 0);
    expect_frame(p, second, 3, QUEUE_FAILED, 0);
    claim(p, second);
    claim(p, second);
    claim(p, NULL);
}

static void test_dependencies_on_frames_are_checked(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char array[ULID_SIZE], single[ULID_SIZE];
    submit_frames(p, NULL, 0, false, array);
    put(p, "single", 0, single);
    s.frames = (const int[]){2, 1, 4};
    s.frame_count = 3;
    const char *needs[] = {single};
    s.after_frames = needs;
    s.after_frames_count = 1;
    queue_receipt receipt = submit(p, &s);
    assert_true(receipt.admission == QUEUE_UNKNOWN_FRAME && receipt.frame == QUEUE_NO_FRAME);
    needs[0] = array;
    receipt = submit(p, &s);
    assert_true(receipt.admission == QUEUE_UNKNOWN_FRAME && receipt.frame == 4 && receipt.dependency == 0);
    s.frame_count = 2;
    s.after = needs;
    s.after_count = 1;
    receipt = submit(p, &s);
    assert_true(receipt.admission == QUEUE_REPEATED_DEPENDENCY && receipt.dependency == 1);
    needs[0] = "01aaaaaaaaaaaaaaaaaaaaaaaa";
    s.after_count = 0;
    assert_int_equal(submit(p, &s).admission, QUEUE_UNKNOWN_DEPENDENCY);
    needs[0] = array;
    receipt = submit(p, &s);
    assert_true(receipt.admission == QUEUE_CREATED && receipt.state == QUEUE_BLOCKED);
    bool accepted = false; /* the database is older than the result of a held frame */
    assert_true(queue_end_found(p->q, receipt.id, 1, QUEUE_CONVERGED, &accepted, NULL) && accepted);
    apply_command(p, receipt.id, QUEUE_CANCEL, true);
}

static void test_a_job_runs_at_most_max_running_tasks(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[ULID_SIZE], other[ULID_SIZE];
    s.frames = (const int[]){1, 2, 3, 4, 5};
    s.frame_count = 5;
    s.max_running = 2;
    submit_for(p, &s, id);
    put(p, "other", -1, other);
    int attempt = claim(p, id);
    claim(p, id);
    claim(p, other); /* the array does not block it */
    claim(p, NULL);
    reopen(p);
    claim(p, NULL);
    assert_true(finish(p, id, 0, attempt, &success));
    claim(p, id);
    claim(p, NULL);
    queue_edited edited;
    assert_true(queue_change(p->q, id, -1, &(queue_edit){.max_running = &(const int){1}}, &edited, NULL));
    assert_true(finish(p, id, 1, 1, &crash));
    claim(p, NULL); /* task 2 still runs */
    assert_true(queue_change(p->q, id, -1, &(queue_edit){.max_running = &(const int){0}}, &edited, NULL));
    claim(p, id);
    claim(p, id);
    claim(p, NULL);
}

/* Submits an array of `count` frames, the first of which is frame 1. */
static void submit_chunks(place *p, int count, int chunk, int priority, char id[ULID_SIZE])
{
    int *numbers = mem_alloc((size_t)count * sizeof *numbers);
    queue_submission s = plain;
    for (int i = 0; i < count; i++) numbers[i] = i + 1;
    s.frames = numbers;
    s.frame_count = (size_t)count;
    s.chunk = chunk;
    s.priority = priority;
    submit_for(p, &s, id);
    free(numbers);
}

static int claim_number(place *p, const char *id)
{
    return claim_in(p, &wide, id).number;
}

static void test_frames_of_a_chunk_run_one_after_another(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], other[ULID_SIZE];
    submit_chunks(p, 7, 3, 0, id);
    put(p, "other", -1, other);
    assert_int_equal(claim_number(p, id), 0);
    assert_int_equal(claim_number(p, id), 3);
    assert_int_equal(claim_number(p, id), 6); /* the last chunk is shorter */
    claim(p, other);                          /* frames that wait for their chunk do not block it */
    claim(p, NULL);
    expect_state(p, id, QUEUE_RUNNING);
    reopen(p);
    claim(p, NULL);
    assert_true(finish(p, id, 3, 1, &success));
    assert_int_equal(claim_number(p, id), 4);
    claim(p, NULL);
    assert_true(finish(p, id, 4, 1, &crash)); /* a failed frame ends like any other */
    assert_true(finish(p, id, 0, 1, &success));
    assert_int_equal(claim_number(p, id), 1);
    assert_int_equal(claim_number(p, id), 5);
    claim(p, NULL);
    assert_int_equal(apply_command(p, id, QUEUE_CANCEL, true), QUEUE_CANCELLING);
    claim(p, NULL);
}

static void test_a_frame_that_is_tried_again_waits_for_its_chunk(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    submit_chunks(p, 4, 2, 0, id);
    assert_int_equal(claim_number(p, id), 0);
    assert_true(requeue(p, id, 1, true, clock_wall_ms() + 3600 * 1000, &crash));
    assert_int_equal(claim_number(p, id), 1); /* meanwhile the chunk goes on */
    assert_int_equal(claim_number(p, id), 2);
    claim(p, NULL);
    assert_true(finish(p, id, 1, 1, &success));
    assert_true(finish(p, id, 2, 1, &success));
    assert_int_equal(claim_number(p, id), 3);
    claim(p, NULL);
    assert_true(finish(p, id, 3, 1, &success));
    expect_state(p, id, QUEUE_RUNNING); /* the delayed frame is left */

    submit_chunks(p, 4, 2, 1, id);
    assert_int_equal(claim_number(p, id), 0);
    assert_true(requeue(p, id, 1, false, 0, &crash)); /* the daemon or the host has ended */
    assert_int_equal(claim_number(p, id), 0);
}

static void test_urgent_jobs_come_between_frames_of_a_chunk(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], urgent[ULID_SIZE];
    submit_chunks(p, 4, 2, 0, id);
    assert_int_equal(claim_number(p, id), 0);
    put(p, "urgent", 1, urgent);
    assert_true(finish(p, id, 0, 1, &success));
    claim(p, urgent);
    assert_int_equal(claim_number(p, id), 1); /* the chunk is free again */
}

static void test_max_running_counts_frames_of_chunks(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_submission s = plain;
    s.frames = (const int[]){1, 2, 3, 4, 5, 6};
    s.frame_count = 6;
    s.chunk = 2;
    s.max_running = 2;
    submit_for(p, &s, id);
    assert_int_equal(claim_number(p, id), 0);
    assert_int_equal(claim_number(p, id), 2);
    claim(p, NULL);
    assert_true(finish(p, id, 0, 1, &success));
    assert_int_equal(claim_number(p, id), 1);
    claim(p, NULL);
    assert_true(finish(p, id, 1, 1, &success));
    assert_int_equal(claim_number(p, id), 4);
    claim(p, NULL);
}

static void test_frames_of_chunks_wait_for_frames(void **state)
{
    place *p = *state;
    char first[ULID_SIZE], second[ULID_SIZE];
    submit_chunks(p, 4, 1, 0, first);
    queue_submission s = plain;
    s.frames = (const int[]){1, 2, 3, 4};
    s.frame_count = 4;
    s.chunk = 2;
    s.priority = 1;
    s.after_frames = &(const char *){first};
    s.after_frames_count = 1;
    submit_for(p, &s, second);
    for (int i = 0; i < 4; i++) claim(p, first);
    assert_true(finish(p, first, 1, 1, &success));
    assert_int_equal(claim_number(p, second), 1); /* frame 1 is passed over */
    assert_true(finish(p, first, 0, 1, &success));
    claim(p, NULL); /* its chunk runs */
    assert_true(finish(p, first, 2, 1, &success));
    assert_int_equal(claim_number(p, second), 2);
    assert_true(finish(p, second, 1, 1, &success));
    assert_int_equal(claim_number(p, second), 0);
    claim(p, NULL);
}

/* Claims the next task of the chunk of `task`; its number, -1: there is none. *more: see queue_claimed. */
static int claim_in_chunk(place *p, const queue_resources *resources, const char *id, int task, bool *more)
{
    queue_claimed claimed = {0};
    bool found = false;
    error e = {0};
    if (!queue_claim_in_chunk(p->q, resources, id, task, &claimed, &found, &e)) fail_msg("%s", e.message);
    int number = found ? claimed.task.number : -1;
    if (found) assert_string_equal(claimed.job.id, id);
    *more = claimed.more;
    queue_claimed_clear(&claimed);
    return number;
}

static void test_a_chunk_is_claimed_as_a_whole(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], single[ULID_SIZE];
    bool more = false;
    queue_resources one_each = wide;
    submit_chunks(p, 6, 4, 0, id);
    put(p, "single", 1, single);
    claim(p, single);
    assert_int_equal(claim_in_chunk(p, &wide, single, 0, &more), -1);
    queue_claimed claimed = {0};
    bool found = false;
    assert_true(queue_claim(p->q, &wide, &claimed, &found, NULL) && found);
    assert_true(claimed.more && claimed.chunk == 0 && claimed.task.number == 0);
    queue_claimed_clear(&claimed);
    assert_int_equal(claim_in_chunk(p, &wide, id, 0, &more), 1);
    assert_true(more);
    apply_command(p, id, QUEUE_PAUSE, true);
    assert_int_equal(claim_in_chunk(p, &wide, id, 1, &more), -1);
    apply_command(p, id, QUEUE_RESUME, true);
    one_each.most_of_owner = 3;
    assert_int_equal(claim_in_chunk(p, &one_each, id, 1, &more), -1);
    one_each = wide;
    one_each.memory_mb = 99;
    assert_int_equal(claim_in_chunk(p, &one_each, id, 1, &more), -1);
    queue_edited edited;
    assert_true(queue_change(p->q, id, -1, &(queue_edit){.max_running = &(const int){2}}, &edited, NULL));
    assert_int_equal(claim_in_chunk(p, &wide, id, 1, &more), -1);
    assert_true(queue_change(p->q, id, -1, &(queue_edit){.max_running = &(const int){3}}, &edited, NULL));
    assert_int_equal(claim_in_chunk(p, &wide, id, 1, &more), 2);
    assert_false(more); /* max_running is reached */
    assert_true(queue_change(p->q, id, -1, &(queue_edit){.max_running = &(const int){0}}, &edited, NULL));
    assert_true(queue_hold(p->q, true, NULL));
    assert_int_equal(claim_in_chunk(p, &wide, id, 2, &more), -1);
    assert_true(queue_hold(p->q, false, NULL));
    assert_int_equal(claim_in_chunk(p, &wide, id, 2, &more), 3);
    assert_false(more); /* the chunk has ended */
    assert_int_equal(claim_in_chunk(p, &wide, id, 3, &more), -1);
    assert_int_equal(claim_number(p, id), 4);
}

/* What a test knows of an array: the state of each of its tasks. */
enum { CHUNK_TASKS = 24 };
typedef struct chunk_model {
    int chunk;
    char state[CHUNK_TASKS + 1]; /* queued, running, delayed, over: the first letter of each; a string */
    int attempt[CHUNK_TASKS];
} chunk_model;

/* The first ready task of a chunk without a running one; -1: none. */
static int expect_next(const chunk_model *m)
{
    for (int i = 0; i < CHUNK_TASKS; i++) {
        bool busy = false;
        int first = i - i % m->chunk;
        for (int k = first; k < first + m->chunk && k < CHUNK_TASKS; k++) busy |= m->state[k] == 'r';
        if (m->state[i] == 'q' && !busy) return i;
    }
    return -1;
}

static int draw(rng *r, int below)
{
    return (int)(rng_uniform(r) * below);
}

static void step_chunks(place *p, const char *id, chunk_model *m, rng *r)
{
    int task = draw(r, CHUNK_TASKS);
    bool accepted = false;
    if (m->state[task] != 'r') {
        int next = expect_next(m);
        queue_task claimed = claim_in(p, &wide, next >= 0 ? id : NULL);
        if (next < 0) return;
        assert_int_equal(claimed.number, next);
        m->state[next] = 'r';
        m->attempt[next] = claimed.attempt;
        return;
    }
    const queue_fence fence = {id, task, m->attempt[task]};
    switch (draw(r, 4)) {
    case 0: /* a wait that outlasts the test */
        assert_true(
            queue_requeue(p->q, &fence, false, clock_wall_ms() + 3600 * 1000, &crash, &accepted, NULL));
        m->state[task] = 'd';
        break;
    case 1:
        assert_true(queue_requeue(p->q, &fence, false, 0, &crash, &accepted, NULL));
        m->state[task] = 'q';
        break;
    default:
        assert_true(queue_finish(p->q, &fence, draw(r, 2) ? &success : &crash, &accepted, NULL));
        m->state[task] = 'o';
    }
    assert_true(accepted);
}

/* Any order of ends, retries and restarts: a claim takes the first task that can start of a chunk without a
 * running task. */
static void test_chunks_in_any_order(void **state)
{
    place *p = *state;
    const char *given = getenv("HEXAD_TEST_SEED");
    uint64_t seed = given ? strtoull(given, NULL, 10) : (uint64_t)clock_wall_ms();
    print_message("HEXAD_TEST_SEED=%" PRIu64 "\n", seed);
    rng r = rng_seed(seed, 0);
    for (int round = 0; round < 12; round++) {
        char id[ULID_SIZE];
        chunk_model m = {.chunk = 1 + draw(&r, CHUNK_TASKS + 2)};
        memset(m.state, 'q', CHUNK_TASKS);
        submit_chunks(p, CHUNK_TASKS, m.chunk, round, id);
        for (int step = 0; step < 150; step++) {
            step_chunks(p, id, &m, &r);
            if (draw(&r, 50) == 0) reopen(p);
        }
        apply_command(p, id, QUEUE_CANCEL, m.state[strspn(m.state, "o")]); /* it waits no more */
    }
}

static void test_cancel_of_an_array(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[ULID_SIZE];
    s.frames = frames;
    s.frame_count = 3;
    submit_for(p, &s, id);
    int attempt = claim(p, id);
    assert_int_equal(apply_command(p, id, QUEUE_CANCEL, true), QUEUE_CANCELLING);
    claim(p, NULL);
    assert_true(finish(p, id, 0, attempt, &crash));
    expect_state(p, id, QUEUE_CANCELLED);
    assert_int_equal(apply_command(p, id, QUEUE_RETRY, true), QUEUE_QUEUED);
    claim(p, id);
}

/* Claims the next task of an ordered job, which must start from the points of `previous`. */
static queue_task claim_after(place *p, const char *id, int previous)
{
    queue_claimed claimed = {0};
    bool found = false;
    assert_true(queue_claim(p->q, &wide, &claimed, &found, NULL));
    assert_true(found);
    assert_string_equal(claimed.job.id, id);
    assert_int_equal(claimed.previous, previous);
    queue_task task = claimed.task;
    queue_claimed_clear(&claimed);
    return task;
}

static void put_in_order(place *p, char id[ULID_SIZE])
{
    queue_submission s = plain;
    s.frames = frames;
    s.frame_count = 3;
    s.ordered = true;
    submit_for(p, &s, id);
}

static void test_tasks_in_order_begin_with_the_one_before(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], other[ULID_SIZE];
    put_in_order(p, id);
    put(p, "other", 0, other);
    queue_task first = claim_after(p, id, QUEUE_NO_FRAME);
    claim(p, other); /* no other frame in the meantime */
    claim(p, NULL);
    reopen(p);
    assert_true(finish(p, id, 0, first.attempt, &success));
    queue_task second = claim_after(p, id, 1);
    assert_int_equal(second.frame, 3);
    /* it crashes: later tasks wait until it is retried */
    assert_true(queue_requeue(p->q, &(queue_fence){id, 1, second.attempt}, true, INT64_MAX, &crash,
                              &(bool){0}, NULL));
    claim(p, NULL);
    expect_state(p, id, QUEUE_RUNNING);
}

static void test_tasks_after_a_failed_one_fail(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put_in_order(p, id);
    assert_true(finish(p, id, 0, claim_after(p, id, QUEUE_NO_FRAME).attempt, &success));
    assert_true(finish(p, id, 1, claim_after(p, id, 1).attempt, &crash));
    queue_job job = get(p, id);
    assert_int_equal(job.state, QUEUE_FAILED);
    assert_int_equal(job.tasks.succeeded, 1);
    assert_int_equal(job.tasks.failed, 2);
    assert_string_equal(job.error_message, "2 of 3 frames failed; frame 3: killed");
    queue_job_clear(&job);
    queue_task last = {0};
    bool found = false;
    assert_true(queue_get_frame(p->q, id, frames[2], &last, &found, NULL) && found);
    assert_string_equal(last.error_code, "dependency_failed");
    assert_non_null(
        strstr(last.error_message, "this frame starts with the points of frame 3, which is failed"));
    queue_task_clear(&last);
    /* both are retried, in order */
    assert_int_equal(apply_command(p, id, QUEUE_RETRY, true), QUEUE_RUNNING);
    assert_true(finish(p, id, 1, claim_after(p, id, 1).attempt, &success));
    assert_true(finish(p, id, 2, claim_after(p, id, 3).attempt, &success));
    expect_state(p, id, QUEUE_SUCCEEDED);
}

static void test_a_frame_without_a_surface_is_skipped(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_ending empty = crash;
    empty.error_code = "no_surface";
    put_in_order(p, id);
    assert_true(finish(p, id, 0, claim_after(p, id, QUEUE_NO_FRAME).attempt, &success));
    assert_true(finish(p, id, 1, claim_after(p, id, 1).attempt, &empty));
    assert_true(finish(p, id, 2, claim_after(p, id, 1).attempt, &success));
    expect_state(p, id, QUEUE_FAILED);
}

static void test_edits_have_revisions(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], other[ULID_SIZE];
    put(p, "edited", 0, id);
    put(p, "other", 1, other);
    queue_job job = get(p, id);
    int64_t revision = job.revision, retention = 1;
    queue_job_clear(&job);
    int priority = 2;
    queue_edit edit = {.priority = &priority, .labels = "[\"b\",\"c\"]"};
    queue_edited edited;
    assert_true(queue_change(p->q, id, revision, &edit, &edited, NULL));
    assert_int_equal(edited, QUEUE_EDITED);
    assert_true(queue_change(p->q, id, revision, &edit, &edited, NULL));
    assert_int_equal(edited, QUEUE_STALE);
    assert_true(queue_change(p->q, "missing", -1, &edit, &edited, NULL));
    assert_int_equal(edited, QUEUE_NOT_THERE);
    job = get(p, id);
    assert_int_equal(job.revision, revision + 1);
    assert_int_equal(job.priority, 2);
    assert_string_equal(job.labels, "[\"b\",\"c\"]");
    queue_job_clear(&job);
    int attempt = claim(p, id); /* it now precedes the other */
    job = get(p, id);
    assert_int_equal(job.revision, revision + 2);
    queue_job_clear(&job);
    assert_true(finish(p, id, 0, attempt, &success));
    int64_t at = 0;
    assert_true(queue_next_expiry(p->q, 0, &at, NULL));
    assert_true(at == INT64_MAX);
    edit = (queue_edit){.retention_s = &retention};
    assert_true(queue_change(p->q, id, -1, &edit, &edited, NULL));
    job = get(p, id);
    assert_true(queue_next_expiry(p->q, 0, &at, NULL));
    assert_true(at == job.finished_ms + 1000);
    assert_true(job.retention_s == 1);
    queue_job_clear(&job);
}

static void test_expired_jobs_are_deleted(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[ULID_SIZE], kept[ULID_SIZE], dependent[ULID_SIZE];
    s.retention_s = 10;
    s.key = "k";
    s.body_hash = "abc";
    submit_for(p, &s, id);
    put(p, "kept", 0, kept);
    const char *needs[] = {id};
    s.key = NULL;
    s.depends_on = needs;
    s.depends_on_count = 1;
    submit_for(p, &s, dependent);
    bool found, deleted;
    assert_true(queue_delete(p->q, id, &found, &deleted, NULL));
    assert_true(found && !deleted);
    assert_true(finish(p, id, 0, claim(p, id), &success));
    assert_true(finish(p, kept, 0, claim(p, kept), &success));
    queue_job job = get(p, id);
    int64_t over = job.finished_ms + 10000;
    queue_job_clear(&job);
    char(*ids)[ULID_SIZE];
    size_t count;
    running_bound bound = {INT64_MIN, INT64_MAX, 0, over - 1};
    assert_true(queue_list_expired(p->q, &bound, 1, 9, &ids, &count, NULL));
    assert_int_equal(count, 0);
    free(ids);
    running_bound later[] = {{INT64_MIN, over - 10000, 0, over},
                             {over - 9999, INT64_MAX, 0, over},
                             {INT64_MIN, INT64_MAX, over - 9999, over}};
    assert_true(queue_list_expired(p->q, later, 3, 9, &ids, &count, NULL));
    assert_int_equal(count, 0);
    free(ids);
    bound.over_ms = over;
    assert_true(queue_list_expired(p->q, &bound, 1, 9, &ids, &count, NULL));
    assert_int_equal(count, 1);
    assert_string_equal(ids[0], id);
    free(ids);
    assert_true(queue_delete(p->q, id, &found, &deleted, NULL));
    assert_true(found && deleted);
    assert_true(queue_delete(p->q, id, &found, &deleted, NULL));
    assert_false(found);
    queue_event_filter filter = {.id = id, .limit = 100};
    queue_event_page page = list_events(p, &filter);
    assert_int_equal(page.count, 0);
    free(page.events);
    claim(p, dependent); /* its dependency had ended */
    s = plain;
    s.key = "k";
    s.body_hash = "def";
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED); /* the key can be used again */
}

static void test_list_pages_newest_first(void **state)
{
    place *p = *state;
    char id[5][ULID_SIZE];
    for (int i = 0; i < 5; i++) put(p, NULL, 0, id[i]);
    claim(p, id[0]);
    expect_listed(p, &(queue_filter){.state = -1, .limit = 3}, (const char *[]){id[4], id[3], id[2]}, 3);
    queue_job job = get(p, id[2]);
    queue_filter next = {.state = -1, .limit = 3, .after_seq = job.seq};
    queue_job_clear(&job);
    expect_listed(p, &next, (const char *[]){id[1], id[0]}, 2);
    queue_filter queued = {.state = QUEUE_QUEUED, .limit = 100};
    expect_listed(p, &queued, (const char *[]){id[4], id[3], id[2], id[1]}, 4);
    int64_t in_state[QUEUE_STATE_COUNT];
    assert_true(queue_count(p->q, in_state, NULL));
    assert_int_equal(in_state[QUEUE_QUEUED], 4);
    assert_int_equal(in_state[QUEUE_RUNNING], 1);
    assert_int_equal(in_state[QUEUE_FAILED], 0);
}

static void test_lists_have_no_long_specs(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char *text = mem_printf("{\"version\":1,\"pad\":\"%*s\"}", 16384, ""), id[ULID_SIZE];
    queue_job *jobs;
    size_t count;
    s.spec = text;
    submit_for(p, &s, id);
    assert_true(queue_list(p->q, &(queue_filter){.state = -1, .limit = 10}, &jobs, &count, NULL));
    assert_int_equal(count, 1);
    assert_null(jobs[0].spec);
    queue_jobs_free(jobs, count);
    free(text);
}

static void test_list_by_name_and_time(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[3][ULID_SIZE];
    int64_t created_ms[3];
    for (int i = 0; i < 3; i++) {
        s.name = i == 1 ? NULL : "ball";
        submit_for(p, &s, id[i]);
        queue_job job = get(p, id[i]);
        created_ms[i] = job.created_ms;
        queue_job_clear(&job);
    }
    /* a day between the jobs; the clock was set back before the last */
    queue_close(p->q);
    p->q = NULL;
    sqlite3 *database = open_raw(p);
    for (int i = 0; i < 3; i++) {
        static const int day[] = {0, 2, 1};
        char *sql = mem_printf("UPDATE job SET created_ms = %lld WHERE id = '%s'",
                               (long long)(created_ms[0] + day[i] * 86400000LL), id[i]);
        assert_int_equal(sqlite3_exec(database, sql, NULL, NULL, NULL), SQLITE_OK);
        free(sql);
    }
    sqlite3_close(database);
    reopen(p);
    queue_filter f = {.state = -1, .limit = 9, .name = "ball"};
    expect_listed(p, &f, (const char *[]){id[2], id[0]}, 2);
    f.since_ms = created_ms[0] + 1;
    expect_listed(p, &f, (const char *[]){id[2]}, 1);
    f.name = NULL;
    expect_listed(p, &f, (const char *[]){id[2], id[1]}, 2);
    f.until_ms = created_ms[0] + 2 * 86400000LL;
    expect_listed(p, &f, (const char *[]){id[2]}, 1);
    f.since_ms = 0;
    expect_listed(p, &f, (const char *[]){id[2], id[0]}, 2);
    f.until_ms = created_ms[0];
    expect_listed(p, &f, NULL, 0);
    f.until_ms = 0;
    f.since_ms = created_ms[0] + 3 * 86400000LL;
    expect_listed(p, &f, NULL, 0);
}

/* The pages of each order, with one job per page, ascending and descending. */
static void test_lists_are_sorted(void **state)
{
    place *p = *state;
    static const struct {
        const char *name, *owner;
        int priority;
    } given[] = {{"Beta 50%", "bob", 5}, {NULL, "ann", -5}, {"alpha", "bob", 5}, {"beta 50%", "cid", 0}};
    static const int wanted[QUEUE_ORDER_COUNT][4] = {[QUEUE_BY_AGE] = {0, 1, 2, 3},
                                                     [QUEUE_BY_NAME] = {1, 2, 0, 3},
                                                     [QUEUE_BY_OWNER] = {1, 0, 2, 3},
                                                     [QUEUE_BY_STATE] = {1, 2, 3, 0},
                                                     [QUEUE_BY_PRIORITY] = {1, 3, 0, 2}};
    queue_submission s = plain;
    char id[4][ULID_SIZE];
    for (int i = 0; i < 4; i++) {
        s.name = given[i].name;
        s.owner = given[i].owner;
        s.priority = given[i].priority;
        submit_for(p, &s, id[i]);
    }
    claim(p, id[0]); /* "running" follows "queued" */
    for (int k = 0; k < 2 * QUEUE_ORDER_COUNT; k++) {
        queue_filter f = {.state = -1, .limit = 1, .order = (queue_order)(k / 2), .rising = k % 2};
        char text[QUEUE_SORT_KEY_SIZE], *key = NULL;
        queue_job *jobs = NULL, last = {0};
        size_t count = 0;
        for (int i = 0; i < 4; i++) {
            assert_true(queue_list(p->q, &f, &jobs, &count, NULL));
            assert_int_equal(count, 1);
            assert_string_equal(jobs[0].id, id[wanted[k / 2][f.rising ? i : 3 - i]]);
            if (i) assert_true(queue_compare(&last, &jobs[0], &f) < 0);
            free(key);
            f.after_key = key = mem_strdup(queue_sort_key(&jobs[0], f.order, text));
            f.after_seq = jobs[0].seq;
            queue_job_clear(&last);
            last = jobs[0];
            free(jobs);
        }
        expect_listed(p, &f, NULL, 0);
        queue_job_clear(&last);
        free(key);
    }
    queue_filter f = {.state = -1, .limit = 9, .text = "BETA 50%", .order = QUEUE_BY_NAME, .rising = true};
    expect_listed(p, &f, (const char *[]){id[0], id[3]}, 2);
    f = (queue_filter){.state = -1, .limit = 9, .text = "a", .owner = "bob"};
    expect_listed(p, &f, (const char *[]){id[2], id[0]}, 2);
    f.text = "5_%";
    expect_listed(p, &f, NULL, 0);
}

/* Checks that consecutive pages that visit `visits` jobs each give the whole list. */
static void expect_pages_are_the_list(place *p, queue_filter f, int visits)
{
    queue_job *all;
    size_t count, seen = 0, pages = 0;
    char *key = NULL, text[QUEUE_SORT_KEY_SIZE];
    if (f.states) {
        queue_page whole;
        assert_true(queue_list_page(p->q, &f, 0, &whole, NULL));
        assert_int_equal(whole.stop.seq, 0);
        all = whole.jobs;
        count = whole.count;
    } else {
        assert_true(queue_list(p->q, &f, &all, &count, NULL));
    }
    f.limit = 2;
    for (bool more = true; more;) {
        queue_page page;
        assert_true(queue_list_page(p->q, &f, visits, &page, NULL));
        for (size_t i = 0; i < page.count; i++) {
            if (seen == count) fail_msg("a job too many");
            assert_string_equal(page.jobs[i].id, all[seen++].id);
        }
        const queue_job *last = page.count == (size_t)f.limit ? &page.jobs[page.count - 1] : NULL;
        more = last || page.stop.seq;
        char *next = last            ? mem_strdup(queue_sort_key(last, f.order, text))
                     : page.stop.key ? mem_strdup(page.stop.key)
                                     : NULL;
        f.after_seq = last ? last->seq : page.stop.seq;
        free(key);
        f.after_key = key = next;
        queue_page_clear(&page);
        if (++pages > 100) fail_msg("the list does not end");
    }
    assert_int_equal(seen, count);
    free(key);
    queue_jobs_free(all, count);
}

static void test_pages_visit_a_bounded_number_of_jobs(void **state)
{
    place *p = *state;
    static const char *const names[] = {"b", NULL, "A", "a", "b", "c", "B"}, *const owners[] = {"ann", "bob"};
    queue_submission s = plain;
    char id[7][ULID_SIZE];
    for (int i = 0; i < 7; i++) {
        s.name = names[i];
        s.owner = owners[i % 2];
        s.priority = i % 3;
        s.labels = i % 3 ? "[\"x\"]" : "[]";
        submit_for(p, &s, id[i]);
    }
    claim(p, id[2]);
    queue_job third = get(p, id[2]);
    unsigned waiting = 1u << QUEUE_QUEUED | 1u << QUEUE_RUNNING | 1u << QUEUE_FAILED;
    const queue_filter filters[] = {
        {.state = -1},
        {.state = QUEUE_QUEUED},
        {.state = QUEUE_SUCCEEDED},
        {.state = -1, .states = waiting},
        {.state = -1, .owner = "ann"},
        {.state = -1, .owner = "ann", .states = waiting},
        {.state = -1, .label = "x"},
        {.state = -1, .label = "y"},
        {.state = -1, .name = "b"},
        {.state = -1, .text = "B"},
        {.state = -1, .text = "none"},
        {.state = -1, .since_ms = third.created_ms},
        {.state = -1, .since_ms = INT64_MAX - 1},
        {.state = -1, .until_ms = third.created_ms},
    };
    queue_job_clear(&third);
    for (size_t i = 0; i < sizeof filters / sizeof *filters; i++)
        for (int k = 0; k < 2 * QUEUE_ORDER_COUNT; k++)
            for (int visits = 1; visits <= 5; visits += 2) {
                queue_filter f = filters[i];
                f.limit = 100;
                f.order = (queue_order)(k / 2);
                f.rising = k % 2;
                expect_pages_are_the_list(p, f, visits);
            }
    queue_page page;
    queue_filter none = {.state = -1, .limit = 9, .text = "none"};
    assert_true(queue_list_page(p->q, &none, 3, &page, NULL));
    assert_int_equal(page.count, 0);
    queue_job fifth = get(p, id[4]);
    assert_int_equal(page.stop.seq, fifth.seq); /* the third newest of seven */
    queue_job_clear(&fifth);
    queue_page_clear(&page);
}

/* All eight combinations of conditions. */
static void test_list_by_owner_and_label(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char ann[ULID_SIZE], bob[ULID_SIZE], shot[ULID_SIZE];
    s.owner = "ann";
    submit_for(p, &s, ann);
    s.labels = "[\"shot\",\"x\",\"shot\"]";
    submit_for(p, &s, shot);
    s.owner = "bob";
    submit_for(p, &s, bob);
    claim(p, ann);
    const queue_filter any = {.state = -1, .limit = 9};
    queue_filter f = any;
    expect_listed(p, &f, (const char *[]){bob, shot, ann}, 3);
    f.state = QUEUE_QUEUED;
    expect_listed(p, &f, (const char *[]){bob, shot}, 2);
    f.owner = "ann";
    expect_listed(p, &f, (const char *[]){shot}, 1);
    f.state = -1;
    expect_listed(p, &f, (const char *[]){shot, ann}, 2);
    f.label = "shot";
    expect_listed(p, &f, (const char *[]){shot}, 1);
    f.state = QUEUE_QUEUED;
    expect_listed(p, &f, (const char *[]){shot}, 1);
    f.owner = NULL;
    expect_listed(p, &f, (const char *[]){bob, shot}, 2);
    f.state = -1;
    f.limit = 1;
    expect_listed(p, &f, (const char *[]){bob}, 1);
    queue_job job = get(p, bob);
    f.after_seq = job.seq;
    queue_job_clear(&job);
    expect_listed(p, &f, (const char *[]){shot}, 1);
    f.label = "nothing";
    expect_listed(p, &f, NULL, 0);
}

static void test_attempts_that_count_add_their_time(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "slow", 0, id);
    queue_ending ran = crash;
    ran.ran_ms = 700;
    assert_true(requeue(p, id, claim(p, id), true, 0, &ran));
    assert_int_equal(get_task(p, id, 0).ran_ms, 700);
    assert_true(requeue(p, id, claim(p, id), false, 0, &ran)); /* does not count */
    assert_int_equal(get_task(p, id, 0).ran_ms, 700);
    assert_true(requeue(p, id, claim(p, id), true, 0, &ran));
    assert_int_equal(claim_in(p, &wide, id).ran_ms, 1400);
    assert_true(finish(p, id, 0, 4, &ran));
    apply_command(p, id, QUEUE_RETRY, true);
    assert_int_equal(get_task(p, id, 0).ran_ms, 0);
}

static queue_delivery next_delivery(place *p, const char *id)
{
    queue_delivery delivery = {0};
    bool found = false;
    assert_true(queue_next_delivery(p->q, "[]", &delivery, &found, NULL));
    assert_int_equal(found, id != NULL);
    if (id) assert_string_equal(delivery.id, id);
    return delivery;
}

static void test_deliveries_to_busy_hosts_are_skipped(void **state)
{
    static const char *const urls[] = {"https://farm:443/a", "https://farm:443/b", "https://farm2:443/",
                                       "https://farm:81/"};
    place *p = *state;
    queue_submission s = plain;
    char id[4][ULID_SIZE];
    for (size_t i = 0; i < 4; i++) {
        s.webhook = urls[i];
        submit_for(p, &s, id[i]);
        assert_true(finish(p, id[i], 0, claim(p, id[i]), &success));
    }
    static const struct {
        const char *but;
        int next; /* -1: none */
    } looks[] = {{"[]", 0},
                 {"[\"https://farm:443/\"]", 2},
                 {"[\"https://farm:443/\",\"https://farm2:443/\"]", 3},
                 {"[\"https://farm:443/\",\"https://farm2:443/\",\"https://farm:81/\"]", -1}};
    for (size_t i = 0; i < sizeof looks / sizeof *looks; i++) {
        queue_delivery delivery = {0};
        bool found = false;
        assert_true(queue_next_delivery(p->q, looks[i].but, &delivery, &found, NULL));
        assert_int_equal(found, looks[i].next >= 0);
        if (found) assert_string_equal(delivery.url, urls[looks[i].next]);
        queue_delivery_clear(&delivery);
    }
}

static void test_ends_are_notified(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char notified[ULID_SIZE], quiet[ULID_SIZE], failed[ULID_SIZE];
    s.webhook = "https://farm/done";
    submit_for(p, &s, notified);
    put(p, "quiet", 0, quiet);
    submit_for(p, &s, failed);
    next_delivery(p, NULL);
    assert_true(finish(p, notified, 0, claim(p, notified), &success));
    assert_true(finish(p, quiet, 0, claim(p, quiet), &success));
    reopen(p);
    queue_delivery delivery = next_delivery(p, notified);
    assert_string_equal(delivery.url, "https://farm/done");
    assert_int_equal(delivery.state, QUEUE_SUCCEEDED);
    assert_int_equal(delivery.outcome, QUEUE_CONVERGED);
    assert_int_equal(delivery.tries, 0);
    assert_string_equal(delivery.labels, plain.labels);
    char event[ULID_SIZE];
    memcpy(event, delivery.event, sizeof event);
    assert_true(ulid_is_valid(event) && ulid_time_ms(event) == delivery.ended_ms);
    const int64_t wait_ms = INT64_C(1) << 42, before_ms = clock_wall_ms();
    assert_true(queue_end_delivery(p->q, delivery.number, wait_ms, NULL));
    queue_delivery_clear(&delivery);
    delivery = next_delivery(p, notified);
    assert_string_equal(delivery.event, event);
    assert_true(delivery.due_ms >= before_ms + wait_ms && delivery.due_ms <= clock_wall_ms() + wait_ms);
    assert_int_equal(delivery.tries, 1);
    queue_delivery_clear(&delivery);
    assert_true(finish(p, failed, 0, claim(p, failed), &crash));
    delivery = next_delivery(p, failed); /* it is due earlier */
    assert_string_not_equal(delivery.event, event);
    assert_int_equal(delivery.state, QUEUE_FAILED);
    assert_true(queue_end_delivery(p->q, delivery.number, 0, NULL));
    queue_delivery_clear(&delivery);
    delivery = next_delivery(p, notified);
    queue_delivery_clear(&delivery);
    bool found, deleted;
    assert_true(queue_delete(p->q, notified, &found, &deleted, NULL));
    next_delivery(p, NULL);
}

static queue_figures get_figures(place *p)
{
    queue_figures figures = {0};
    assert_true(queue_get_figures(p->q, &figures, NULL));
    assert_true(figures.database_bytes > 0 && figures.database_bytes % 512 == 0);
    return figures;
}

/* Time of the newest event of the job itself. */
static int64_t last_event_ms(place *p, const char *id)
{
    queue_event_page page = {0};
    assert_true(queue_list_events(p->q, &(queue_event_filter){.id = id, .limit = 100}, &page, NULL));
    int64_t at_ms = page.events[page.count - 1].at_ms;
    free(page.events);
    return at_ms;
}

static void test_figures(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE];
    queue_figures none = get_figures(p);
    assert_true(!none.waiting_since_ms && !none.deliveries && !none.delivery_since_ms);
    s.webhook = "https://farm/done";
    submit_for(p, &s, first);
    submit_for(p, &s, second);
    assert_true(get_figures(p).waiting_since_ms == last_event_ms(p, first));
    int attempt = claim(p, first);
    assert_true(get_figures(p).waiting_since_ms == last_event_ms(p, second));
    assert_true(finish(p, first, 0, attempt, &crash));
    assert_int_equal(get_figures(p).deliveries, 1);
    queue_job ended = get(p, first);
    assert_true(finish(p, second, 0, claim(p, second), &success));
    queue_figures both = get_figures(p);
    assert_int_equal(both.deliveries, 2);
    assert_true(both.delivery_since_ms == ended.finished_ms && !both.waiting_since_ms);
    queue_job_clear(&ended);
    apply_command(p, first, QUEUE_RETRY, true); /* it waits since the retry, not since the submission */
    assert_true(get_figures(p).waiting_since_ms == last_event_ms(p, first));
}

/* The deletion of a job records its directories. The queue returns the task of a directory. */
static void test_deletion_records_the_directories(void **state)
{
    place *p = *state;
    static const int two[] = {7, 3};
    char single[ULID_SIZE], array[ULID_SIZE];
    bool found, deleted;
    queue_submission s = plain;
    put(p, "single", 1, single);
    s.frames = two;
    s.frame_count = 2;
    submit_for(p, &s, array);
    assert_true(requeue(p, single, claim(p, single), true, 0, &crash));
    assert_true(finish(p, single, 0, claim(p, single), &success));
    for (int task = 0; task < 2; task++) assert_true(finish(p, array, task, claim(p, array), &success));
    queue_directory d[] = {{.frame = QUEUE_NO_FRAME},
                           {.frame = QUEUE_NO_FRAME, .attempt = 2},
                           {.frame = QUEUE_NO_FRAME, .attempt = 3},
                           {.frame = 0},
                           {.frame = 3},
                           {.frame = 4}};
    for (int i = 0; i < 6; i++) memcpy(d[i].id, i < 4 ? single : array, ULID_SIZE);
    static const bool belongs[] = {true, true, true, false, true, false};
    assert_true(queue_find_directories(p->q, d, 6, NULL));
    for (int i = 0; i < 6; i++) {
        assert_int_equal(d[i].known, belongs[i]);
        assert_false(d[i].to_be_removed);
        if (d[i].known) assert_int_equal(d[i].state, QUEUE_SUCCEEDED);
    }
    assert_int_equal(d[0].last_attempt, 2);
    queue_removal *removals;
    size_t count;
    assert_true(queue_delete(p->q, single, &found, &deleted, NULL) && deleted);
    assert_true(queue_delete(p->q, array, &found, &deleted, NULL) && deleted);
    assert_true(queue_list_removals(p->q, array, 0, 9, &removals, &count, NULL));
    assert_int_equal(count, 2);
    assert_int_equal(removals[0].frame, 7);
    assert_int_equal(removals[1].frame, 3);
    free(removals);
    assert_true(queue_list_removals(p->q, NULL, 0, 9, &removals, &count, NULL));
    assert_int_equal(count, 3);
    assert_string_equal(removals[0].id, single);
    assert_int_equal(removals[0].frame, QUEUE_NO_FRAME);
    assert_int_equal(removals[0].attempts, 2);
    reopen(p); /* the record is durable */
    static const bool goes[] = {true, true, false, false, true, false};
    assert_true(queue_find_directories(p->q, d, 6, NULL));
    for (int i = 0; i < 6; i++) assert_true(!d[i].known && d[i].to_be_removed == goes[i]);
    assert_true(queue_end_removals(p->q, removals, 1, NULL));
    free(removals);
    assert_true(queue_list_removals(p->q, single, 0, 9, &removals, &count, NULL));
    assert_int_equal(count, 0);
    free(removals);
}

/* For jobs in each waiting state. */
static void test_a_found_result_ends_a_waiting_task(void **state)
{
    place *p = *state;
    static const int two[] = {7, 3};
    char blocked[ULID_SIZE], paused[ULID_SIZE], array[ULID_SIZE], last[ULID_SIZE];
    bool accepted = false;
    queue_submission s = plain;
    put(p, "paused", 1, paused);
    apply_command(p, paused, QUEUE_PAUSE, true);
    const char *needs[] = {paused};
    s.depends_on = needs;
    s.depends_on_count = 1;
    submit_for(p, &s, blocked);
    needs[0] = blocked;
    submit_for(p, &s, last);
    s = plain;
    s.frames = two;
    s.frame_count = 2;
    submit_for(p, &s, array);
    assert_true(requeue(p, array, claim(p, array), true, INT64_MAX / 2, &crash)); /* one task is delayed */
    expect_state(p, blocked, QUEUE_BLOCKED);
    assert_true(queue_end_found(p->q, blocked, QUEUE_NO_FRAME, QUEUE_CONVERGED, &accepted, NULL) && accepted);
    expect_state(p, blocked, QUEUE_SUCCEEDED);
    expect_state(p, last, QUEUE_QUEUED); /* it had waited for that job */
    assert_true(queue_end_found(p->q, blocked, QUEUE_NO_FRAME, QUEUE_CONVERGED, &accepted, NULL) &&
                !accepted);
    assert_true(queue_end_found(p->q, paused, QUEUE_NO_FRAME, QUEUE_NOT_CONVERGED, &accepted, NULL) &&
                accepted);
    queue_job job = get(p, paused);
    assert_int_equal(job.state, QUEUE_SUCCEEDED);
    assert_int_equal(job.outcome, QUEUE_NOT_CONVERGED);
    queue_job_clear(&job);
    assert_true(queue_end_found(p->q, array, 4, QUEUE_CONVERGED, &accepted, NULL) && !accepted);
    assert_true(queue_end_found(p->q, array, QUEUE_NO_FRAME, QUEUE_CONVERGED, &accepted, NULL) && !accepted);
    assert_true(queue_end_found(p->q, array, 7, QUEUE_CONVERGED, &accepted, NULL) && accepted);
    expect_state(p, array, QUEUE_RUNNING); /* between two frames */
    assert_true(queue_end_found(p->q, array, 3, QUEUE_CONVERGED, &accepted, NULL) && accepted);
    expect_state(p, array, QUEUE_SUCCEEDED);
    assert_true(queue_end_found(p->q, "0123456789abcdefghjkmnpqrs", 3, QUEUE_CONVERGED, &accepted, NULL) &&
                !accepted);
    assert_int_equal(claim(p, last), 1);
    assert_true(queue_end_found(p->q, last, QUEUE_NO_FRAME, QUEUE_CONVERGED, &accepted, NULL) &&
                !accepted); /* it runs */
}

static void test_adopted_jobs(void **state)
{
    place *p = *state;
    queue_adopted_task one = {.frame = QUEUE_NO_FRAME, .outcome = QUEUE_CONVERGED, .finished_ms = 50};
    queue_adopted_task many[] = {{.frame = 1, .outcome = QUEUE_CONVERGED, .finished_ms = 70},
                                 {.frame = 5, .outcome = QUEUE_NOT_CONVERGED, .finished_ms = 60}};
    queue_adoption jobs[] = {{.id = "00000000a0abcdefghjkmnpqrs",
                              .name = "n",
                              .labels = "[\"x\",\"x\"]",
                              .spec = "{}",
                              .priority = 2,
                              .max_attempts = 3,
                              .threads = 4,
                              .memory_mb = 5,
                              .tasks = &one,
                              .task_count = 1},
                             {.id = "00000000a0abcdefghjkmnpqrt",
                              .labels = "[]",
                              .spec = "{}",
                              .max_attempts = 1,
                              .threads = 1,
                              .tasks = many,
                              .task_count = 2}};
    assert_true(queue_adopt(p->q, jobs, 2, NULL));
    queue_job job = get(p, jobs[0].id);
    assert_int_equal(job.state, QUEUE_SUCCEEDED);
    assert_int_equal(job.created_ms, ulid_time_ms(jobs[0].id));
    assert_int_equal(job.finished_ms, 50);
    assert_true(!job.array && job.tasks.all == 1 && job.tasks.succeeded == 1 && job.priority == 2 &&
                job.threads == 4);
    queue_job_clear(&job);
    job = get(p, jobs[1].id);
    assert_int_equal(job.outcome, QUEUE_NOT_CONVERGED);
    assert_int_equal(job.finished_ms, 70);
    assert_true(job.array && job.tasks.all == 2 && job.tasks.succeeded == 2);
    queue_job_clear(&job);
    expect_listed(p, &(queue_filter){.state = -1, .limit = 9, .label = "x"}, (const char *[]){jobs[0].id}, 1);
    error e = {0};
    assert_false(queue_adopt(p->q, jobs, 2, &e)); /* they exist */
    bool found, deleted;
    assert_true(queue_delete(p->q, jobs[0].id, &found, &deleted, NULL) && deleted);
    assert_false(queue_adopt(p->q, jobs, 2, &e)); /* all or none */
    assert_true(queue_get(p->q, jobs[0].id, &job, &found, NULL) && !found);
    claim(p, NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_a_job_survives_a_reopening),
        CASE(test_claims_go_by_priority_then_age),
        CASE(test_jobs_ahead_are_those_claimed_before),
        CASE(test_jobs_ahead_are_those_of_the_owner_that_may_start),
        CASE(test_only_the_current_attempt_ends_a_task),
        CASE(test_an_attempt_given_back_does_not_count),
        CASE(test_a_crashed_job_waits_and_does_not_block_others),
        CASE(test_cancel),
        CASE(test_pause_and_resume),
        CASE(test_the_same_key_is_the_same_job),
        CASE(test_unfinished_jobs_of_a_user_are_limited),
        CASE(test_running_tasks_of_a_user_are_limited),
        CASE(test_fitting_jobs_overtake_a_limited_number_of_times),
        CASE(test_jobs_wait_for_others),
        CASE(test_jobs_wait_for_any_end),
        CASE(test_attempts_come_in_pages),
        CASE(test_lists_have_no_long_specs),
        CASE(test_list_by_name_and_time),
        CASE(test_lists_are_sorted),
        CASE(test_dependents_of_a_failed_job_fail),
        CASE(test_dependents_start_with_accepted_outcomes_only),
        CASE(test_a_retry_includes_failed_dependents),
        CASE(test_an_array_has_one_state),
        CASE(test_a_job_runs_at_most_max_running_tasks),
        CASE(test_frames_of_a_chunk_run_one_after_another),
        CASE(test_a_frame_that_is_tried_again_waits_for_its_chunk),
        CASE(test_urgent_jobs_come_between_frames_of_a_chunk),
        CASE(test_max_running_counts_frames_of_chunks),
        CASE(test_frames_of_chunks_wait_for_frames),
        CASE(test_a_chunk_is_claimed_as_a_whole),
        CASE(test_chunks_in_any_order),
        CASE(test_frames_start_after_the_same_frames_of_another_job),
        CASE(test_frames_wait_for_frames_of_another_user_only_for_administrators),
        CASE(test_a_dependency_on_another_users_job_shows_whether_it_succeeded),
        CASE(test_a_reused_result_is_shown_to_the_owner_of_both_jobs),
        CASE(test_a_retried_frame_waits_again),
        CASE(test_frames_in_order_wait_for_the_first),
        CASE(test_frames_start_after_accepted_outcomes_only),
        CASE(test_dependencies_on_frames_are_checked),
        CASE(test_cancel_of_an_array),
        CASE(test_tasks_in_order_begin_with_the_one_before),
        CASE(test_tasks_after_a_failed_one_fail),
        CASE(test_a_frame_without_a_surface_is_skipped),
        CASE(test_edits_have_revisions),
        CASE(test_expired_jobs_are_deleted),
        CASE(test_list_pages_newest_first),
        CASE(test_pages_visit_a_bounded_number_of_jobs),
        CASE(test_list_by_owner_and_label),
        CASE(test_attempts_that_count_add_their_time),
        CASE(test_deliveries_to_busy_hosts_are_skipped),
        CASE(test_ends_are_notified),
        CASE(test_figures),
        CASE(test_faults_of_storage_are_counted_apart),
        CASE(test_copies_are_noted),
        CASE(test_deletion_records_the_directories),
        CASE(test_a_found_result_ends_a_waiting_task),
        CASE(test_adopted_jobs),
    };
    sqlite3_auto_extension((void (*)(void))note_connection);
    return cmocka_run_group_tests_name("queue", tests, NULL, NULL);
}

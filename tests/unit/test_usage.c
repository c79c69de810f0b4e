// SPDX-License-Identifier: Apache-2.0
/* The disk space of results: sums, bounds, the order of deletion, and refusals when no job may be deleted. */
#include "queue_place.h"

#define NONE INT64_MAX

static void bound(place *p, queue_sum all, queue_sum user, bool undelivered)
{
    queue_bound(p->q, &(queue_bounds){.all = all, .user = user, .undelivered = undelivered});
}

/* Submits a job, runs it, and ends it with this disk space. */
static void run(place *p, const char *owner, const queue_ending *ending, int64_t bytes, char id[ULID_SIZE])
{
    queue_submission s = plain;
    queue_ending end = *ending;
    end.bytes = bytes;
    s.owner = owner;
    submit_for(p, &s, id);
    assert_true(finish(p, id, 0, claim(p, id), &end));
}

static void deliver(place *p, const char *id, int frame)
{
    static int64_t now = 4000000000000; /* later than the previous one, and than the end of every job */
    assert_true(queue_note_delivery(p->q, id, frame, now++, NULL));
}

static void expect_leaving(place *p, const char *id)
{
    char leaving[ULID_SIZE] = "";
    bool found = false;
    error e = {0};
    if (!queue_next_leaving(p->q, leaving, &found, &e)) fail_msg("%s", e.message);
    assert_int_equal(found, id != NULL);
    if (id) assert_string_equal(leaving, id);
}

static void remove_job(place *p, const char *id)
{
    bool found = false, deleted = false;
    assert_true(queue_delete(p->q, id, &found, &deleted, NULL) && deleted);
}

static void expect_usage(place *p, const char *owner, int64_t bytes, int64_t results)
{
    queue_usage usage;
    queue_sum sum = {0}, all = {0};
    assert_true(queue_get_usage(p->q, &usage, NULL));
    for (size_t i = 0; i < usage.count; i++) {
        if (strcmp(usage.user[i].name, owner) == 0) sum = usage.user[i].sum;
        all.bytes += usage.user[i].sum.bytes;
        all.results += usage.user[i].sum.results;
    }
    assert_true(sum.bytes == bytes && sum.results == results);
    assert_true(usage.all.bytes == all.bytes && usage.all.results == all.results);
    free(usage.user);
}

static void test_sums_follow_jobs(void **state)
{
    place *p = *state;
    char one[ULID_SIZE], two[ULID_SIZE], failed[ULID_SIZE];
    queue_ending failure = crash;
    run(p, "ann", &success, 1000, one);
    run(p, "ann", &success, 500, two);
    run(p, "bob", &failure, 7, failed);
    expect_usage(p, "ann", 1500, 2);
    expect_usage(p, "bob", 7, 1);
    reopen(p);
    expect_usage(p, "ann", 1500, 2);
    remove_job(p, one);
    expect_usage(p, "ann", 500, 1);
    apply_command(p, failed, QUEUE_RETRY, true);
    expect_usage(p, "bob", 7, 0); /* its log still exists */
    assert_true(finish(p, failed, 0, claim(p, failed), &success));
    expect_usage(p, "bob", 7, 1);
    remove_job(p, failed);
    remove_job(p, two);
    expect_usage(p, "ann", 0, 0);
    expect_usage(p, "bob", 0, 0);
}

static void test_the_job_delivered_first_is_deleted_first(void **state)
{
    place *p = *state;
    char job[4][ULID_SIZE];
    for (int i = 0; i < 4; i++) run(p, "ann", &success, 100, job[i]);
    bound(p, (queue_sum){200, NONE}, (queue_sum){NONE, NONE}, false);
    expect_leaving(p, NULL); /* nothing was delivered */
    deliver(p, job[2], QUEUE_NO_FRAME);
    deliver(p, job[0], QUEUE_NO_FRAME);
    deliver(p, job[2], QUEUE_NO_FRAME); /* a second time changes nothing */
    expect_leaving(p, job[2]);
    remove_job(p, job[2]);
    expect_leaving(p, job[0]);
    remove_job(p, job[0]);
    expect_leaving(p, NULL); /* 200 remain, and neither was delivered */
    deliver(p, job[1], QUEUE_NO_FRAME);
    expect_leaving(p, job[1]);
    remove_job(p, job[1]);
    expect_leaving(p, NULL); /* below the bound */
}

static void test_undelivered_jobs_are_deleted_last_and_only_if_permitted(void **state)
{
    place *p = *state;
    char job[3][ULID_SIZE];
    for (int i = 0; i < 3; i++) run(p, "ann", &success, 100, job[i]);
    deliver(p, job[1], QUEUE_NO_FRAME);
    bound(p, (queue_sum){NONE, 1}, (queue_sum){NONE, NONE}, true);
    for (int i = 0; i < 3; i++) {
        static const int order[] = {1, 0, 2};
        expect_leaving(p, job[order[i]]);
        remove_job(p, job[order[i]]);
    }
    expect_leaving(p, NULL);
}

/* A copy in output.directory is a delivery. A failed job has no result to deliver. */
static void test_copies_and_failures_are_delivered_at_the_end(void **state)
{
    place *p = *state;
    char plain_one[ULID_SIZE], failed[ULID_SIZE], copied[ULID_SIZE];
    queue_ending end = success;
    run(p, "ann", &success, 100, plain_one);
    run(p, "ann", &crash, 100, failed);
    end.delivered = true;
    run(p, "ann", &end, 100, copied);
    bound(p, (queue_sum){1, NONE}, (queue_sum){NONE, NONE}, false);
    expect_leaving(p, failed);
    remove_job(p, failed);
    expect_leaving(p, copied);
    remove_job(p, copied);
    expect_leaving(p, NULL);
}

static void expect_copy(place *p, const char *id, const char *state, const char *code)
{
    queue_job job = get(p, id);
    assert_string_equal(job.copy_state, state);
    if (code)
        assert_string_equal(job.copy_code, code);
    else
        assert_null(job.copy_code);
    queue_job_clear(&job);
}

/* A result that could not be copied is kept until it was copied. */
static void test_a_result_whose_copy_failed_is_not_delivered(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    queue_submission s = plain;
    queue_ending failed = success;
    queue_uncopied job = {0};
    bool found = true;
    s.owner = "ann";
    s.directory = "/show/a";
    failed.copy_code = "output_taken";
    failed.copy_message = "taken";
    submit_for(p, &s, id);
    assert_true(finish(p, id, 0, claim(p, id), &failed));
    bound(p, (queue_sum){NONE, 1}, (queue_sum){NONE, NONE}, false);
    expect_copy(p, id, "failed", "output_taken");
    expect_leaving(p, NULL);
    assert_true(queue_next_uncopied(p->q, 0, &job, &found, NULL));
    assert_false(found);
    apply_command(p, id, QUEUE_DELIVER, true);
    apply_command(p, id, QUEUE_DELIVER, false); /* it is in progress */
    expect_copy(p, id, "pending", NULL);
    reopen(p);
    bound(p, (queue_sum){NONE, 1}, (queue_sum){NONE, NONE}, false);
    const error fault = {ERROR_OUTPUT_UNWRITABLE, "read-only"}, *faults[] = {&fault, NULL};
    for (int i = 0; i < 2; i++) {
        assert_true(queue_next_uncopied(p->q, 0, &job, &found, NULL) && found);
        assert_string_equal(job.directory, "/show/a");
        assert_string_equal(job.owner, "ann");
        assert_true(job.count == 1 && job.tasks[0].frame == QUEUE_NO_FRAME);
        assert_true(queue_note_copied(p->q, id, &job.tasks[0], faults[i], ".x.hexad-tmp", NULL));
        assert_true(queue_end_copying(p->q, id, NULL));
        queue_uncopied_clear(&job);
        expect_copy(p, id, i ? "delivered" : "failed", i ? NULL : "output_unwritable");
        expect_leaving(p, i ? id : NULL);
        if (!i) apply_command(p, id, QUEUE_DELIVER, true);
    }
    remove_job(p, id);
}

static void test_an_array_is_deleted_when_all_frames_are_delivered(void **state)
{
    place *p = *state;
    static const int frames[] = {5, 6};
    char id[ULID_SIZE];
    queue_submission s = plain;
    queue_ending end = success;
    end.bytes = 100;
    s.frames = frames;
    s.frame_count = 2;
    submit_for(p, &s, id);
    assert_true(finish(p, id, 0, claim(p, id), &end));
    bound(p, (queue_sum){150, NONE}, (queue_sum){NONE, NONE}, false);
    deliver(p, id, 5);
    assert_true(finish(p, id, 1, claim(p, id), &end));
    expect_leaving(p, NULL);
    deliver(p, id, 6);
    expect_leaving(p, id);
}

static void test_a_bound_of_users(void **state)
{
    place *p = *state;
    char ann[2][ULID_SIZE], bob[ULID_SIZE];
    queue_submission s = plain;
    run(p, "bob", &success, 10, bob);
    deliver(p, bob, QUEUE_NO_FRAME);
    for (int i = 0; i < 2; i++) run(p, "ann", &success, 100, ann[i]);
    s.owner = "ann";
    char waiting[ULID_SIZE], other[ULID_SIZE];
    submit_for(p, &s, waiting);
    bound(p, (queue_sum){NONE, NONE}, (queue_sum){200, NONE}, false);
    expect_leaving(p, NULL);
    assert_int_equal(submit(p, &s).admission, QUEUE_USER_RESULTS_FULL);
    claim(p, NULL); /* ann's job waits */
    s.owner = "bob";
    submit_for(p, &s, other);
    claim(p, other); /* jobs of other users do not wait */
    deliver(p, ann[1], QUEUE_NO_FRAME);
    expect_leaving(p, ann[1]);
    s.owner = "ann";
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED); /* a job can be deleted for it */
    remove_job(p, ann[1]);
    claim(p, waiting);
}

static void test_a_bound_of_all(void **state)
{
    place *p = *state;
    char done[ULID_SIZE], waiting[ULID_SIZE];
    queue_usage usage;
    queue_submission s = plain;
    run(p, "ann", &success, 100, done);
    put(p, "waits", 0, waiting);
    bound(p, (queue_sum){NONE, 1}, (queue_sum){NONE, NONE}, false);
    assert_int_equal(submit(p, &s).admission, QUEUE_RESULTS_FULL);
    assert_true(queue_get_usage(p->q, &usage, NULL) && usage.full);
    free(usage.user);
    claim(p, NULL);
    expect_state(p, done, QUEUE_SUCCEEDED);
    deliver(p, done, QUEUE_NO_FRAME);
    assert_true(queue_get_usage(p->q, &usage, NULL) && !usage.full);
    free(usage.user);
    assert_int_equal(submit(p, &s).admission, QUEUE_CREATED);
    claim(p, NULL); /* not before it is deleted */
    remove_job(p, done);
    claim(p, waiting);
}

/* Older versions did not measure disk space. */
static void test_unmeasured_jobs_are_returned(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], asked[ULID_SIZE];
    bool found = true;
    run(p, "ann", &success, 100, id);
    assert_true(queue_next_unmeasured(p->q, asked, &found, NULL));
    assert_false(found);
    alter_database(p, "UPDATE job SET result_bytes = NULL;");
    expect_usage(p, "ann", 0, 1);
    assert_true(queue_next_unmeasured(p->q, asked, &found, NULL) && found);
    assert_string_equal(asked, id);
    assert_true(queue_note_bytes(p->q, id, 4096, NULL));
    expect_usage(p, "ann", 4096, 1);
    assert_true(queue_next_unmeasured(p->q, asked, &found, NULL));
    assert_false(found);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_sums_follow_jobs),
        CASE(test_the_job_delivered_first_is_deleted_first),
        CASE(test_undelivered_jobs_are_deleted_last_and_only_if_permitted),
        CASE(test_copies_and_failures_are_delivered_at_the_end),
        CASE(test_a_result_whose_copy_failed_is_not_delivered),
        CASE(test_an_array_is_deleted_when_all_frames_are_delivered),
        CASE(test_a_bound_of_users),
        CASE(test_a_bound_of_all),
        CASE(test_unmeasured_jobs_are_returned),
    };
    sqlite3_auto_extension((void (*)(void))note_connection);
    return cmocka_run_group_tests_name("usage", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* Turns of users within a priority, by weights; holds; numbers of users in settings. */
#include "service/queue/user_numbers.h"
#include "queue_place.h"

static void put_for(place *p, const char *owner, int priority, int count)
{
    queue_submission s = plain;
    char id[ULID_SIZE];
    s.owner = owner;
    s.priority = priority;
    for (int i = 0; i < count; i++) submit_for(p, &s, id);
}

/* Claims a task of this owner and ends it. */
static void expect_turn(place *p, const queue_resources *resources, const char *owner)
{
    queue_claimed claimed = {0};
    bool found = false;
    error e = {0};
    if (!queue_claim(p->q, resources, &claimed, &found, &e)) fail_msg("%s", e.message);
    assert_true(found);
    assert_string_equal(claimed.job.owner, owner);
    assert_true(finish(p, claimed.job.id, claimed.task.number, claimed.task.attempt, &success));
    queue_claimed_clear(&claimed);
}

/* Claims tasks and ends them. Returns the number of tasks of this owner. */
static int count_turns(place *p, const queue_resources *resources, const char *owner, int claims)
{
    int count = 0;
    for (int i = 0; i < claims; i++) {
        queue_claimed claimed = {0};
        bool found = false;
        assert_true(queue_claim(p->q, resources, &claimed, &found, NULL) && found);
        count += strcmp(claimed.job.owner, owner) == 0;
        assert_true(finish(p, claimed.job.id, claimed.task.number, claimed.task.attempt, &success));
        queue_claimed_clear(&claimed);
    }
    return count;
}

static void test_the_user_that_came_later_is_next(void **state)
{
    place *p = *state;
    put_for(p, "ann", 0, 400);
    expect_turn(p, &wide, "ann");
    put_for(p, "bob", 0, 1);
    expect_turn(p, &wide, "bob");
    expect_turn(p, &wide, "ann");
}

static void test_users_take_turns(void **state)
{
    place *p = *state;
    put_for(p, "ann", 0, 30);
    put_for(p, "bob", 0, 10);
    put_for(p, "eve", 0, 10);
    for (int i = 0; i < 10; i++) {
        expect_turn(p, &wide, "ann");
        expect_turn(p, &wide, "bob");
        expect_turn(p, &wide, "eve");
    }
    expect_turn(p, &wide, "ann");
}

static void test_priority_comes_first(void **state)
{
    place *p = *state;
    put_for(p, "ann", 0, 3);
    put_for(p, "bob", 5, 3);
    for (int i = 0; i < 3; i++) expect_turn(p, &wide, "bob");
    expect_turn(p, &wide, "ann");
}

static void test_turns_are_proportional_to_weights(void **state)
{
    place *p = *state;
    static const char *const given[] = {"alice:2", "*:0.5", "bob:1"};
    user_numbers *weights = user_numbers_read(given, 3, 0.01, 100, NULL);
    queue_resources resources = wide;
    resources.weights = weights;
    put_for(p, "alice", 0, 100);
    put_for(p, "bob", 0, 100);
    put_for(p, "carl", 0, 100);
    assert_int_equal(count_turns(p, &resources, "alice", 35), 20);
    assert_int_equal(count_turns(p, &resources, "bob", 35), 10);
    assert_int_equal(count_turns(p, &resources, "carl", 35), 5);
    user_numbers_free(weights);
}

/* A user that was idle for a long time gets no additional turns afterwards. */
static void test_idle_users_accumulate_no_turns(void **state)
{
    place *p = *state;
    put_for(p, "bob", 0, 1);
    put_for(p, "ann", 0, 200);
    assert_int_equal(count_turns(p, &wide, "ann", 101), 100);
    put_for(p, "bob", 0, 50);
    put_for(p, "new", 0, 50);
    assert_int_equal(count_turns(p, &wide, "bob", 30), 10);
    assert_int_equal(count_turns(p, &wide, "new", 30), 10);
}

/* A user that waited with a low priority gets no additional turns among users of that priority. */
static void test_users_of_lower_priority_accumulate_no_turns(void **state)
{
    place *p = *state;
    put_for(p, "low", 0, 50);
    put_for(p, "high", 9, 100);
    assert_int_equal(count_turns(p, &wide, "high", 100), 100);
    put_for(p, "new", 0, 50);
    assert_int_equal(count_turns(p, &wide, "low", 20), 10);
}

/* A user that always has one job, and submits the next one when it has ended, gets an equal share. */
static void test_leaving_and_returning_keeps_the_turn(void **state)
{
    place *p = *state;
    static const char *const busy[] = {"a", "b", "c", "d"};
    int turns = 0;
    for (size_t i = 0; i < 4; i++) put_for(p, busy[i], 0, 100);
    for (int i = 0; i < 50; i++) {
        queue_job *waiting;
        size_t count;
        assert_true(queue_list(p->q, &(queue_filter){.state = -1, .owner = "one", .limit = 1}, &waiting,
                               &count, NULL));
        if (!count || queue_state_is_final(waiting->state)) put_for(p, "one", 0, 1);
        queue_jobs_free(waiting, count);
        turns += count_turns(p, &wide, "one", 1);
    }
    assert_int_equal(turns, 10);
}

static void test_turns_outlive_a_restart(void **state)
{
    place *p = *state;
    put_for(p, "ann", 0, 10);
    put_for(p, "bob", 0, 10);
    expect_turn(p, &wide, "ann");
    reopen(p);
    expect_turn(p, &wide, "bob");
    expect_turn(p, &wide, "ann");
    reopen(p);
    expect_turn(p, &wide, "bob");
}

static void test_an_array_has_a_turn_for_each_task(void **state)
{
    place *p = *state;
    int frames[20];
    char id[ULID_SIZE];
    queue_submission s = plain;
    for (int i = 0; i < 20; i++) frames[i] = i;
    s.owner = "ann";
    s.frames = frames;
    s.frame_count = 20;
    submit_for(p, &s, id);
    put_for(p, "bob", 0, 20);
    assert_int_equal(count_turns(p, &wide, "ann", 20), 10);
}

/* A user at the limit of running tasks is skipped, and continues afterwards without additional turns. */
static void test_users_at_a_limit_accumulate_no_turns(void **state)
{
    place *p = *state;
    queue_resources one_each = wide;
    queue_claimed held = {0};
    bool found = false;
    one_each.most_of_owner = 1;
    put_for(p, "ann", 0, 50);
    assert_true(queue_claim(p->q, &one_each, &held, &found, NULL) && found);
    put_for(p, "bob", 0, 100);
    assert_int_equal(count_turns(p, &one_each, "bob", 50), 50);
    assert_true(finish(p, held.job.id, 0, held.task.attempt, &success));
    queue_claimed_clear(&held);
    assert_int_equal(count_turns(p, &one_each, "ann", 21), 11); /* ann is first */
}

/* A task that does not fit is overtaken at most QUEUE_OVERTAKE_MOST times, also by users that come later, and
 * then has its turn. */
static void test_newcomers_do_not_starve_a_large_task(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char large[ULID_SIZE], name[16];
    s.owner = "ann";
    s.threads = 4;
    submit_for(p, &s, large);
    queue_resources busy = {.threads = 3, .all_threads = 4, .memory_mb = 1000, .all_memory_mb = 1000},
                    idle = busy;
    idle.threads = 4;
    for (int i = 0; i < QUEUE_OVERTAKE_MOST; i++) {
        snprintf(name, sizeof name, "user%d", i);
        put_for(p, name, 0, 1);
        expect_turn(p, &busy, name);
    }
    put_for(p, "another", 0, 1);
    claim_in(p, &busy, NULL);
    claim_in(p, &idle, large);
}

/* A pause, an edit or a dependency changes the first job of a user. */
static void test_changes_of_a_job_update_the_first_job(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char first[ULID_SIZE], second[ULID_SIZE], third[ULID_SIZE];
    s.owner = "ann";
    submit_for(p, &s, first);
    submit_for(p, &s, second);
    s.depends_on = (const char *const[]){first};
    s.depends_on_count = 1;
    submit_for(p, &s, third);
    apply_command(p, first, QUEUE_PAUSE, true);
    int attempt = claim(p, second);
    claim(p, NULL);
    apply_command(p, first, QUEUE_RESUME, true);
    assert_true(requeue(p, second, attempt, false, 0, &crash));
    queue_edited edited;
    assert_true(queue_change(p->q, second, -1, &(queue_edit){.priority = &(int){5}}, &edited, NULL));
    claim(p, second);
    attempt = claim(p, first);
    claim(p, NULL);
    assert_true(finish(p, first, 0, attempt, &success));
    claim(p, third);
}

static void test_a_hold_outlives_a_restart(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    bool held = true;
    assert_true(queue_is_held(p->q, &held, NULL));
    assert_false(held);
    put(p, "first", 0, id);
    assert_true(queue_hold(p->q, true, NULL));
    claim(p, NULL);
    reopen(p);
    assert_true(queue_is_held(p->q, &held, NULL));
    assert_true(held);
    claim(p, NULL);
    assert_true(queue_hold(p->q, false, NULL));
    claim(p, id);
}

static void test_numbers_of_users(void **state)
{
    (void)state;
    static const char *const given[] = {"bob:1.5", "DOMAIN:ann:3", "*:0.25"};
    user_numbers *n = user_numbers_read(given, 3, 0.1, 10, NULL);
    assert_non_null(n);
    assert_true(user_numbers_of(n, "bob", 7) == 1.5);
    assert_true(user_numbers_of(n, "DOMAIN:ann", 7) == 3);
    assert_true(user_numbers_of(n, "eve", 7) == 0.25);
    user_numbers_free(n);
    n = user_numbers_read(given, 2, 0.1, 10, NULL);
    assert_true(user_numbers_of(n, "eve", 7) == 7);
    user_numbers_free(n);
    assert_true(user_numbers_of(NULL, "eve", 7) == 7);
    static const struct {
        const char *item, *says;
    } wrong[] = {
        {"bob", "user:number"}, {"bob:", "user:number"}, {":1", "user:number"},  {"bob:1x", "user:number"},
        {"bob:nan", "user"},    {"bob:11", "0.1 to 10"}, {"bob:0", "0.1 to 10"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        error e = {0};
        assert_null(user_numbers_read(&wrong[i].item, 1, 0.1, 10, &e));
        assert_int_equal(e.code, ERROR_SPEC_INVALID);
        assert_non_null(strstr(e.message, wrong[i].says));
    }
    static const char *const twice[] = {"bob:1", "bob:2"};
    error e = {0};
    assert_null(user_numbers_read(twice, 2, 0.1, 10, &e));
    assert_non_null(strstr(e.message, "twice"));
}

int main(void)
{
    sqlite3_auto_extension((void (*)(void))note_connection);
    const struct CMUnitTest tests[] = {
        CASE(test_the_user_that_came_later_is_next),
        CASE(test_users_take_turns),
        CASE(test_priority_comes_first),
        CASE(test_turns_are_proportional_to_weights),
        CASE(test_idle_users_accumulate_no_turns),
        CASE(test_users_of_lower_priority_accumulate_no_turns),
        CASE(test_leaving_and_returning_keeps_the_turn),
        CASE(test_turns_outlive_a_restart),
        CASE(test_an_array_has_a_turn_for_each_task),
        CASE(test_users_at_a_limit_accumulate_no_turns),
        CASE(test_newcomers_do_not_starve_a_large_task),
        CASE(test_changes_of_a_job_update_the_first_job),
        CASE(test_a_hold_outlives_a_restart),
        cmocka_unit_test(test_numbers_of_users),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "queue_place.h"

static void test_each_change_has_an_event(void **state)
{
    place *p = *state;
    queue_submission s = plain;
    char id[ULID_SIZE];
    s.owner = "ann";
    submit_for(p, &s, id);
    assert_true(requeue(p, id, claim(p, id), true, 0, &crash));
    assert_true(finish(p, id, 0, claim(p, id), &success));
    static const struct {
        queue_event_type type;
        queue_state state;
        int attempt;
    } expected[] = {
        {QUEUE_EVENT_STATE, QUEUE_QUEUED, 0},    {QUEUE_EVENT_STATE, QUEUE_RUNNING, 0},
        {QUEUE_EVENT_STARTED, QUEUE_RUNNING, 1}, {QUEUE_EVENT_ENDED, QUEUE_QUEUED, 1},
        {QUEUE_EVENT_STATE, QUEUE_QUEUED, 0},    {QUEUE_EVENT_STATE, QUEUE_RUNNING, 0},
        {QUEUE_EVENT_STARTED, QUEUE_RUNNING, 2}, {QUEUE_EVENT_ENDED, QUEUE_SUCCEEDED, 2},
        {QUEUE_EVENT_STATE, QUEUE_SUCCEEDED, 0},
    };
    size_t wanted = sizeof expected / sizeof *expected;
    queue_event_filter filter = {.id = id, .limit = 100};
    reopen(p);
    queue_event_page page = list_events(p, &filter);
    assert_int_equal(page.count, wanted);
    for (size_t i = 0; i < wanted; i++) {
        assert_string_equal(page.events[i].id, id);
        assert_string_equal(page.events[i].owner, "ann");
        assert_int_equal(page.events[i].type, expected[i].type);
        assert_int_equal(page.events[i].state, expected[i].state);
        assert_int_equal(page.events[i].attempt, expected[i].attempt);
        assert_true(i == 0 || page.events[i].seq > page.events[i - 1].seq);
    }
    assert_int_equal(page.events[wanted - 1].outcome, QUEUE_CONVERGED);
    assert_false(page.more);
    assert_int_equal(page.position, page.newest);
    filter.after_seq = page.events[wanted - 2].seq;
    free(page.events);
    page = list_events(p, &filter);
    assert_int_equal(page.count, 1);
    free(page.events);
}

/* Checks the jobs of the events that pass the filter, in order; consecutive events of a job count once. */
static void expect_events_of(place *p, queue_event_filter filter, const char *const *ids, size_t count)
{
    queue_event_page page = list_events(p, &filter);
    size_t at = 0;
    for (size_t i = 0; i < page.count; i++) {
        if (i > 0 && strcmp(page.events[i].id, page.events[i - 1].id) == 0) continue;
        assert_true(at < count);
        assert_string_equal(page.events[i].id, ids[at++]);
    }
    assert_int_equal(at, count);
    free(page.events);
}

static void test_events_are_filtered(void **state)
{
    place *p = *state;
    char ann[ULID_SIZE], other[ULID_SIZE], bob[ULID_SIZE];
    queue_submission s = plain;
    s.owner = "ann";
    s.labels = "[\"night\",\"x\"]";
    submit_for(p, &s, ann);
    put(p, "other", -1, other);
    s.owner = "bob";
    submit_for(p, &s, bob);
    expect_events_of(p, (queue_event_filter){.limit = 9}, (const char *[]){ann, other, bob}, 3);
    expect_events_of(p, (queue_event_filter){.limit = 2}, (const char *[]){ann, other}, 2);
    expect_events_of(p, (queue_event_filter){.owner = "bob", .limit = 9}, (const char *[]){bob}, 1);
    expect_events_of(p, (queue_event_filter){.label = "night", .limit = 9}, (const char *[]){ann, bob}, 2);
    expect_events_of(p, (queue_event_filter){.label = "night", .owner = "ann", .limit = 9},
                     (const char *[]){ann}, 1);
    expect_events_of(p, (queue_event_filter){.label = "none", .limit = 9}, NULL, 0);
    expect_events_of(p, (queue_event_filter){.id = other, .limit = 9}, (const char *[]){other}, 1);
    expect_events_of(p, (queue_event_filter){.id = other, .owner = "bob", .limit = 9}, NULL, 0);
    expect_events_of(p, (queue_event_filter){.id = bob, .label = "x", .limit = 9}, (const char *[]){bob}, 1);
}

/* A page without matching events has examined a bounded number, and returns its position. */
static void test_a_page_of_events_is_bounded(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    put(p, "busy", 0, id);
    alter_database(
        p, "WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 20000)"
           " INSERT INTO event (at_ms, job, type, state) SELECT 0, seq, 'edited', 'queued' FROM job, n");
    queue_event_filter filter = {.label = "none", .limit = 10};
    queue_event_page page = {.more = true};
    int pages = 0;
    for (; page.more; pages++) {
        page = list_events(p, &filter);
        assert_int_equal(page.count, 0);
        assert_true(page.position > filter.after_seq);
        filter.after_seq = page.position;
    }
    assert_true(pages > 1);
    assert_int_equal(page.position, page.newest);
    assert_int_equal(look_at_events(p).position, page.newest);
    page = list_events(p, &(queue_event_filter){.after_seq = page.newest + 7, .limit = 10});
    assert_int_equal(page.position, page.newest);
    assert_false(page.more);
    /* the events of one job are examined completely */
    page = list_events(p, &(queue_event_filter){.id = id, .label = "none", .limit = 10});
    assert_false(page.more);
    assert_int_equal(page.position, page.newest);
}

static void test_removed_events_are_noted(void **state)
{
    place *p = *state;
    char first[ULID_SIZE], second[ULID_SIZE];
    bool found, deleted;
    put(p, "first", 0, first);
    put(p, "second", 0, second);
    apply_command(p, second, QUEUE_CANCEL, true);
    int64_t gone = look_at_events(p).newest;
    apply_command(p, first, QUEUE_PAUSE, true);
    assert_int_equal(look_at_events(p).removed_up_to, 0);
    assert_true(queue_delete(p->q, first, &found, &deleted, NULL));
    assert_false(deleted); /* nothing is recorded either */
    assert_int_equal(look_at_events(p).removed_up_to, 0);
    assert_true(queue_delete(p->q, second, &found, &deleted, NULL));
    assert_true(deleted);
    reopen(p);
    assert_int_equal(look_at_events(p).removed_up_to, gone);
    queue_event_filter of_one = {.id = first, .limit = 1};
    queue_event_page page = list_events(p, &of_one);
    assert_int_equal(page.removed_up_to, 0);
    free(page.events);
    /* a deleted job had the newest event: its numbers are not reused */
    apply_command(p, first, QUEUE_CANCEL, true);
    int64_t newest = look_at_events(p).newest;
    assert_true(queue_delete(p->q, first, &found, &deleted, NULL));
    page = look_at_events(p);
    assert_int_equal(page.newest, newest);
    assert_int_equal(page.removed_up_to, newest);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_each_change_has_an_event),
        CASE(test_events_are_filtered),
        CASE(test_a_page_of_events_is_bounded),
        CASE(test_removed_events_are_noted),
    };
    sqlite3_auto_extension((void (*)(void))note_connection);
    return cmocka_run_group_tests_name("event", tests, NULL, NULL);
}

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "http/shelf.h"
#include "queue_place.h"

static const access_caller owner = {.user = "ann", .scopes = SCOPE_USER},
                           other = {.user = "bob", .scopes = SCOPE_USER},
                           admin = {.user = "eve", .scopes = SCOPE_ALL};

static void keep(shelf *s, place *p, const char *id, bool own, const char *text)
{
    queue_job job = get(p, id);
    shelf_document d = {.text = (char *)text, .length = strlen(text), .tag = "\"1\""};
    shelf_put(s, &job, own, &d);
    queue_job_clear(&job);
}

/* Whether the shelf gives the caller this text; NULL: nothing. */
static void expect_found(shelf *s, place *p, const char *id, const access_caller *caller, const char *text)
{
    shelf_document d;
    bool found = shelf_find(s, p->q, id, caller, &d);
    assert_int_equal(found, text != NULL);
    if (!text) return;
    assert_string_equal(d.text, text);
    assert_int_equal(d.length, strlen(text));
    assert_string_equal(d.tag, "\"1\"");
    free(d.text);
}

static void submit_of_ann(place *p, char id[ULID_SIZE])
{
    queue_submission s = plain;
    s.owner = owner.user;
    submit_for(p, &s, id);
}

static void test_each_is_shown_what_is_for_them(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], second[ULID_SIZE];
    shelf *s = shelf_new(8);
    submit_of_ann(p, id);
    submit_of_ann(p, second);
    keep(s, p, id, true, "all of it");
    expect_found(s, p, id, &owner, "all of it");
    expect_found(s, p, id, &admin, "all of it");
    expect_found(s, p, id, &other, NULL);
    expect_found(s, p, second, &owner, NULL);
    keep(s, p, id, false, "a part");
    expect_found(s, p, id, &other, "a part");
    expect_found(s, p, id, &owner, "all of it");
    keep(s, p, id, false, "a part, again");
    expect_found(s, p, id, &other, "a part, again");
    shelf_free(s);
}

/* The document has to be away when the call that changed the job returns, and not before. */
static void expect_gone(shelf *s, place *p, const char *id)
{
    expect_found(s, p, id, &owner, NULL);
    keep(s, p, id, true, "as it is now");
    expect_found(s, p, id, &owner, "as it is now");
}

static void test_no_change_leaves_a_document(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], follower[ULID_SIZE];
    shelf *s = shelf_new(8);
    submit_of_ann(p, id);
    const char *needs[] = {id};
    queue_submission depending = plain;
    depending.owner = owner.user;
    depending.depends_on = needs;
    depending.depends_on_count = 1;
    submit_for(p, &depending, follower);
    keep(s, p, id, true, "new");
    keep(s, p, follower, true, "new");
    tell(p, id, QUEUE_PAUSE, true);
    expect_gone(s, p, id);
    tell(p, id, QUEUE_PAUSE, false);
    expect_found(s, p, id, &owner, "as it is now"); /* nothing changed */
    tell(p, id, QUEUE_RESUME, true);
    expect_gone(s, p, id);
    int priority = 3;
    int64_t retention_s = 7;
    const queue_edit edits[] = {
        {.priority = &priority}, {.labels = "[\"b\"]"}, {.retention_s = &retention_s}};
    for (size_t i = 0; i < sizeof edits / sizeof *edits; i++) {
        queue_edited edited;
        assert_true(queue_change(p->q, id, -1, &edits[i], &edited, NULL));
        expect_gone(s, p, id);
    }
    int attempt = claim(p, id);
    expect_gone(s, p, id);
    assert_true(requeue(p, id, attempt, true, 1, &crash));
    expect_gone(s, p, id);
    attempt = claim(p, id);
    expect_gone(s, p, id);
    expect_found(s, p, follower, &owner, "new");
    assert_true(finish(p, id, 0, attempt, &crash));
    expect_gone(s, p, id);
    expect_gone(s, p, follower); /* has failed, too */
    tell(p, id, QUEUE_RETRY, true);
    expect_gone(s, p, id);
    tell(p, id, QUEUE_CANCEL, true);
    expect_gone(s, p, id);
    bool found, deleted;
    assert_true(queue_delete(p->q, id, &found, &deleted, NULL) && deleted);
    expect_found(s, p, id, &owner, NULL);
    shelf_free(s);
}

/* What was read before a change and is put on the shelf after it. */
static void test_a_document_that_comes_late_is_not_shown(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    shelf *s = shelf_new(8);
    submit_of_ann(p, id);
    queue_job before = get(p, id);
    tell(p, id, QUEUE_PAUSE, true);
    shelf_document d = {.text = (char *)"old", .length = 3};
    shelf_put(s, &before, true, &d);
    expect_found(s, p, id, &owner, NULL);
    queue_job_clear(&before);
    shelf_free(s);
}

static void test_it_has_a_number_of_places(void **state)
{
    enum { JOBS = 20, PLACES = 5 };
    place *p = *state;
    char id[JOBS][ULID_SIZE];
    char *large = mem_alloc(SHELF_BYTES_MOST + 2);
    shelf *s = shelf_new(PLACES), *none = shelf_new(0);
    size_t kept = 0;
    for (size_t i = 0; i < JOBS; i++) {
        submit_of_ann(p, id[i]);
        keep(s, p, id[i], true, "text");
        expect_found(s, p, id[i], &owner, "text"); /* the newest is there */
    }
    for (size_t i = 0; i < JOBS; i++) {
        shelf_document d;
        if (!shelf_find(s, p->q, id[i], &owner, &d)) continue;
        kept++;
        free(d.text);
    }
    assert_in_range(kept, 1, 8);
    memset(large, ' ', SHELF_BYTES_MOST + 1);
    keep(s, p, id[0], false, large);
    expect_found(s, p, id[0], &other, NULL);
    keep(none, p, id[0], true, "text");
    expect_found(none, p, id[0], &owner, NULL);
    free(large);
    shelf_free(none);
    shelf_free(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_each_is_shown_what_is_for_them),
        CASE(test_no_change_leaves_a_document),
        CASE(test_a_document_that_comes_late_is_not_shown),
        CASE(test_it_has_a_number_of_places),
    };
    sqlite3_auto_extension((void (*)(void))note_connection);
    return cmocka_run_group_tests_name("shelf", tests, NULL, NULL);
}

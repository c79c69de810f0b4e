// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "service/api/document_cache.h"
#include "queue_place.h"

static const access_caller owner = {.user = "ann", .scopes = SCOPE_USER},
                           other = {.user = "bob", .scopes = SCOPE_USER},
                           admin = {.user = "eve", .scopes = SCOPE_ALL};

static void keep(document_cache *cache, place *p, const char *id, job_json_viewer viewer, const char *text)
{
    queue_job job = get(p, id);
    cached_document d = {.text = (char *)text, .length = strlen(text), .tag = "\"1\""};
    document_cache_put(cache, &job, viewer, &d);
    queue_job_clear(&job);
}

/* Checks that the cache returns this text to the caller; NULL: none. */
static void expect_found(document_cache *cache, place *p, const char *id, const access_caller *caller,
                         const char *text)
{
    cached_document d;
    bool found = document_cache_find(cache, p->q, id, caller, &d);
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

static void test_owners_administrators_and_readers_get_separate_documents(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], second[ULID_SIZE];
    document_cache *cache = document_cache_new(8);
    submit_of_ann(p, id);
    submit_of_ann(p, second);
    keep(cache, p, id, JOB_JSON_OWNER, "all of it");
    expect_found(cache, p, id, &owner, "all of it");
    expect_found(cache, p, id, &admin, NULL);
    keep(cache, p, id, JOB_JSON_ADMINISTRATOR, "all of it, and of related jobs");
    expect_found(cache, p, id, &admin, "all of it, and of related jobs");
    expect_found(cache, p, id, &owner, "all of it");
    expect_found(cache, p, id, &other, NULL);
    expect_found(cache, p, second, &owner, NULL);
    keep(cache, p, id, JOB_JSON_READER, "a part");
    expect_found(cache, p, id, &other, "a part");
    expect_found(cache, p, id, &owner, "all of it");
    keep(cache, p, id, JOB_JSON_READER, "a part, again");
    expect_found(cache, p, id, &other, "a part, again");
    document_cache_free(cache);
}

/* Checks that the document was removed when the call that changed the job returned. */
static void expect_gone(document_cache *cache, place *p, const char *id)
{
    expect_found(cache, p, id, &owner, NULL);
    keep(cache, p, id, JOB_JSON_OWNER, "as it is now");
    expect_found(cache, p, id, &owner, "as it is now");
}

static void test_no_change_leaves_a_document(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], follower[ULID_SIZE];
    document_cache *cache = document_cache_new(8);
    submit_of_ann(p, id);
    const char *needs[] = {id};
    queue_submission depending = plain;
    depending.owner = owner.user;
    depending.depends_on = needs;
    depending.depends_on_count = 1;
    submit_for(p, &depending, follower);
    keep(cache, p, id, JOB_JSON_OWNER, "new");
    keep(cache, p, follower, JOB_JSON_OWNER, "new");
    apply_command(p, id, QUEUE_PAUSE, true);
    expect_gone(cache, p, id);
    apply_command(p, id, QUEUE_PAUSE, false);
    expect_found(cache, p, id, &owner, "as it is now"); /* nothing changed */
    apply_command(p, id, QUEUE_RESUME, true);
    expect_gone(cache, p, id);
    int priority = 3;
    int64_t retention_s = 7;
    const queue_edit edits[] = {
        {.priority = &priority}, {.labels = "[\"b\"]"}, {.retention_s = &retention_s}};
    for (size_t i = 0; i < sizeof edits / sizeof *edits; i++) {
        queue_edited edited;
        assert_true(queue_change(p->q, id, -1, &edits[i], &edited, NULL));
        expect_gone(cache, p, id);
    }
    int attempt = claim(p, id);
    expect_gone(cache, p, id);
    assert_true(requeue(p, id, attempt, true, 1, &crash));
    expect_gone(cache, p, id);
    attempt = claim(p, id);
    expect_gone(cache, p, id);
    expect_found(cache, p, follower, &owner, "new");
    assert_true(finish(p, id, 0, attempt, &crash));
    expect_gone(cache, p, id);
    expect_gone(cache, p, follower); /* has failed, too */
    apply_command(p, id, QUEUE_RETRY, true);
    expect_gone(cache, p, id);
    apply_command(p, id, QUEUE_CANCEL, true);
    expect_gone(cache, p, id);
    bool found, deleted;
    assert_true(queue_delete(p->q, id, &found, &deleted, NULL) && deleted);
    expect_found(cache, p, id, &owner, NULL);
    document_cache_free(cache);
}

/* The document was read before a change and is stored after it. */
static void test_a_document_stored_after_a_change_is_not_returned(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    document_cache *cache = document_cache_new(8);
    submit_of_ann(p, id);
    queue_job before = get(p, id);
    apply_command(p, id, QUEUE_PAUSE, true);
    cached_document d = {.text = (char *)"old", .length = 3};
    document_cache_put(cache, &before, JOB_JSON_OWNER, &d);
    expect_found(cache, p, id, &owner, NULL);
    queue_job_clear(&before);
    document_cache_free(cache);
}

static void test_the_number_of_documents_is_fixed(void **state)
{
    enum { JOBS = 20, PLACES = 5 };
    place *p = *state;
    char id[JOBS][ULID_SIZE];
    char *large = mem_alloc(DOCUMENT_CACHE_BYTES_MOST + 2);
    document_cache *cache = document_cache_new(PLACES), *none = document_cache_new(0);
    size_t kept = 0;
    for (size_t i = 0; i < JOBS; i++) {
        submit_of_ann(p, id[i]);
        keep(cache, p, id[i], JOB_JSON_OWNER, "text");
        expect_found(cache, p, id[i], &owner, "text"); /* the newest document is stored */
    }
    for (size_t i = 0; i < JOBS; i++) {
        cached_document d;
        if (!document_cache_find(cache, p->q, id[i], &owner, &d)) continue;
        kept++;
        free(d.text);
    }
    assert_in_range(kept, 1, 8);
    memset(large, ' ', DOCUMENT_CACHE_BYTES_MOST + 1);
    keep(cache, p, id[0], JOB_JSON_READER, large);
    expect_found(cache, p, id[0], &other, NULL);
    keep(none, p, id[0], JOB_JSON_OWNER, "text");
    expect_found(none, p, id[0], &owner, NULL);
    free(large);
    document_cache_free(none);
    document_cache_free(cache);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_owners_administrators_and_readers_get_separate_documents),
        CASE(test_no_change_leaves_a_document),
        CASE(test_a_document_stored_after_a_change_is_not_returned),
        CASE(test_the_number_of_documents_is_fixed),
    };
    sqlite3_auto_extension((void (*)(void))note_connection);
    return cmocka_run_group_tests_name("document_cache", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* upload_store: the space that uploads reserve, in total and of each user; who holds files, and which are removed. */
#include <dirent.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "files/file.h"
#include "service/ledger/ledger.h"
#include "service/uploads/upload_store.h"

enum { LONGEST = 100, TOTAL = 20, OF_USER = 10, AT_ONCE = 2, ROUNDS = 100 };

typedef struct place {
    char *base, *directory;
    queue *q;
    ledger *counts;
    store_inputs *inputs;
} place;

static void open_inputs(place *p)
{
    p->q = queue_open(p->base, NULL);
    assert_non_null(p->q);
    p->counts = ledger_new();
    ledger_limit(p->counts, LEDGER_UPLOAD_BYTES, (ledger_limits){.holder = OF_USER});
    ledger_limit(p->counts, LEDGER_UPLOADS, (ledger_limits){.holder = AT_ONCE});
    p->inputs = store_inputs_open(p->directory, LONGEST, TOTAL, p->q, p->counts, NULL);
    assert_non_null(p->inputs);
}

static void close_inputs(place *p)
{
    store_inputs_close(p->inputs);
    ledger_free(p->counts);
    queue_close(p->q);
}

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    p->base = mem_strdup("/tmp/hexad-inputs-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    p->directory = mem_printf("%s/inputs", p->base);
    open_inputs(p);
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    close_inputs(p);
    assert_true(store_remove(p->base, NULL));
    free(p->directory);
    free(p->base);
    free(p);
    return 0;
}

static store_upload_outcome begin(const place *p, const char *user, int64_t announced, store_upload **upload)
{
    char hex[STORE_HASH_SIZE];
    store_hash("", 0, hex);
    store_upload_outcome outcome = store_upload_begin(p->inputs, hex, user, announced, upload);
    return outcome == STORE_UPLOAD_GOOD ? store_upload_open(*upload, NULL) : outcome;
}

/* Begins and ends an upload of this many bytes. */
static store_upload_outcome try_upload(const place *p, const char *user, int64_t bytes)
{
    store_upload *upload = NULL;
    store_upload_outcome outcome = begin(p, user, bytes, &upload);
    store_upload_end(upload);
    return outcome;
}

/* Uploads a text of the user by this name, which is stored under its hash. */
static void send_named(const place *p, const char *user, const char *text, const char *name,
                       char hex[STORE_HASH_SIZE])
{
    store_upload *upload = NULL;
    store_hash(text, strlen(text), hex);
    assert_int_equal(store_upload_begin(p->inputs, hex, user, -1, &upload), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_open(upload, NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_write(upload, text, strlen(text), NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_commit(upload, name, NULL), STORE_UPLOAD_GOOD);
    store_upload_end(upload);
}

static void send_text(const place *p, const char *user, const char *text, char hex[STORE_HASH_SIZE])
{
    send_named(p, user, text, NULL, hex);
}

static void test_space_is_reserved_as_bytes_arrive(void **state)
{
    place *p = *state;
    store_upload *first = NULL, *second = NULL;
    assert_int_equal(begin(p, "ann", OF_USER, &first), STORE_UPLOAD_GOOD);
    assert_int_equal(begin(p, "ann", OF_USER, &second), STORE_UPLOAD_GOOD);
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 0);
    assert_int_equal(store_upload_write(first, "1234567", 7, NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 7);
    assert_int_equal(store_upload_write(second, "1234", 4, NULL), STORE_UPLOAD_USER_FULL);
    store_upload_end(second);
    store_upload_end(first);
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 0);
    assert_int_equal(try_upload(p, "ann", OF_USER), STORE_UPLOAD_GOOD);
}

static void test_a_user_has_a_limit_of_bytes(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE];
    send_text(p, "ann", "12345678", hex);
    assert_int_equal(try_upload(p, "ann", 2), STORE_UPLOAD_GOOD);
    assert_int_equal(try_upload(p, "ann", 3), STORE_UPLOAD_USER_FULL);
    assert_int_equal(try_upload(p, "bob", OF_USER), STORE_UPLOAD_GOOD);
    assert_int_equal(try_upload(p, "bob", TOTAL - 7), STORE_UPLOAD_ALL_FULL);
    send_text(p, "bob", "12345678", hex); /* counts for both */
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 8);
    assert_int_equal(try_upload(p, "bob", 3), STORE_UPLOAD_USER_FULL);
    close_inputs(p);
    open_inputs(p);
    assert_int_equal(try_upload(p, "ann", 3), STORE_UPLOAD_USER_FULL);
    assert_int_equal(try_upload(p, "bob", 3), STORE_UPLOAD_USER_FULL);
    bool found;
    assert_true(store_inputs_remove(p->inputs, hex, &found, NULL));
    assert_int_equal(try_upload(p, "ann", OF_USER), STORE_UPLOAD_GOOD);
    assert_int_equal(try_upload(p, "bob", OF_USER), STORE_UPLOAD_GOOD);
}

static void test_a_user_has_a_limit_of_simultaneous_uploads(void **state)
{
    place *p = *state;
    store_upload *held[AT_ONCE];
    for (int i = 0; i < AT_ONCE; i++) assert_int_equal(begin(p, "ann", -1, &held[i]), STORE_UPLOAD_GOOD);
    assert_int_equal(try_upload(p, "ann", 0), STORE_UPLOAD_TOO_MANY);
    assert_int_equal(try_upload(p, "bob", 0), STORE_UPLOAD_GOOD);
    store_upload_end(held[0]);
    assert_int_equal(try_upload(p, "ann", 0), STORE_UPLOAD_GOOD);
    for (int i = 1; i < AT_ONCE; i++) store_upload_end(held[i]);
}

/* The number of entries of the directory of uploads. */
static int count_entries(const place *p)
{
    int count = 0;
    DIR *directory = opendir(p->directory);
    assert_non_null(directory);
    for (struct dirent *d; (d = readdir(directory));) count += d->d_name[0] != '.';
    closedir(directory);
    return count;
}

static void expect_name(const place *p, const char *hex, const char *user, const char *expected)
{
    char *name;
    store_inputs_find_sent(p->inputs, hex, user, &name);
    if (expected)
        assert_string_equal(name, expected);
    else
        assert_null(name);
    free(name);
}

static void remove_file(const place *p, const char *hex)
{
    char *path = mem_printf("%s/sha256:%s", p->directory, hex);
    assert_int_equal(unlink(path), 0);
    free(path);
}

static void test_each_user_names_a_file(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE];
    bool found;
    send_text(p, "ann", "1234", hex);
    expect_name(p, hex, "ann", NULL);
    send_named(p, "ann", "1234", "a.obj", hex);
    assert_int_equal(store_inputs_hold(p->inputs, hex, "bob", "a/../\"b\n", NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_inputs_hold(p->inputs, hex, "ann", "b.obj", NULL), STORE_UPLOAD_GOOD);
    send_text(p, "ann", "1234", hex); /* keeps the name */
    assert_true(store_inputs_holds(p->inputs, hex, "ann", NULL));
    assert_true(store_inputs_holds(p->inputs, hex, "ann", "b.obj"));
    assert_false(store_inputs_holds(p->inputs, hex, "ann", "a.obj"));
    assert_false(store_inputs_holds(p->inputs, hex, "cleo", NULL));
    close_inputs(p);
    open_inputs(p);
    expect_name(p, hex, "ann", "b.obj");
    expect_name(p, hex, "bob", "a/../\"b\n");
    expect_name(p, hex, "cleo", NULL);
    assert_int_equal(count_entries(p), 1);
    assert_true(store_inputs_remove(p->inputs, hex, &found, NULL));
    assert_int_equal(count_entries(p), 0);
    expect_name(p, hex, "bob", NULL);
    assert_int_equal(try_upload(p, "ann", OF_USER), STORE_UPLOAD_GOOD); /* names use no space of users */
    assert_int_equal(try_upload(p, "bob", OF_USER), STORE_UPLOAD_GOOD);
    /* a file that is missing has neither sender nor name */
    send_named(p, "ann", "1234", "c.obj", hex);
    remove_file(p, hex);
    close_inputs(p);
    open_inputs(p);
    assert_false(store_inputs_holds(p->inputs, hex, "ann", NULL));
    expect_name(p, hex, "ann", NULL);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 0);
}

/* The text of a file on the disk is changed. */
static void damage(const place *p, const char *hex)
{
    char *path = mem_printf("%s/sha256:%s", p->directory, hex);
    assert_true(store_file_write(path, "87654321", 8, NULL));
    free(path);
}

static void test_a_damaged_file_is_held_by_no_user_and_keeps_its_names(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE], name[STORE_INPUT_NAME_SIZE];
    send_named(p, "ann", "12345678", "a.obj", hex);
    send_named(p, "bob", "12345678", "b.obj", hex);
    snprintf(name, sizeof name, STORE_INPUT_PREFIX "%s", hex);
    store_inputs_discard_damaged(p->inputs, name, NULL);
    assert_int_equal(store_inputs_find(p->inputs, hex, NULL), 8); /* it is not damaged */
    damage(p, hex);
    store_inputs_discard_damaged(p->inputs, name, NULL);
    assert_int_equal(store_inputs_find(p->inputs, hex, NULL), -1);
    assert_false(store_inputs_holds(p->inputs, hex, "ann", NULL));
    expect_name(p, hex, "ann", "a.obj");
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 0);
    send_text(p, "bob", "12345678", hex);
    assert_true(store_inputs_holds(p->inputs, hex, "bob", "b.obj"));
    assert_false(store_inputs_holds(p->inputs, hex, "ann", NULL));
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 8);
}

/* The number of files that the user holds, and the first one in *first. */
static size_t list_held(const place *p, const char *user, queue_upload *first)
{
    queue_upload *list = NULL, all = {.sent_ms = INT64_MAX};
    size_t count = 0;
    assert_true(store_inputs_list(p->inputs, user, &all, 100, &list, &count, NULL));
    if (count) *first = list[0];
    free(list);
    return count;
}

static void test_each_user_holds_a_file(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE], other[STORE_HASH_SIZE], *name;
    queue_upload first = {0};
    bool found = false;
    send_text(p, "ann", "12345678", hex);
    send_text(p, "bob", "12345678", hex);
    send_text(p, "ann", "xy", other);
    assert_int_equal(list_held(p, "ann", &first), 2);
    assert_int_equal(list_held(p, "cleo", &first), 0);
    assert_int_equal(list_held(p, "bob", &first), 1);
    assert_string_equal(first.hash, hex);
    assert_int_equal(first.bytes, 8);
    assert_int_equal(first.sent_ms, store_inputs_find_sent(p->inputs, hex, "bob", &name));
    assert_null(name);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 10);
    /* one user ends its hold: its bytes are released, and the file stays for the other one */
    assert_int_equal(store_inputs_hold(p->inputs, hex, "ann", "a.obj", NULL), STORE_UPLOAD_GOOD);
    assert_true(store_inputs_release(p->inputs, hex, "ann", &found, NULL));
    assert_true(found);
    expect_name(p, hex, "ann", NULL);
    assert_false(store_inputs_holds(p->inputs, hex, "ann", NULL));
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 2);
    assert_true(store_inputs_release(p->inputs, hex, "ann", &found, NULL));
    assert_false(found);
    assert_int_equal(store_inputs_find(p->inputs, hex, NULL), 8);
    /* a user holds it without sending it */
    assert_int_equal(store_inputs_hold(p->inputs, hex, "cleo", NULL, NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_inputs_hold(p->inputs, hex, "cleo", NULL, NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "cleo"), 8); /* counted once */
    assert_int_equal(store_inputs_hold(p->inputs, other, "cleo", NULL, NULL), STORE_UPLOAD_GOOD);
    send_text(p, "dan", "z", other);
    assert_int_equal(store_inputs_hold(p->inputs, other, "cleo", NULL, NULL), STORE_UPLOAD_USER_FULL);
    close_inputs(p);
    open_inputs(p);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "cleo"), 10);
    /* the last release removes it */
    assert_true(store_inputs_release(p->inputs, hex, "bob", &found, NULL) && found);
    assert_int_equal(store_inputs_find(p->inputs, hex, NULL), 8);
    assert_true(store_inputs_release(p->inputs, hex, "cleo", &found, NULL) && found);
    assert_int_equal(store_inputs_find(p->inputs, hex, NULL), -1);
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 3);
    assert_int_equal(store_inputs_hold(p->inputs, hex, "cleo", NULL, NULL), STORE_UPLOAD_GONE);
}

/* Pages of two files each: every file once, sent last first. */
static void test_a_list_of_uploads_has_pages(void **state)
{
    place *p = *state;
    queue_upload *list = NULL, last = {.sent_ms = INT64_MAX};
    char hex[STORE_HASH_SIZE];
    size_t count = 2, all = 0;
    for (const char *text = "abcde"; *text; text++) send_text(p, "ann", (char[]){*text, '\0'}, hex);
    while (count == 2) {
        assert_true(store_inputs_list(p->inputs, "ann", &last, 2, &list, &count, NULL));
        for (size_t i = 0; i < count; last = list[i++])
            assert_true(list[i].sent_ms < last.sent_ms ||
                        (list[i].sent_ms == last.sent_ms && strcmp(list[i].hash, last.hash) > 0));
        all += count;
        free(list);
    }
    assert_int_equal(all, 5);
}

/* Submits a job that reads the file. */
static void put_reader(const place *p, const char *hex, char id[ULID_SIZE])
{
    char name[STORE_INPUT_NAME_SIZE];
    const char *inputs[] = {name};
    queue_submission job = {
        .labels = "[]", .spec = "{}", .max_attempts = 3, .inputs = inputs, .input_count = 1};
    queue_receipt receipt;
    snprintf(name, sizeof name, STORE_INPUT_PREFIX "%s", hex);
    assert_true(queue_put(p->q, &job, &receipt, NULL));
    memcpy(id, receipt.id, sizeof receipt.id);
}

static size_t collect(const place *p, int64_t keep_ms)
{
    size_t gone = 0;
    assert_true(store_inputs_collect(p->inputs, keep_ms, &gone, NULL));
    return gone;
}

static void test_a_collection_removes_files_that_all_users_have_released(void **state)
{
    place *p = *state;
    char held[STORE_HASH_SIZE], wanted[STORE_HASH_SIZE], id[ULID_SIZE];
    bool found, changed;
    queue_state now;
    send_text(p, "ann", "a", held);
    send_text(p, "bob", "a", held);
    send_text(p, "ann", "bb", wanted);
    put_reader(p, wanted, id);
    assert_true(store_inputs_release(p->inputs, held, "ann", &found, NULL));
    assert_true(store_inputs_release(p->inputs, wanted, "ann", &found, NULL));
    assert_int_equal(collect(p, 0), 0);
    assert_int_equal(store_inputs_find(p->inputs, wanted, NULL), 2);
    assert_true(queue_apply_command(p->q, id, QUEUE_CANCEL, &found, &changed, &now, NULL) && changed);
    assert_int_equal(collect(p, 0), 1);
    assert_int_equal(store_inputs_find(p->inputs, wanted, NULL), -1);
    assert_int_equal(store_inputs_find(p->inputs, held, NULL), 1);
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 1);
}

/* The database was lost, or is older than the file: the file is kept for the time of unused ones, and held by the user that
 * sends its bytes again. */
static void test_a_file_without_a_row_is_kept(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE], *path;
    bool found;
    store_hash("ccc", 3, hex);
    path = mem_printf("%s/sha256:%s", p->directory, hex);
    assert_true(store_file_write(path, "ccc", 3, NULL));
    close_inputs(p);
    open_inputs(p);
    assert_int_equal(collect(p, 0), 0);
    assert_int_equal(collect(p, INT64_C(3600000)), 0);
    assert_true(store_inputs_release(p->inputs, hex, "ann", &found, NULL) && !found);
    assert_int_equal(store_inputs_find(p->inputs, hex, NULL), 3);
    send_text(p, "ann", "ccc", hex);
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 3);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 3);
    assert_true(store_inputs_release(p->inputs, hex, "ann", &found, NULL) && found);
    assert_int_equal(store_inputs_find(p->inputs, hex, NULL), -1);
    free(path);
}

static void put_record(const place *p, const char *kind, const char *hex, const char *user, const char *text)
{
    char sender[STORE_HASH_SIZE];
    store_hash(user, strlen(user), sender);
    char *path = mem_printf("%s/%s:%s:%s", p->directory, kind, hex, sender);
    assert_true(store_file_write(path, text, strlen(text), NULL));
    free(path);
}

/* Builds of schema 21 recorded who holds a file in files beside it. The opening after a kill finds some of them again. */
static void test_records_of_older_builds_are_moved_to_the_queue(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE], missing[STORE_HASH_SIZE], *name;
    send_text(p, "ann", "12345678", hex);
    const int64_t sent_ms = store_inputs_find_sent(p->inputs, hex, "ann", &name);
    store_hash("x", 1, missing);
    for (int times = 0; times < 2; times++) {
        put_record(p, "sender", hex, "ann", "");
        put_record(p, "sender", hex, "bob", "");
        put_record(p, "name", hex, "bob", "b \"\n.obj");
        put_record(p, "name", hex, "cleo", "c.obj");
        put_record(p, "sender", missing, "bob", "");
        close_inputs(p);
        open_inputs(p);
        assert_int_equal(count_entries(p), 1);
        assert_int_equal(store_inputs_find_sent(p->inputs, hex, "ann", &name), sent_ms);
        assert_null(name);
        assert_true(store_inputs_find_sent(p->inputs, hex, "bob", &name) > clock_wall_ms() - 3600000);
        assert_string_equal(name, "b \"\n.obj");
        free(name);
        expect_name(p, hex, "cleo", "c.obj");
        assert_false(store_inputs_holds(p->inputs, hex, "cleo", NULL));
        assert_false(store_inputs_holds(p->inputs, missing, "bob", NULL));
        assert_int_equal(store_inputs_count_bytes(p->inputs, "bob"), 8);
    }
}

/* More records than are read and stored at once. */
static void test_many_users_hold_a_file(void **state)
{
    enum { USERS = 2500 };
    place *p = *state;
    char hex[STORE_HASH_SIZE], user[20];
    bool found;
    send_text(p, "ann", "12345678", hex);
    for (int i = 0; i < USERS; i++) {
        snprintf(user, sizeof user, "user %d", i);
        put_record(p, "sender", hex, user, "");
    }
    close_inputs(p);
    open_inputs(p);
    assert_int_equal(count_entries(p), 1);
    for (int i = 0; i < USERS; i++) {
        snprintf(user, sizeof user, "user %d", i);
        assert_int_equal(store_inputs_count_bytes(p->inputs, user), 8);
    }
    assert_true(store_inputs_remove(p->inputs, hex, &found, NULL) && found);
    for (int i = 0; i < USERS; i++) {
        snprintf(user, sizeof user, "user %d", i);
        assert_int_equal(store_inputs_count_bytes(p->inputs, user), 0);
        assert_false(store_inputs_holds(p->inputs, hex, user, NULL));
    }
}

/* Sends a file and releases it, again and again. */
static void *send_and_release(void *context)
{
    const place *p = context;
    char hex[STORE_HASH_SIZE];
    bool found;
    for (int i = 0; i < ROUNDS; i++) {
        send_text(p, "ann", "12345", hex);
        assert_true(store_inputs_release(p->inputs, hex, "ann", &found, NULL));
    }
    return NULL;
}

static void test_removals_count_the_bytes_of_files_that_are_sent_meanwhile(void **state)
{
    place *p = *state;
    pthread_t sender;
    char hex[STORE_HASH_SIZE];
    bool found;
    assert_int_equal(pthread_create(&sender, NULL, send_and_release, p), 0);
    for (int i = 0; i < ROUNDS; i++) {
        collect(p, 0);
        store_hash("12345", 5, hex);
        assert_true(store_inputs_remove(p->inputs, hex, &found, NULL));
    }
    pthread_join(sender, NULL);
    assert_true(store_inputs_remove(p->inputs, hex, &found, NULL));
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 0);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 0);
    assert_int_equal(count_entries(p), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_space_is_reserved_as_bytes_arrive, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_user_has_a_limit_of_bytes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_user_has_a_limit_of_simultaneous_uploads, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_each_user_names_a_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_damaged_file_is_held_by_no_user_and_keeps_its_names, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_each_user_holds_a_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_list_of_uploads_has_pages, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_collection_removes_files_that_all_users_have_released, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_a_file_without_a_row_is_kept, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_records_of_older_builds_are_moved_to_the_queue, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_many_users_hold_a_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_removals_count_the_bytes_of_files_that_are_sent_meanwhile,
                                        set_up, tear_down),
    };
    return cmocka_run_group_tests_name("inputs", tests, NULL, NULL);
}

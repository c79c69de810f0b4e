// SPDX-License-Identifier: Apache-2.0
/* upload_store: the space that uploads reserve, in total and of each user. */
#include <dirent.h>
#include <fcntl.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "base/core/memory.h"
#include "files/file.h"
#include "service/ledger/ledger.h"
#include "service/uploads/upload_store.h"

enum { LONGEST = 100, TOTAL = 20, OF_USER = 10, AT_ONCE = 2, ROUNDS = 100, OTHERS = 1000 };

typedef struct place {
    char *directory;
    ledger *counts;
    store_inputs *inputs;
} place;

static void open_inputs(place *p)
{
    p->counts = ledger_new();
    ledger_limit(p->counts, LEDGER_UPLOAD_BYTES, (ledger_limits){.holder = OF_USER});
    ledger_limit(p->counts, LEDGER_UPLOADS, (ledger_limits){.holder = AT_ONCE});
    p->inputs = store_inputs_open(p->directory, LONGEST, TOTAL, p->counts, NULL);
    assert_non_null(p->inputs);
}

static void close_inputs(place *p)
{
    store_inputs_close(p->inputs);
    ledger_free(p->counts);
}

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    p->directory = mem_strdup("/tmp/hexad-inputs-XXXXXX");
    assert_non_null(mkdtemp(p->directory));
    open_inputs(p);
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    close_inputs(p);
    assert_true(store_remove(p->directory, NULL));
    free(p->directory);
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

/* Uploads a text of the user, which is stored under its hash. */
static void send_text(const place *p, const char *user, const char *text, char hex[STORE_HASH_SIZE])
{
    store_upload *upload = NULL;
    store_hash(text, strlen(text), hex);
    assert_int_equal(store_upload_begin(p->inputs, hex, user, -1, &upload), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_open(upload, NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_write(upload, text, strlen(text), NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_commit(upload, NULL), STORE_UPLOAD_GOOD);
    store_upload_end(upload);
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
    assert_true(store_inputs_remove(p->inputs, hex, true, &found, NULL));
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
    char *name = store_inputs_get_file_name(p->inputs, hex, user);
    if (expected)
        assert_string_equal(name, expected);
    else
        assert_null(name);
    free(name);
}

static void test_each_user_names_a_file(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE];
    bool found;
    send_text(p, "ann", "12345678", hex);
    expect_name(p, hex, "ann", NULL);
    assert_true(store_inputs_set_file_name(p->inputs, hex, "ann", "a.obj", NULL));
    assert_true(store_inputs_set_file_name(p->inputs, hex, "bob", "a/../\"b\n", NULL));
    assert_true(store_inputs_set_file_name(p->inputs, hex, "ann", "b.obj", NULL));
    assert_int_equal(store_inputs_find_sent(p->inputs, hex, "bob"), -1); /* a name gives no right */
    close_inputs(p);
    open_inputs(p);
    expect_name(p, hex, "ann", "b.obj");
    expect_name(p, hex, "bob", "a/../\"b\n");
    expect_name(p, hex, "cleo", NULL);
    assert_int_equal(count_entries(p), 4); /* the file, its sender and two names */
    assert_true(store_inputs_remove(p->inputs, hex, true, &found, NULL));
    assert_int_equal(count_entries(p), 0);
    assert_int_equal(try_upload(p, "ann", OF_USER), STORE_UPLOAD_GOOD); /* names use no space of users */
    assert_int_equal(try_upload(p, "bob", OF_USER), STORE_UPLOAD_GOOD);
    /* a file whose records were left over has neither sender nor name */
    send_text(p, "ann", "12345678", hex);
    assert_true(store_inputs_set_file_name(p->inputs, hex, "ann", "c.obj", NULL));
    char *path = mem_printf("%s/sha256:%s", p->directory, hex);
    assert_int_equal(unlink(path), 0);
    free(path);
    close_inputs(p);
    open_inputs(p);
    assert_int_equal(count_entries(p), 0);
}

/* The number of files that the user holds, and the first one in *first. */
static size_t list_held(const place *p, const char *user, store_input *first)
{
    store_input *list = NULL;
    size_t count = 0;
    assert_true(store_inputs_list(p->inputs, user, &list, &count, NULL));
    if (count) *first = list[0];
    free(list);
    return count;
}

static void test_each_user_holds_a_file(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE], other[STORE_HASH_SIZE];
    store_input first = {0};
    bool found = false;
    send_text(p, "ann", "12345678", hex);
    send_text(p, "bob", "12345678", hex);
    send_text(p, "ann", "xy", other);
    assert_int_equal(list_held(p, "ann", &first), 2);
    assert_int_equal(list_held(p, "cleo", &first), 0);
    assert_int_equal(list_held(p, "bob", &first), 1);
    assert_string_equal(first.hex, hex);
    assert_int_equal(first.bytes, 8);
    assert_int_equal(first.sent_ms, store_inputs_find_sent(p->inputs, hex, "bob"));
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 10);
    /* one user ends its hold: its bytes are released, and the file stays for the other one */
    assert_true(store_inputs_set_file_name(p->inputs, hex, "ann", "a.obj", NULL));
    assert_true(store_inputs_release(p->inputs, hex, "ann", &found, NULL));
    assert_true(found);
    expect_name(p, hex, "ann", NULL);
    assert_int_equal(store_inputs_find_sent(p->inputs, hex, "ann"), -1);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 2);
    assert_true(store_inputs_release(p->inputs, hex, "ann", &found, NULL));
    assert_false(found);
    assert_true(store_inputs_remove(p->inputs, hex, false, &found, NULL));
    assert_false(found);
    assert_int_equal(store_inputs_find(p->inputs, hex), 8);
    /* without a hold it can be removed, and be held again before */
    assert_true(store_inputs_release(p->inputs, hex, "bob", &found, NULL));
    assert_int_equal(store_inputs_hold(p->inputs, hex, "cleo", NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_inputs_hold(p->inputs, hex, "cleo", NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "cleo"), 8); /* counted once */
    assert_int_equal(store_inputs_hold(p->inputs, other, "cleo", NULL), STORE_UPLOAD_GOOD);
    send_text(p, "dan", "z", other);
    assert_int_equal(store_inputs_hold(p->inputs, other, "cleo", NULL), STORE_UPLOAD_USER_FULL);
    close_inputs(p);
    open_inputs(p);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "cleo"), 10);
    assert_true(store_inputs_release(p->inputs, hex, "cleo", &found, NULL));
    assert_true(store_inputs_remove(p->inputs, hex, false, &found, NULL));
    assert_true(found);
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 3);
    assert_int_equal(store_inputs_hold(p->inputs, hex, "cleo", NULL), STORE_UPLOAD_GONE);
}

/* A decision of store_inputs_collect. *context: the hash of a file that stays although no user holds it. */
static bool is_unheld(void *context, const char *name, int64_t used_ms, bool held)
{
    (void)used_ms;
    return !held && strcmp(name + strlen(STORE_INPUT_PREFIX), context) != 0;
}

static void test_a_collection_receives_which_files_are_held(void **state)
{
    place *p = *state;
    char held[STORE_HASH_SIZE], wanted[STORE_HASH_SIZE], unheld[STORE_HASH_SIZE];
    size_t gone = 0;
    bool found;
    send_text(p, "ann", "a", held);
    send_text(p, "bob", "a", held);
    send_text(p, "ann", "bb", wanted);
    send_text(p, "ann", "ccc", unheld);
    assert_true(store_inputs_release(p->inputs, held, "ann", &found, NULL));
    assert_true(store_inputs_release(p->inputs, wanted, "ann", &found, NULL));
    assert_true(store_inputs_release(p->inputs, unheld, "ann", &found, NULL));
    assert_true(store_inputs_collect(p->inputs, is_unheld, wanted, &gone, NULL));
    assert_int_equal(gone, 1);
    assert_int_equal(store_inputs_find(p->inputs, unheld), -1);
    assert_int_equal(store_inputs_find(p->inputs, wanted), 2);
    assert_int_equal(store_inputs_find(p->inputs, held), 1);
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 3);
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

static bool is_any(void *context, const char *name, int64_t used_ms, bool held)
{
    (void)context;
    (void)name;
    (void)used_ms;
    (void)held;
    return true;
}

static void test_a_collection_counts_the_bytes_of_files_that_are_sent_meanwhile(void **state)
{
    place *p = *state;
    pthread_t sender;
    size_t gone = 0;
    char hex[STORE_HASH_SIZE];
    bool found;
    for (int i = 0; i < OTHERS; i++) { /* they prolong a collection */
        char *path = mem_printf("%s/other-%d", p->directory, i);
        const int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
        assert_true(fd >= 0 && close(fd) == 0);
        free(path);
    }
    assert_int_equal(pthread_create(&sender, NULL, send_and_release, p), 0);
    for (int i = 0; i < ROUNDS; i++) {
        assert_true(store_inputs_collect(p->inputs, is_any, NULL, &gone, NULL));
        store_hash("12345", 5, hex);
        assert_true(store_inputs_remove(p->inputs, hex, true, &found, NULL));
    }
    pthread_join(sender, NULL);
    assert_true(store_inputs_collect(p->inputs, is_any, NULL, &gone, NULL));
    assert_int_equal(store_inputs_get_space(p->inputs).used_bytes, 0);
    assert_int_equal(store_inputs_count_bytes(p->inputs, "ann"), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_space_is_reserved_as_bytes_arrive, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_user_has_a_limit_of_bytes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_user_has_a_limit_of_simultaneous_uploads, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_each_user_names_a_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_each_user_holds_a_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_collection_receives_which_files_are_held, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_collection_counts_the_bytes_of_files_that_are_sent_meanwhile,
                                        set_up, tear_down),
    };
    return cmocka_run_group_tests_name("inputs", tests, NULL, NULL);
}

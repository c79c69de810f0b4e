// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "set_clock.h"

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/results/result.h"
#include "service/results/retention.h"
#include "files/file.h"

#define PATIENCE_MS 30000
/* Retention of uploaded files. In the tests the last use is long ago or in the future. */
#define KEEP_S 1
#define HOUR INT64_C(3600000)

typedef struct place {
    char base[64];
    queue *q;
    runner *tasks;
    retention *r;
    ledger *counts;
    store_inputs *inputs;
} place;

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    reset_clocks();
    strcpy(p->base, "/tmp/hexad-retention-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    error e = {0};
    p->counts = ledger_new();
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
    static const char *const parts[] = {"results", "attempts"};
    for (int i = 0; i < 2; i++) {
        char *path = mem_printf("%s/%s", p->base, parts[i]);
        assert_true(store_directory_create(path, NULL));
        free(path);
    }
    *state = p;
    return 0;
}

static void end(place *p)
{
    if (p->tasks) runner_stop(p->tasks);
    retention_free(p->r);
    runner_free(p->tasks);
    p->r = NULL;
    p->tasks = NULL;
}

static int tear_down(void **state)
{
    place *p = *state;
    end(p);
    store_inputs_close(p->inputs);
    ledger_free(p->counts);
    queue_close(p->q);
    assert_true(store_remove(p->base, NULL));
    free(p);
    return 0;
}

static void begin_keeping(place *p, double keep_s)
{
    error e = {0};
    p->tasks = runner_new();
    p->r = retention_add(p->tasks, p->q, p->base, p->inputs, keep_s, -1);
    if (!runner_start(p->tasks, &e)) fail_msg("%s", e.message);
}

static void begin(place *p)
{
    begin_keeping(p, KEEP_S);
}

static const int frames[] = {1, 2};

static void put(place *p, bool array, int64_t retention_s, char id[ULID_SIZE])
{
    queue_submission s = {.labels = "[]", .spec = "{}", .max_attempts = 3, .retention_s = retention_s};
    queue_receipt receipt;
    if (array) {
        s.frames = frames;
        s.frame_count = 2;
    }
    assert_true(queue_put(p->q, &s, &receipt, NULL));
    memcpy(id, receipt.id, sizeof receipt.id);
}

static void put_directory(char *path)
{
    char *file = mem_printf("%s/report.json", path);
    assert_true(store_directory_create(path, NULL));
    assert_true(store_file_write(file, "{}", 2, NULL));
    free(file);
    free(path);
}

/* Ends the first task of the job in its second attempt, with the directories of both attempts. */
static void run(place *p, const char *id, int frame)
{
    for (int number = 1; number <= 2; number++) {
        queue_claimed claimed = {0};
        bool found = false, accepted = false;
        assert_true(queue_claim_job(p->q, id, &claimed, &found, NULL));
        assert_true(found);
        queue_fence fence = {id, claimed.task.number, claimed.task.attempt};
        const queue_ending ending = {.state = QUEUE_SUCCEEDED, .outcome = QUEUE_CONVERGED, .exit_status = 0};
        assert_true(number == 1 ? queue_requeue(p->q, &fence, true, 0, &ending, &accepted, NULL)
                                : queue_finish(p->q, &fence, &ending, &accepted, NULL));
        assert_true(accepted);
        queue_claimed_clear(&claimed);
        put_directory(result_attempt_directory(p->base, id, frame, number));
    }
    put_directory(result_directory(p->base, id, frame));
}

static bool is_there(char *path)
{
    bool there = access(path, F_OK) == 0;
    free(path);
    return there;
}

static bool any_left(place *p, const char *id, int frame)
{
    return is_there(result_directory(p->base, id, frame)) ||
           is_there(result_attempt_directory(p->base, id, frame, 1)) ||
           is_there(result_attempt_directory(p->base, id, frame, 2));
}

static bool is_known(place *p, const char *id)
{
    queue_job job = {0};
    bool found = false;
    assert_true(queue_get(p->q, id, &job, &found, NULL));
    queue_job_clear(&job);
    return found;
}

/* Ann holds an uploaded file from now on. */
static void hold_input(place *p, const char *name)
{
    queue_upload row = {.bytes = 3, .sent_ms = clock_wall_ms()};
    size_t added;
    strcpy(row.hash, name + strlen(STORE_INPUT_PREFIX));
    store_hash("ann", 3, row.user);
    assert_true(queue_hold_uploads(p->q, &row, 1, &added, NULL) && added == 1);
}

/* An uploaded file that was last used this long ago, of which the queue knows nothing. */
static char *put_input(place *p, char digit, int64_t ago_s, char name[STORE_INPUT_NAME_SIZE])
{
    memset(name, digit, STORE_INPUT_NAME_SIZE - 1);
    memcpy(name, STORE_INPUT_PREFIX, strlen(STORE_INPUT_PREFIX));
    name[STORE_INPUT_NAME_SIZE - 1] = '\0';
    char *path = mem_printf("%s/inputs/%s", p->base, name);
    assert_true(store_file_write(path, "xyz", 3, NULL));
    struct timespec times[2] = {{.tv_sec = clock_wall_ms() / 1000 - ago_s}};
    times[1] = times[0];
    assert_int_equal(utimensat(AT_FDCWD, path, times, 0), 0);
    return path;
}

static void wait_gone(const char *path)
{
    for (int64_t since = clock_monotonic_ms(); access(path, F_OK) == 0; poll(NULL, 0, 2))
        if (clock_monotonic_ms() - since > PATIENCE_MS) fail_msg("%s is kept", path);
}

static void wait_forgotten(place *p, const char *id)
{
    for (int64_t since = clock_monotonic_ms(); is_known(p, id); poll(NULL, 0, 2))
        if (clock_monotonic_ms() - since > PATIENCE_MS) fail_msg("the job is kept");
}

static void test_expired_jobs_are_deleted(void **state)
{
    place *p = *state;
    char over[ULID_SIZE], kept[ULID_SIZE];
    begin(p);
    put(p, true, 1000, over);
    put(p, false, 0, kept);
    run(p, over, 1);
    run(p, over, 2);
    run(p, kept, QUEUE_NO_FRAME);
    retention_wake(p->r);
    assert_true(is_known(p, over));
    int64_t soon = 1; /* the end may be a millisecond ago, so the following waits take up to a second */
    queue_edit edit = {.retention_s = &soon};
    queue_edited edited;
    assert_true(queue_change(p->q, over, -1, &edit, &edited, NULL));
    retention_wake(p->r);
    for (int64_t since = clock_monotonic_ms();
         is_known(p, over) || any_left(p, over, 1) || any_left(p, over, 2); poll(NULL, 0, 2))
        if (clock_monotonic_ms() - since > PATIENCE_MS) fail_msg("the job is kept");
    assert_true(is_known(p, kept));
    assert_true(is_there(result_directory(p->base, kept, QUEUE_NO_FRAME)));
}

/* Whatever the wall clock, an ended job is kept for ten hours of running time, and an uploaded file for
 * KEEP_S. */
static void test_a_clock_that_is_set_forward_deletes_nothing(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], mark[ULID_SIZE], name[STORE_INPUT_NAME_SIZE];
    char *directory = mem_printf("%s/inputs", p->base);
    assert_true(store_directory_create(directory, NULL));
    p->inputs = store_inputs_open(directory, 100, 9, p->q, p->counts, NULL);
    char *sent = put_input(p, 'a', 1000, name);
    hold_input(p, name);
    put(p, false, 36000, id);
    run(p, id, QUEUE_NO_FRAME);
    for (int start = 0; start < 2; start++) {
        step_wall(1000 * HOUR);
        begin(p);
        put(p, false, 1, mark);
        run(p, mark, QUEUE_NO_FRAME);
        pass(2000);
        retention_wake(p->r);
        wait_forgotten(p, mark); /* after the other jobs were examined */
        assert_true(is_known(p, id));
        assert_int_equal(access(sent, F_OK), 0);
        end(p);
        store_inputs_close(p->inputs);
        queue_close(p->q);
        assert_non_null(p->q = queue_open(p->base, NULL));
        assert_non_null(p->inputs = store_inputs_open(directory, 100, 9, p->q, p->counts, NULL));
    }
    begin(p);
    pass(2 * HOUR);
    retention_wake(p->r);
    wait_gone(sent);
    assert_true(is_known(p, id));
    pass(8 * HOUR);
    retention_wake(p->r);
    wait_forgotten(p, id);
    free(sent);
    free(directory);
}

static void test_delete(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    bool found, deleted;
    begin(p);
    put(p, false, 0, id);
    assert_true(retention_delete(p->r, id, &found, &deleted, NULL));
    assert_true(found && !deleted);
    run(p, id, QUEUE_NO_FRAME);
    assert_true(retention_delete(p->r, id, &found, &deleted, NULL));
    assert_true(found && deleted);
    assert_false(is_known(p, id) || any_left(p, id, QUEUE_NO_FRAME));
    assert_true(retention_delete(p->r, id, &found, &deleted, NULL));
    assert_false(found);
}

static void wait_removed(place *p, const char *id, int frame)
{
    for (int64_t since = clock_monotonic_ms(); any_left(p, id, frame); poll(NULL, 0, 2))
        if (clock_monotonic_ms() - since > PATIENCE_MS) fail_msg("frame %d is kept", frame);
}

static size_t count_removals(place *p)
{
    queue_removal *removals = NULL;
    size_t count = 0;
    assert_true(queue_list_removals(p->q, NULL, 0, 1000, &removals, &count, NULL));
    free(removals);
    return count;
}

static void wait_done(place *p)
{
    for (int64_t since = clock_monotonic_ms(); count_removals(p) > 0; poll(NULL, 0, 2))
        if (clock_monotonic_ms() - since > PATIENCE_MS) fail_msg("the notes are kept");
}

/* The daemon crashed after the queue had deleted the job and recorded its directories. */
static void test_a_start_removes_noted_directories(void **state)
{
    place *p = *state;
    char gone[ULID_SIZE], kept[ULID_SIZE];
    bool found, deleted;
    static const char unknown[] = "0123456789abcdefghjkmnpqrs";
    put(p, true, 0, gone);
    put(p, false, 0, kept);
    run(p, gone, 1);
    run(p, gone, 2);
    run(p, kept, QUEUE_NO_FRAME);
    put_directory(result_directory(p->base, unknown, QUEUE_NO_FRAME)); /* not recorded, so not removed */
    put_directory(result_attempt_directory(p->base, unknown, QUEUE_NO_FRAME, 1));
    put_directory(
        /* not recorded either: the queue never assigned that number */
        result_attempt_directory(p->base, gone, 1, 3));
    assert_true(queue_delete(p->q, gone, &found, &deleted, NULL));
    assert_true(deleted);
    assert_int_equal(count_removals(p), 2);
    begin(p);
    wait_removed(p, gone, 1);
    wait_removed(p, gone, 2);
    wait_done(p);
    assert_true(is_there(result_directory(p->base, kept, QUEUE_NO_FRAME)));
    assert_true(is_there(result_directory(p->base, unknown, QUEUE_NO_FRAME)));
    assert_true(is_there(result_attempt_directory(p->base, unknown, QUEUE_NO_FRAME, 1)));
    assert_true(is_there(result_attempt_directory(p->base, gone, 1, 3)));
}

/* A job is deleted even if its directories cannot be removed. They are removed once that is possible. */
static void test_directories_that_cannot_be_removed_stay_noted(void **state)
{
    place *p = *state;
    char stuck[ULID_SIZE], other[ULID_SIZE];
    bool found, deleted;
    put(p, false, 0, stuck);
    put(p, false, 0, other);
    run(p, stuck, QUEUE_NO_FRAME);
    run(p, other, QUEUE_NO_FRAME);
    begin(p);
    char *results = mem_printf("%s/results", p->base), *away = mem_printf("%s/away", p->base);
    /* in place of `results`: nothing can be opened below it */
    assert_true(store_file_write(away, "x", 1, NULL));
    assert_int_equal(renameat2(AT_FDCWD, results, AT_FDCWD, away, RENAME_EXCHANGE), 0);
    log_set_level(LOG_LEVEL_ERROR);
    assert_true(retention_delete(p->r, stuck, &found, &deleted, NULL));
    assert_true(found && deleted);
    assert_false(is_known(p, stuck));
    assert_int_equal(count_removals(p), 1);
    /* in one step, because the thread treats a missing directory as removed */
    assert_int_equal(renameat2(AT_FDCWD, results, AT_FDCWD, away, RENAME_EXCHANGE), 0);
    assert_true(retention_delete(p->r, other, &found, &deleted, NULL)); /* is not blocked */
    assert_true(deleted);
    assert_false(any_left(p, other, QUEUE_NO_FRAME));
    end(p);
    begin(p); /* a start tries again at once */
    wait_removed(p, stuck, QUEUE_NO_FRAME);
    wait_done(p);
    free(results);
    free(away);
}

static void test_unused_uploads_are_removed(void **state)
{
    place *p = *state;
    char name[STORE_INPUT_NAME_SIZE], id[ULID_SIZE];
    char *directory = mem_printf("%s/inputs", p->base);
    bool found;
    assert_true(store_directory_create(directory, NULL));
    char *unused = put_input(p, 'a', 1000, name);
    hold_input(p, name);
    char *fresh = put_input(p, 'b', -100000, name);
    hold_input(p, name);
    char *without_a_row = put_input(p, 'e', -100000, name), *wanted = put_input(p, 'c', -100000, name);
    hold_input(p, name);
    p->inputs = store_inputs_open(directory, 100, 12, p->q, p->counts, NULL);
    assert_non_null(p->inputs);
    const char *inputs[] = {name};
    queue_submission s = {
        .labels = "[]", .spec = "{}", .max_attempts = 3, .inputs = inputs, .input_count = 1};
    queue_receipt receipt;
    assert_true(queue_put(p->q, &s, &receipt, NULL));
    memcpy(id, receipt.id, sizeof id);
    assert_true(store_inputs_release(p->inputs, name + strlen(STORE_INPUT_PREFIX), "ann", &found, NULL));
    begin(p);
    pass(2 * HOUR);
    retention_wake(p->r);
    wait_gone(unused); /* in the same collection as the others */
    assert_int_equal(access(fresh, F_OK), 0);
    assert_int_equal(access(without_a_row, F_OK), 0);
    assert_int_equal(access(wanted, F_OK), 0);
    run(p, id, QUEUE_NO_FRAME);
    wait_gone(wanted);
    assert_int_equal(access(fresh, F_OK), 0);
    assert_int_equal(access(without_a_row, F_OK), 0);
    /* and its space was released */
    store_upload *upload = NULL;
    assert_int_equal(store_upload_begin(p->inputs, name + strlen(STORE_INPUT_PREFIX), "ann", 6, &upload),
                     STORE_UPLOAD_GOOD);
    store_upload_end(upload);
    /* a use keeps the file; the thread must not delete it before */
    end(p);
    free(unused);
    unused = put_input(p, 'd', 100000, name);
    assert_int_equal(store_inputs_use(p->inputs, name + strlen(STORE_INPUT_PREFIX)), 3);
    struct stat info;
    assert_int_equal(stat(unused, &info), 0);
    assert_true(info.st_mtim.tv_sec > clock_wall_ms() / 1000 - 50000);
    free(unused);
    free(fresh);
    free(without_a_row);
    free(wanted);
    free(directory);
}

/* A file of which the queue knows nothing is kept like one that a user holds. */
static void test_unused_uploads_without_a_row_are_removed(void **state)
{
    place *p = *state;
    char name[STORE_INPUT_NAME_SIZE], *directory = mem_printf("%s/inputs", p->base);
    assert_true(store_directory_create(directory, NULL));
    char *unused = put_input(p, 'a', 1000, name);
    p->inputs = store_inputs_open(directory, 100, 9, p->q, p->counts, NULL);
    assert_non_null(p->inputs);
    begin(p);
    pass(2 * HOUR);
    retention_wake(p->r);
    wait_gone(unused);
    free(unused);
    free(directory);
}

/* Without a retention time uploaded files are kept, unless all users have released them. The thread examines them once before
 * it ends. */
static void test_uploads_are_kept_without_a_retention_time(void **state)
{
    place *p = *state;
    char name[STORE_INPUT_NAME_SIZE], *directory = mem_printf("%s/inputs", p->base);
    queue_upload row = {.sent_ms = QUEUE_NOT_HELD};
    size_t added;
    assert_true(store_directory_create(directory, NULL));
    char *unused = put_input(p, 'a', 1000, name);
    hold_input(p, name);
    char *without_a_row = put_input(p, 'c', 1000, name), *released = put_input(p, 'b', 0, name);
    strcpy(row.hash, name + strlen(STORE_INPUT_PREFIX));
    assert_true(queue_hold_uploads(p->q, &row, 1, &added, NULL) && added == 0);
    p->inputs = store_inputs_open(directory, 100, 9, p->q, p->counts, NULL);
    assert_non_null(p->inputs);
    begin_keeping(p, 0);
    end(p);
    assert_int_equal(access(unused, F_OK), 0);
    assert_int_equal(access(without_a_row, F_OK), 0);
    assert_int_equal(access(released, F_OK), -1);
    free(released);
    free(without_a_row);
    free(unused);
    free(directory);
}

#define SENT "xyz"

static void *collect(void *argument)
{
    place *p = argument;
    size_t gone;
    return store_inputs_collect(p->inputs, 0, &gone, NULL) ? p : NULL;
}

static void send_it(place *p, const char *hex)
{
    store_upload *upload = NULL;
    assert_int_equal(store_upload_begin(p->inputs, hex, "ann", -1, &upload), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_open(upload, NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_write(upload, SENT, strlen(SENT), NULL), STORE_UPLOAD_GOOD);
    assert_int_equal(store_upload_commit(upload, NULL, NULL), STORE_UPLOAD_GOOD);
    store_upload_end(upload);
}

/* In either order, the free space corresponds to the stored files. */
static void test_an_upload_during_a_collection_is_counted_once(void **state)
{
    place *p = *state;
    char hex[STORE_HASH_SIZE];
    store_hash(SENT, strlen(SENT), hex);
    char *directory = mem_printf("%s/inputs", p->base), *path = mem_printf("%s/sha256:%s", directory, hex);
    p->inputs = store_inputs_open(directory, 100, 9, p->q, p->counts, NULL);
    assert_non_null(p->inputs);
    send_it(p, hex);
    queue_upload row = {0}, *ended;
    size_t count;
    strcpy(row.hash, hex);
    store_hash("ann", 3, row.user);
    for (int i = 0; i < 50; i++) { /* each time the file may go until it is sent again */
        assert_true(queue_forget_uploads(p->q, QUEUE_FORGET_USER, &row, 1, &ended, &count, NULL));
        free(ended);
        pthread_t other;
        void *collected = NULL;
        assert_int_equal(pthread_create(&other, NULL, collect, p), 0);
        send_it(p, hex);
        assert_int_equal(pthread_join(other, &collected), 0);
        assert_non_null(collected);
        assert_int_equal(access(path, F_OK), 0);
        store_upload *upload = NULL;
        assert_int_equal(store_upload_begin(p->inputs, hex, "ann", 7, &upload), STORE_UPLOAD_ALL_FULL);
        assert_int_equal(store_upload_begin(p->inputs, hex, "ann", 6, &upload), STORE_UPLOAD_GOOD);
        store_upload_end(upload);
    }
    free(path);
    free(directory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_expired_jobs_are_deleted, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_clock_that_is_set_forward_deletes_nothing, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_delete, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_start_removes_noted_directories, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_directories_that_cannot_be_removed_stay_noted, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_unused_uploads_are_removed, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_unused_uploads_without_a_row_are_removed, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_uploads_are_kept_without_a_retention_time, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_an_upload_during_a_collection_is_counted_once, set_up,
                                        tear_down),
    };
    log_set_level(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests_name("retention", tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
/* The entries of results/ and attempts/ compared with the queue. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/results/inventory.h"
#include "files/file.h"

typedef struct place {
    char base[64];
    queue *q;
} place;

static char *at(place *p, const char *name)
{
    return mem_printf("%s/%s", p->base, name);
}

static void make(place *p, const char *name)
{
    char *path = at(p, name);
    assert_true(store_directory_create(path, NULL));
    free(path);
}

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-inventory-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    p->q = queue_open(p->base, NULL);
    assert_non_null(p->q);
    make(p, "results");
    make(p, "attempts");
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

static bool is_there(place *p, const char *name)
{
    struct stat info;
    char *path = at(p, name);
    bool there = lstat(path, &info) == 0;
    free(path);
    return there;
}

static void expect_moved(place *p, const char *name, bool moved)
{
    char *away = mem_printf("lost+found/%s", name);
    if (is_there(p, away) != moved || is_there(p, name) == moved)
        fail_msg("%s is%s moved", name, moved ? " not" : "");
    free(away);
}

static void take(place *p)
{
    error e = {0};
    if (!inventory_take(p->q, p->base, false, &e)) fail_msg("%s", e.message);
}

static const int frames[] = {0, 3};

/* Submits a job and runs this number of attempts of each task. The last one ends the task with `end`, unless
 * the task waits. */
static void put(place *p, bool array, int attempts, queue_state end, char id[ULID_SIZE])
{
    queue_submission s = {.labels = "[]", .spec = "{}", .max_attempts = 9};
    queue_receipt receipt;
    if (array) {
        s.frames = frames;
        s.frame_count = 2;
    }
    assert_true(queue_put(p->q, &s, &receipt, NULL));
    memcpy(id, receipt.id, sizeof receipt.id);
    for (int k = 0; k < attempts * (array ? 2 : 1); k++) {
        queue_claimed c = {0};
        bool found, accepted;
        const queue_ending ending = {.state = end,
                                     .outcome = end == QUEUE_SUCCEEDED ? QUEUE_CONVERGED : QUEUE_NO_OUTCOME,
                                     .error_code = "internal",
                                     .error_message = "no",
                                     .exit_status = 1,
                                     .signal = -1};
        assert_true(queue_claim_job(p->q, id, &c, &found, NULL) && found);
        const queue_fence fence = {id, c.task.number, c.task.attempt};
        bool again = c.task.attempt < attempts || end == QUEUE_QUEUED;
        assert_true(again
                        ? queue_requeue(p->q, &fence, true, again && end == QUEUE_QUEUED ? INT64_MAX / 2 : 0,
                                        &ending, &accepted, NULL)
                        : queue_finish(p->q, &fence, &ending, &accepted, NULL));
        queue_claimed_clear(&c);
    }
}

static char *name_of(const char *part, const char *id, const char *rest)
{
    return mem_printf("%s/%s%s", part, id, rest);
}

static const struct {
    const char *part, *rest;
    bool moved;
} of_array[] = {
    /* two attempts of the frames 0 and 3; the second ones succeeded */
    {"results", ".0", false},
    {"results", ".3", false},
    {"results", "", true},
    {"results", ".1", true},
    {"results", ".03", true},
    {"results", ".0.1", true},
    {"results", ".-1", true},
    {"results", ".", true},
    {"results", ".x", true},
    {"results", ".3 ", true},
    {"results", ".99999999999", true},
    {"attempts", ".0.1", false},
    {"attempts", ".3.2", false},
    {"attempts", ".3.3", true},
    {"attempts", ".1", true},
    {"attempts", ".3.0", true},
    {"attempts", ".3", true},
    {"attempts", "", true},
    {"attempts", ".3.1.1", true},
    {"attempts", ".0.01", true},
};

static void test_names_identify_the_job(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    size_t count = sizeof of_array / sizeof *of_array;
    put(p, true, 2, QUEUE_SUCCEEDED, id);
    for (size_t i = 0; i < count; i++) {
        char *name = name_of(of_array[i].part, id, of_array[i].rest);
        make(p, name);
        free(name);
    }
    for (int times = 0; times < 2; times++) {
        take(p);
        for (size_t i = 0; i < count; i++) {
            char *name = name_of(of_array[i].part, id, of_array[i].rest);
            expect_moved(p, name, of_array[i].moved);
            free(name);
        }
    }
}

static void test_results_of_jobs_in_each_state(void **state)
{
    place *p = *state;
    static const struct {
        queue_state end;
        int attempts;
        bool moved;
    } cases[] = {{QUEUE_SUCCEEDED, 1, false},
                 {QUEUE_FAILED, 1, true},
                 {QUEUE_TIMED_OUT, 1, true},
                 {QUEUE_QUEUED, 0, true},
                 {QUEUE_QUEUED, 1, true}};
    char id[5][ULID_SIZE];
    for (int i = 0; i < 5; i++) {
        put(p, false, cases[i].attempts, cases[i].end, id[i]);
        char *name = name_of("results", id[i], ""); /* an incomplete result */
        make(p, name);
        free(name);
    }
    take(p);
    for (int i = 0; i < 5; i++) {
        char *name = name_of("results", id[i], "");
        expect_moved(p, name, cases[i].moved);
        free(name);
    }
}

static void test_entries_noted_for_removal_are_kept(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    bool found, deleted;
    put(p, true, 1, QUEUE_SUCCEEDED, id);
    assert_true(queue_delete(p->q, id, &found, &deleted, NULL) && deleted);
    char *result = name_of("results", id, ".3"), *attempt = name_of("attempts", id, ".3.1"),
         *later = name_of("attempts", id, ".3.2");
    make(p, result);
    make(p, attempt);
    make(p, later);
    take(p);
    expect_moved(p, result, false);
    expect_moved(p, attempt, false);
    expect_moved(p, later, true);
    free(result);
    free(attempt);
    free(later);
}

static void test_names_in_lost_and_found_are_not_taken_twice(void **state)
{
    place *p = *state;
    static const char *const expected[] = {"lost+found/results/x", "lost+found/results/x~1",
                                           "lost+found/results/x~2"};
    for (int i = 0; i < 3; i++) {
        make(p, "results/x");
        take(p);
        for (int k = 0; k < 3; k++) assert_int_equal(is_there(p, expected[k]), k <= i);
    }
}

/* A check of the disk whose file could not be removed. */
static void test_probes_of_the_disk_stay(void **state)
{
    place *p = *state;
    static const char *const probes[] = {"attempts/.probe", "results/.probe"};
    for (int i = 0; i < 2; i++) make(p, probes[i]);
    take(p);
    for (int i = 0; i < 2; i++) expect_moved(p, probes[i], false);
}

/* A waiting job would need the name. */
static void test_a_blocking_entry_that_cannot_be_moved_is_an_error(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    error e = {0};
    put(p, false, 0, QUEUE_QUEUED, id);
    char *result = name_of("results", id, ""), *file = at(p, INVENTORY_LOST_FOUND);
    make(p, "results/other");
    assert_true(store_file_write(file, "x", 1, NULL));
    take(p); /* entries without a job may stay */
    make(p, result);
    assert_false(inventory_take(p->q, p->base, false, &e));
    assert_non_null(strstr(e.message, result));
    assert_true(is_there(p, result) && is_there(p, "results/other"));
    free(result);
    free(file);
}

#define CASE(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_names_identify_the_job),
        CASE(test_results_of_jobs_in_each_state),
        CASE(test_entries_noted_for_removal_are_kept),
        CASE(test_names_in_lost_and_found_are_not_taken_twice),
        CASE(test_probes_of_the_disk_stay),
        CASE(test_a_blocking_entry_that_cannot_be_moved_is_an_error),
    };
    log_set_level(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests_name("inventory", tests, NULL, NULL);
}

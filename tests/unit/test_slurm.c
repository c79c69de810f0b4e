// SPDX-License-Identifier: Apache-2.0
/* Unit tests of the engine slurm: attempts whose files are damaged. squeue is a script that lists no job. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/slurm/attempt_files.h"
#include "service/slurm/slurm.h"
#include "files/file.h"

#define PATIENCE_MS 30000
#define NAME "01aaaaaaaaaaaaaaaaaaaaaaaa.1"

typedef struct place {
    char base[64];
    char *directory; /* of the attempt, in farm/ */
    runner *tasks;
    slurm *s;
} place;

static int set_up(void **state)
{
    static const char squeue[] = "#!/bin/sh\n";
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-slurm-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    char *program = mem_printf("%s/squeue", p->base), *path = mem_printf("%s:/bin:/usr/bin", p->base);
    assert_true(store_file_write(program, squeue, strlen(squeue), NULL));
    assert_int_equal(chmod(program, 0700), 0);
    setenv("PATH", path, true);
    free(program);
    free(path);
    p->directory = mem_printf("%s/farm/" NAME, p->base);
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    if (p->tasks) runner_stop(p->tasks);
    slurm_close(p->s);
    runner_free(p->tasks);
    assert_true(store_remove(p->base, NULL));
    free(p->directory);
    free(p);
    return 0;
}

/* An attempt that a node has run, with this text as its ending. */
static engine_attempt *resume(place *p, double lost_s, const char *text)
{
    error e = {0};
    const attempt_files_batch batch = {"hexad-x-1", 0, 0};
    char *out = mem_printf("%s/attempts/" NAME, p->base),
         *ending = mem_printf("%s/ending.json", p->directory);
    p->tasks = runner_new();
    p->s = slurm_open(
        &(slurm_settings){.work_dir = p->base, .interval_s = 0.02, .command_s = 10, .lost_s = lost_s},
        p->tasks, &e);
    if (!p->s || !runner_start(p->tasks, &e)) fail_msg("%s", e.message);
    const engine_request request = {.worker = "w",
                                    .command = "run",
                                    .directory = out,
                                    .spec = "{}",
                                    .memory_mb = 1,
                                    .threads = 1,
                                    .chunk = -1,
                                    .instance = "x",
                                    .wake_fd = -1};
    if (!attempt_files_begin(p->directory, &request, &e)) fail_msg("%s", e.message);
    assert_true(attempt_files_write_batch(p->directory, &batch, NULL));
    assert_int_equal(attempt_files_take(p->directory, &batch), ATTEMPT_FILES_WON);
    assert_true(store_file_write(ending, text, strlen(text), NULL));
    engine_attempt *a = engine_slurm.resume(p->s, &request, NULL);
    free(out);
    free(ending);
    return a;
}

static void expect_loss(engine_attempt *a, engine_loss loss, const char *words)
{
    const char *progress;
    engine_ending ending = {0};
    for (int64_t since = clock_monotonic_ms(); !engine_slurm.poll(a, &progress); poll(NULL, 0, 2))
        if (clock_monotonic_ms() - since > PATIENCE_MS) fail_msg("the attempt goes on");
    engine_slurm.settle(a, &ending);
    assert_int_equal(ending.loss, loss);
    if (!strstr(ending.why, words)) fail_msg("%s", ending.why);
    free(ending.last_words);
}

static void test_an_unreadable_ending_is_abandoned(void **state)
{
    place *p = *state;
    expect_loss(resume(p, 0.1, "{\"exit_status\": "), ENGINE_INTERRUPTED, "ending.json");
}

static void test_a_forced_cancellation_waits_for_no_ending(void **state)
{
    place *p = *state;
    engine_attempt *a = resume(p, 1e6, "no JSON");
    engine_slurm.cancel(a, true);
    expect_loss(a, ENGINE_INTERRUPTED, "abandoned");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_an_unreadable_ending_is_abandoned, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_forced_cancellation_waits_for_no_ending, set_up, tear_down),
    };
    log_set_level(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests_name("slurm", tests, NULL, NULL);
}

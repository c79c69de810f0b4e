// SPDX-License-Identifier: Apache-2.0
/* Members of a spec and settings that belong to missing parts. This test replaces build_part_missing; `make
 * check-builds` tests real builds.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "base/core/build_part.h"
#include "base/core/memory.h"
#include "service/config/config.h"
#include "spec/spec.h"
#include "spec_text.h"

#define COUNT(a) ((int)(sizeof(a) / sizeof *(a)))

const char *__wrap_build_part_missing(build_part part);

const char *__wrap_build_part_missing(build_part part)
{
    static const char *const why[] = {
        [BUILD_PART_PREVIEW] = "no --disable-preview",
        [BUILD_PART_SLURM] = "no --without-slurm",
        [BUILD_PART_PAGE] = "no --without-page",
    };
    return why[part];
}

static void refuse(const char *members, const char *pointer, const char *option)
{
    error e = {0};
    spec_faults faults;
    if (spec_of_text(members, &faults, &e)) fail_msg("accepted: %s", members);
    assert_int_equal(e.code, ERROR_NOT_SUPPORTED);
    assert_int_equal(faults.count, 1);
    assert_string_equal(faults.item[0].pointer, pointer);
    assert_int_equal(faults.item[0].code, ERROR_NOT_SUPPORTED);
    if (!strstr(e.message, option)) fail_msg("'%s' does not name %s", e.message, option);
}

static spec *accept(const char *members)
{
    error e = {0};
    spec *s = spec_of_text(members, NULL, &e);
    if (!s) fail_msg("%s: %s", members, e.message);
    return s;
}

static void members_of_missing_parts_are_not_supported(void **state)
{
    (void)state;
    refuse(",\"output\":{\"preview\":true}", "/output/preview", "--disable-preview");
    refuse(",\"output\":{\"preview\":{}}", "/output/preview", "--disable-preview");
    refuse(",\"output\":{\"preview\":{\"size\":128}}", "/output/preview", "--disable-preview");
    refuse(",\"queue\":{\"slurm\":[\"--partition=a\"]}", "/queue/slurm", "--without-slurm");
}

static void members_that_disable_missing_parts_are_accepted(void **state)
{
    (void)state;
    spec *s = accept(",\"output\":{\"preview\":false},\"queue\":{\"slurm\":[]}");
    assert_false(s->has_preview || s->preview_left_out || s->slurm_count);
    spec_free(s);
}

/* A worker reads a spec that the daemon has already read, and warns. */
static void default_preview_is_omitted_by_daemon_and_worker(void **state)
{
    (void)state;
    error e = {0};
    spec *s = accept("");
    assert_true(s->preview_left_out && !s->has_preview);
    spec *again = spec_parse(s->normalised, NULL, &e);
    if (!again) fail_msg("%s", e.message);
    assert_true(again->preview_left_out && !again->has_preview);
    spec_free(again);
    spec_free(s);
}

static void expect_settings(char *option, error_code code, const char *named)
{
    char *argv[] = {"hexad", option};
    config c = {0};
    config_action action;
    error e = {0};
    const bool ok = config_parse(COUNT(argv), argv, &c, &action, &e);
    if (e.code != code || ok != (code == ERROR_NONE) || !strstr(e.message, named))
        fail_msg("%s: code %d, %s", option, e.code, e.message);
    config_clear(&c);
}

static void settings_of_missing_parts_are_not_supported(void **state)
{
    (void)state;
    expect_settings("--slurm_batch_s=5", ERROR_NOT_SUPPORTED, "--without-slurm");
    expect_settings("--slurm_allow=--partition", ERROR_NOT_SUPPORTED, "--without-slurm");
    expect_settings("--session_s=60", ERROR_NOT_SUPPORTED, "--without-page");
}

static void defaults_of_missing_parts_are_accepted(void **state)
{
    (void)state;
    expect_settings("--slurm_batch_s=60", ERROR_NONE, "");
    expect_settings("--page=1", ERROR_NONE, "");
    expect_settings("--page=0", ERROR_NONE, "");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(members_of_missing_parts_are_not_supported),
        cmocka_unit_test(members_that_disable_missing_parts_are_accepted),
        cmocka_unit_test(default_preview_is_omitted_by_daemon_and_worker),
        cmocka_unit_test(settings_of_missing_parts_are_not_supported),
        cmocka_unit_test(defaults_of_missing_parts_are_accepted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "service/config/config.h"
#include "service/config/config_table.h"
#include "files/file.h"

#define COUNT(a) ((int)(sizeof(a) / sizeof *(a)))

static char path[] = "/tmp/hexad-config-XXXXXX";

static int set_up(void **state)
{
    (void)state;
    int fd = mkstemp(path);
    return fd < 0 ? -1 : close(fd);
}

static int tear_down(void **state)
{
    (void)state;
    return unlink(path);
}

static void write_file(const char *text)
{
    assert_true(store_file_write(path, text, strlen(text), NULL));
}

static config parse(int argc, char **argv)
{
    config c = {0};
    config_action action;
    error e = {0};
    if (!config_parse(argc, argv, &c, &action, &e)) fail_msg("%s", e.message);
    assert_int_equal(action, CONFIG_RUN);
    return c;
}

static void expect_fault(int argc, char **argv, const char *words)
{
    config c = {0};
    config_action action;
    error e = {0};
    assert_false(config_parse(argc, argv, &c, &action, &e));
    if (!strstr(e.message, words)) fail_msg("\"%s\" is not in: %s", words, e.message);
}

static void expect_file_fault(const char *text, const char *words)
{
    char *argv[] = {"hexad", "--config", path};
    write_file(text);
    expect_fault(COUNT(argv), argv, words);
}

static void test_defaults(void **state)
{
    (void)state;
    char *argv[] = {"hexad"};
    config c = parse(COUNT(argv), argv);
    assert_int_equal(c.listen.count, 0);
    assert_int_equal(c.max_attempts, 3);
    assert_int_equal(c.memory_mb, 4096);
    assert_int_equal(c.body_limit_bytes, 1048576);
    assert_int_equal(c.input_roots.count, 0);
    assert_int_equal(c.log_level, LOG_LEVEL_INFO);
    assert_true(*c.state_dir == '/');
    config_clear(&c);
}

static void test_options_take_precedence_over_the_file(void **state)
{
    (void)state;
    write_file("# comment\n[hexad]\nworkers = 3\nlisten = 127.0.0.1:1\ninput_roots = /a:/b\n"
               "input_roots = /c, /d\npath_mappings = Z:/a=/b, /c=/d\ndrain_s = 2.5\n");
    char *argv[] = {"hexad", "--workers=5", "--config", path, "--state-dir", "/s", "--log_level", "debug"};
    config c = parse(COUNT(argv), argv);
    assert_int_equal(c.workers, 5);
    assert_string_equal(c.listen.item[0], "127.0.0.1:1");
    assert_int_equal(c.input_roots.count, 4);
    assert_string_equal(c.input_roots.item[0], "/a");
    assert_int_equal(c.path_mappings.count, 2); /* separated by commas only */
    assert_string_equal(c.path_mappings.item[0], "Z:/a=/b");
    assert_string_equal(c.input_roots.item[3], "/d");
    assert_string_equal(c.state_dir, "/s");
    assert_true(c.drain_s == 2.5);
    assert_int_equal(c.log_level, LOG_LEVEL_DEBUG);
    config_clear(&c);
    char *list[] = {"hexad", "--config", path, "--input_roots", "/x", "--input_roots", "/y"};
    c = parse(COUNT(list), list);
    assert_int_equal(c.input_roots.count, 2); /* replaces the values of the file */
    assert_string_equal(c.input_roots.item[0], "/x");
    config_clear(&c);
}

/* Powers of 1024; only of sizes, and only if the result is a whole number of the setting's unit. */
static void test_sizes_may_have_a_unit(void **state)
{
    (void)state;
    write_file("host_memory_mb = 3G\nfile_mb = 2048K\nupload_limit_bytes = 1T\nbody_limit_bytes = 64K\n"
               "free_space_mb = 300M\nreserve_mb = 20\n");
    char *argv[] = {"hexad", "--config", path, "--answer_total_bytes=1M"};
    config c = parse(COUNT(argv), argv);
    assert_int_equal(c.host_memory_mb, 3 * 1024);
    assert_int_equal(c.file_mb, 2);
    assert_int_equal(c.upload_limit_bytes, INT64_C(1) << 40);
    assert_int_equal(c.body_limit_bytes, 65536);
    assert_int_equal(c.free_space_mb, 300);
    assert_int_equal(c.reserve_mb, 20);
    assert_int_equal(c.answer_total_bytes, 1 << 20);
    config_clear(&c);
    expect_file_fault("file_mb = 1025K\n", "K, M, G or T, such as 2G for 2 GiB (given \"1025K\")");
    expect_file_fault("body_limit_bytes = 2G\n",
                      "body_limit_bytes: must be a whole number from 1 to 1073741824 bytes, or");
    expect_file_fault("file_mb = 2GB\n", "(given \"2GB\")");
    expect_file_fault("file_mb = G\n", "(given \"G\")");
    expect_file_fault("workers = 2K\n", "(given \"2K\")");
    expect_file_fault("drain_s = 2K\n", "(given \"2K\")");
}

/* Each setting is distinguished from all others: none is reported as given twice. */
static void test_all_settings_at_once(void **state)
{
    (void)state;
    char **argv = mem_alloc((config_table_size + 1) * sizeof *argv);
    argv[0] = mem_strdup("hexad");
    for (size_t i = 0; i < config_table_size; i++) {
        const config_row *row = &config_table[i];
        argv[i + 1] = mem_printf("--%s=%s", row->key, row->default_text ? row->default_text : "");
    }
    config c = parse((int)config_table_size + 1, argv);
    config_clear(&c);
    for (size_t i = 0; i <= config_table_size; i++) free(argv[i]);
    free(argv);
}

static void test_faults_of_the_file_name_the_line(void **state)
{
    (void)state;
    char where[64];
    snprintf(where, sizeof where, "%s:2: unknown setting nonsense", path);
    expect_file_fault("workers = 1\nnonsense = 1\n", where);
    expect_file_fault("wrokers = 1\n", ":1: unknown setting wrokers; did you mean workers?");
    expect_file_fault("input_root = /a\n", "did you mean input_roots?");
    expect_file_fault("workers = many\n",
                      ":1: workers: must be a whole number from 0 to 1024 processes (given \"many\")");
    expect_file_fault("\n\nworkers = 1.5\n", ":3: workers");
    expect_file_fault("drain_s = nan\n", ":1: drain_s");
    expect_file_fault("memory_mb = -1\n", ":1: memory_mb");
    expect_file_fault("inputs_keep_s = 59\n", "must be 0 or a number from 60 to 1e+10 s (given \"59\")");
    expect_file_fault("inputs_keep_s = -1\n", ":1: inputs_keep_s");
    expect_file_fault("memory_mb = 99999999999999999999\n", ":1: memory_mb");
    expect_file_fault("log_level = loud\n", ":1: log_level");
    expect_file_fault("workers = 1\nworkers = 2\n", ":2: workers is given twice");
    expect_file_fault("[other]\nworkers = 1\n", "section [other]");
    expect_file_fault("workers = 1\nwords without sense\n", ":2: the line is not a setting");
    char long_line[400];
    memset(long_line, 'x', sizeof long_line);
    memcpy(long_line, "worker = ", 9);
    strcpy(long_line + sizeof long_line - 2, "\n");
    expect_file_fault(long_line, ":1: the line is longer");
    char *argv[] = {"hexad", "--config", "/nonexistent.conf"};
    expect_fault(COUNT(argv), argv, "/nonexistent.conf");
}

static void test_faults_of_the_command_line(void **state)
{
    (void)state;
    char *unknown[] = {"hexad", "--nonsense", "1"};
    expect_fault(COUNT(unknown), unknown, "unknown option --nonsense; see hexad --help");
    char *misspelt[] = {"hexad", "--wrokers=1"};
    expect_fault(COUNT(misspelt), misspelt, "unknown option --wrokers; did you mean --workers?");
    char *action[] = {"hexad", "--adpot"};
    expect_fault(COUNT(action), action, "unknown option --adpot; did you mean --adopt?");
    char *file[] = {"hexad", "--confg", path};
    expect_fault(COUNT(file), file, "did you mean --config?");
    char *flag[] = {"hexad", "--adopt=1"};
    expect_fault(COUNT(flag), flag, "--adopt takes no value");
    char *bare[] = {"hexad", "word"};
    expect_fault(COUNT(bare), bare, "unexpected argument word");
    char *missing[] = {"hexad", "--workers"};
    expect_fault(COUNT(missing), missing, "--workers requires a value");
    char *value[] = {"hexad", "--workers", "x"};
    expect_fault(COUNT(value), value, "command line: workers");
}

static void test_actions(void **state)
{
    (void)state;
    config c = {0};
    config_action action;
    char *argv[] = {"hexad", "--help", "all"};
    for (int all = 0; all <= 1; all++) {
        assert_true(config_parse(2 + all, argv, &c, &action, NULL));
        assert_int_equal(action, CONFIG_HELP);
        assert_int_equal(c.help_all, all);
        config_clear(&c);
    }
    char *all[] = {"hexad", "all"};
    expect_fault(COUNT(all), all, "unexpected argument all");
}

static void test_each_setting_has_a_rank_and_basic_ones_are_first_in_the_help(void **state)
{
    (void)state;
    char *text[2] = {NULL};
    size_t size, basic = 0;
    for (int all = 0; all <= 1; all++) {
        FILE *stream = open_memstream(&text[all], &size);
        config_print_help(stream, all);
        fclose(stream);
    }
    const char *further = strstr(text[true], "\nFurther settings\n");
    assert_non_null(further);
    for (size_t i = 0; i < config_table_size; i++) {
        const config_row *row = &config_table[i];
        const bool is_basic = row->rank == OPTION_BASIC;
        char *brief = mem_printf("\n  --%s ", row->key), *whole = mem_printf("\n  --%s\n", row->key);
        const char *at = strstr(text[true], whole);
        assert_in_range(row->rank, OPTION_BASIC, OPTION_RESEARCH);
        assert_int_equal(strstr(text[false], brief) != NULL, is_basic);
        if (!at || (at < further) != is_basic) fail_msg("%s: %s", row->key, at ? "misplaced" : "missing");
        basic += is_basic;
        free(brief);
        free(whole);
    }
    assert_in_range(basic, 15, 25);
    for (int all = 0; all <= 1; all++) free(text[all]);
}

/* etc/hexad.conf equals the table, and gives the defaults if every key is enabled. */
static void test_the_sample_file_equals_the_table(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size, length;
    FILE *stream = open_memstream(&text, &size);
    config_print_sample(stream);
    fclose(stream);
    const char *source = getenv("HEXAD_SOURCE");
    char *sample_path = mem_printf("%s/etc/hexad.conf", source ? source : ".");
    char *sample = store_file_read(sample_path, 1 << 20, &length, NULL);
    assert_non_null(sample);
    assert_string_equal(sample, text);
    for (char *c = text; *c; c++) /* "#key = value" becomes "key = value"; prose has a blank after # */
        if (*c == '#' && c[1] != ' ' && c[-1] == '\n') memmove(c, c + 1, strlen(c));
    write_file(text);
    char *argv[] = {"hexad", "--config", path}, *none[] = {"hexad"};
    config c = parse(COUNT(argv), argv), defaults = parse(COUNT(none), none);
    assert_int_equal(c.listen.count, defaults.listen.count);
    assert_string_equal(c.state_dir, defaults.state_dir);
    assert_int_equal(c.connection_limit, defaults.connection_limit);
    assert_true(c.grace_s == defaults.grace_s);
    config_clear(&c);
    config_clear(&defaults);
    free(sample);
    free(sample_path);
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_options_take_precedence_over_the_file),
        cmocka_unit_test(test_sizes_may_have_a_unit),
        cmocka_unit_test(test_all_settings_at_once),
        cmocka_unit_test(test_faults_of_the_file_name_the_line),
        cmocka_unit_test(test_faults_of_the_command_line),
        cmocka_unit_test(test_actions),
        cmocka_unit_test(test_each_setting_has_a_rank_and_basic_ones_are_first_in_the_help),
        cmocka_unit_test(test_the_sample_file_equals_the_table),
    };
    return cmocka_run_group_tests_name("config", tests, set_up, tear_down);
}

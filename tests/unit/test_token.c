// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <grp.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "service/auth/access.h"
#include "service/auth/session.h"
#include "files/token.h"
#include "base/core/memory.h"
#include "files/file.h"

static char path[] = "/tmp/hexad-token-XXXXXX";

static int set_up(void **state)
{
    (void)state;
    strcpy(path + sizeof path - 7, "XXXXXX");
    int fd = mkstemp(path);
    return fd < 0 ? -1 : close(fd);
}

static int tear_down(void **state)
{
    (void)state;
    return unlink(path);
}

static void test_scopes(void **state)
{
    (void)state;
    unsigned scopes = 99;
    char text[SCOPE_TEXT_SIZE];
    assert_true(scope_parse("submit,read", &scopes));
    assert_int_equal(scopes, SCOPE_READ | SCOPE_SUBMIT);
    assert_string_equal(scope_print(scopes, text), "read,submit");
    assert_true(scope_parse("admin", &scopes));
    assert_int_equal(scopes, SCOPE_ALL);
    assert_string_equal(scope_print(scopes, text), "read,submit,cancel,admin");
    static const char *const bad[] = {"",     ",",   "read,", ",read",      "read,read",
                                      "Read", "rea", "reads", "read submit"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (scope_parse(bad[i], &scopes)) fail_msg("%s", bad[i]);
    assert_int_equal(scopes, SCOPE_ALL);
}

static void test_a_token_is_found_by_its_secret_alone(void **state)
{
    (void)state;
    token_set made = {0}, read = {0};
    char first[TOKEN_SIZE], second[TOKEN_SIZE];
    error e = {0};
    assert_non_null(token_set_add(&made, "alice", SCOPE_READ, TOKEN_ANY_PRIORITY, first, &e));
    assert_non_null(token_set_add(&made, "bob@studio", SCOPE_ALL, -7, second, &e));
    assert_string_not_equal(first, second);
    assert_int_equal(strlen(first), TOKEN_SIZE - 1);
    if (!token_set_write(path, &made, TOKEN_NO_GROUP, &e) || !token_set_read(path, &read, &e))
        fail_msg("%s", e.message);
    struct stat info;
    assert_int_equal(stat(path, &info), 0);
    assert_int_equal(info.st_mode & 0777, 0600);
    size_t length;
    char *text = store_file_read(path, 1 << 16, &length, &e);
    assert_null(strstr(text, first + strlen(TOKEN_PREFIX))); /* only the hash is stored */
    free(text);
    assert_int_equal(read.count, 2);
    const token *found = token_set_find(&read, second);
    assert_non_null(found);
    assert_string_equal(found->user, "bob@studio");
    assert_int_equal(found->scopes, SCOPE_ALL);
    assert_int_equal(found->max_priority, -7);
    assert_int_equal(token_set_find(&read, first)->max_priority, TOKEN_ANY_PRIORITY);
    assert_null(token_set_find(&read, ""));
    assert_null(token_set_find(&read, found->id));
    first[TOKEN_SIZE - 2] = first[TOKEN_SIZE - 2] == '0' ? '1' : '0';
    assert_null(token_set_find(&read, first));
    char id[TOKEN_ID_SIZE];
    strcpy(id, found->id);
    assert_true(token_set_remove(&read, id));
    assert_false(token_set_remove(&read, id));
    assert_null(token_set_find(&read, second));
    token_set_clear(&made);
    token_set_clear(&read);
}

static void expect_refusal(const char *words)
{
    token_set set = {0};
    error e = {0};
    assert_false(token_set_read(path, &set, &e));
    if (!strstr(e.message, words)) fail_msg("\"%s\" is not in: %s", words, e.message);
    assert_int_equal(set.count, 0);
}

/* They are refused for new tokens only. */
static void test_users_that_are_named_like_directories_keep_their_tokens(void **state)
{
    (void)state;
    static const char file[] =
        "0123456789ab .. read 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef 1\n"
        "1123456789ab . read 1123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef 1\n";
    error e = {0};
    token_set set = {0};
    assert_true(store_file_write(path, file, strlen(file), &e));
    assert_int_equal(chmod(path, 0600), 0);
    for (int i = 0; i < 2; i++) { /* as they were written, and as they are written now */
        if (!token_set_read(path, &set, &e)) fail_msg("%s", e.message);
        assert_int_equal(set.count, 2);
        assert_string_equal(set.item[0].user, "..");
        assert_string_equal(set.item[1].user, ".");
        if (!token_set_write(path, &set, TOKEN_NO_GROUP, &e)) fail_msg("%s", e.message);
        token_set_clear(&set);
    }
}

static void test_invalid_files_are_refused(void **state)
{
    (void)state;
#define HASH "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef"
    static const char *const bad[] = {
        "nonsense\n",
        "0123456789ab alice read " HASH "\n",
        "0123456789ab alice read " HASH " 1 2 3\n",
        "0123456789ab alice read " HASH " 1 high\n",
        "0123456789ab alice read " HASH " 1 2.5\n",
        "0123456789ab alice read " HASH " 1 1001\n",
        "0123456789ab alice read " HASH " 1 -1001\n",
        "0123456789ac alice read " HASH " 1\n",
        "0123456789ab alice write " HASH " 1\n",
        "0123456789ab al:ice read " HASH " 1\n",
        "0123456789ab alice read " HASH "00 1\n",
    };
    error e = {0};
    token_set set = {0};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char text[300] = "# a comment\n\n";
        strcat(text, bad[i]);
        assert_true(store_file_write(path, text, strlen(text), &e));
        assert_int_equal(chmod(path, 0600), 0);
        expect_refusal(":3:");
    }
    static const char good[] = "0123456789ab alice read " HASH " 1\n";
    assert_true(store_file_write(path, good, strlen(good), &e));
    static const mode_t open_to_others[] = {0644, 0604, 0660, 0602, 0610};
    for (size_t i = 0; i < sizeof open_to_others / sizeof *open_to_others; i++) {
        assert_int_equal(chmod(path, open_to_others[i]), 0);
        expect_refusal(geteuid() == 0 ? "chmod 640" : "chmod 600");
    }
    assert_int_equal(chmod(path, 0640), 0);
    if (geteuid() != 0) expect_refusal("chmod 600"); /* root may let its group read a file */
    assert_int_equal(chmod(path, 0600), 0);
    assert_true(token_set_read(path, &set, &e));
    assert_int_equal(set.count, 1);
    assert_int_equal(set.item[0].max_priority, TOKEN_ANY_PRIORITY); /* as written by older versions */
    token_set_clear(&set);
    char secret[TOKEN_SIZE];
    assert_null(token_set_add(&set, "", SCOPE_READ, TOKEN_ANY_PRIORITY, secret, &e));
    assert_null(token_set_add(&set, "a b", SCOPE_READ, TOKEN_ANY_PRIORITY, secret, &e));
    assert_null(token_set_add(&set, ".", SCOPE_READ, TOKEN_ANY_PRIORITY, secret, &e));
    assert_null(token_set_add(&set, "..", SCOPE_READ, TOKEN_ANY_PRIORITY, secret, &e));
    assert_non_null(strstr(e.message, "must not be \"..\""));
    /* reserved for users without names */
    assert_null(token_set_add(&set, "uid:7", SCOPE_READ, TOKEN_ANY_PRIORITY, secret, &e));
}

/* Whether the user and group `id`, which is also in the group `other`, can read the file. */
static bool can_read_as(uid_t id, gid_t other)
{
    int status = 0;
    pid_t child = fork();
    if (child == 0) {
        token_set set = {0};
        bool ok = setgroups(1, &other) == 0 && setgid(id) == 0 && setuid(id) == 0 &&
                  token_set_read(path, &set, &(error){0}) && set.count == 1;
        token_set_clear(&set);
        _exit(ok ? 0 : 1);
    }
    assert_true(child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status));
    return WEXITSTATUS(status) == 0;
}

static void expect_owner(gid_t group, mode_t mode)
{
    struct stat info;
    assert_int_equal(stat(path, &info), 0);
    assert_int_equal(info.st_uid, 0);
    assert_int_equal(info.st_gid, group);
    assert_int_equal(info.st_mode & 07777, mode);
}

/* A file that root writes can be read by the group of the service, and by no other group. */
static void test_a_file_of_root_is_readable_for_the_group_of_the_service(void **state)
{
    (void)state;
    if (geteuid() != 0) return; /* not skip(), which counts as a failure in cmocka's TAP */
    error e = {0};
    token_set set = {0};
    char secret[TOKEN_SIZE], directory[] = "/tmp/hexad-token-XXXXXX", in_directory[sizeof directory + 8];
    struct stat info;
    assert_non_null(token_set_add(&set, "alice", SCOPE_READ, TOKEN_ANY_PRIORITY, secret, &e));
    assert_int_equal(unlink(path), 0);
    assert_true(token_set_write(path, &set, 60001, &e));
    expect_owner(60001, 0640);
    assert_true(can_read_as(60001, 60002));
    /* it can be opened, but is refused: the group has other members */
    assert_false(can_read_as(60002, 60001));
    assert_false(can_read_as(60003, 60003));
    /* a group that an administrator has set is kept */
    assert_int_equal(chown(path, 0, 60002), 0);
    assert_true(token_set_write(path, &set, 60001, &e));
    expect_owner(60002, 0640);
    assert_true(token_set_write(path, &set, TOKEN_NO_GROUP, &e));
    expect_owner(60002, 0640);
    /* a new file in the directory of a service gets its group */
    assert_non_null(mkdtemp(directory));
    assert_int_equal(chown(directory, 60003, 60003), 0);
    sprintf(in_directory, "%s/tokens", directory);
    assert_true(token_set_write(in_directory, &set, TOKEN_NO_GROUP, &e));
    assert_int_equal(stat(in_directory, &info), 0);
    assert_true(info.st_uid == 0 && info.st_gid == 60003 && (info.st_mode & 07777) == 0640);
    token_set_clear(&set);
    assert_int_equal(unlink(in_directory), 0);
    assert_int_equal(rmdir(directory), 0);
}

/* The kernel reports the user of the peer, which is this process. */
static void test_peers_and_tokens(void **state)
{
    (void)state;
    int pair[2];
    error e = {0};
    token_set set = {0};
    char secret[TOKEN_SIZE], header[TOKEN_SIZE + 16];
    access_settings settings = {.token_file = path};
    assert_int_equal(unlink(path), 0);
    access_control *a = access_open(&settings, &e);
    if (!a) fail_msg("%s", e.message);
    assert_false(access_has_tokens(a));
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, pair), 0);
    access_peer peer, stranger = {.uid = (uid_t)-1};
    access_caller caller;
    access_look(a, pair[0], &peer);
    assert_true(peer.local && peer.uid == geteuid());
    assert_true(access_identify(a, &peer, NULL, NULL, &caller));
    assert_int_equal(caller.scopes, SCOPE_ALL);
    assert_int_equal(caller.max_priority, TOKEN_ANY_PRIORITY);
    assert_false(access_identify(a, &stranger, NULL, NULL, &caller));
    /* a token that is added while the service runs is known, and takes precedence */
    assert_non_null(token_set_add(&set, "alice", SCOPE_READ, 0, secret, &e));
    assert_true(token_set_write(path, &set, TOKEN_NO_GROUP, &e));
    strcat(strcpy(header, "Bearer "), secret);
    assert_true(access_identify(a, &peer, header, NULL, &caller));
    assert_string_equal(caller.user, "alice");
    assert_int_equal(caller.scopes, SCOPE_READ);
    assert_int_equal(caller.max_priority, 0);
    assert_true(access_identify(a, &stranger, header, NULL, &caller));
    assert_true(access_is_owner(&caller, "alice"));
    assert_false(access_is_owner(&caller, "bob"));
    header[10]++;
    assert_false(access_identify(a, &peer, header, NULL, &caller));
    assert_false(access_identify(a, &peer, "Basic YTpi", NULL, &caller));
    assert_false(access_identify(a, &peer, "", NULL, &caller));
    /* a file that other users can access is ignored */
    header[10]--;
    assert_int_equal(chmod(path, 0644), 0);
    assert_false(access_identify(a, &stranger, header, NULL, &caller));
    access_close(a);
    token_set_clear(&set);
    close(pair[0]);
    close(pair[1]);
}

/* The file changes while no descriptor is available: the known tokens are kept, and the file is read
 * later. */
static void test_tokens_stay_while_their_file_cannot_be_read(void **state)
{
    (void)state;
    error e = {0};
    token_set set = {0};
    char first[TOKEN_SIZE], second[TOKEN_SIZE], header[2][TOKEN_SIZE + 16];
    access_peer stranger = {.uid = (uid_t)-1};
    access_caller caller;
    assert_non_null(token_set_add(&set, "alice", SCOPE_READ, 0, first, &e));
    assert_true(token_set_write(path, &set, TOKEN_NO_GROUP, &e));
    access_control *a = access_open(&(access_settings){.token_file = path}, &e);
    assert_non_null(a);
    assert_non_null(token_set_add(&set, "bob", SCOPE_READ, 0, second, &e));
    assert_true(token_set_write(path, &set, TOKEN_NO_GROUP, &e));
    strcat(strcpy(header[0], "Bearer "), first);
    strcat(strcpy(header[1], "Bearer "), second);
    struct rlimit limit, none;
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    int next = dup(0);
    close(next);
    none = (struct rlimit){(rlim_t)next, limit.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
    bool known = access_identify(a, &stranger, header[0], NULL, &caller),
         early = access_identify(a, &stranger, header[1], NULL, &caller);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
    assert_true(known && !early);
    assert_true(access_identify(a, &stranger, header[0], NULL, &caller));
    assert_true(access_identify(a, &stranger, header[1], NULL, &caller));
    access_close(a);
    token_set_clear(&set);
}

static void test_sessions(void **state)
{
    (void)state;
    error e = {0};
    token_set set = {0};
    session_key key, same, other;
    char secret[TOKEN_SIZE], text[SESSION_SIZE], more[SESSION_SIZE];
    char *file = mem_printf("%s-key", path);
    assert_true(session_key_open(file, &key, &e));
    assert_true(session_key_open(file, &same, &e));
    assert_memory_equal(key.bytes, same.bytes, sizeof key.bytes);
    assert_string_equal(key.cookie, same.cookie);
    assert_non_null(token_set_add(&set, "alice", SCOPE_READ, 0, secret, &e));
    assert_non_null(token_set_add(&set, "bob", SCOPE_ALL, 0, secret, &e));
    int64_t ends_ms = 0;
    session_begin(&key, &set.item[1], 5000, text);
    assert_ptr_equal(session_find(&same, &set, text, &ends_ms), &set.item[1]);
    assert_int_equal(ends_ms, 5000);
    /* each byte is significant */
    for (size_t i = 0; text[i]; i++) {
        strcpy(more, text);
        more[i] ^= 1;
        assert_null(session_find(&key, &set, more, &ends_ms));
        more[i] = '\0';
        assert_null(session_find(&key, &set, more, &ends_ms));
    }
    /* the hash of the token is not sufficient */
    assert_int_equal(unlink(file), 0);
    assert_true(session_key_open(file, &other, &e));
    assert_string_not_equal(other.cookie, key.cookie);
    assert_null(session_find(&other, &set, text, &ends_ms));
    assert_true(token_set_remove(&set, set.item[1].id));
    assert_null(session_find(&key, &set, text, &ends_ms));
    assert_int_equal(truncate(file, 31), 0);
    assert_false(session_key_open(file, &key, &e));
    assert_int_equal(truncate(file, 33), 0);
    assert_false(session_key_open(file, &key, &e));
    assert_int_equal(unlink(file), 0);
    free(file);
    /* in a missing directory */
    file = mem_printf("%s-none/key", path);
    assert_false(session_key_open(file, &key, &e));
    assert_non_null(strstr(e.message, file));
    free(file);
    token_set_clear(&set);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_sessions, set_up, tear_down),
        cmocka_unit_test(test_scopes),
        cmocka_unit_test_setup_teardown(test_a_token_is_found_by_its_secret_alone, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_invalid_files_are_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_users_that_are_named_like_directories_keep_their_tokens, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_a_file_of_root_is_readable_for_the_group_of_the_service, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_peers_and_tokens, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_tokens_stay_while_their_file_cannot_be_read, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("token", tests, NULL, NULL);
}

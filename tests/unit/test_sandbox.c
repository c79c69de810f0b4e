// SPDX-License-Identifier: Apache-2.0
/* The permissions of a process in the sandbox. Each probe is a separate process that enters the sandbox and
 * tries an operation.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <linux/sched.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/sandbox.h"
#include "files/file.h"

#if defined __SANITIZE_ADDRESS__ || defined __SANITIZE_THREAD__
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

/* The argument with which this program starts itself; it then exits with STARTED_AGAIN. */
#define AGAIN "again"
enum { STARTED_AGAIN = 42, NOT_ENTERED = 126 };

typedef struct place {
    char base[64];
    /* input/file and the single file are readable places; outside is beside them */
    char *input, *file, *output, *outside, *single;
    pid_t parent;
} place;

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-sandbox-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    p->input = mem_printf("%s/input", p->base);
    p->file = mem_printf("%s/input/file", p->base);
    p->output = mem_printf("%s/output", p->base);
    p->outside = mem_printf("%s/outside", p->base);
    p->single = mem_printf("%s/single", p->base);
    p->parent = getpid();
    assert_int_equal(mkdir(p->input, 0700), 0);
    assert_int_equal(mkdir(p->output, 0700), 0);
    assert_true(store_file_write(p->file, "x", 1, NULL) && store_file_write(p->outside, "x", 1, NULL) &&
                store_file_write(p->single, "x", 1, NULL));
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    assert_true(store_remove(p->base, NULL));
    free(p->input);
    free(p->file);
    free(p->output);
    free(p->outside);
    free(p->single);
    free(p);
    return 0;
}

/* Runs the probe in a process in the sandbox. Returns the errno of the probe; 0: it succeeded. */
static int run_inside(const place *p, int (*probe)(const place *))
{
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        const char *readable[] = {p->input, p->single};
        const sandbox_places places = {readable, 2, p->output};
        error e = {0};
        if (!sandbox_enter(SANDBOX_AVAILABLE, &places, &e)) {
            dprintf(STDERR_FILENO, "%s\n", e.message);
            _exit(NOT_ENTERED);
        }
        _exit(probe(p));
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_not_equal(WEXITSTATUS(status), NOT_ENTERED);
    return WEXITSTATUS(status);
}

static int answer(bool could)
{
    return could ? 0 : errno;
}

/* ---- the filter */

static int make_inet_socket(const place *p)
{
    (void)p;
    return answer(socket(AF_INET, SOCK_STREAM, 0) >= 0);
}

static int make_unix_socket(const place *p)
{
    (void)p;
    return answer(socket(AF_UNIX, SOCK_STREAM, 0) >= 0);
}

static int make_netlink_socket(const place *p)
{
    (void)p;
    return answer(socket(AF_NETLINK, SOCK_RAW, 0) >= 0);
}

/* Such sockets could send to any named socket. */
static int make_datagram_pair(const place *p)
{
    int ends[2];
    (void)p;
    return answer(socketpair(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0, ends) == 0);
}

static int connect_descriptor(const place *p)
{
    struct sockaddr address = {.sa_family = AF_UNSPEC};
    (void)p;
    return answer(connect(STDIN_FILENO, &address, sizeof address) == 0);
}

static int trace_parent(const place *p)
{
    return answer(ptrace(PTRACE_SEIZE, p->parent, NULL, NULL) == 0);
}

static int read_parent(const place *p)
{
    char byte;
    struct iovec to = {&byte, 1}, from = {&byte, 1};
    return answer(syscall(SYS_process_vm_readv, p->parent, &to, 1, &from, 1, 0) == 1);
}

static int leave_name_space(const place *p)
{
    (void)p;
    return answer(unshare(CLONE_NEWUSER) == 0);
}

/* Creates a separate process without shared memory. */
static int copy_itself(const place *p)
{
    (void)p;
    long pid = syscall(SYS_clone, SIGCHLD, NULL, NULL, NULL, 0);
    if (pid == 0) _exit(0);
    return answer(pid > 0);
}

static int make_name_space(const place *p)
{
    (void)p;
    long pid = syscall(SYS_clone, CLONE_VM | CLONE_VFORK | CLONE_NEWUSER | SIGCHLD, NULL, NULL, NULL, 0);
    if (pid == 0) _exit(0);
    return answer(pid > 0);
}

static int clone_by_pointer(const place *p)
{
    struct clone_args arguments = {.flags = CLONE_NEWUSER, .exit_signal = SIGCHLD};
    (void)p;
    long pid = syscall(SYS_clone3, &arguments, sizeof arguments);
    if (pid == 0) _exit(0);
    return answer(pid > 0);
}

static int mount_something(const place *p)
{
    return answer(mount("none", p->output, "tmpfs", 0, NULL) == 0);
}

static int make_ring(const place *p)
{
    char parameters[256] = {0};
    (void)p;
    return answer(syscall(SYS_io_uring_setup, 1, parameters) >= 0);
}

static int limit_parent(const place *p)
{
    const struct rlimit none = {0, 0};
    return answer(prlimit(p->parent, RLIMIT_CORE, &none, NULL) == 0);
}

static int make_dumpable(const place *p)
{
    (void)p;
    return answer(prctl(PR_SET_DUMPABLE, 1, 0, 0, 0) == 0);
}

static void *try_socket(void *out)
{
    *(int *)out = make_inet_socket(NULL);
    return NULL;
}

/* A thread that is created in the sandbox is in the sandbox. */
static int make_socket_in_thread(const place *p)
{
    pthread_t thread;
    int got = 0;
    (void)p;
    if (pthread_create(&thread, NULL, try_socket, &got) != 0) return 0;
    pthread_join(thread, NULL);
    return got;
}

static const struct call {
    const char *name;
    int (*probe)(const place *);
    bool sanitizers_need_it;
} calls[] = {
    {"socket(AF_INET)", make_inet_socket, false},
    {"socket(AF_UNIX)", make_unix_socket, false},
    {"socket(AF_NETLINK)", make_netlink_socket, false},
    {"socketpair(SOCK_DGRAM)", make_datagram_pair, false},
    {"connect", connect_descriptor, false},
    {"ptrace", trace_parent, false},
    {"process_vm_readv", read_parent, false},
    {"unshare", leave_name_space, false},
    {"fork", copy_itself, false},
    {"clone(CLONE_NEWUSER)", make_name_space, false},
    {"clone3", clone_by_pointer, false},
    {"mount", mount_something, false},
    {"io_uring_setup", make_ring, false},
    {"prlimit of another process", limit_parent, false},
    {"prctl(PR_SET_DUMPABLE)", make_dumpable, true},
    {"socket in a thread", make_socket_in_thread, false},
};

static void test_other_system_calls_return_enosys(void **state)
{
    for (size_t i = 0; i < sizeof calls / sizeof *calls; i++) {
        if (SANITIZED && calls[i].sanitizers_need_it) {
            print_message("# skipped in a sanitized build: %s\n", calls[i].name);
            continue;
        }
        int got = run_inside(*state, calls[i].probe);
        if (got != ENOSYS) fail_msg("%s: %s", calls[i].name, strerror(got));
    }
}

/* The number after a name in /proc/PID/status. */
static int status_of(pid_t pid, const char *name)
{
    char path[64], line[256];
    int value = -1;
    snprintf(path, sizeof path, "/proc/%d/status", (int)pid);
    FILE *file = fopen(path, "r");
    while (file && fgets(line, sizeof line, file))
        if (strncmp(line, name, strlen(name)) == 0) value = atoi(line + strlen(name));
    if (file) fclose(file);
    return value;
}

/* Checked from outside, because /proc is not readable inside. */
static void test_no_new_privileges(void **state)
{
    const place *p = *state;
    int entered[2], gate[2];
    char byte;
    assert_int_equal(pipe(entered), 0);
    assert_int_equal(pipe(gate), 0);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        const sandbox_places places = {NULL, 0, p->output};
        close(gate[1]);
        bool ok = sandbox_enter(SANDBOX_AVAILABLE, &places, NULL) && write(entered[1], "", 1) == 1;
        _exit(ok && read(gate[0], &byte, 1) == 0 ? 0 : NOT_ENTERED);
    }
    close(entered[1]);
    close(gate[0]);
    assert_int_equal(read(entered[0], &byte, 1), 1);
    assert_int_equal(status_of(child, "NoNewPrivs:"), 1);
    assert_int_equal(status_of(child, "Seccomp:"), 2 /* a filter */);
    close(gate[1]);
    close(entered[0]);
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
}

/* ---- Landlock */

static int read_at(const char *path)
{
    return answer(open(path, O_RDONLY) >= 0);
}

static int make_at(const char *path)
{
    return answer(open(path, O_WRONLY | O_CREAT, 0600) >= 0);
}

static int read_input(const place *p)
{
    return read_at(p->file);
}

static int read_single(const place *p)
{
    return read_at(p->single);
}

static int read_outside(const place *p)
{
    return read_at(p->outside);
}

static int read_passwords(const place *p)
{
    (void)p;
    return read_at("/etc/passwd");
}

static int list_input(const place *p)
{
    return answer(open(p->input, O_RDONLY | O_DIRECTORY) >= 0);
}

static int write_input(const place *p)
{
    return answer(open(p->file, O_WRONLY) >= 0);
}

static int truncate_input(const place *p)
{
    return answer(open(p->file, O_RDONLY | O_TRUNC) >= 0);
}

static int remove_input(const place *p)
{
    return answer(unlink(p->file) == 0);
}

static int make_input(const place *p)
{
    char *path = mem_printf("%s/new", p->input);
    return make_at(path);
}

static int make_outside(const place *p)
{
    char *path = mem_printf("%s/new", p->base);
    return make_at(path);
}

static int move_outside(const place *p)
{
    char *from = mem_printf("%s/new", p->output), *to = mem_printf("%s/new", p->base);
    return answer(make_at(from) == 0 && rename(from, to) == 0);
}

static int link_outside(const place *p)
{
    char *to = mem_printf("%s/link", p->output);
    return answer(symlink(p->outside, to) == 0);
}

/* Writes a file like a result: creates it, reads it back, renames it, and flushes its directory. */
static int write_output(const place *p)
{
    char *path = mem_printf("%s/result", p->output);
    return answer(store_file_write(path, "x", 1, NULL) && unlink(path) == 0);
}

static int spawn(const char *program)
{
    static char name[] = "program", again[] = AGAIN, *arguments[] = {name, again, NULL},
                *environment[] = {NULL};
    pid_t pid;
    int status, why = posix_spawn(&pid, program, NULL, NULL, arguments, environment);
    if (why) return why;
    if (waitpid(pid, &status, 0) != pid) return errno;
    return WIFEXITED(status) && WEXITSTATUS(status) == STARTED_AGAIN ? 0 : ECHILD;
}

static int begin_flush(const place *p)
{
    char *path = mem_printf("%s/flushed", p->output);
    int fd = open(path, O_WRONLY | O_CREAT, 0600);
    free(path);
    return answer(fd >= 0 && sync_file_range(fd, 0, 0, SYNC_FILE_RANGE_WRITE) == 0);
}

static int start_itself(const place *p)
{
    (void)p;
    return spawn("/proc/self/exe");
}

static int start_shell(const place *p)
{
    (void)p;
    return spawn("/bin/sh");
}

static int start_own_file(const place *p)
{
    char *path = mem_printf("%s/script", p->output);
    int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0700);
    if (fd < 0 || write(fd, "#!/bin/sh\nexit 42\n", 18) != 18) return errno;
    close(fd);
    return spawn(path);
}

static int signal_parent(const place *p)
{
    return answer(kill(p->parent, SIGURG) == 0); /* a signal that the parent would ignore */
}

static const struct place_probe {
    const char *name;
    int (*probe)(const place *);
    int expected;
    int since; /* version of Landlock that supports it */
} place_probes[] = {
    {"read an input", read_input, 0, 1},
    {"read a single file", read_single, 0, 1},
    {"write a result", write_output, 0, 1},
    {"begin to flush it", begin_flush, 0, 1},
    {"start the program itself", start_itself, 0, 1},
    {"read outside", read_outside, EACCES, 1},
    {"read /etc/passwd", read_passwords, EACCES, 1},
    {"list an input root", list_input, EACCES, 1},
    {"write an input", write_input, EACCES, 1},
    {"truncate an input", truncate_input, EACCES, 3},
    {"remove an input", remove_input, EACCES, 1},
    {"make a file among inputs", make_input, EACCES, 1},
    {"make a file outside", make_outside, EACCES, 1},
    {"move a file outside", move_outside, EACCES, 1},
    {"make a symbolic link", link_outside, ENOSYS, 1},
    {"start a shell", start_shell, EACCES, 1},
    {"start a file of its own", start_own_file, EACCES, 1},
    {"signal another process", signal_parent, EPERM, 6},
};

static int landlock_version(void)
{
    char text[SANDBOX_TEXT_SIZE];
    const char *at = strstr(sandbox_describe(SANDBOX_REQUIRED, text), "Landlock version ");
    return at ? atoi(at + strlen("Landlock version ")) : 0;
}

static void test_only_the_given_places_are_accessible(void **state)
{
    int version = landlock_version();
    assert_int_equal(sandbox_check(SANDBOX_REQUIRED, NULL), version > 0);
    for (size_t i = 0; i < sizeof place_probes / sizeof *place_probes; i++) {
        if (version < place_probes[i].since) {
            print_message("# skipped with Landlock version %d: %s\n", version, place_probes[i].name);
            continue;
        }
        int got = run_inside(*state, place_probes[i].probe);
        if (got != place_probes[i].expected) fail_msg("%s: %s", place_probes[i].name, strerror(got));
    }
}

static void test_modes_have_names(void **state)
{
    (void)state;
    sandbox_mode mode = SANDBOX_OFF;
    for (int i = SANDBOX_OFF; i <= SANDBOX_REQUIRED; i++) {
        assert_true(sandbox_mode_from_name(sandbox_mode_name((sandbox_mode)i), &mode));
        assert_int_equal(mode, i);
    }
    assert_false(sandbox_mode_from_name("none", &mode));
    assert_int_equal(mode, SANDBOX_REQUIRED);
}

int main(int argc, char **argv)
{
    if (argc == 2 && strcmp(argv[1], AGAIN) == 0) _exit(STARTED_AGAIN);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_modes_have_names),
        cmocka_unit_test_setup_teardown(test_other_system_calls_return_enosys, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_no_new_privileges, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_only_the_given_places_are_accessible, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

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
#include <linux/filter.h>
#include <linux/sched.h>
#include <linux/seccomp.h>
#include <mqueue.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/pidfd.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <time.h>
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
    pid_t victim; /* another process of this user; 0: there is none */
    int handle;   /* its descriptor, such as a process may have inherited */
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

/* Makes the kernel appear to lack Landlock, so that a process enters the filter alone. */
static bool hide_landlock(void)
{
    struct sock_filter code[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_landlock_create_ruleset, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    const struct sock_fprog program = {sizeof code / sizeof *code, code};
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
           prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

/* Runs the probe in a process in the sandbox, or in its filter alone. Returns the errno of the probe; 0: it
 * succeeded. */
static int run_in(const place *p, int (*probe)(const place *), bool filter_alone)
{
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        const char *readable[] = {p->input, p->single};
        const sandbox_places places = {readable, 2, p->output};
        error e = {0};
        if (filter_alone && !hide_landlock()) _exit(NOT_ENTERED);
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

static int run_inside(const place *p, int (*probe)(const place *))
{
    return run_in(p, probe, false);
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

/* ---- calls that act on other processes, with the filter alone */

static int send_kill(const place *p)
{
    return answer(kill(p->victim, SIGKILL) == 0);
}

static int send_to_group(const place *p)
{
    return answer(kill(-p->victim, SIGKILL) == 0);
}

static int send_tgkill(const place *p)
{
    return answer(tgkill(p->victim, p->victim, SIGKILL) == 0);
}

static int send_tkill(const place *p)
{
    return answer(syscall(SYS_tkill, p->victim, SIGKILL) == 0);
}

static int queue_signal(const place *p)
{
    siginfo_t info = {.si_signo = SIGKILL, .si_code = SI_QUEUE};
    return answer(syscall(SYS_rt_sigqueueinfo, p->victim, SIGKILL, &info) == 0);
}

static int queue_signal_to_thread(const place *p)
{
    siginfo_t info = {.si_signo = SIGKILL, .si_code = SI_QUEUE};
    return answer(syscall(SYS_rt_tgsigqueueinfo, p->victim, p->victim, SIGKILL, &info) == 0);
}

static int send_by_handle(const place *p)
{
    return answer(pidfd_send_signal(p->handle, SIGKILL, NULL, 0) == 0);
}

static int open_handle(const place *p)
{
    return answer(pidfd_open(p->victim, 0) >= 0);
}

static int take_descriptor(const place *p)
{
    return answer(pidfd_getfd(p->handle, STDIN_FILENO, 0) >= 0);
}

/* Makes the kernel send SIGKILL to the owner of a socket to which data comes. */
static int signal_owner(const place *p, int (*own)(int fd, pid_t owner), int (*announce)(int fd))
{
    int ends[2];
    (void)p;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) return errno;
    return answer(own(ends[0], p->victim) == 0 && announce(ends[0]) == 0 && write(ends[1], "x", 1) == 1);
}

static int own_by_fcntl(int fd, pid_t owner)
{
    return fcntl(fd, F_SETOWN, owner) == 0 ? fcntl(fd, F_SETSIG, SIGKILL) : -1;
}

static int own_by_fcntl_ex(int fd, pid_t owner)
{
    const struct f_owner_ex ex = {F_OWNER_PID, owner};
    return fcntl(fd, F_SETOWN_EX, &ex) == 0 ? fcntl(fd, F_SETSIG, SIGKILL) : -1;
}

static int own_by_ioctl(int fd, pid_t owner)
{
    return ioctl(fd, FIOSETOWN, &owner);
}

static int own_socket(int fd, pid_t owner)
{
    return ioctl(fd, SIOCSPGRP, &owner);
}

static int announce_by_fcntl(int fd)
{
    return fcntl(fd, F_SETFL, O_ASYNC);
}

static int announce_by_ioctl(int fd)
{
    int on = 1;
    return ioctl(fd, FIOASYNC, &on);
}

static int signal_by_fcntl(const place *p)
{
    return signal_owner(p, own_by_fcntl, announce_by_fcntl);
}

static int signal_by_fcntl_ex(const place *p)
{
    return signal_owner(p, own_by_fcntl_ex, announce_by_fcntl);
}

static int signal_by_ioctl(const place *p)
{
    return signal_owner(p, own_by_ioctl, announce_by_ioctl);
}

static int signal_by_socket(const place *p)
{
    return signal_owner(p, own_socket, announce_by_ioctl);
}

static int announce_alone(const place *p)
{
    (void)p;
    return answer(fcntl(STDIN_FILENO, F_SETFL, O_ASYNC) == 0);
}

/* A lease delays each process that opens the file. */
static int lease_file(const place *p)
{
    int fd = open(p->file, O_RDONLY);
    return fd < 0 ? 0 : answer(fcntl(fd, F_SETLEASE, F_RDLCK) == 0);
}

/* A lock delays each process that locks the file. */
static int lock_file(const place *p)
{
    struct flock lock = {.l_type = F_RDLCK};
    int fd = open(p->file, O_RDONLY);
    return fd < 0 ? 0 : answer(fcntl(fd, F_SETLK, &lock) == 0);
}

static int flock_file(const place *p)
{
    int fd = open(p->file, O_RDONLY);
    return fd < 0 ? 0 : answer(syscall(SYS_flock, fd, 1 /* shared */) == 0);
}

static int set_timer_of_thread(const place *p)
{
    struct sigevent event = {.sigev_notify = SIGEV_THREAD_ID, .sigev_signo = SIGKILL};
    timer_t timer;
    event._sigev_un._tid = p->victim;
    return answer(timer_create(CLOCK_MONOTONIC, &event, &timer) == 0);
}

static int notify_by_queue(const place *p)
{
    const struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGKILL};
    (void)p;
    return answer(mq_notify(STDIN_FILENO, &event) == 0);
}

static int write_memory(const place *p)
{
    char byte = 0;
    struct iovec to = {&byte, 1}, from = {&byte, 1};
    return answer(syscall(SYS_process_vm_writev, p->victim, &to, 1, &from, 1, 0) == 1);
}

static int advise_memory(const place *p)
{
    struct iovec all = {NULL, 4096};
    return answer(syscall(SYS_process_madvise, p->handle, &all, 1, MADV_COLD, 0) >= 0);
}

static int move_memory(const place *p)
{
    return answer(syscall(SYS_move_pages, p->victim, 0, NULL, NULL, NULL, 0) == 0);
}

static int migrate_memory(const place *p)
{
    unsigned long node = 1;
    return answer(syscall(SYS_migrate_pages, p->victim, sizeof node * 8, &node, &node) == 0);
}

static int release_memory(const place *p)
{
    return answer(syscall(SYS_process_mrelease, p->handle, 0) == 0);
}

static int compare_processes(const place *p)
{
    return answer(syscall(SYS_kcmp, p->victim, p->victim, 0, 0, 0) >= 0);
}

static int trace_victim(const place *p)
{
    return answer(ptrace(PTRACE_SEIZE, p->victim, NULL, NULL) == 0);
}

static int limit_victim(const place *p)
{
    const struct rlimit limit = {0, 0};
    return answer(prlimit(p->victim, RLIMIT_CPU, &limit, NULL) == 0);
}

static int slow_victim(const place *p)
{
    return answer(setpriority(PRIO_PROCESS, (id_t)p->victim, 19) == 0);
}

static int slow_input_of_victim(const place *p)
{
    return answer(syscall(SYS_ioprio_set, 1, p->victim, 3 << 13) == 0);
}

static int bind_victim(const place *p)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(0, &set);
    return answer(sched_setaffinity(p->victim, sizeof set, &set) == 0);
}

static int schedule_victim(const place *p)
{
    const struct sched_param none = {0};
    return answer(sched_setscheduler(p->victim, SCHED_IDLE, &none) == 0);
}

static int set_parameters_of_victim(const place *p)
{
    const struct sched_param none = {0};
    return answer(sched_setparam(p->victim, &none) == 0);
}

static int set_attributes_of_victim(const place *p)
{
    uint32_t attributes[12] = {sizeof attributes, SCHED_IDLE};
    return answer(syscall(SYS_sched_setattr, p->victim, attributes, 0) == 0);
}

/* The signals that the group of the victim gets would then reach this process, and those of its end the group. */
static int join_group_of_victim(const place *p)
{
    return answer(setpgid(0, p->victim) == 0);
}

static int begin_session(const place *p)
{
    (void)p;
    return answer(setsid() >= 0);
}

static int take_terminal(const place *p)
{
    return answer(ioctl(STDIN_FILENO, TIOCSPGRP, &p->victim) == 0);
}

static int end_at_once(void *unused)
{
    (void)unused;
    _exit(0);
}

/* The new process is a child of this one's parent. */
static int give_parent_a_child(const place *p)
{
    static char stack[65536];
    (void)p;
    return answer(
        clone(end_at_once, stack + sizeof stack, CLONE_VM | CLONE_VFORK | CLONE_PARENT | SIGCHLD, NULL) > 0);
}

static int enter_spaces_of_victim(const place *p)
{
    return answer(setns(p->handle, CLONE_NEWUTS) == 0);
}

static int count_events_of_victim(const place *p)
{
    char attributes[128] = {0};
    return answer(syscall(SYS_perf_event_open, attributes, p->victim, -1, -1, 0) >= 0);
}

static const struct call acts[] = {
    {"kill", send_kill, true},
    {"kill of a group", send_to_group, true},
    {"tgkill", send_tgkill, true},
    {"tkill", send_tkill, true},
    {"rt_sigqueueinfo", queue_signal, false},
    {"rt_tgsigqueueinfo", queue_signal_to_thread, false},
    {"pidfd_send_signal", send_by_handle, false},
    {"pidfd_open", open_handle, false},
    {"pidfd_getfd", take_descriptor, false},
    {"fcntl(F_SETOWN)", signal_by_fcntl, false},
    {"fcntl(F_SETOWN_EX)", signal_by_fcntl_ex, false},
    {"fcntl(F_SETFL, O_ASYNC)", announce_alone, false},
    {"fcntl(F_SETLEASE)", lease_file, false},
    {"fcntl(F_SETLK)", lock_file, false},
    {"flock", flock_file, false},
    {"ioctl(FIOSETOWN)", signal_by_ioctl, false},
    {"ioctl(SIOCSPGRP)", signal_by_socket, false},
    {"ioctl(TIOCSPGRP)", take_terminal, false},
    {"timer_create", set_timer_of_thread, false},
    {"mq_notify", notify_by_queue, false},
    {"process_vm_writev", write_memory, false},
    {"process_madvise", advise_memory, false},
    {"process_mrelease", release_memory, false},
    {"move_pages", move_memory, false},
    {"migrate_pages", migrate_memory, false},
    {"kcmp", compare_processes, false},
    {"ptrace", trace_victim, false},
    {"prlimit", limit_victim, false},
    {"setpriority", slow_victim, false},
    {"ioprio_set", slow_input_of_victim, false},
    {"sched_setaffinity", bind_victim, false},
    {"sched_setscheduler", schedule_victim, false},
    {"sched_setparam", set_parameters_of_victim, false},
    {"sched_setattr", set_attributes_of_victim, false},
    {"setpgid", join_group_of_victim, false},
    {"setsid", begin_session, false},
    {"clone(CLONE_PARENT)", give_parent_a_child, false},
    {"setns", enter_spaces_of_victim, false},
    {"perf_event_open", count_events_of_victim, false},
    {"io_uring_setup", make_ring, false},
};

/* Starts another process of this user, which waits for signals. */
static void start_victim(place *p)
{
    p->victim = fork();
    assert_true(p->victim >= 0);
    if (p->victim == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        for (;;) pause();
    }
    assert_int_equal(setpgid(p->victim, p->victim), 0);
    p->handle = pidfd_open(p->victim, 0);
    assert_true(p->handle >= 0);
}

/* Whether the process still ran. */
static bool end_victim(place *p)
{
    const bool ran = waitpid(p->victim, NULL, WNOHANG) == 0;
    if (ran) {
        kill(p->victim, SIGKILL);
        assert_int_equal(waitpid(p->victim, NULL, 0), p->victim);
    }
    close(p->handle);
    return ran;
}

static void test_no_call_acts_on_another_process(void **state)
{
    int failed = 0;
    for (size_t i = 0; i < sizeof acts / sizeof *acts; i++) {
        if (SANITIZED && acts[i].sanitizers_need_it) {
            print_message("# skipped in a sanitized build: %s\n", acts[i].name);
            continue;
        }
        start_victim(*state);
        const int got = run_in(*state, acts[i].probe, true);
        const bool ran = end_victim(*state);
        if (got == ENOSYS && ran) continue;
        print_error("%s: %s%s\n", acts[i].name, strerror(got), ran ? "" : ", and the other process ended");
        failed++;
    }
    assert_int_equal(failed, 0);
}

/* An abort sends itself a signal; where that fails, glibc executes an invalid instruction. */
static void test_an_abort_ends_the_process_by_a_fault(void **state)
{
    (void)state;
    int status = 0;
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        for (int number = 1; number < NSIG; number++) signal(number, SIG_DFL); /* those of the test */
        if (!sandbox_enter(SANDBOX_AVAILABLE, &(sandbox_places){0}, NULL)) _exit(NOT_ENTERED);
        abort();
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));
    const int ended_by = WTERMSIG(status);
    if (SANITIZED)
        assert_int_equal(ended_by, SIGABRT);
    else if (ended_by != SIGTRAP) /* of ARM */
        assert_int_equal(ended_by, SIGSEGV);
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
    {"signal another process", signal_parent, SANITIZED ? EPERM : ENOSYS, SANITIZED ? 6 : 1},
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
        cmocka_unit_test_setup_teardown(test_no_call_acts_on_another_process, set_up, tear_down),
        cmocka_unit_test(test_an_abort_ends_the_process_by_a_fault),
        cmocka_unit_test_setup_teardown(test_no_new_privileges, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_only_the_given_places_are_accessible, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

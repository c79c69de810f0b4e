// SPDX-License-Identifier: Apache-2.0
/* contain [--suite] COMMAND [ARGUMENT...]: runs a test, and ends every process that it leaves behind.
 *
 * `make check` runs each test program through `contain`; bootstrap runs the whole of `make check` through
 * `contain --suite`. The program becomes the parent of orphaned descendants (PR_SET_CHILD_SUBREAPER), so
 * daemons that detach themselves are found as well. Descendants are killed in these cases:
 * - the command has ended;
 * - this program gets SIGTERM, SIGINT or SIGHUP, or its parent dies;
 * - the enclosing `contain --suite` dies, by any signal.
 * In the last two cases the processes have GRACE_MS to clean up: a test gets SIGINT, make gets SIGTERM.
 *
 * Prints a TAP diagnostic `# time: 1.25 s wall, 2.00 s CPU` after the command's own output; the CPU time
 * includes all descendants. `tools/slowest.py` reads these lines. Exit status: that of the command; 128 + N
 * if signal N ended it; 126 if it could not be started. */
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <dirent.h>
#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { GRACE_MS = 5000 };

/* Environment variable: the read end of a pipe whose write end only `contain --suite` holds. It reports
 * POLLHUP when that process is gone. */
#define LIFELINE "HEXAD_CONTAIN_FD"

static double seconds_since(const struct timespec *start)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)(now.tv_sec - start->tv_sec) + 1e-9 * (double)(now.tv_nsec - start->tv_nsec);
}

/* The parent of a process, or 0 if it is gone. */
static pid_t parent_of(pid_t pid)
{
    char path[64], line[512];
    snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return 0;
    ssize_t length = read(fd, line, sizeof line - 1);
    close(fd);
    if (length <= 0) return 0;
    line[length] = 0;
    const char *end_of_name = strrchr(line, ')');
    char state;
    int parent;
    return end_of_name && sscanf(end_of_name + 1, " %c %d", &state, &parent) == 2 ? parent : 0;
}

static bool is_descendant(pid_t pid, pid_t ancestor)
{
    while (pid > 1) {
        pid = parent_of(pid);
        if (pid == ancestor) return true;
    }
    return false;
}

static void kill_descendants(void)
{
    DIR *processes = opendir("/proc");
    if (!processes) return;
    pid_t self = getpid();
    for (struct dirent *entry; (entry = readdir(processes));) {
        pid_t pid = (pid_t)atoi(entry->d_name);
        if (pid > 1 && pid != self && is_descendant(pid, self)) kill(pid, SIGKILL);
    }
    closedir(processes);
}

/* Waits for children that have ended. True if `child` was among them, whose status goes to *status. */
static bool reap(pid_t child, int *status)
{
    bool found = false;
    int ended;
    for (pid_t pid; (pid = waitpid(-1, &ended, WNOHANG)) > 0;)
        if (pid == child) {
            *status = ended;
            found = true;
        }
    return found;
}

static bool has_children(void)
{
    return waitpid(-1, NULL, WNOHANG) >= 0 || errno != ECHILD;
}

static void end_descendants(void)
{
    while (has_children()) {
        kill_descendants();
        nanosleep(&(struct timespec){.tv_nsec = 2000000}, NULL);
    }
}

/* The lifeline of the enclosing suite, closed in the command; -1: there is none. */
static int take_lifeline(void)
{
    const char *text = getenv(LIFELINE);
    int end = text ? atoi(text) : -1;
    unsetenv(LIFELINE);
    return end >= 0 && fcntl(end, F_SETFD, FD_CLOEXEC) == 0 ? end : -1;
}

/* Makes the lifeline of a suite. The write end stays open in this process alone. */
static void make_lifeline(void)
{
    int ends[2];
    if (pipe(ends) < 0) return;
    fcntl(ends[1], F_SETFD, FD_CLOEXEC);
    char number[16];
    snprintf(number, sizeof number, "%d", ends[0]);
    setenv(LIFELINE, number, 1);
}

int main(int argc, char **argv)
{
    bool suite = argc > 1 && strcmp(argv[1], "--suite") == 0;
    char **command = argv + 1 + suite;
    if (argc < 2 + suite) {
        fprintf(stderr, "usage: contain [--suite] COMMAND [ARGUMENT...]\n");
        return 2;
    }
    pid_t parent = getppid();
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    prctl(PR_SET_CHILD_SUBREAPER, 1);
    sigset_t watched, before;
    sigemptyset(&watched);
    sigaddset(&watched, SIGTERM);
    sigaddset(&watched, SIGINT);
    sigaddset(&watched, SIGHUP);
    sigaddset(&watched, SIGCHLD);
    sigprocmask(SIG_BLOCK, &watched, &before);
    int signals = signalfd(-1, &watched, SFD_CLOEXEC | SFD_NONBLOCK);
    int lifeline = take_lifeline();
    if (suite) make_lifeline();
    struct timespec start, stop_time;
    clock_gettime(CLOCK_MONOTONIC, &start);

    pid_t child = fork();
    if (child < 0) {
        perror("contain: fork");
        return 126;
    }
    if (child == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        signal(SIGINT, SIG_DFL); /* ignored in the background of a shell, where a test could not clean up */
        sigprocmask(SIG_SETMASK, &before, NULL);
        execvp(command[0], command);
        fprintf(stderr, "contain: %s cannot be started: %s\n", command[0], strerror(errno));
        _exit(126);
    }

    int status = 0;
    bool stop_requested = getppid() != parent, stopping = false, ended = false;
    for (;;) {
        ended = reap(child, &status) || ended;
        if (ended && !(stopping && suite && has_children())) break;
        if (stop_requested && !stopping) {
            stopping = true;
            clock_gettime(CLOCK_MONOTONIC, &stop_time);
            kill(child, suite ? SIGTERM : SIGINT);
        }
        if (stopping && seconds_since(&stop_time) * 1e3 >= GRACE_MS) break;
        struct pollfd polled[2] = {{.fd = signals, .events = POLLIN}, {.fd = stopping ? -1 : lifeline}};
        poll(polled, 2, stopping ? 50 : -1);
        struct signalfd_siginfo info;
        while (read(signals, &info, sizeof info) == (ssize_t)sizeof info)
            stop_requested = stop_requested || info.ssi_signo != SIGCHLD;
        stop_requested = stop_requested || polled[1].revents != 0;
    }
    end_descendants();
    if (!ended) return 128 + SIGKILL;
    struct rusage used;
    getrusage(RUSAGE_CHILDREN, &used);
    printf("# time: %.2f s wall, %.2f s CPU\n", seconds_since(&start),
           (double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
               1e-6 * (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec));
    return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

// SPDX-License-Identifier: Apache-2.0
#include "service/slurm/program_call.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/core/child_environment.h"
#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/transfer.h"

/* Limit of the output. A listing of 100 000 jobs has about 20 MB. */
#define MOST_BYTES ((size_t)256 << 20)

typedef struct text {
    char *bytes;
    size_t used, capacity;
} text;

/* Reads a part of the output. False at the end of the stream, or at the limit. */
static bool take(int fd, text *t)
{
    if (t->used + 65537 > t->capacity)
        t->bytes = mem_resize(t->bytes, t->capacity = 2 * t->capacity + 131072);
    ssize_t got = read(fd, t->bytes + t->used, 65536);
    if (got < 0) return errno == EINTR || errno == EAGAIN;
    t->used += (size_t)got;
    t->bytes[t->used] = '\0';
    return got > 0 && t->used < MOST_BYTES;
}

static int make_input(const char *input)
{
    if (!input) return open("/dev/null", O_RDONLY | O_CLOEXEC);
    int fd = memfd_create("input", MFD_CLOEXEC);
    if (fd >= 0 && transfer_write(fd, input, strlen(input))) lseek(fd, 0, SEEK_SET);
    return fd;
}

static int spawn(const char *const *arguments, int in, int out, int complaint, pid_t *pid)
{
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
    posix_spawn_file_actions_adddup2(&actions, in, STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, out, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, complaint, STDERR_FILENO);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    char **environment = child_environment_new(CHILD_ENVIRONMENT_OF_SLURM, NULL);
    int why = posix_spawnp(pid, arguments[0], &actions, &attributes, (char *const *)arguments, environment);
    free(environment);
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
    return why;
}

static void collect(int fds[2], pid_t pid, double limit_s, text texts[2], bool *timed_out)
{
    int64_t end_ms = clock_monotonic_ms() + (int64_t)(limit_s * 1000);
    while (fds[0] >= 0 || fds[1] >= 0) {
        int64_t left = *timed_out ? 1000 : end_ms - clock_monotonic_ms();
        struct pollfd watched[2] = {{.fd = fds[0], .events = POLLIN}, {.fd = fds[1], .events = POLLIN}};
        int ready = left > 0 ? poll(watched, 2, (int)left) : 0;
        if (ready == 0 && *timed_out) return; /* a child of the program still has the pipes open */
        if (ready == 0) {
            kill(pid, SIGKILL);
            *timed_out = true;
        }
        for (int i = 0; i < 2; i++) {
            if (ready <= 0 || !watched[i].revents || take(fds[i], &texts[i])) continue;
            close(fds[i]);
            fds[i] = -1;
        }
    }
}

/* Waits for the end of a program that has closed its output, and kills it after limit_s. Returns its exit
 * status; -1: a signal ended it. */
static int await(pid_t pid, double limit_s, bool *timed_out)
{
    int status = 0;
    int64_t end_ms = clock_monotonic_ms() + (int64_t)(limit_s * 1000);
    while (waitpid(pid, &status, WNOHANG) == 0) {
        if (clock_monotonic_ms() >= end_ms) {
            kill(pid, SIGKILL);
            *timed_out = true;
        }
        poll(NULL, 0, 1);
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

bool program_call_run(const char *const *arguments, const char *input, double limit_s,
                      program_call_result *out, error *e)
{
    int in = make_input(input), outputs[2] = {-1, -1}, complaints[2] = {-1, -1};
    pid_t pid = -1;
    text texts[2] = {{0}};
    program_call_result r = {0};
    int why = in < 0 || pipe2(outputs, O_CLOEXEC) != 0 || pipe2(complaints, O_CLOEXEC) != 0
                  ? errno
                  : spawn(arguments, in, outputs[1], complaints[1], &pid);
    if (in >= 0) close(in);
    if (outputs[1] >= 0) close(outputs[1]);
    if (complaints[1] >= 0) close(complaints[1]);
    int reading[2] = {outputs[0], complaints[0]};
    if (!why) {
        collect(reading, pid, limit_s, texts, &r.timed_out);
        r.status = await(pid, r.timed_out ? 0 : limit_s, &r.timed_out);
    }
    for (int i = 0; i < 2; i++)
        if (reading[i] >= 0) close(reading[i]);
    r.output = texts[0].bytes ? texts[0].bytes : mem_strdup("");
    r.complaint = texts[1].bytes ? texts[1].bytes : mem_strdup("");
    bool ok = !why && texts[0].used < MOST_BYTES && texts[1].used < MOST_BYTES;
    if (ok)
        *out = r;
    else
        program_call_clear(&r);
    return ok || error_set(e, ERROR_INTERNAL, "cannot run %s: %s", arguments[0],
                           why ? strerror(why) : "its output is too long");
}

void program_call_clear(program_call_result *r)
{
    free(r->output);
    free(r->complaint);
    *r = (program_call_result){0};
}

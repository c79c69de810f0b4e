// SPDX-License-Identifier: Apache-2.0
/* A job in a child, hexad-worker: the spec goes to its standard input, arrays come back through one pipe, progress through
 * another one. The child is waited for if the host permits it: a host that ignores SIGCHLD has no status to wait for, and
 * then the end of the pipe shows that the child has ended. */
#include "config.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/pidfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/core/child_environment.h"
#include "base/core/frames.h"
#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "library/call.h"

/* Descriptors of the child. */
enum { CHILD_ARRAYS = 3, CHILD_PROGRESS = 4, CHILD_FIRST_CLOSED = 5 };

typedef struct child {
    pid_t pid;
    int handle;           /* a descriptor of the process; -1: it has ended already */
    int arrays, progress; /* ends of pipes; -1: closed */
    char line[4096];      /* of the progress */
    size_t length;
    char phase[16];
    double fraction;
    bool is_cancelled;
} child;

/* The program: HEXAD_WORKER, or beside the library, or where it was installed. */
static char *find_program(void)
{
    static const char name[] = "/hexad-worker";
    const char *set = getenv("HEXAD_WORKER");
    if (set && *set) return mem_strdup(set);
    Dl_info library;
    if (dladdr(name, &library) && *library.dli_fname == '/') { /* the child may start in another directory */
        const size_t length = (size_t)(strrchr(library.dli_fname, '/') - library.dli_fname);
        char *beside = mem_alloc(length + sizeof name);
        memcpy(beside, library.dli_fname, length);
        memcpy(beside + length, name, sizeof name);
        if (access(beside, X_OK) == 0) return beside;
        free(beside);
    }
    return mem_strdup(HEXAD_BINDIR "/hexad-worker");
}

/* A descriptor from which the text can be read; -1. */
static int text_file(const char *text)
{
    const int fd = memfd_create("hexad spec", MFD_CLOEXEC);
    const size_t length = strlen(text);
    size_t done = 0;
    while (fd >= 0 && done < length) {
        const ssize_t n = write(fd, text + done, length - done);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) {
            close(fd);
            return -1;
        }
        done += (size_t)n;
    }
    if (fd >= 0) lseek(fd, 0, SEEK_SET);
    return fd;
}

/* ---- the command line */

typedef struct words {
    size_t count;
    char **word;
} words;

static void add_word(words *w, const char *text)
{
    w->word = mem_resize(w->word, (w->count + 2) * sizeof *w->word);
    w->word[w->count++] = mem_strdup(text);
    w->word[w->count] = NULL;
}

static void add_root(words *w, const char *path)
{
    for (size_t k = 0; k + 1 < w->count; k++)
        if (strcmp(w->word[k], "--" WORKER_OPTION_INPUT_ROOT) == 0 && strcmp(w->word[k + 1], path) == 0)
            return;
    add_word(w, "--" WORKER_OPTION_INPUT_ROOT);
    add_word(w, path);
}

/* Without roots, the files of the spec may be in their directories, with the files that they name there. */
static void add_own_roots(words *w, const spec *s)
{
    spec_input input;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) {
        const char *slash = strrchr(input.path, '/');
        if (*input.path != '/') {
            add_root(w, ".");
            continue;
        }
        char *directory =
            slash == input.path ? mem_strdup("/") : mem_strndup(input.path, (size_t)(slash - input.path));
        add_root(w, directory);
        free(directory);
    }
}

static words command_line(const hexad_job *job, const spec *s)
{
    words w = {0};
    char number[16], *program = find_program();
    add_word(&w, program);
    free(program);
    add_word(&w, WORKER_COMMAND_RUN);
    add_word(&w, WORKER_SPEC_ON_STDIN);
    snprintf(number, sizeof number, "%d", CHILD_ARRAYS);
    add_word(&w, "--" WORKER_OPTION_ARRAYS_FD);
    add_word(&w, number);
    snprintf(number, sizeof number, "%d", CHILD_PROGRESS);
    add_word(&w, "--" WORKER_OPTION_PROGRESS_FD);
    add_word(&w, number);
    add_word(&w, "--" WORKER_OPTION_SANDBOX);
    add_word(&w, "available");
    for (size_t k = 0; k < job->root_count; k++) add_root(&w, job->roots[k]);
    if (job->root_count == 0) add_own_roots(&w, s);
    return w;
}

/* ---- the process */

/* A descriptor above those of the child, so that dup2 does not replace it. */
static int raised(int fd)
{
    const int higher = fd < 0 ? -1 : fcntl(fd, F_DUPFD_CLOEXEC, CHILD_FIRST_CLOSED);
    if (fd >= 0) close(fd);
    return higher;
}

static bool make_pipe(int ends[2])
{
    int made[2];
    ends[0] = ends[1] = -1;
    if (pipe2(made, O_CLOEXEC) != 0) return false;
    ends[0] = raised(made[0]);
    ends[1] = raised(made[1]);
    return ends[0] >= 0 && ends[1] >= 0;
}

static void close_end(int *fd)
{
    if (*fd >= 0) close(*fd);
    *fd = -1;
}

static int spawn(const hexad_job *job, char *const *word, int input, int arrays, int progress, pid_t *pid)
{
    posix_spawn_file_actions_t files;
    posix_spawnattr_t attributes;
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawn_file_actions_init(&files);
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setpgroup(&attributes, 0); /* keys of a terminal reach the host, which cancels */
    posix_spawnattr_setflags(&attributes,
                             POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    int fault = 0;
    if (job->directory) fault = posix_spawn_file_actions_addchdir_np(&files, job->directory);
    if (!fault) fault = posix_spawn_file_actions_adddup2(&files, input, STDIN_FILENO);
    if (!fault) fault = posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    if (!fault) fault = posix_spawn_file_actions_adddup2(&files, STDOUT_FILENO, STDERR_FILENO);
    if (!fault) fault = posix_spawn_file_actions_adddup2(&files, arrays, CHILD_ARRAYS);
    if (!fault) fault = posix_spawn_file_actions_adddup2(&files, progress, CHILD_PROGRESS);
    if (!fault) fault = posix_spawn_file_actions_addclosefrom_np(&files, CHILD_FIRST_CLOSED);
    char **environment = child_environment_new(CHILD_ENVIRONMENT_OF_WORKER, NULL);
    if (!fault) fault = posix_spawn(pid, word[0], &files, &attributes, word, environment);
    free(environment);
    posix_spawn_file_actions_destroy(&files);
    posix_spawnattr_destroy(&attributes);
    return fault;
}

static bool start(const hexad_job *job, const json *document, const spec *s, child *out, error *e)
{
    char *text = json_print(document);
    words w = command_line(job, s);
    int input = raised(text_file(text)), arrays[2] = {-1, -1}, progress[2] = {-1, -1};
    *out = (child){.handle = -1, .arrays = -1, .progress = -1, .phase = "load"};
    int fault = input >= 0 && make_pipe(arrays) && make_pipe(progress) ? 0 : errno;
    if (!fault) fault = spawn(job, w.word, input, arrays[1], progress[1], &out->pid);
    if (fault)
        error_set(
            e, ERROR_INTERNAL,
            "files are read by the program %s, which cannot be started: %s. Install hexad-worker, or set "
            "HEXAD_WORKER to its path.",
            w.word[0], strerror(fault));
    close_end(&input);
    close_end(&arrays[1]);
    close_end(&progress[1]);
    out->arrays = arrays[0];
    out->progress = progress[0];
    if (!fault) out->handle = pidfd_open(out->pid, 0);
    if (fault) {
        close_end(&out->arrays);
        close_end(&out->progress);
    }
    mem_free_texts(w.word, w.count);
    free(text);
    return !fault;
}

static void cancel(child *c)
{
    if (!c->is_cancelled && c->handle >= 0) pidfd_send_signal(c->handle, SIGTERM, NULL, 0);
    c->is_cancelled = true;
}

static void end(child *c)
{
    close_end(&c->arrays); /* a child that still writes ends */
    close_end(&c->progress);
    while (waitpid(c->pid, NULL, 0) < 0 && errno == EINTR) continue; /* ECHILD: there is no status */
    close_end(&c->handle);
}

/* ---- progress */

static void take_line(child *c, const char *text, size_t length)
{
    json *line = json_parse(text, length, NULL);
    const json_at root = json_root(line);
    snprintf(c->phase, sizeof c->phase, "%s", json_string(json_member(&root, "phase"), c->phase));
    c->fraction = json_number(json_member(&root, "fraction"), c->fraction);
    json_free(line);
}

/* Takes whole lines of the progress. */
static void read_progress(child *c)
{
    const ssize_t n = read(c->progress, c->line + c->length, sizeof c->line - c->length);
    if (n <= 0) {
        if (n == 0 || errno != EINTR) close_end(&c->progress);
        return;
    }
    c->length += (size_t)n;
    for (char *stop; (stop = memchr(c->line, '\n', c->length));) {
        take_line(c, c->line, (size_t)(stop - c->line));
        c->length -= (size_t)(stop + 1 - c->line);
        memmove(c->line, stop + 1, c->length);
    }
    if (c->length == sizeof c->line) c->length = 0;
}

typedef struct child_wait {
    hexad_job *job;
    child *child;
    int64_t told_ms; /* of the last call of the progress function */
    bool has_data;
} child_wait;

/* Waits until the child returns a part of its result or has ended. False: the job is cancelled while it does. */
static bool wait_for_data(void *context)
{
    child_wait *w = context;
    child *c = w->child;
    for (;;) {
        struct pollfd ends[2] = {{c->arrays, POLLIN, 0}, {c->progress, POLLIN, 0}};
        const int ready = poll(ends, 2, w->job->progress ? CALL_TICK_MS : -1);
        if (ready > 0 && ends[1].revents) read_progress(c);
        if (clock_monotonic_ms() - w->told_ms >= CALL_TICK_MS) {
            w->told_ms = clock_monotonic_ms();
            if (!call_report_progress(w->job, c->phase, c->fraction)) cancel(c);
            if (c->is_cancelled && w->has_data) return false;
        }
        if (ready < 0 && errno != EINTR) return true; /* reading fails, too */
        w->has_data |= ready > 0 && ends[0].revents;
        if (ready > 0 && ends[0].revents) return true;
    }
}

/* Whether the files with absolute paths can be read. Without this check, the error of a missing directory is about roots
 * that the caller has not set. */
static bool check_files(const spec *s, error *e)
{
    spec_input input;
    for (size_t k = 0; spec_input_at(s, k, &input); k++)
        if (*input.path == '/' && !frames_is_pattern(input.path) && access(input.path, R_OK) != 0) {
            error_set(e, ERROR_INPUT_MISSING,
                      "cannot read %.700s: %s; put the file there, or correct the path", input.path,
                      strerror(errno));
            return error_prefix(e, "%s", input.pointer);
        }
    return true;
}

bool call_in_child(hexad_job *job, const json *document, const spec *s, error *e)
{
    child c;
    if (job->root_count == 0 && !check_files(s, e)) return false;
    if (!start(job, document, s, &c, e)) return false;
    child_wait w = {.job = job, .child = &c};
    const bool ok = result_arrays_read(c.arrays, wait_for_data, &w, &job->results, e);
    end(&c);
    return ok;
}

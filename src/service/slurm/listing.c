// SPDX-License-Identifier: Apache-2.0
/* listing: reads the states of all Slurm jobs of this service in one answer. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/slurm/program_call.h"
#include "service/slurm/engine_data.h"

/* The pause after a call of squeue in units of its duration: squeue then runs at most a quarter of the
 * time. */
#define PAUSE_TIMES 3
/* Maximum number of jobs in one call of scancel. */
#define CANCEL_MOST 500

typedef struct row {
    char *number, *element, *name, *state, *host, *reason;
} row;

/* Splits the next line of *text and advances *text. */
static bool next_row(char **text, row *r)
{
    char *fields[6], *line = *text;
    if (!*line) return false;
    size_t length = strcspn(line, "\n");
    *text = line + length + (line[length] == '\n');
    line[length] = '\0';
    for (size_t i = 0; i < 6; i++) {
        fields[i] = line;
        size_t part = i < 5 ? strcspn(line, "|") : strlen(line);
        line += part;
        if (*line) *line++ = '\0';
    }
    *r = (row){fields[0], fields[1], fields[2], fields[3], fields[4], fields[5]};
    return true;
}

/* Adds a name, which is taken over. A name that equals the last one is discarded. */
static void add_name(attempt_files_names *n, char *name)
{
    if (n->count && strcmp(n->name[n->count - 1], name) == 0) {
        free(name);
        return;
    }
    mem_add_text(&n->name, &n->count, name);
}

static bool has_name(const attempt_files_names *n, const char *name)
{
    for (size_t i = 0; i < n->count; i++)
        if (strcmp(n->name[i], name) == 0) return true;
    return false;
}

typedef struct listing {
    slurm_batch *last; /* of the previous row: the rows of an array are consecutive */
    /* "NAME NUMBER" or "NAME NUMBER_TASK". strays: to be cancelled if the next listing has them as well.
     * doomed: to be cancelled now. */
    attempt_files_names strays, doomed;
} listing;

/* The id to cancel because all attempts that the task runs or may run have ended or were cancelled: of the
 * task, or of its whole array. NULL: none. A running task may have claimed one of the open attempts. */
static char *find_unwanted(const slurm *s, const slurm_batch *b, const row *r, const slurm_state *state)
{
    bool any_open = s->open && (!b || b->shared);
    if (state->over || strcmp(r->state, "COMPLETING") == 0 || (any_open && !state->waits)) return NULL;
    if (b && (b->open || b->tasks[strtoul(r->element, NULL, 10)].wanted)) return NULL;
    return any_open || (b && b->wanted) ? mem_printf("%s %s_%s", r->name, r->number, r->element)
                                        : mem_printf("%s %s", r->name, r->number);
}

/* Stores the state in a row. The caller holds the mutex. */
static void take_row(slurm *s, listing *l, const row *r)
{
    if (strncmp(r->name, s->prefix, strlen(s->prefix)) != 0) return;
    const slurm_state *state = slurm_state_of(r->state);
    if (!l->last || strcmp(l->last->name, r->name) != 0) l->last = slurm_batch_find(s, r->name);
    size_t number = strtoul(r->element, NULL, 10);
    if (!l->last) {
        char *id = find_unwanted(s, NULL, r, state);
        if (!id) return;
        add_name(has_name(&s->strays, id) ? &l->doomed : &l->strays, id);
        return;
    }
    if (number >= SLURM_TASKS_MOST) return;
    slurm_task *task = slurm_batch_task(s, l->last, number);
    task->state = state;
    task->listing = s->listing;
    task->seen_ms = clock_monotonic_ms();
    snprintf(task->host, sizeof task->host, "%s", r->host);
    snprintf(task->reason, sizeof task->reason, "%s", r->reason);
    char *id = find_unwanted(s, l->last, r, state);
    if (id) add_name(&l->doomed, id);
}

/* Cancels the first elements that belong to one job, and returns their number. The call also contains the
 * name, because Slurm may reuse a number for another job. */
static size_t cancel_some(const slurm *s, char *const *doomed, size_t count)
{
    const char *arguments[CANCEL_MOST + 4] = {"scancel", "--quiet"};
    size_t length = strcspn(doomed[0], " ") + 1, i = 0;
    char *name = mem_printf("--name=%.*s", (int)length - 1, doomed[0]);
    program_call_result said = {0};
    error e = {0};
    arguments[2] = name;
    for (; i < count && i < CANCEL_MOST && strncmp(doomed[i], doomed[0], length) == 0; i++)
        arguments[i + 3] = doomed[i] + length;
    bool ok = program_call_run(arguments, NULL, s->settings.command_s, &said, &e);
    log_write(LOG_LEVEL_DEBUG, "slurm: scancel %s tasks=%zu%s%s", name, i, ok ? "" : ": ", e.message);
    if (ok) program_call_clear(&said);
    free(name);
    return i;
}

static bool ask(const slurm *s, program_call_result *said)
{
    error e = {0};
    char *user = mem_printf("--user=%ld", (long)geteuid());
    const char *arguments[] = {
        "squeue", "--noheader", "--array", "--all", "--states=all", user, "--format=%F|%K|%j|%T|%N|%r", NULL};
    bool ok = program_call_run(arguments, NULL, s->settings.command_s, said, &e);
    free(user);
    if (ok && said->status == 0) return true;
    log_write(s->away ? LOG_LEVEL_DEBUG : LOG_LEVEL_WARNING,
              "slurm: squeue does not answer; attempts keep their state until it does: %.*s",
              ok ? (int)strcspn(said->complaint, "\n") : (int)strlen(e.message),
              ok ? said->complaint : e.message);
    if (ok) program_call_clear(said);
    return false;
}

/* Stores the states of a listing. The caller holds the mutex. */
static void take_listing(slurm *s, char *text, listing *l)
{
    row r;
    s->listing++;
    while (next_row(&text, &r)) take_row(s, l, &r);
    attempt_files_clear_names(&s->strays);
    s->strays = l->strays;
    s->quiet = s->attempt_count || s->strays.count || l->doomed.count ? 0 : s->quiet + 1;
}

void slurm_list(slurm *s)
{
    program_call_result said = {0};
    listing l = {0};
    int64_t began_ms = clock_monotonic_ms();
    bool answered = ask(s, &said);
    pthread_mutex_lock(&s->mutex);
    if (answered) take_listing(s, said.output, &l);
    s->away = !answered;
    pthread_mutex_unlock(&s->mutex);
    program_call_clear(&said);
    for (size_t i = 0; i < l.doomed.count;) i += cancel_some(s, l.doomed.name + i, l.doomed.count - i);
    attempt_files_clear_names(&l.doomed);
    int64_t pause_ms = (int64_t)(s->settings.interval_s * 1000), took_ms = clock_monotonic_ms() - began_ms;
    if (pause_ms < PAUSE_TIMES * took_ms) pause_ms = PAUSE_TIMES * took_ms;
    pthread_mutex_lock(&s->mutex);
    s->list_due_ms = clock_monotonic_ms() + pause_ms;
    runner_wake(s->files);
    pthread_mutex_unlock(&s->mutex);
}

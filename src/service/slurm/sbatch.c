// SPDX-License-Identifier: Apache-2.0
/* sbatch: selects the waiting attempts that are submitted together, calls sbatch and interprets its
 * answer. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/slurm/program_call.h"
#include "service/slurm/engine_data.h"
#include "files/file.h"

/* Maximum number of attempts of an array. The script contains their names; Slurm accepts scripts of up to
 * 4 MB. */
#define MOST_MEMBERS 8000
/* Small attempts share tasks only if more than SPREAD of them wait. */
#define SPREAD 16
/* Wait, in ms, before the next command after Slurm could not be reached. */
#define AWAY_MS 2000
/* Attempts are gathered, because a call of sbatch costs Slurm more than an attempt: until none has arrived
 * for PAUSE_MS, and at most for GATHER_MS. While attempts of a chunk are missing, none may arrive for
 * GATHER_MS. If no attempt is in Slurm, its nodes are idle, and the limit is PAUSE_MS. If more small attempts
 * wait in Slurm than here, the limit is GATHER_MORE_MS. */
#define PAUSE_MS 100
#define GATHER_MS 2000
#define GATHER_MORE_MS 10000

/* Error messages of Slurm's client commands after which nothing was submitted, and a repetition may
 * succeed. */
static const char *const away[] = {
    "Unable to contact slurm controller",           "Connection refused",
    "Slurm temporarily unable to accept job",       "Resource temporarily unavailable",
    "Slurm backup controller in standby mode",      "Could not establish a configuration source",
    "job allocation cannot be granted at this time"};
/* Error messages after which the job may have been accepted. */
static const char *const unclear[] = {"Socket timed out",
                                      "Zero Bytes were transmitted",
                                      "Communication connection failure",
                                      "Unexpected message received",
                                      "Message receive failure",
                                      "Transport endpoint is not connected",
                                      "Header lengths are longer than"};

static bool says_any(const char *complaint, const char *const *list, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (strstr(complaint, list[i])) return true;
    return false;
}

/* The data of one submission. It has copies of all texts, because the attempts may end in the meantime. */
typedef struct load {
    slurm_batch *batch;
    char *needs;
    char **names;
    size_t *tasks; /* of each attempt */
    size_t count, task_count;
    attempt_files_names open;        /* the new contents of the list */
    bool chunks;                     /* each task runs a chunk */
    size_t together;                 /* number of attempts per task; with chunks: of the longest */
    double more_s;                   /* time in which a task takes attempts of other tasks */
    double timeout_s;                /* of a task; 0: none */
    char avoided[AVOIDED_MOST * 66]; /* nodes, separated by commas */
} load;

static void load_clear(load *l)
{
    mem_free_texts(l->names, l->count);
    free(l->tasks);
    free(l->needs);
    attempt_files_clear_names(&l->open);
}

static bool waits(const engine_attempt *a, int64_t now)
{
    return !a->batch && !a->ended && !a->refused && !a->cancelled && a->not_before_ms <= now;
}

static bool goes_with(const engine_attempt *head, const engine_attempt *a)
{
    return a == head ||
           (!head->alone && !a->alone && a->small == head->small && (a->chunk < 0) == (head->chunk < 0) &&
            strcmp(a->needs, head->needs) == 0 && (a->timeout_s > 0) == (head->timeout_s > 0));
}

/* Whether two attempts belong to one chunk of a job. */
static bool is_same_chunk(const engine_attempt *a, const engine_attempt *b)
{
    return a->chunk == b->chunk && strncmp(a->name, b->name, ULID_SIZE - 1) == 0;
}

/* Adds `head` and the attempts that can be submitted with it. The caller holds the mutex. */
static void add_members(load *l, engine_attempt *head, size_t waiting, int64_t now)
{
    const engine_attempt *last = NULL;
    size_t in_task = 0;
    l->names = mem_alloc(waiting * sizeof *l->names);
    l->tasks = mem_alloc(waiting * sizeof *l->tasks);
    for (engine_attempt *a = head; a; a = TAILQ_NEXT(a, link)) {
        if (!waits(a, now) || !goes_with(head, a)) continue;
        bool next = !last || (l->chunks ? !is_same_chunk(a, last) : in_task == l->together);
        if (next && (l->task_count == SLURM_TASKS_MOST || l->count >= MOST_MEMBERS)) break;
        in_task = next ? 1 : in_task + 1;
        l->task_count += next;
        if (in_task > l->together) l->together = in_task;
        slurm_enter(a, l->batch, l->task_count - 1);
        l->tasks[l->count] = l->task_count - 1;
        l->names[l->count++] = mem_strdup(a->name);
        if (a->timeout_s > l->timeout_s) l->timeout_s = a->timeout_s;
        last = a;
    }
}

/* Lists the excluded nodes. The caller holds the mutex. */
static void list_avoided(const slurm *s, int64_t now, load *l)
{
    size_t used = 0;
    for (size_t i = 0; i < AVOIDED_MOST; i++)
        if (s->avoided[i].until_ms > now)
            used += (size_t)snprintf(l->avoided + used, sizeof l->avoided - used, "%s%s", used ? "," : "",
                                     s->avoided[i].host);
}

/* Makes the list of attempts that nodes may run after their own: attempts with the same needs and time limit.
 * The caller holds the mutex. */
static void share(slurm *s, load *l)
{
    char hex[STORE_HASH_SIZE];
    char *alike = mem_printf("%s\n%.0f", l->needs, l->timeout_s);
    store_hash(alike, strlen(alike), hex);
    free(alike);
    l->batch->list = mem_printf(ATTEMPT_FILES_LIST "%.16s", hex);
    l->more_s = s->settings.more_s;
    const engine_attempt *a;
    TAILQ_FOREACH (a, &s->attempts, link)
        if (a->batch && a->batch->list && !a->is_claimed && !a->ended && !a->cancelled &&
            strcmp(a->batch->list, l->batch->list) == 0)
            attempt_files_add_name(&l->open, a->name, strlen(a->name));
}

/* Takes the first waiting attempt and the attempts that can be submitted with it. False: none is due; *due_ms
 * is the time of the next one. The caller holds the mutex. */
static bool gather(slurm *s, load *l, int64_t *due_ms)
{
    int64_t now = clock_monotonic_ms();
    engine_attempt *head = NULL;
    size_t waiting = 0;
    bool idle = true;
    engine_attempt *a;
    TAILQ_FOREACH (a, &s->attempts, link) {
        idle &= !a->batch || a->ended;
        if (!a->batch && !a->ended && a->not_before_ms > now && a->not_before_ms < *due_ms)
            *due_ms = a->not_before_ms;
        if (!waits(a, now)) continue;
        if (!head) head = a;
        waiting += goes_with(head, a);
    }
    if (!head) return false;
    int64_t patience_ms = idle ? PAUSE_MS : head->small && s->open > waiting ? GATHER_MORE_MS : GATHER_MS;
    int64_t pause_ms = s->more ? GATHER_MS : PAUSE_MS;
    if (now - s->newest_ms < pause_ms && (s->more || now - head->since_ms < patience_ms)) {
        if (s->newest_ms + pause_ms < *due_ms)
            *due_ms = s->newest_ms + pause_ms; /* more attempts may arrive */
        return false;
    }
    size_t together = head->small ? 1 + waiting / SPREAD : 1, most = (size_t)s->settings.together;
    if (together > most) together = most;
    char *name = mem_printf("%s%s-%" PRIx64, s->prefix, head->name, s->serial++);
    *l = (load){.batch = slurm_batch_new(s, name, together > 1),
                .needs = mem_strdup(head->needs),
                .chunks = head->chunk >= 0,
                .together = together};
    free(name);
    l->batch->users++;
    add_members(l, head, waiting, now);
    list_avoided(s, now, l);
    if (l->batch->shared) share(s, l);
    if (l->timeout_s > 0) l->timeout_s = fmax(l->timeout_s * (double)l->together, l->timeout_s + l->more_s);
    return true;
}

/* Records the batch in the files of its attempts, before it is submitted. */
static bool note_batch(slurm *s, const load *l, error *e)
{
    if (l->batch->list && !attempt_files_write_list(s->farm, l->batch->list, &l->open, e)) return false;
    attempt_files_batch note = {.number = l->batch->shared};
    snprintf(note.name, sizeof note.name, "%s", l->batch->name);
    for (size_t i = 0; i < l->count; i++) {
        char *directory = mem_printf("%s/%s", s->farm, l->names[i]);
        note.task = (int)l->tasks[i];
        bool ok = attempt_files_write_batch(directory, &note, e);
        free(directory);
        if (!ok) return false;
    }
    return true;
}

/* A line has one attempt, or the attempts of a chunk. */
static char *write_script(const slurm *s, const load *l)
{
    size_t capacity = strlen(s->settings.node) + strlen(s->farm) + strlen(l->batch->name) + 256;
    for (size_t i = 0; i < l->count; i++) capacity += strlen(l->names[i]) + 1;
    char *script = mem_alloc(capacity);
    size_t used = (size_t)sprintf(
        script, "#!/bin/sh\n# attempts of hexad\nexec '%s' '%s' %s $SLURM_ARRAY_TASK_ID %zu %.3f %s <<END\n",
        s->settings.node, s->farm, l->batch->name, l->chunks ? 1 : l->together, l->more_s,
        l->batch->list ? l->batch->list : "-");
    for (size_t i = 0; i < l->count; i++) {
        bool goes_on = l->chunks && i + 1 < l->count && l->tasks[i + 1] == l->tasks[i];
        used += (size_t)sprintf(script + used, "%s%c", l->names[i], goes_on ? ' ' : '\n');
    }
    sprintf(script + used, "END\n");
    return script;
}

static bool call_sbatch(slurm *s, const load *l, program_call_result *said, error *e)
{
    const char *const fixed[] = {"sbatch",     "--parsable",         "--no-requeue",
                                 "--ntasks=1", "--output=/dev/null", "--chdir=/"};
    size_t count = sizeof fixed / sizeof *fixed, capacity = count + 6;
    for (const char *line = l->needs; (line = strchr(line, '\n')); line++) capacity++;
    const char **arguments = mem_alloc(capacity * sizeof *arguments);
    memcpy(arguments, fixed, sizeof fixed);
    char *name = mem_printf("--job-name=%s", l->batch->name),
         *array = mem_printf("--array=0-%zu", l->task_count - 1);
    char *exclude = *l->avoided ? mem_printf("--exclude=%s", l->avoided) : NULL;
    char *time = l->timeout_s > 0 ? mem_printf("--time=%.0f", l->timeout_s / 60 + 1) : NULL;
    char *script = write_script(s, l), *needs = mem_strdup(l->needs), *rest = NULL;
    arguments[count++] = name;
    arguments[count++] = array;
    if (time) arguments[count++] = time;
    if (exclude) arguments[count++] = exclude;
    for (char *need = strtok_r(needs, "\n", &rest); need; need = strtok_r(NULL, "\n", &rest))
        arguments[count++] = need;
    bool ok = program_call_run(arguments, script, s->settings.command_s, said, e);
    free(name);
    free(array);
    free(time);
    free(exclude);
    free(script);
    free(needs);
    free(arguments);
    return ok;
}

typedef enum answer { ACCEPTED, AWAY, UNCLEAR, REFUSED, AGAIN } answer;

/* Interprets the answer of sbatch. If Slurm is too busy, sbatch repeats the request by itself until the time
 * limit ends it. */
static answer understand(const program_call_result *said)
{
    bool is_away = says_any(said->complaint, away, sizeof away / sizeof *away);
    if (said->status == 0 && !said->timed_out) return ACCEPTED;
    if (says_any(said->complaint, unclear, sizeof unclear / sizeof *unclear)) return UNCLEAR;
    if (is_away) return AWAY;
    return said->timed_out ? UNCLEAR : REFUSED;
}

/* The last line of sbatch's error output, without the prefix "sbatch: error: ". */
static void find_reason(const char *complaint, char *why, size_t size)
{
    size_t length = strlen(complaint);
    while (length && complaint[length - 1] == '\n') length--;
    size_t first = length;
    while (first && complaint[first - 1] != '\n') first--;
    const char *words = complaint + first;
    if (length - first > 15 && strncmp(words, "sbatch: error: ", 15) == 0) {
        words += 15;
        first += 15;
    }
    snprintf(why, size, "Slurm refused the job: %.*s", (int)(length - first), words);
}

/* Removes the attempts from a batch that Slurm has not accepted. If several attempts were refused together,
 * each is submitted separately. The caller holds the mutex. */
static void take_back(slurm *s, const load *l, answer a, const char *why)
{
    engine_attempt *m;
    TAILQ_FOREACH (m, &s->attempts, link) {
        if (m->batch != l->batch) continue;
        slurm_leave(m);
        m->not_before_ms = a == AWAY ? clock_monotonic_ms() + AWAY_MS : 0;
        if (a != REFUSED) continue;
        if (l->count > 1) {
            m->alone = true;
        } else {
            m->refused = true;
            snprintf(m->ending.why, sizeof m->ending.why, "%s", why);
        }
    }
}

static void tell(slurm *s, const load *l, answer a, const char *why)
{
    static const char *const words[] = {"accepted", "not reached", "unknown: it is searched for by its name",
                                        "refused"};
    log_write(a == ACCEPTED                  ? LOG_LEVEL_DEBUG
              : a == REFUSED || a == UNCLEAR ? LOG_LEVEL_WARNING
              : s->away                      ? LOG_LEVEL_DEBUG
                                             : LOG_LEVEL_WARNING,
              "slurm: submission %s name=%s attempts=%zu tasks=%zu%s%s", words[a], l->batch->name, l->count,
              l->task_count, *why ? ": " : "", why);
}

int64_t slurm_submit(slurm *s)
{
    int64_t due_ms = INT64_MAX;
    for (;;) {
        load l = {0};
        error e = {0};
        program_call_result said = {0};
        char why[256] = "";
        pthread_mutex_lock(&s->mutex);
        bool any = !runner_is_stopping(s->commands) && gather(s, &l, &due_ms);
        pthread_mutex_unlock(&s->mutex);
        if (!any) return due_ms;
        bool called = note_batch(s, &l, &e) && call_sbatch(s, &l, &said, &e);
        answer a = called ? understand(&said) : AWAY; /* a missing program or disk: try again later */
        if (a != ACCEPTED) find_reason(called ? said.complaint : e.message, why, sizeof why);
        tell(s, &l, a, why);
        pthread_mutex_lock(&s->mutex);
        if (a == REFUSED && *l.avoided) { /* there may be no nodes other than the excluded ones */
            memset(s->avoided, 0, sizeof s->avoided);
            a = AGAIN;
        }
        if (a == AWAY || a == REFUSED || a == AGAIN) take_back(s, &l, a, why);
        s->away = a == AWAY;
        s->quiet = 0;
        for (size_t i = 0; i < l.batch->task_count; i++) {
            l.batch->tasks[i].listing = s->listing;
            l.batch->tasks[i].seen_ms = clock_monotonic_ms();
        }
        slurm_batch_release(l.batch);
        pthread_mutex_unlock(&s->mutex);
        program_call_clear(&said);
        load_clear(&l);
        if (a == AWAY) return clock_monotonic_ms() + AWAY_MS;
    }
}

// SPDX-License-Identifier: Apache-2.0
#include "service/executor/estimator.h"

#include <errno.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/descriptor_wait.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "service/executor/input_permissions.h"
#include "service/executor/local.h"
#include "service/executor/settlement.h"
#include "base/json/json.h"
#include "files/file.h"

/* Maximum size of a document: estimates are small, descriptions of files may be long. */
#define LONGEST_BYTES (8u << 20)

struct estimator {
    executor_settings settings;
    char *directory;
    int at_once;
    double timeout_s;
    atomic_int running;
    atomic_uint number; /* number of the next directory */
    int end_fd;         /* readable: the estimator is dismissed */
};

estimator *estimator_open(const executor_settings *settings, int at_once, double timeout_s, error *e)
{
    estimator *m = mem_alloc(sizeof *m);
    m->settings = *settings;
    m->settings.engine = &engine_local; /* clients wait for estimates */
    m->directory = mem_printf("%s/estimates", settings->state_dir);
    m->at_once = at_once;
    m->timeout_s = timeout_s;
    m->end_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    bool ok = m->end_fd >= 0 ||
              error_set(e, ERROR_INTERNAL, "cannot create an event descriptor: %s", strerror(errno));
    if (ok && store_remove(m->directory, e) && store_directory_add(m->directory, e)) return m;
    estimator_close(m);
    return NULL;
}

void estimator_dismiss(estimator *m)
{
    ssize_t written = write(m->end_fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* a full counter is readable, too */
}

void estimator_close(estimator *m)
{
    if (!m) return;
    if (m->end_fd >= 0) close(m->end_fd);
    free(m->directory);
    free(m);
}

/* Waits until the worker has ended. False: it was killed at its time limit or when the estimator was
 * dismissed. */
static bool await(const estimator *m, engine_attempt *attempt, double timeout_s)
{
    int64_t end_ms = clock_monotonic_ms() + (int64_t)(timeout_s * 1000);
    const char *progress;
    bool stopped = false;
    while (!m->settings.engine->poll(attempt, &progress)) {
        struct pollfd fds[1 + ENGINE_MAX_FDS] = {{.fd = stopped ? -1 : m->end_fd, .events = POLLIN}};
        size_t count = 1 + m->settings.engine->watch(attempt, fds + 1);
        int64_t left_ms = end_ms - clock_monotonic_ms();
        descriptor_wait(fds, count, stopped ? -1 : left_ms > 0 ? (int)left_ms + 1 : 0);
        if (stopped || (!fds[0].revents && clock_monotonic_ms() < end_ms)) continue;
        m->settings.engine->cancel(attempt, true);
        stopped = true;
    }
    return !stopped;
}

/* Reads the output of the worker. NULL: it is not a JSON object. */
static char *read_document(const engine_request *request)
{
    size_t length = 0;
    bool inspects = strcmp(request->command, WORKER_COMMAND_INSPECT) == 0;
    char *path =
        mem_printf("%s/%s", request->directory, inspects ? WORKER_INSPECTION_NAME : WORKER_ESTIMATE_NAME);
    char *text = store_file_read(path, LONGEST_BYTES, &length, NULL);
    json *document = text ? json_parse(text, length, NULL) : NULL;
    if (json_type_of(json_root(document)) != JSON_OBJECT) {
        free(text);
        text = NULL;
    }
    json_free(document);
    free(path);
    return text;
}

static estimator_outcome decide(const engine_ending *ending, const engine_request *request, char **document,
                                error *e)
{
    if (ending->exit_status == WORKER_EXIT_CONVERGED && (*document = read_document(request)))
        return ESTIMATOR_MADE;
    if (ending->exit_status > 0 && settlement_read_last_words(ending->last_words, e) &&
        e->code != ERROR_INTERNAL && e->code != ERROR_CANCELLED && !error_is_of_storage(e->code))
        return ESTIMATOR_FAULT;
    error_set(
        e, ERROR_INTERNAL,
        "the worker of the estimate ended without an answer and without an error: report it with the spec");
    return ESTIMATOR_NONE;
}

static void tell_late(const char *command, double timeout_s, bool asked, error *e)
{
    bool inspects = strcmp(command, WORKER_COMMAND_INSPECT) == 0;
    const char *what = inspects ? "inspection" : "estimate";
    if (asked)
        error_set(e, ERROR_INTERNAL, "the %s took longer than %g s: raise within_ms of the request", what,
                  timeout_s);
    else
        error_set(e, ERROR_INTERNAL,
                  "the %s took longer than %g s: run `hexad-worker %s`, which has no limit, or ask the "
                  "administrator to raise the setting estimate_timeout_s%s",
                  what, timeout_s, inspects ? "inspect FILE" : "estimate SPEC.json --output DIR",
                  inspects ? "" : ". The job can be submitted without an estimate");
}

static estimator_outcome ask(estimator *m, engine_request *request, double within_s, char **document,
                             error *e)
{
    engine_ending ending = {0};
    engine_attempt *attempt =
        store_directory_add(request->directory, e) ? m->settings.engine->start(NULL, request, e) : NULL;
    bool asked = within_s > 0 && within_s < m->timeout_s;
    double timeout_s = asked ? within_s : m->timeout_s;
    bool ended = attempt && await(m, attempt, timeout_s);
    if (attempt) m->settings.engine->settle(attempt, &ending);
    estimator_outcome outcome = ESTIMATOR_NONE;
    if (ended)
        outcome = decide(&ending, request, document, e);
    else if (attempt)
        tell_late(request->command, timeout_s, asked, e);
    free(ending.last_words);
    store_remove(request->directory, NULL);
    return outcome;
}

estimator_outcome estimator_run(estimator *m, const char *command, const char *spec,
                                const char *const *inputs, size_t input_count, int frame, int threads,
                                int64_t memory_mb, double within_s, char **document, error *e)
{
    estimator_outcome outcome = ESTIMATOR_NONE;
    const executor_settings *settings = &m->settings;
    if (atomic_fetch_add(&m->running, 1) < m->at_once) {
        size_t root_count = 0;
        char *directory = mem_printf("%s/%u", m->directory, atomic_fetch_add(&m->number, 1));
        char **roots = input_permissions_list(inputs, input_count, settings->inputs, settings->input_roots,
                                              settings->input_root_count, &root_count);
        engine_request request = {
            .chunk = -1,
            .worker = settings->worker,
            .command = command,
            .directory = directory,
            .spec = spec,
            .input_roots = (const char *const *)roots,
            .input_root_count = root_count,
            .memory_mb = memory_mb,
            .most_memory_mb = executor_most_memory_mb(settings),
            .groups = settings->groups,
            .threads = threads,
            .frame = frame,
            .file_mb = settings->file_mb,
            .sandbox = settings->sandbox,
        };
        const double timeout_s = within_s > 0 ? fmin(within_s, m->timeout_s) : m->timeout_s;
        const store_deadline end = clock_monotonic_ms() + (int64_t)(timeout_s * 1000);
        outcome = ask(m, &request, within_s, document, e);
        for (size_t i = 0; outcome == ESTIMATOR_FAULT && e->code == ERROR_INPUT_DAMAGED && i < input_count;
             i++)
            store_inputs_discard_damaged(settings->inputs, inputs[i], &end);
        mem_free_texts(roots, root_count);
        free(directory);
    } else {
        outcome = ESTIMATOR_BUSY;
        error_set(e, ERROR_INTERNAL, "%d other estimates are running (setting estimates): try again later",
                  m->at_once);
    }
    atomic_fetch_sub(&m->running, 1);
    return outcome;
}

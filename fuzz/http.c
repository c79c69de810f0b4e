// SPDX-License-Identifier: Apache-2.0
/* Bytes to the service as it is, over a Unix socket: service/http/server with its routes, queries, headers,
 * tokens, ranges and bodies, and the handlers behind them. What is held: the first answer is HTTP, and no
 * fault of the service.
 *
 * The queue has a job that waits and one that has a result, whose ids stand in an input as 26 times "0" and
 * "1". The only slot is taken by a job without end, so that none is run. A client that has sent all
 * half-closes, so that the service does not wait for more.
 */
#include <errno.h>
#include <poll.h>
#include <stdbool.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "service/api/context.h"
#include "service/api/openapi.h"
#include "service/api/routes.h"
#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/executor/local.h"
#include "fuzz/target.h"
#include "service/http/server.h"
#include "service/results/result.h"
#include "files/file.h"

/* An answer that was asked to wait is not waited for. */
#define PATIENCE_MS 100
#define JOBS 2

typedef struct service {
    char base[64], socket_path[80];
    char id[JOBS][ULID_SIZE];
    listen_socket socket;
    access_control *access;
    queue *q;
    ledger *counts;
    runner *tasks;
    executor *x;
    wait_list *waiting;
    store_inputs *inputs;
    store_roots *roots;
    store_outputs output_roots; /* none */
    output_place *outputs;
    http_counters counters;
    delivery_counters calls;
    atomic_bool copying;
    pthread_mutex_t frame_checks;
    http_context context;
    openapi *openapi;
    address_ranges proxies; /* none */
    pages *pages;
    server *http;
} service;

/* Of the token "hexad_" with 64 times "a", which may read. */
static const char tokens[] =
    "beba3c4fe559 reader read beba3c4fe5599ef435e171c5b1364fbc2b9608ce7e160fbc480ca37c259233ca 1\n";
static const char report[] =
    "{\"outcome\":\"converged\",\"count\":4,\"outputs\":[{\"name\":\"points.ply\",\"bytes\":10,"
    "\"sha256\":\"84d89877f0d4041efb6bf91a16f0248f2fd573e6af05c19f96bedb9f882f7882\"}]}";
static const char spec[] = "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"radius\":1}},"
                           "\"sampling\":{\"count\":4}}";

static void put_file(const char *directory, const char *name, const char *text)
{
    char *path = mem_printf("%s/%s", directory, name);
    FILE *file = fopen(path, "w");
    expect(file && fputs(text, file) >= 0 && fchmod(fileno(file), 0600) == 0 && fclose(file) == 0);
    free(path);
}

static void put_job(service *s, char id[ULID_SIZE])
{
    error e = {0};
    queue_receipt receipt;
    queue_submission submission = {
        .name = "a", .labels = "[\"x\"]", .spec = spec, .priority = 1, .max_attempts = 1};
    expect(queue_put(s->q, &submission, &receipt, &e) && receipt.admission == QUEUE_CREATED);
    strcpy(id, receipt.id);
}

static void finish_job(service *s, const char *id)
{
    error e = {0};
    bool good = false;
    queue_claimed claimed;
    expect(queue_claim_job(s->q, id, &claimed, &good, &e) && good);
    const queue_fence fence = {id, claimed.task.number, claimed.task.attempt};
    const queue_ending ending = {.state = QUEUE_SUCCEEDED, .outcome = QUEUE_CONVERGED};
    expect(queue_finish(s->q, &fence, &ending, &good, &e) && good);
    queue_claimed_clear(&claimed);
    char *directory = result_directory(s->base, id, QUEUE_NO_FRAME);
    expect(mkdir(directory, 0700) == 0);
    put_file(directory, "points.ply", "0123456789");
    put_file(directory, "report.json", report);
    free(directory);
}

static bool is_there(service *s, const char *id, queue_state state)
{
    error e = {0};
    bool found = false;
    queue_job job = {0};
    expect(queue_get(s->q, id, &job, &found, &e));
    found = found && job.state == state;
    queue_job_clear(&job);
    return found;
}

/* What an input did to them is not to be seen by the next. */
static void put_jobs(service *s)
{
    executor_close(s->x, false);
    if (!is_there(s, s->id[0], QUEUE_QUEUED)) put_job(s, s->id[0]);
    if (is_there(s, s->id[1], QUEUE_SUCCEEDED)) return;
    put_job(s, s->id[1]);
    finish_job(s, s->id[1]);
}

/* A job whose worker does nothing for ever. */
static void take_the_slot(service *s)
{
    error e = {0};
    char id[ULID_SIZE];
    put_file(s->base, "worker", "#!/bin/sh\nexec sleep 1000000000\n");
    char *worker = mem_printf("%s/worker", s->base);
    expect(chmod(worker, 0700) == 0);
    put_job(s, id);
    executor_settings settings = {.engine = &engine_local,
                                  .counts = s->counts,
                                  .state_dir = s->base,
                                  .work_dir = s->base,
                                  .worker = worker,
                                  .workers = 1,
                                  .threads = 1,
                                  .memory_mb = 64};
    s->tasks = runner_new();
    s->waiting = wait_list_new(s->tasks);
    expect((s->x = executor_open(&settings, s->q, s->tasks, &e)));
    expect(runner_start(s->tasks, &e) && executor_start(s->x, &e));
    while (!is_there(s, id, QUEUE_RUNNING)) usleep(1000);
    free(worker);
}

static service the_service; /* libFuzzer has no other place for what lives from input to input */

static void stop(void)
{
    service *s = &the_service;
    server_stop(s->http);
    executor_stop(s->x);
    runner_stop(s->tasks);
    wait_list_free(s->waiting);
    executor_free(s->x);
    runner_free(s->tasks);
    output_place_free(s->outputs);
    store_inputs_close(s->inputs);
    store_roots_close(s->roots);
    queue_close(s->q);
    ledger_free(s->counts);
    access_close(s->access);
    listen_close(&s->socket);
    pages_free(s->pages);
    openapi_free(s->openapi);
    store_remove(s->base, NULL);
}

static void start(service *s)
{
    error e = {0};
    log_set_level(LOG_LEVEL_ERROR);
    const char *under = getenv("TMPDIR");
    snprintf(s->base, sizeof s->base, "%.40s/hexad-fuzz-XXXXXX", under ? under : "/tmp");
    expect(mkdtemp(s->base));
    s->counts = ledger_new();
    snprintf(s->socket_path, sizeof s->socket_path, "%s/socket", s->base);
    put_file(s->base, "tokens", tokens);
    char *where = mem_printf("unix:%s", s->socket_path), *file = mem_printf("%s/tokens", s->base);
    char *uploads = mem_printf("%s/inputs", s->base);
    const char *roots[] = {uploads};
    expect(listen_open(where, false, &s->socket, &e));
    expect((s->access = access_open(&(access_settings){.token_file = file}, &e)));
    expect((s->q = queue_open(s->base, &e)));
    expect((s->inputs = store_inputs_open(uploads, 1000, 10000, s->q, s->counts, &e)));
    expect((s->roots = store_roots_open(NULL, roots, 1, &e)));
    s->outputs = output_place_new(s->q, &s->output_roots, false);
    take_the_slot(s);
    s->openapi = openapi_new();
    pthread_mutex_init(&s->frame_checks, NULL);
    s->context = (http_context){.access = s->access,
                                .counts = s->counts,
                                .frame_checks = &s->frame_checks,
                                .q = s->q,
                                .x = s->x,
                                .roots = s->roots,
                                .inputs = s->inputs,
                                .work_dir = s->base,
                                .max_attempts = 1,
                                .started_ms = clock_wall_ms(),
                                .counters = &s->counters,
                                .calls = &s->calls,
                                .copying = &s->copying,
                                .wait_s = PATIENCE_MS / 2e3,
                                .outputs = s->outputs,
                                .openapi = s->openapi};
    static const char *const origin = "https://gui.example";
    expect((s->pages = pages_new(&origin, 1, &e)));
    pages_add(s->pages, where, s->socket.address);
    server_settings limits = {.routes = &api_routes,
                              .context = &s->context,
                              .counters = &s->counters,
                              .waiting = s->waiting,
                              .counts = s->counts,
                              .connections = {.connection_limit = 100, .timeout_s = 60},
                              .body_limit_bytes = 4096,
                              .header_limit_bytes = 8192,
                              .proxies = &s->proxies,
                              .pages = s->pages};
    expect((s->http = server_start(&limits, &s->socket, 1, s->access, &e)));
    free(where);
    free(file);
    free(uploads);
    atexit(stop);
}

/* The input with the jobs' ids in the place of their stand-ins. */
static char *put_ids(const service *s, const uint8_t *data, size_t size)
{
    char *text = mem_alloc(size + 1);
    memcpy(text, data, size);
    for (size_t n = 0; n < JOBS; n++) {
        char stand_in[ULID_SIZE] = {0};
        memset(stand_in, '0' + (int)n, sizeof stand_in - 1);
        for (char *at = text; (at = memmem(at, size - (size_t)(at - text), stand_in, sizeof stand_in - 1));)
            memcpy(at, s->id[n], sizeof stand_in - 1);
    }
    return text;
}

static void check_answer(const char *head)
{
    int status = 0;
    expect(sscanf(head, "HTTP/1.%*1[01] %3d", &status) == 1);
    expect(status >= 100 && status < 600);
    expect(status < 500 || status == 503 || status == 505 || status == 501); /* draining; the library's own */
}

static void exchange(const service *s, const char *text, size_t size)
{
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    char head[65], rest[4096];
    size_t got = 0;
    strcpy(to.sun_path, s->socket_path);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    expect(fd >= 0 && connect(fd, (struct sockaddr *)&to, sizeof to) == 0);
    while (size > 0) {
        ssize_t sent = send(fd, text, size, MSG_NOSIGNAL);
        if (sent <= 0) break; /* it has heard enough */
        text += sent;
        size -= (size_t)sent;
    }
    shutdown(fd, SHUT_WR);
    for (struct pollfd wait = {.fd = fd, .events = POLLIN}; poll(&wait, 1, PATIENCE_MS) > 0;) {
        ssize_t now = recv(fd, got < sizeof head - 1 ? head + got : rest,
                           got < sizeof head - 1 ? sizeof head - 1 - got : sizeof rest, 0);
        if (now <= 0) break;
        if (got < sizeof head - 1) got += (size_t)now;
    }
    close(fd);
    if (got == 0) return;
    head[got] = '\0';
    check_answer(head);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    service *s = &the_service;
    if (!s->http) start(s);
    put_jobs(s);
    char *text = put_ids(s, data, size);
    exchange(s, text, size);
    free(text);
    return 0;
}

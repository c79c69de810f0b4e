// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "service/http/server.h"
#include "files/file.h"

enum { PIECES = 3 };

/* What the handlers share with the test. */
static pthread_t serving_thread;
static atomic_int pieces_in_serving_thread, drops_in_serving_thread, drops, opened_in_serving_thread,
    opened_uploads;

static char taken[16]; /* bytes of uploads */

static bool is_serving_thread(void)
{
    return pthread_equal(pthread_self(), serving_thread);
}

static void answer_in_serving_thread(const http_context *c, const http_request *request, reply *r)
{
    (void)c;
    (void)request;
    serving_thread = pthread_self();
    reply_set_constant(r, "text/plain", "constant", 8);
}

typedef struct counting {
    reply_source source;
    int count;
    char text[16];
} counting;

static ssize_t produce(reply_source *source, const char **piece)
{
    counting *s = (counting *)(void *)source;
    pieces_in_serving_thread += is_serving_thread();
    if (s->count == PIECES) return -1;
    *piece = s->text;
    return snprintf(s->text, sizeof s->text, "piece %d,", s->count++);
}

static void free_counting(reply_source *source)
{
    free(source);
}

static void begin_stream(const http_context *c, const http_request *request, reply *r)
{
    (void)c;
    (void)request;
    counting *s = mem_alloc(sizeof *s);
    s->source = (reply_source){produce, free_counting};
    reply_set_source(r, "text/plain", "", &s->source);
}

static void open_sink(http_sink *sink)
{
    (void)sink;
    opened_in_serving_thread += is_serving_thread();
    opened_uploads++;
}

static void take(http_sink *sink, const char *bytes, size_t count)
{
    (void)sink;
    assert_true(opened_uploads > 0);
    size_t length = strlen(taken);
    snprintf(taken + length, sizeof taken - length, "%.*s", (int)count, bytes);
}

static void drop(http_sink *sink)
{
    drops_in_serving_thread += is_serving_thread();
    drops++;
    free(sink);
}

static http_sink *begin_upload(const http_context *c, const http_request *request, reply *r)
{
    (void)c;
    (void)request;
    (void)r;
    http_sink *sink = mem_alloc(sizeof *sink);
    *sink = (http_sink){open_sink, take, drop};
    return sink;
}

static void end_upload(const http_context *c, const http_request *request, reply *r)
{
    (void)c;
    (void)request;
    reply_set_empty(r, 204);
}

static const route rows[] = {
    {.method = "GET",
     .pattern = "/constant",
     .handler = answer_in_serving_thread,
     .runs_in = ROUTE_SERVING_THREAD},
    {.method = "GET", .pattern = "/stream", .handler = begin_stream, .runs_in = ROUTE_POOL, .streams = true},
    {.method = "PUT",
     .pattern = "/upload",
     .handler = end_upload,
     .opener = begin_upload,
     .runs_in = ROUTE_POOL,
     .body = "file"},
};

typedef struct place {
    char base[64];
    listen_socket socket;
    access_control *access;
    ledger *counts;
    wait_list *waiting;
    pages *pages;
    address_ranges proxies;
    http_counters counters;
    route_table routes;
    runner *tasks;
    server *s;
} place;

static int set_up(void **state)
{
    error e = {0};
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-server-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    char *where = mem_printf("unix:%s/socket", p->base), *tokens = mem_printf("%s/tokens", p->base);
    static const parameter_table no_parameters;
    p->routes = (route_table){rows, sizeof rows / sizeof *rows, &no_parameters};
    assert_true(listen_open(where, false, &p->socket, &e));
    assert_non_null(p->access = access_open(&(access_settings){.token_file = tokens}, &e));
    p->tasks = runner_new();
    p->waiting = wait_list_new(p->tasks);
    assert_true(runner_start(p->tasks, &e));
    assert_non_null(p->pages = pages_new(NULL, 0, &e));
    p->counts = ledger_new();
    const server_settings settings = {.routes = &p->routes,
                                      .counters = &p->counters,
                                      .waiting = p->waiting,
                                      .counts = p->counts,
                                      .connections = {.connection_limit = 10, .timeout_s = 60},
                                      .body_limit_bytes = 4096,
                                      .header_limit_bytes = 8192,
                                      .thread_wait_s = 60,
                                      .proxies = &p->proxies,
                                      .pages = p->pages};
    p->s = server_start(&settings, &p->socket, 1, p->access, &e);
    if (!p->s) fail_msg("%s", e.message);
    free(where);
    free(tokens);
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    server_stop(p->s);
    runner_stop(p->tasks);
    wait_list_free(p->waiting);
    runner_free(p->tasks);
    access_close(p->access);
    ledger_free(p->counts);
    listen_close(&p->socket);
    pages_free(p->pages);
    assert_true(store_remove(p->base, NULL));
    free(p);
    return 0;
}

static int connect_and_send(const place *p, const char *request)
{
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    strcpy(to.sun_path, p->socket.unix_path);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(connect(fd, (struct sockaddr *)&to, sizeof to), 0);
    assert_int_equal(send(fd, request, strlen(request), MSG_NOSIGNAL), strlen(request));
    return fd;
}

/* The answer up to the end of the connection, to be freed. */
static char *ask(const place *p, const char *request)
{
    int fd = connect_and_send(p, request);
    char *text = mem_alloc(4096);
    size_t length = 0;
    for (ssize_t count; (count = recv(fd, text + length, 4095 - length, 0)) > 0;) length += (size_t)count;
    close(fd);
    return text;
}

#define HEAD "Host: a\r\nConnection: close\r\n"

static void serve_constant(const place *p)
{
    char *text = ask(p, "GET /constant HTTP/1.1\r\n" HEAD "\r\n");
    assert_non_null(strstr(text, "\r\n\r\nconstant"));
    free(text);
}

static void pieces_of_a_stream_are_produced_outside_the_serving_thread(void **state)
{
    const place *p = *state;
    serve_constant(p);
    char *text = ask(p, "GET /stream HTTP/1.1\r\n" HEAD "\r\n");
    const char *last = text;
    for (int i = 0; i < PIECES; i++) {
        char piece[16];
        snprintf(piece, sizeof piece, "piece %d,", i);
        last = strstr(last, piece);
        if (!last) fail_msg("%s is missing or late in %s", piece, text);
    }
    assert_int_equal(pieces_in_serving_thread, 0);
    free(text);
}

static void uploads_are_opened_and_dropped_outside_the_serving_thread(void **state)
{
    const place *p = *state;
    serve_constant(p);
    free(ask(p, "PUT /upload HTTP/1.1\r\n" HEAD "Content-Length: 3\r\n\r\nabc"));
    assert_string_equal(taken, "abc");
    int unfinished = connect_and_send(p, "PUT /upload HTTP/1.1\r\n" HEAD "Content-Length: 3\r\n\r\na");
    while (opened_uploads < 2) usleep(1000);
    close(unfinished);
    while (drops < 2) usleep(1000);
    assert_int_equal(opened_in_serving_thread, 0);
    assert_int_equal(drops_in_serving_thread, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(pieces_of_a_stream_are_produced_outside_the_serving_thread, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(uploads_are_opened_and_dropped_outside_the_serving_thread, set_up,
                                        tear_down),
    };
    return cmocka_run_group_tests_name("server", tests, NULL, NULL);
}

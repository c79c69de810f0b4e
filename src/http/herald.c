#include "http/herald.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"
#include "executor/rows.h"

/* Of the news of one look. With more the rest is told at once after that. */
#define NEWS_MOST 256
/* A look without news, in case the database could not be read when there was some. */
#define LOOK_MS 1000

struct herald {
    queue *q;
    rows *rows;
    lounge *lounge;
    pthread_t thread;
    atomic_bool stopping;
    int64_t event_seq, row_number; /* those that were told */
};

/* The jobs of the news that was not told yet. */
typedef struct news {
    const char *topic[2 * NEWS_MOST];
    size_t count;
} news;

static void add_topic(news *n, const char *id)
{
    for (size_t i = 0; i < n->count; i++)
        if (strcmp(n->topic[i], id) == 0) return;
    n->topic[n->count++] = id;
}

/* Tells what is new; whether there may be more. */
static bool tell(herald *h)
{
    error e = {0};
    news n = {.count = 0};
    queue_event *events = NULL;
    size_t event_count = 0;
    queue_event_filter filter = {.after_seq = h->event_seq, .limit = NEWS_MOST};
    if (!queue_list_events(h->q, &filter, &events, &event_count, &e))
        log_write(LOG_LEVEL_ERROR, "events cannot be read: %s", e.message);
    for (size_t i = 0; i < event_count; i++) add_topic(&n, events[i].id);
    if (event_count) h->event_seq = events[event_count - 1].seq;
    rows_line *lines = NULL;
    size_t line_count = rows_list(h->rows, NULL, h->row_number, NEWS_MOST, &lines, &h->row_number);
    for (size_t i = 0; i < line_count; i++) add_topic(&n, lines[i].id);
    if (n.count) lounge_wake(h->lounge, n.topic, n.count);
    free(events);
    rows_lines_free(lines, line_count);
    return event_count == NEWS_MOST || line_count == NEWS_MOST;
}

static void *run(void *argument)
{
    herald *h = argument;
    uint64_t seen = 0;
    while (!h->stopping) {
        queue_wait(h->q, &seen, clock_monotonic_ms() + LOOK_MS);
        while (!h->stopping && tell(h)) {
        }
    }
    return NULL;
}

/* Nobody has been told of anything yet, and nobody waits: what is there already is no news. */
static bool catch_up(herald *h, error *e)
{
    return queue_last_event(h->q, &h->event_seq, e);
}

herald *herald_start(queue *q, executor *x, lounge *l, error *e)
{
    herald *h = mem_alloc(sizeof *h);
    h->q = q;
    h->rows = executor_rows(x);
    h->lounge = l;
    int why = 0;
    if (catch_up(h, e)) {
        why = pthread_create(&h->thread, NULL, run, h);
        if (why == 0) return h;
        error_set(e, ERROR_INTERNAL, "no thread for the server: %s", strerror(why));
    }
    free(h);
    return NULL;
}

void herald_stop(herald *h)
{
    if (!h) return;
    h->stopping = true;
    queue_signal(h->q);
    pthread_join(h->thread, NULL);
    free(h);
}

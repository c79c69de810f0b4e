// SPDX-License-Identifier: Apache-2.0
#include "service/api/notifier.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/hash.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/executor/progress_ring.h"

/* Events, and progress lines, that one round reads. If there are more, the next round follows without a
 * wait. */
#define NEWS_MOST 256

struct notifier {
    queue *q;
    progress_ring *progress;
    wait_list *waiting;
    int64_t event_seq, row_number; /* the last event and the last progress line that were read */
};

/* The topics of one round: jobs and their owners. */
typedef struct news_topics {
    const char *topic[4 * NEWS_MOST];
    size_t count;
    char owner_topic[2 * NEWS_MOST][REPLY_TOPIC_SIZE]; /* of each event and each line */
} news_topics;

void notifier_name_topic(const char *owner, char topic[REPLY_TOPIC_SIZE])
{
    /* a collision of two users causes only needless wake-ups */
    snprintf(topic, REPLY_TOPIC_SIZE, "owner:%016" PRIx64, hash_add_text(HASH_NONE, owner));
}

static void add_topic(news_topics *n, const char *topic)
{
    for (size_t i = 0; i < n->count; i++)
        if (strcmp(n->topic[i], topic) == 0) return;
    n->topic[n->count++] = topic;
}

/* Reads new events and progress lines and wakes their topics. If there may be more, or if the events could
 * not be read, the next step need not be woken. */
static int64_t wake_waiters(void *context)
{
    notifier *n = context;
    error e = {0};
    news_topics fresh;
    fresh.count = 0;
    queue_event_page page = {0};
    queue_event_filter filter = {.after_seq = n->event_seq, .limit = NEWS_MOST};
    const bool ok = queue_list_events(n->q, &filter, &page, &e);
    if (!ok)
        log_write(LOG_LEVEL_ERROR, "events cannot be read: %s", e.message);
    else
        n->event_seq = page.position;
    for (size_t i = 0; i < page.count; i++) {
        notifier_name_topic(page.events[i].owner, fresh.owner_topic[i]);
        add_topic(&fresh, page.events[i].id);
        add_topic(&fresh, fresh.owner_topic[i]);
    }
    progress_ring_line *lines = NULL;
    size_t line_count =
        progress_ring_list(n->progress, NULL, NULL, n->row_number, NEWS_MOST, &lines, &n->row_number);
    for (size_t i = 0; i < line_count; i++) {
        char *owner_topic = fresh.owner_topic[page.count + i];
        notifier_name_topic(lines[i].owner, owner_topic);
        add_topic(&fresh, lines[i].id);
        add_topic(&fresh, owner_topic);
    }
    if (fresh.count) wait_list_wake(n->waiting, fresh.topic, fresh.count);
    free(page.events);
    progress_ring_lines_free(lines, line_count);
    if (page.more || line_count == NEWS_MOST) return 0;
    return ok ? RUNNER_WHEN_WOKEN : runner_retry_time();
}

/* Skips the existing events: no connection waits for them. */
static bool catch_up(notifier *n, error *e)
{
    queue_event_page page;
    queue_event_filter filter = {.after_seq = QUEUE_EVENTS_FROM_NOW};
    if (!queue_list_events(n->q, &filter, &page, e)) return false;
    n->event_seq = page.position;
    return true;
}

notifier *notifier_add(runner *to, queue *q, executor *x, wait_list *l, error *e)
{
    notifier *n = mem_alloc(sizeof *n);
    n->q = q;
    n->progress = executor_progress_ring(x);
    n->waiting = l;
    if (catch_up(n, e)) {
        queue_wake_on_change(q, runner_add(to, "notifier", wake_waiters, n));
        return n;
    }
    free(n);
    return NULL;
}

void notifier_free(notifier *n)
{
    free(n);
}

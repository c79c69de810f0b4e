// SPDX-License-Identifier: Apache-2.0
#include "service/webhook/delivery.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <curl/curl.h>
#include <nettle/base64.h>
#include <nettle/hmac.h>

#include "config.h"

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/denial.h"
#include "base/core/memory.h"
#include "base/json/json.h"
#include "files/file.h"

/* Maximum time, in ms, between two checks of the outbox and of the wall clock, which may be set. */
#define CHECK_MS 60000
#define SECRET_LEAST 16
#define SECRET_MOST 4096
/* The form of a key in the Standard Webhooks specification. */
#define KEY_PREFIX "whsec_"
#define KEY_LEAST 24
#define KEY_MOST 64

/* A task that makes the calls given to it, one after another. */
typedef struct caller {
    delivery *c;
    CURL *curl;
    char fault[CURL_ERROR_SIZE];
    runner_task *task;
    queue_delivery delivery;
    bool is_accepted; /* the head of an answer with a status of 2xx has been received */
    char *host;       /* the host being called (webhook_host_of); NULL: idle. Guarded by the mutex */
} caller;

struct delivery {
    delivery_settings settings;
    uint8_t *key;
    size_t key_length;
    queue *q;
    _Atomic int64_t not_before_ms; /* monotonic; after an error of the database */
    runner_task *task;             /* gives due notifications to callers */
    clock_watch watch;             /* used by `task` only */
    pthread_mutex_t mutex;
    caller *callers;
};

/* Decodes the text after KEY_PREFIX. NULL if it is not the base64 text of a key. */
static uint8_t *decode_key(const char *text, size_t *length, error *e)
{
    struct base64_decode_ctx context;
    size_t decoded = 0;
    uint8_t *key = mem_alloc(BASE64_DECODE_LENGTH(strlen(text)) + 1);
    base64_decode_init(&context);
    bool ok =
        base64_decode_update(&context, &decoded, key, strlen(text), text) && base64_decode_final(&context);
    if (ok && decoded >= KEY_LEAST && decoded <= KEY_MOST) {
        *length = decoded;
        return key;
    }
    free(key);
    if (!ok)
        error_set(e, ERROR_SPEC_INVALID, "the text after " KEY_PREFIX " is not base64: write the key again");
    else
        error_set(e, ERROR_SPEC_INVALID,
                  "a key that begins with " KEY_PREFIX " must have %d to %d bytes (given %zu)", KEY_LEAST,
                  KEY_MOST, decoded);
    return NULL;
}

/* The key in the text of a secret, which the caller frees. Takes over the text. */
static uint8_t *take_key(char *text, size_t *length, error *e)
{
    text[strcspn(text, "\r\n")] = '\0';
    if (strncmp(text, KEY_PREFIX, strlen(KEY_PREFIX)) == 0) {
        uint8_t *key = decode_key(text + strlen(KEY_PREFIX), length, e);
        free(text);
        return key;
    }
    *length = strlen(text);
    if (*length >= SECRET_LEAST) return (uint8_t *)text;
    free(text);
    error_set(e, ERROR_SPEC_INVALID, "the secret must have at least %d characters, in one line",
              SECRET_LEAST);
    return NULL;
}

static uint8_t *read_key(const char *path, size_t *key_length, error *e)
{
    size_t length = 0;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* it may be a pipe */
    if (fd < 0) {
        const int fault = errno;
        char *why = denial_explain(path, fault, DENIAL_SECRET, ". Correct this setting.");
        error_set(e, ERROR_SPEC_INVALID, "webhook_secret_file: cannot read %s: %s%s", path, strerror(fault),
                  why);
        free(why);
        return NULL;
    }
    bool is_private = store_file_check_private(fd, path, e);
    close(fd);
    char *text = is_private ? store_file_read(path, SECRET_MOST, &length, e) : NULL;
    uint8_t *key = text ? take_key(text, key_length, e) : NULL;
    if (!text)
        error_prefix(e, "webhook_secret_file");
    else if (!key)
        error_prefix(e, "webhook_secret_file %s", path);
    return key;
}

bool delivery_check_secret(const char *file, error *e)
{
    size_t length = 0;
    uint8_t *key = read_key(file, &length, e);
    free(key);
    return key != NULL;
}

static char *describe(const delivery *c, const queue_delivery *d)
{
    char ended[CLOCK_TEXT_SIZE];
    json *o = json_new_object();
    json_put_string(o, "type", "job.ended");
    json_put_string(o, "timestamp", clock_format_utc(d->ended_ms, ended));
    json *data = json_put_object(o, "data");
    json_put_string(data, "job", d->id);
    json_put_string(data, "state", queue_state_name(d->state));
    json_put_string(data, "outcome", queue_outcome_name(d->outcome));
    json_put_string(data, "name", d->name);
    json_put_text(data, "labels", d->labels);
    json_put_string(data, "traceparent", d->trace);
    json_put_string(data, "host", c->settings.host);
    if (d->copy_state) {
        json *copy = json_put_object(data, "delivery");
        json_put_string(copy, "state", d->copy_state);
        json_put_string(copy, "code", d->copy_code);
        json_put_string(copy, "message", d->copy_message);
    } else {
        json_put_null(data, "delivery");
    }
    char *text = json_print(o);
    json_free(o);
    return text;
}

static struct curl_slist *make_headers(const delivery *c, const queue_delivery *d, const char *body)
{
    struct hmac_sha256_ctx hmac;
    uint8_t digest[SHA256_DIGEST_SIZE];
    char signature[BASE64_ENCODE_RAW_LENGTH(SHA256_DIGEST_SIZE) + 1] = "";
    long long now = clock_wall_ms() / 1000;
    char *content = mem_printf("%s.%lld.%s", d->event, now, body);
    hmac_sha256_set_key(&hmac, c->key_length, c->key);
    hmac_sha256_update(&hmac, strlen(content), (const uint8_t *)content);
    hmac_sha256_digest(&hmac, sizeof digest, digest);
    base64_encode_raw(signature, sizeof digest, digest);
    free(content);
    char *lines[] = {
        mem_strdup("Content-Type: application/json"),
        mem_strdup("Expect:"), /* send a short body without waiting for 100 Continue */
        mem_printf("webhook-id: %s", d->event),
        mem_printf("webhook-timestamp: %lld", now),
        mem_printf("webhook-signature: v1,%s", signature),
        d->trace ? mem_printf("traceparent: %s", d->trace) : NULL,
    };
    struct curl_slist *headers = NULL;
    for (size_t i = 0; i < sizeof lines / sizeof *lines && lines[i]; i++) {
        headers = curl_slist_append(headers, lines[i]);
        free(lines[i]);
    }
    return headers;
}

/* Called for each line of the head. The last line is empty. */
static size_t take_line(char *data, size_t size, size_t count, void *context)
{
    caller *r = context;
    long status = 0;
    if (*data == '\r' || *data == '\n') {
        curl_easy_getinfo(r->curl, CURLINFO_RESPONSE_CODE, &status);
        r->is_accepted = status / 100 == 2;
    }
    return size * count;
}

/* Discards the body of an answer. After a status of 2xx it stops the transfer at the first byte. */
static size_t drop_body(char *data, size_t size, size_t count, void *context)
{
    (void)data;
    const caller *r = context;
    return r->is_accepted ? 0 : size * count; /* 0 stops the transfer */
}

static int check_transfer(void *context, curl_off_t all, curl_off_t got, curl_off_t all_up, curl_off_t up)
{
    (void)all, (void)got, (void)all_up, (void)up;
    const caller *r = context;
    return r->is_accepted || runner_is_stopping(r->task); /* a value other than 0 stops the transfer */
}

/* The answer of a receiver that did not accept a call. */
typedef struct refusal {
    bool gone;           /* it requests no further tries (410) */
    int64_t at_least_ms; /* before the next try */
} refusal;

static refusal read_refusal(const caller *r)
{
    long status = 0;
    curl_off_t after_s = 0;
    curl_easy_getinfo(r->curl, CURLINFO_RESPONSE_CODE, &status);
    if (status == 429 || status == 503) curl_easy_getinfo(r->curl, CURLINFO_RETRY_AFTER, &after_s);
    double wait_s = fmin((double)after_s, r->c->settings.retry_after_s);
    return (refusal){status == 410, (int64_t)(1000 * wait_s)};
}

/* Makes one call. On failure *why is set. */
static bool post(caller *r, refusal *refused, error *why)
{
    const delivery *c = r->c;
    const queue_delivery *d = &r->delivery;
    CURL *curl = r->curl;
    long status = 0;
    r->is_accepted = false;
    if (!webhook_hosts_admit(c->settings.hosts, d->url, why)) return false;
    char *body = describe(c, d);
    struct curl_slist *headers = make_headers(c, d, body);
    curl_easy_reset(curl);
    r->fault[0] = '\0';
    curl_easy_setopt(curl, CURLOPT_ERRORBUFFER, r->fault);
    curl_easy_setopt(curl, CURLOPT_URL, d->url);
    curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(curl, CURLOPT_NOPROXY, "*"); /* connect to the listed hosts directly */
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_USERAGENT, PACKAGE_NAME "/" PACKAGE_VERSION);
    curl_easy_setopt(curl, CURLOPT_TIMEOUT_MS, (long)(c->settings.timeout_s * 1000));
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(curl, CURLOPT_POSTFIELDS, body);
    curl_easy_setopt(curl, CURLOPT_HEADERFUNCTION, take_line);
    curl_easy_setopt(curl, CURLOPT_HEADERDATA, r);
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, drop_body);
    curl_easy_setopt(curl, CURLOPT_WRITEDATA, r);
    curl_easy_setopt(curl, CURLOPT_NOPROGRESS, 0L);
    curl_easy_setopt(curl, CURLOPT_XFERINFOFUNCTION, check_transfer);
    curl_easy_setopt(curl, CURLOPT_XFERINFODATA, r);
    CURLcode code = curl_easy_perform(curl);
    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &status);
    curl_slist_free_all(headers);
    free(body);
    if (r->is_accepted) return true;
    if (code != CURLE_OK)
        return error_set(why, ERROR_INTERNAL, "%s", *r->fault ? r->fault : curl_easy_strerror(code));
    *refused = read_refusal(r);
    return error_set(why, ERROR_INTERNAL, "the receiver answered with status %ld", status);
}

static int64_t wait_ms(const delivery_settings *s, int tries)
{
    double wait_s = s->retry_s;
    for (int i = 0; i < tries && wait_s < s->retry_most_s; i++) wait_s *= 2;
    return (int64_t)(1000 * (wait_s < s->retry_most_s ? wait_s : s->retry_most_s));
}

/* Makes one try and stores its result in the queue. False if it could not be stored. */
static bool deliver(caller *r)
{
    const delivery *c = r->c;
    const queue_delivery *d = &r->delivery;
    error why = {0}, e = {0};
    refusal refused = {0};
    bool is_accepted = post(r, &refused, &why);
    if (!is_accepted && runner_is_stopping(r->task)) return true;
    bool last = refused.gone || d->tries + 1 >= c->settings.tries;
    int64_t wait = wait_ms(&c->settings, d->tries);
    if (wait < refused.at_least_ms) wait = refused.at_least_ms;
    delivery_counters *n = c->settings.counters;
    (*(is_accepted ? &n->delivered : last ? &n->given_up : &n->failed))++;
    if (is_accepted)
        log_write(LOG_LEVEL_INFO, "webhook delivered job=%s event=%s", d->id, d->event);
    else if (last)
        log_write(
            LOG_LEVEL_WARNING,
            "webhook given up job=%s event=%s try=%d: %s; this event is not sent again: repair the receiver, and "
            "see the job with hexadctl show",
            d->id, d->event, d->tries + 1, why.message);
    else
        log_write(LOG_LEVEL_WARNING, "webhook not delivered job=%s event=%s try=%d next_s=%g: %s", d->id,
                  d->event, d->tries + 1, clock_seconds(wait), why.message);
    if (queue_end_delivery(c->q, d->number, is_accepted || last ? 0 : wait < 1 ? 1 : wait, &e)) return true;
    log_write(LOG_LEVEL_ERROR, "webhook will be repeated job=%s event=%s: %s", d->id, d->event, e.message);
    return false;
}

/* Makes the call that was given to the caller, if there is one. */
static int64_t make_call(void *context)
{
    caller *r = context;
    delivery *c = r->c;
    pthread_mutex_lock(&c->mutex);
    const bool given = r->host;
    pthread_mutex_unlock(&c->mutex);
    if (!given) return RUNNER_WHEN_WOKEN;
    if (!deliver(r)) c->not_before_ms = runner_retry_time();
    pthread_mutex_lock(&c->mutex);
    queue_delivery_clear(&r->delivery);
    free(r->host);
    r->host = NULL;
    pthread_mutex_unlock(&c->mutex);
    runner_wake(c->task); /* further calls may wait for this host or for an idle caller */
    return RUNNER_WHEN_WOKEN;
}

/* Returns an idle caller, or NULL; *busy is a JSON array of the hosts that are being called. */
static caller *find_caller(delivery *c, char **busy)
{
    caller *idle = NULL;
    json *hosts = json_new_array();
    pthread_mutex_lock(&c->mutex);
    for (int i = 0; i < c->settings.calls; i++) {
        if (c->callers[i].host)
            json_append_string(hosts, c->callers[i].host);
        else
            idle = &c->callers[i];
    }
    pthread_mutex_unlock(&c->mutex);
    *busy = json_print(hosts);
    json_free(hosts);
    return idle;
}

static void give(caller *r, const queue_delivery *d)
{
    pthread_mutex_lock(&r->c->mutex);
    r->delivery = *d;
    r->host = webhook_host_of(d->url);
    pthread_mutex_unlock(&r->c->mutex);
    runner_wake(r->task);
}

/* Gives due notifications to idle callers. */
static int64_t give_due(void *context)
{
    delivery *c = context;
    if (clock_was_set_back(&c->watch) && !queue_shorten_waits(c->q, NULL)) c->watch = CLOCK_WATCH;
    for (;;) {
        queue_delivery d = {0};
        bool found = false;
        char *busy;
        int64_t now = clock_monotonic_ms(), not_before = c->not_before_ms;
        if (now < not_before) return not_before;
        caller *idle = find_caller(c, &busy);
        bool ok = !idle || queue_next_delivery(c->q, busy, &d, &found, NULL);
        free(busy);
        int64_t ahead_ms = ok && found ? d.due_ms - clock_wall_ms() : CHECK_MS;
        if (!ok) c->not_before_ms = runner_retry_time();
        if (found && ahead_ms <= 0) {
            give(idle, &d);
            continue;
        }
        queue_delivery_clear(&d);
        if (ok) return now + (ahead_ms < CHECK_MS ? ahead_ms : CHECK_MS);
    }
}

void delivery_free(delivery *c)
{
    if (!c) return;
    for (int i = 0; i < c->settings.calls; i++) {
        caller *r = &c->callers[i];
        if (r->curl) curl_easy_cleanup(r->curl);
        queue_delivery_clear(&r->delivery);
        free(r->host);
    }
    pthread_mutex_destroy(&c->mutex);
    free(c->callers);
    free(c->key);
    free(c);
}

static bool open_caller(delivery *c, caller *r, error *e)
{
    r->c = c;
    r->curl = curl_easy_init();
    return r->curl || error_set(e, ERROR_INTERNAL, "cannot initialise libcurl");
}

delivery *delivery_add(runner *to, const delivery_settings *settings, queue *q, error *e)
{
    delivery *c = mem_alloc(sizeof *c);
    c->settings = *settings;
    c->q = q;
    c->watch = CLOCK_WATCH;
    c->callers = mem_alloc((size_t)settings->calls * sizeof *c->callers);
    pthread_mutex_init(&c->mutex, NULL);
    c->key = read_key(settings->secret_file, &c->key_length, e);
    bool ok = c->key != NULL;
    for (int i = 0; ok && i < settings->calls; i++) ok = open_caller(c, &c->callers[i], e);
    if (!ok) {
        delivery_free(c);
        return NULL;
    }
    for (int i = 0; i < settings->calls; i++)
        c->callers[i].task = runner_add(to, "webhook-call", make_call, &c->callers[i]);
    c->task = runner_add(to, "webhooks", give_due, c);
    queue_wake_on_change(q, c->task);
    return c;
}

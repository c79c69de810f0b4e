// SPDX-License-Identifier: Apache-2.0
#include "client/client.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <curl/curl.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "base/core/user_name.h"

#define HTTP "http://"
#define HTTPS "https://"
#define UNIX "unix:"
/* The socket of the systemd service whose settings file `hexad --allow` changes. */
#define SYSTEM_SOCKET "unix:/run/hexad/hexad.sock"
#define CONNECT_TIMEOUT_S 5L
/* Seconds without data after which a reply is abandoned. */
#define STALL_TIMEOUT_S 60L
/* Limit of a document. The largest documents are a job with its spec and a page of a listing. */
#define REPLY_LIMIT_BYTES (64u << 20)

struct client {
    CURL *curl;
    char *server;       /* as the caller gave it */
    char *base;         /* its URL without a trailing slash */
    const char *advice; /* of client_set_advice; NULL: the usual one */
    char fault[CURL_ERROR_SIZE];
};

#define START_UNITS "`systemctl start hexad.socket hexad.service`"
#define RESET_UNITS "`systemctl reset-failed hexad.service hexad.socket`"
#define SHOW_LOG "`journalctl -u hexad -n 20`"
#define WITHOUT_SERVICE "`hexad-worker sample FILE` needs no service"

/* Limit of a line of an event stream. */
#define EVENT_LIMIT_BYTES (1u << 20)

typedef struct buffer {
    char *text;
    size_t length;
} buffer;

client *client_open(const char *server, const char *token, const char *authorities, error *e)
{
    const char *unix_path = strncmp(server, UNIX, strlen(UNIX)) == 0 ? server + strlen(UNIX) : NULL;
    if (!unix_path && strncmp(server, HTTP, strlen(HTTP)) != 0 &&
        strncmp(server, HTTPS, strlen(HTTPS)) != 0) {
        error_set(e, ERROR_SPEC_INVALID,
                  "server %s: must be unix:/path, http://HOST:PORT or https://HOST:PORT", server);
        return NULL;
    }
    client *c = mem_alloc(sizeof *c);
    c->curl = curl_easy_init();
    if (!c->curl) {
        free(c);
        error_set(e, ERROR_INTERNAL, "cannot initialise libcurl: check the memory that is free");
        return NULL;
    }
    c->server = mem_strdup(server);
    c->base = mem_strdup(unix_path ? "http://localhost" : server);
    for (size_t length = strlen(c->base); length && c->base[length - 1] == '/'; length--)
        c->base[length - 1] = '\0';
    if (unix_path) curl_easy_setopt(c->curl, CURLOPT_UNIX_SOCKET_PATH, unix_path);
    if (token) {
        curl_easy_setopt(c->curl, CURLOPT_HTTPAUTH, CURLAUTH_BEARER);
        static const char around[] = " \t\r\n";
        char *trimmed = mem_strdup(token + strspn(token, around));
        for (size_t length = strlen(trimmed); length && strchr(around, trimmed[length - 1]); length--)
            trimmed[length - 1] = '\0';
        curl_easy_setopt(c->curl, CURLOPT_XOAUTH2_BEARER, trimmed);
        free(trimmed);
    }
    if (authorities) curl_easy_setopt(c->curl, CURLOPT_CAINFO, authorities);
    curl_easy_setopt(c->curl, CURLOPT_ERRORBUFFER, c->fault);
    curl_easy_setopt(c->curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(c->curl, CURLOPT_NOPROXY, "*"); /* no proxy: the service is on the local network */
    curl_easy_setopt(c->curl, CURLOPT_CONNECTTIMEOUT, CONNECT_TIMEOUT_S);
    curl_easy_setopt(c->curl, CURLOPT_LOW_SPEED_LIMIT, 1L);
    curl_easy_setopt(c->curl, CURLOPT_LOW_SPEED_TIME, STALL_TIMEOUT_S);
    return c;
}

void client_close(client *c)
{
    if (!c) return;
    curl_easy_cleanup(c->curl);
    free(c->server);
    free(c->base);
    free(c);
}

void client_set_advice(client *c, const char *advice)
{
    c->advice = advice;
}

static size_t take_text(char *data, size_t size, size_t count, void *context)
{
    buffer *b = context;
    size_t length = size * count;
    if (b->length + length > REPLY_LIMIT_BYTES) return 0;
    b->text = mem_resize(b->text, b->length + length + 1);
    memcpy(b->text + b->length, data, length);
    b->length += length;
    b->text[b->length] = '\0';
    return length;
}

/* A file that is downloaded, or the problem document sent instead. */
typedef struct download {
    CURL *curl;
    FILE *stream;
    buffer problem;
} download;

static size_t take_file(char *data, size_t size, size_t count, void *context)
{
    download *d = context;
    long status = 0;
    curl_easy_getinfo(d->curl, CURLINFO_RESPONSE_CODE, &status);
    return status == 200 ? fwrite(data, size, count, d->stream) : take_text(data, size, count, &d->problem);
}

static size_t give_file(char *data, size_t size, size_t count, void *context)
{
    size_t given = fread(data, size, count, context);
    return ferror((FILE *)context) ? CURL_READFUNC_ABORT : given;
}

static size_t ignore(char *data, size_t size, size_t count, void *context)
{
    (void)data;
    (void)context;
    return size * count;
}

/* Whether the service answers without TLS at this https address. The token is not sent. */
static bool answers_without_tls(const client *c)
{
    long status = 0;
    CURL *probe = curl_easy_init();
    char *url = mem_printf("http://%s/healthz", c->base + strlen(HTTPS));
    curl_easy_setopt(probe, CURLOPT_URL, url);
    curl_easy_setopt(probe, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(probe, CURLOPT_NOPROXY, "*");
    curl_easy_setopt(probe, CURLOPT_TIMEOUT, CONNECT_TIMEOUT_S);
    curl_easy_setopt(probe, CURLOPT_WRITEFUNCTION, ignore);
    if (curl_easy_perform(probe) == CURLE_OK) curl_easy_getinfo(probe, CURLINFO_RESPONSE_CODE, &status);
    curl_easy_cleanup(probe);
    free(url);
    return status == 200;
}

/* Whether the units of systemd are installed on this machine. The directories are those of systemd.unit(5). */
static bool has_units(void)
{
    static const char usual[] =
        "/etc/systemd/system:/usr/local/lib/systemd/system:/lib/systemd/system:/usr/lib/systemd/system";
    const char *given = getenv("SYSTEMD_UNIT_PATH"), *rest = given && *given ? given : usual;
    struct stat info;
    bool found = false;
    while (!found && *rest) {
        const size_t length = strcspn(rest, ":");
        char *unit = mem_printf("%.*s/hexad.socket", (int)length, rest);
        found = stat(unit, &info) == 0 && S_ISREG(info.st_mode); /* a masked unit is a link to /dev/null */
        free(unit);
        rest += length + (rest[length] == ':');
    }
    return found;
}

static const char *advice_on_start(const client *c)
{
    if (c->advice) return c->advice;
    return has_units()
               ? "start hexad (as root: " START_UNITS "; after a failed start, " SHOW_LOG
                 " says why, and " RESET_UNITS " is needed first), or name its address with --server or "
                 "HEXAD_SERVER, such as unix:DIR/hexad.sock. " WITHOUT_SERVICE
               : "start hexad (`hexad --state_dir DIR &`; as a service of systemd, install the package hexad "
                 "first), or name its address with --server or HEXAD_SERVER, such as unix:DIR/hexad.sock. " WITHOUT_SERVICE;
}

/* For a Unix socket that was connected and gave no answer. */
static const char *advice_on_silence(void)
{
    return has_units() ? "hexad ended or is stuck: " SHOW_LOG
                         " says why. Correct it; then run as root " RESET_UNITS " and " START_UNITS
                       : "hexad ended or is stuck: its log says why. Correct it and start hexad again";
}

/* Sets the error for a Unix socket to which this user must not connect. */
static bool explain_refusal(const client *c, error *e)
{
    struct stat info;
    char name[USER_NAME_SIZE];
    user_name_of(geteuid(), name);
    bool found = stat(c->server + strlen(UNIX), &info) == 0;
    if (found && strcmp(c->server, SYSTEM_SOCKET) == 0)
        return error_set(e, ERROR_INTERNAL,
                         "%s: the user \"%s\" may not connect: run `hexad --allow %s` as root", c->server,
                         name, name);
    if (found)
        return error_set(
            e, ERROR_INTERNAL,
            "%s: the user \"%s\" may not connect: run `hexad --config FILE --allow %s` as root, with the settings file"
            " of this service, or restart it with %s in its option --unix_users",
            c->server, name, name, name);
    return error_set(
        e, ERROR_INTERNAL,
        "%s: the user \"%s\" cannot enter the directory of this socket: ask its administrator to set listen and"
        " unix_users of hexad",
        c->server, name);
}

static bool explain_no_connection(const client *c, CURLcode code, error *e)
{
    long number = 0; /* libcurl's own message names a port even for a Unix socket */
    curl_easy_getinfo(c->curl, CURLINFO_OS_ERRNO, &number);
    if (number == EACCES && strncmp(c->server, UNIX, strlen(UNIX)) == 0) return explain_refusal(c, e);
    return error_set(e, ERROR_INTERNAL, "%s: cannot connect (%s): %s", c->server,
                     number ? strerror((int)number) : curl_easy_strerror(code), advice_on_start(c));
}

static bool perform(client *c, const char *path, long *status, error *e)
{
    const bool is_unix = strncmp(c->server, UNIX, strlen(UNIX)) == 0;
    char *url = mem_printf("%s%s", c->base, path);
    c->fault[0] = '\0';
    curl_easy_setopt(c->curl, CURLOPT_URL, url);
    CURLcode code = curl_easy_perform(c->curl);
    free(url);
    if (code == CURLE_COULDNT_CONNECT) return explain_no_connection(c, code, e);
    if (code == CURLE_SSL_CONNECT_ERROR && answers_without_tls(c))
        return error_set(
            e, ERROR_INTERNAL,
            "%s: this port does not use TLS: write http://%s, or use the address of the TLS proxy", c->server,
            c->base + strlen(HTTPS));
    if ((code == CURLE_RECV_ERROR || code == CURLE_GOT_NOTHING || code == CURLE_UNSUPPORTED_PROTOCOL) &&
        strncmp(c->server, HTTP, strlen(HTTP)) == 0)
        return error_set(
            e, ERROR_INTERNAL,
            "%s: the server does not answer in HTTP (%s): if this port uses TLS, write https://%s", c->server,
            *c->fault ? c->fault : curl_easy_strerror(code), c->base + strlen(HTTP));
    const bool silent = code == CURLE_RECV_ERROR || code == CURLE_SEND_ERROR || code == CURLE_GOT_NOTHING ||
                        code == CURLE_OPERATION_TIMEDOUT;
    if (code != CURLE_OK)
        return error_set(e, ERROR_INTERNAL, "%s: %s%s%s", c->server,
                         *c->fault ? c->fault : curl_easy_strerror(code), silent && is_unix ? ": " : "",
                         silent && is_unix ? advice_on_silence() : "");
    curl_easy_getinfo(c->curl, CURLINFO_RESPONSE_CODE, status);
    return true;
}

char *client_escape(client *c, const char *text)
{
    char *escaped = curl_easy_escape(c->curl, text, (int)strlen(text));
    char *copy = mem_strdup(escaped ? escaped : "");
    curl_free(escaped);
    return copy;
}

/* Performs a request whose reply is collected in a buffer. Parses the buffer as the reply and frees it. */
static bool perform_for_reply(client *c, const char *path, buffer *b, client_reply *reply, error *e)
{
    long status = 0;
    bool ok = perform(c, path, &status, e);
    curl_off_t again_s = 0;
    if (ok) curl_easy_getinfo(c->curl, CURLINFO_RETRY_AFTER, &again_s);
    if (ok)
        *reply = (client_reply){status, b->text ? json_parse(b->text, b->length, NULL) : NULL,
                                strncmp(c->server, UNIX, strlen(UNIX)) == 0, (long)again_s};
    free(b->text);
    return ok;
}

/* `key`: the Idempotency-Key, or NULL. */
static bool send_request(client *c, const char *method, const char *path, const char *key, const char *body,
                         size_t length, client_reply *reply, error *e)
{
    buffer b = {0};
    struct curl_slist *headers = curl_slist_append(NULL, "Content-Type: application/json");
    char *named = key ? mem_printf("Idempotency-Key: %s", key) : NULL;
    if (named) headers = curl_slist_append(headers, named);
    curl_easy_setopt(c->curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(c->curl, CURLOPT_WRITEFUNCTION, take_text);
    curl_easy_setopt(c->curl, CURLOPT_WRITEDATA, &b);
    bool patch = strcmp(method, "PATCH") == 0;
    if (patch || strcmp(method, "POST") == 0) {
        curl_easy_setopt(c->curl, CURLOPT_POST, 1L);
        curl_easy_setopt(c->curl, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)(body ? length : 0));
        curl_easy_setopt(c->curl, CURLOPT_POSTFIELDS, body ? body : "");
    } else {
        curl_easy_setopt(c->curl, CURLOPT_HTTPGET, 1L);
    }
    if (patch || strcmp(method, "DELETE") == 0) curl_easy_setopt(c->curl, CURLOPT_CUSTOMREQUEST, method);
    bool ok = perform_for_reply(c, path, &b, reply, e);
    curl_easy_setopt(c->curl, CURLOPT_CUSTOMREQUEST, NULL);
    curl_easy_setopt(c->curl, CURLOPT_HTTPHEADER, NULL);
    curl_slist_free_all(headers);
    free(named);
    return ok;
}

bool client_call(client *c, const char *method, const char *path, const char *body, size_t length,
                 client_reply *reply, error *e)
{
    return send_request(c, method, path, NULL, body, length, reply, e);
}

bool client_post_within(client *c, const char *path, const char *body, size_t length, long within_ms,
                        client_reply *reply, error *e)
{
    curl_easy_setopt(c->curl, CURLOPT_TIMEOUT_MS, within_ms);
    bool ok = send_request(c, "POST", path, NULL, body, length, reply, e);
    curl_easy_setopt(c->curl, CURLOPT_TIMEOUT_MS, 0L);
    return ok;
}

bool client_post_once(client *c, const char *path, const char *key, const char *body, size_t length,
                      client_reply *reply, error *e)
{
    return send_request(c, "POST", path, key, body, length, reply, e);
}

void client_reply_clear(client_reply *reply)
{
    json_free(reply->document);
    *reply = (client_reply){0};
}

bool client_download(client *c, const char *path, FILE *stream, client_reply *reply, error *e)
{
    download d = {.curl = c->curl, .stream = stream};
    curl_easy_setopt(c->curl, CURLOPT_HTTPGET, 1L);
    curl_easy_setopt(c->curl, CURLOPT_WRITEFUNCTION, take_file);
    curl_easy_setopt(c->curl, CURLOPT_WRITEDATA, &d);
    return perform_for_reply(c, path, &d.problem, reply, e);
}

bool client_confirm(client *c, const char *path, const char *sha256, client_reply *reply, error *e)
{
    buffer b = {0};
    char *known = mem_printf("If-None-Match: \"%s\"", sha256);
    struct curl_slist *headers = curl_slist_append(NULL, known);
    curl_easy_setopt(c->curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(c->curl, CURLOPT_HTTPGET, 1L);
    curl_easy_setopt(c->curl, CURLOPT_WRITEFUNCTION, take_text);
    curl_easy_setopt(c->curl, CURLOPT_WRITEDATA, &b);
    bool ok = perform_for_reply(c, path, &b, reply, e);
    curl_easy_setopt(c->curl, CURLOPT_HTTPHEADER, NULL);
    curl_slist_free_all(headers);
    free(known);
    return ok;
}

bool client_upload(client *c, const char *path, FILE *stream, int64_t bytes, bool always, client_reply *reply,
                   error *e)
{
    buffer b = {0};
    struct curl_slist *headers = curl_slist_append(NULL, always ? "Expect:" : "Expect: 100-continue");
    curl_easy_setopt(c->curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(c->curl, CURLOPT_UPLOAD, 1L);
    curl_easy_setopt(c->curl, CURLOPT_INFILESIZE_LARGE, (curl_off_t)bytes);
    curl_easy_setopt(c->curl, CURLOPT_READFUNCTION, give_file);
    curl_easy_setopt(c->curl, CURLOPT_READDATA, stream);
    curl_easy_setopt(c->curl, CURLOPT_WRITEFUNCTION, take_text);
    curl_easy_setopt(c->curl, CURLOPT_WRITEDATA, &b);
    bool ok = perform_for_reply(c, path, &b, reply, e);
    curl_easy_setopt(c->curl, CURLOPT_UPLOAD, 0L);
    curl_easy_setopt(c->curl, CURLOPT_HTTPHEADER, NULL);
    curl_slist_free_all(headers);
    return ok;
}

/* An event stream, line by line. */
typedef struct listener {
    CURL *curl;
    FILE *stream;
    int64_t id;
    char *line;
    size_t length;
    buffer problem; /* the problem document sent instead of events */
} listener;

static void take_line(listener *l)
{
    if (strncmp(l->line, "id: ", 4) == 0) l->id = strtoll(l->line + 4, NULL, 10);
    if (strncmp(l->line, "data: ", 6) == 0) {
        terminal_text_write(l->stream, TERMINAL_TEXT_JSON, l->line + 6, strlen(l->line + 6));
        fputc('\n', l->stream);
        fflush(l->stream);
    }
}

static size_t take_events(char *data, size_t size, size_t count, void *context)
{
    listener *l = context;
    long status = 0;
    curl_easy_getinfo(l->curl, CURLINFO_RESPONSE_CODE, &status);
    if (status != 200) return take_text(data, size, count, &l->problem);
    for (size_t i = 0; i < size * count; i++) {
        if (l->length == EVENT_LIMIT_BYTES) return 0;
        l->line[l->length++] = data[i] == '\n' ? '\0' : data[i];
        if (data[i] != '\n') continue;
        take_line(l);
        l->length = 0;
    }
    return size * count;
}

bool client_follow(client *c, const char *path, int64_t *last, FILE *stream, client_reply *reply, error *e)
{
    listener l = {.curl = c->curl, .stream = stream, .id = *last, .line = mem_alloc(EVENT_LIMIT_BYTES)};
    char *position = mem_printf("Last-Event-ID: %lld", (long long)*last);
    struct curl_slist *headers = curl_slist_append(NULL, "Accept: text/event-stream");
    if (*last) headers = curl_slist_append(headers, position);
    curl_easy_setopt(c->curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(c->curl, CURLOPT_HTTPGET, 1L);
    curl_easy_setopt(c->curl, CURLOPT_WRITEFUNCTION, take_events);
    curl_easy_setopt(c->curl, CURLOPT_WRITEDATA, &l);
    bool ok = perform_for_reply(c, path, &l.problem, reply, e);
    curl_easy_setopt(c->curl, CURLOPT_HTTPHEADER, NULL);
    curl_slist_free_all(headers);
    *last = l.id;
    free(position);
    free(l.line);
    return ok;
}

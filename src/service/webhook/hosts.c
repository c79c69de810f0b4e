// SPDX-License-Identifier: Apache-2.0
#include "service/webhook/hosts.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <curl/curl.h>

#include "base/core/memory.h"

typedef struct host {
    char *name, *port; /* port NULL: the default port of the scheme */
} host;

struct webhook_hosts {
    size_t count;
    host *item;
};

/* A part of a URL, which the caller frees; NULL if the URL does not have it. */
static char *take_part(CURLU *address, CURLUPart part, unsigned flags)
{
    char *text = NULL;
    if (curl_url_get(address, part, &text, flags) != CURLUE_OK) return NULL;
    char *copy = mem_strdup(text);
    curl_free(text);
    return copy;
}

static bool is_bare(CURLU *address)
{
    char *path = take_part(address, CURLUPART_PATH, 0), *query = take_part(address, CURLUPART_QUERY, 0),
         *fragment = take_part(address, CURLUPART_FRAGMENT, 0);
    bool bare = path && strcmp(path, "/") == 0 && !query && !fragment;
    free(path);
    free(query);
    free(fragment);
    return bare;
}

static bool read_host(const char *text, host *h, error *e)
{
    CURLU *address = curl_url();
    char *url = mem_printf("http://%s", text);
    bool ok = address && !strchr(text, '/') &&
              curl_url_set(address, CURLUPART_URL, url, CURLU_DISALLOW_USER) == CURLUE_OK && is_bare(address);
    if (ok) {
        h->name = take_part(address, CURLUPART_HOST, 0);
        h->port = take_part(address, CURLUPART_PORT, 0);
    }
    free(url);
    curl_url_cleanup(address);
    return (ok && h->name) ||
           error_set(e, ERROR_SPEC_INVALID, "webhook_hosts: must be HOST or HOST:PORT (given %s)", text);
}

webhook_hosts *webhook_hosts_read(const char *const *texts, size_t count, error *e)
{
    webhook_hosts *hosts = mem_alloc(sizeof *hosts);
    bool ok = true;
    hosts->item = mem_alloc((count + 1) * sizeof *hosts->item); /* + 1: never a size of 0 */
    for (size_t i = 0; ok && i < count; i++) ok = read_host(texts[i], &hosts->item[hosts->count++], e);
    if (ok) return hosts;
    webhook_hosts_free(hosts);
    return NULL;
}

void webhook_hosts_free(webhook_hosts *hosts)
{
    if (!hosts) return;
    for (size_t i = 0; i < hosts->count; i++) {
        free(hosts->item[i].name);
        free(hosts->item[i].port);
    }
    free(hosts->item);
    free(hosts);
}

static bool is_listed(const webhook_hosts *hosts, const char *scheme, const char *name, const char *port)
{
    const char *usual = strcmp(scheme, "https") == 0 ? "443" : "80";
    bool listed = false;
    for (size_t i = 0; i < hosts->count; i++) {
        const host *h = &hosts->item[i];
        listed |= strcasecmp(h->name, name) == 0 && strcmp(h->port ? h->port : usual, port) == 0;
    }
    return listed;
}

bool webhook_hosts_admit(const webhook_hosts *hosts, const char *url, error *e)
{
    if (!hosts || hosts->count == 0)
        return error_set(e, ERROR_SPEC_INVALID,
                         "this service calls no webhooks: remove this member, or set webhook_hosts");
    CURLU *address = curl_url();
    CURLUcode code =
        address ? curl_url_set(address, CURLUPART_URL, url, CURLU_DISALLOW_USER) : CURLUE_OUT_OF_MEMORY;
    char *scheme = NULL, *name = NULL, *port = NULL;
    bool ok = code == CURLUE_OK;
    if (ok) {
        scheme = take_part(address, CURLUPART_SCHEME, 0);
        name = take_part(address, CURLUPART_HOST, 0);
        port = take_part(address, CURLUPART_PORT, CURLU_DEFAULT_PORT);
    }
    if (!ok)
        error_set(e, ERROR_SPEC_INVALID, "must be an http or https URL without a user: %s",
                  curl_url_strerror(code));
    else if (!(ok = scheme && (strcmp(scheme, "http") == 0 || strcmp(scheme, "https") == 0) && name && port))
        error_set(e, ERROR_SPEC_INVALID, "must be an http or https URL");
    else if (!(ok = is_listed(hosts, scheme, name, port)))
        error_set(e, ERROR_SPEC_INVALID,
                  "this service does not call %s:%s: choose a host that its setting webhook_hosts lists",
                  name, port);
    free(scheme);
    free(name);
    free(port);
    curl_url_cleanup(address);
    return ok;
}

char *webhook_address(const char *url)
{
    CURLU *address = curl_url();
    char *text = NULL;
    if (address && curl_url_set(address, CURLUPART_URL, url, CURLU_DISALLOW_USER) == CURLUE_OK)
        text = take_part(address, CURLUPART_URL, CURLU_DEFAULT_PORT);
    curl_url_cleanup(address);
    char *begin = text ? strstr(text, "://") : NULL;
    /* the text after % is the name of a network interface, which keeps its case */
    for (char *c = begin ? begin + 3 : NULL; c && *c && !strchr("/%", *c); c++) *c = (char)tolower(*c);
    return text;
}

char *webhook_host_of(const char *address)
{
    const char *begin = strstr(address, "://");
    size_t length = begin ? (size_t)(begin - address) + 3 : 0;
    length += strcspn(address + length, "/");
    return mem_strndup(address, length + (address[length] == '/'));
}

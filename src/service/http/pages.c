// SPDX-License-Identifier: Apache-2.0
#include "service/http/pages.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/core/memory.h"

struct pages {
    char **host; /* "localhost:8080" */
    size_t host_count;
    char **origin;
    size_t origin_count;
};

static const char own_scheme[] = "http://";

static void add_host(pages *p, const char *host, size_t length, const char *port)
{
    bool default_port = strcmp(port, "80") == 0; /* browsers leave it out */
    mem_add_text(&p->host, &p->host_count,
                 default_port ? mem_strndup(host, length) : mem_printf("%.*s:%s", (int)length, host, port));
}

/* Whether a text is "http://" or "https://" with a possible host and an optional port. */
static bool is_origin(const char *text)
{
    const char *host = strstr(text, "://");
    if (!host || (strncmp(text, "http://", 7) != 0 && strncmp(text, "https://", 8) != 0)) return false;
    host += 3;
    return *host && !host[strcspn(host, "/?#@ \t\"\\ABCDEFGHIJKLMNOPQRSTUVWXYZ")];
}

void pages_add(pages *p, const char *listen, const char *served)
{
    static const char *const loopback[] = {"localhost", "127.0.0.1", "[::1]"};
    const char *port = strrchr(served, ':'), *colon = strrchr(listen, ':');
    if (!port || strncmp(served, "unix:", 5) == 0) return;
    add_host(p, served, (size_t)(port - served), port + 1);
    for (size_t i = 0; i < 3; i++) add_host(p, loopback[i], strlen(loopback[i]), port + 1);
    if (colon && colon > listen) add_host(p, listen, (size_t)(colon - listen), port + 1);
}

pages *pages_new(const char *const *origins, size_t count, error *e)
{
    pages *p = mem_alloc(sizeof *p);
    p->origin = mem_alloc(count * sizeof *p->origin);
    for (size_t i = 0; i < count; i++) {
        if (!is_origin(origins[i])) {
            error_set(e, ERROR_SPEC_INVALID,
                      "page_origins: must be scheme://host:port in lower case, without a path (given %s)",
                      origins[i]);
            pages_free(p);
            return NULL;
        }
        p->origin[p->origin_count++] = mem_strdup(origins[i]);
    }
    return p;
}

void pages_free(pages *p)
{
    if (!p) return;
    mem_free_texts(p->host, p->host_count);
    mem_free_texts(p->origin, p->origin_count);
    free(p);
}

static bool is_own_host(const pages *p, const char *host)
{
    for (size_t i = 0; i < p->host_count; i++)
        if (strcasecmp(p->host[i], host) == 0) return true;
    return false;
}

bool pages_is_host(const pages *p, const char *host)
{
    for (size_t i = 0; i < p->origin_count; i++)
        if (strcasecmp(strstr(p->origin[i], "://") + 3, host) == 0) return true;
    return is_own_host(p, host);
}

bool pages_is_listed(const pages *p, const char *origin)
{
    for (size_t i = 0; i < p->origin_count; i++)
        if (strcmp(p->origin[i], origin) == 0) return true;
    return false;
}

bool pages_has_listed(const pages *p)
{
    return p->origin_count > 0;
}

bool pages_is_permitted(const pages *p, const char *origin)
{
    size_t length = sizeof own_scheme - 1;
    return pages_is_listed(p, origin) ||
           (strncasecmp(origin, own_scheme, length) == 0 && is_own_host(p, origin + length));
}

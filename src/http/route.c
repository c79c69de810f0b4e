#include "http/route.h"

#include <stdio.h>
#include <string.h>

typedef struct route {
    const char *method, *pattern;
    jobs_handler *handler;
    bool takes_body;
} route;

static const route routes[] = {
    {"POST", "/v1/jobs", jobs_submit, true},
    {"GET", "/v1/jobs", jobs_list, false},
    {"GET", "/v1/jobs/{id}", jobs_show, false},
    {"POST", "/v1/jobs/{id}/cancel", jobs_cancel, false},
    {"GET", "/v1/jobs/{id}/results", jobs_list_results, false},
    {"GET", "/v1/jobs/{id}/results/{name}", jobs_send_result, false},
    {"GET", "/healthz", jobs_health, false},
    {"GET", "/version", jobs_version, false},
};

/* Walks pattern and path part by part; a {..} takes any part that is not empty. */
static bool fits(const char *pattern, const char *path, size_t *starts, size_t *lengths)
{
    size_t count = 0;
    const char *start = path;
    while (*pattern == '/' && *path == '/') {
        size_t want = strcspn(++pattern, "/"), have = strcspn(++path, "/");
        if (*pattern == '{') {
            if (!have) return false;
            starts[count] = (size_t)(path - start);
            lengths[count++] = have;
        } else if (want != have || strncmp(pattern, path, want) != 0) {
            return false;
        }
        pattern += want;
        path += have;
    }
    return !*pattern && !*path;
}

static void allow(route_match *match, const char *method)
{
    size_t used = strlen(match->allow);
    snprintf(match->allow + used, sizeof match->allow - used, "%s%s%s", used ? ", " : "", method,
             strcmp(method, "GET") == 0 ? ", HEAD" : "");
}

void route_find(const char *method, const char *path, route_match *match)
{
    *match = (route_match){0};
    if (strlen(path) >= sizeof match->path) return;
    if (strcmp(method, "HEAD") == 0) method = "GET";
    for (size_t i = 0; i < sizeof routes / sizeof *routes; i++) {
        size_t starts[JOBS_MAX_PARAMETERS] = {0}, lengths[JOBS_MAX_PARAMETERS] = {0};
        if (!fits(routes[i].pattern, path, starts, lengths)) continue;
        match->known = true;
        allow(match, routes[i].method);
        if (strcmp(routes[i].method, method) != 0) continue;
        match->handler = routes[i].handler;
        match->takes_body = routes[i].takes_body;
        strcpy(match->path, path);
        for (size_t p = 0; p < JOBS_MAX_PARAMETERS; p++) {
            if (!lengths[p]) continue;
            match->parameter[p] = match->path + starts[p];
            match->path[starts[p] + lengths[p]] = '\0';
        }
    }
}

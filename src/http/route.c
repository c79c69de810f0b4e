#include "http/route.h"

#include <stdio.h>
#include <string.h>

#include "http/backup.h"
#include "http/change.h"
#include "http/events.h"
#include "http/inputs.h"
#include "http/jobs.h"
#include "http/openapi.h"
#include "http/results.h"
#include "http/status.h"
#include "http/tasks.h"

#define EXAMPLE                                                                                         \
    "{'version':1,'name':'ball','surface':{'analytic':{'shape':'sphere','center':[0,0,0],'radius':1}}," \
    "'sampling':{'count':1000},'queue':{'priority':5,'labels':['example']}}"
#define BODY_PROBLEMS "json_invalid body_too_large media_type_unsupported spec_invalid path_forbidden "

static const route routes[] = {
    {"POST", "/v1/jobs", jobs_submit, SCOPE_SUBMIT, true, NULL, "submitJob", "Submit a job", "",
     "Idempotency-Key traceparent", "JobSpec", EXAMPLE, "201:Job",
     BODY_PROBLEMS "idempotency_mismatch too_many_jobs"},
    {"GET", "/v1/jobs", jobs_list, SCOPE_READ, false, NULL, "listJobs", "List jobs, the newest first",
     "state owner label limit cursor", "", NULL, NULL, "200:JobPage", ""},
    {"POST", "/v1/jobs:validate", jobs_validate, SCOPE_READ, true, NULL, "validateJob",
     "Check a spec without submitting it, and tell what it would take", "", "", "JobSpec", EXAMPLE,
     "200:Validation",
     BODY_PROBLEMS "input_damaged grid_missing grid_ambiguous isovalue_required no_surface"},
    {"GET", "/v1/jobs/{id}", jobs_show, SCOPE_READ, false, NULL, "getJob", "Look at a job", "",
     "If-None-Match Prefer", NULL, NULL, "200:Job 304:-", "not_found"},
    {"PATCH", "/v1/jobs/{id}", change_edit, SCOPE_CANCEL, true, NULL, "editJob",
     "Change priority, labels or retention", "", "If-Match", "JobPatch", "{'priority':7,'labels':['urgent']}",
     "200:Job",
     "not_found precondition_failed json_invalid body_too_large media_type_unsupported spec_invalid"},
    {"DELETE", "/v1/jobs/{id}", change_delete, SCOPE_CANCEL, true, NULL, "deleteJob",
     "Forget a job that has ended, with its results", "", "", NULL, NULL, "204:-", "not_found conflict"},
    {"POST", "/v1/jobs/{id}/cancel", change_cancel, SCOPE_CANCEL, true, NULL, "cancelJob", "Cancel a job", "",
     "", NULL, NULL, "200:Job 202:Job", "not_found conflict"},
    {"POST", "/v1/jobs/{id}/pause", change_pause, SCOPE_CANCEL, true, NULL, "pauseJob",
     "Start no attempt of a job until it is resumed", "", "", NULL, NULL, "200:Job", "not_found conflict"},
    {"POST", "/v1/jobs/{id}/resume", change_resume, SCOPE_CANCEL, true, NULL, "resumeJob",
     "Resume a job that was paused", "", "", NULL, NULL, "200:Job", "not_found conflict"},
    {"POST", "/v1/jobs/{id}/retry", change_retry, SCOPE_CANCEL, true, NULL, "retryJob",
     "Run what has failed of a job that has ended again", "", "", NULL, NULL, "200:Job",
     "not_found conflict"},
    {"GET", "/v1/jobs/{id}/tasks", tasks_list, SCOPE_READ, false, NULL, "listTasks", "List a job's tasks",
     "after limit", "", NULL, NULL, "200:TaskPage", "not_found"},
    {"GET", "/v1/jobs/{id}/attempts", tasks_list_attempts, SCOPE_READ, false, NULL, "listAttempts",
     "List the attempts of a job", "", "", NULL, NULL, "200:Attempts", "not_found"},
    {"GET", "/v1/jobs/{id}/log", tasks_show_log, SCOPE_READ, false, NULL, "getLog", "What a worker said",
     "frame attempt", "", NULL, NULL, "200:text", "not_found"},
    {"GET", "/v1/jobs/{id}/events", events_of_job, SCOPE_READ, false, NULL, "followJob",
     "What happened to a job, as pages or as a stream", "after limit", "Last-Event-ID", NULL, NULL,
     "200:EventPage 204:-", "not_found"},
    {"GET", "/v1/events", events_of_all, SCOPE_READ, false, NULL, "followJobs",
     "What happens to the caller's jobs from now on; for an admin, to all", "after job owner label limit",
     "Last-Event-ID", NULL, NULL, "200:EventPage", "not_found"},
    {"GET", "/v1/jobs/{id}/results", results_list, SCOPE_READ, true, NULL, "listResults",
     "List a job's results", "frame", "", NULL, NULL, "200:Results", "not_found conflict"},
    {"GET", "/v1/jobs/{id}/results/{name}", results_send, SCOPE_READ, true, NULL, "getResult",
     "Fetch a result, or a part of it", "frame", "Range If-Range If-None-Match", NULL, NULL,
     "200:file 206:file 304:-", "not_found conflict range_not_satisfiable"},
    {"GET", "/v1/workers", status_workers, SCOPE_READ, false, NULL, "listWorkers", "What runs, and what may",
     "", "", NULL, NULL, "200:Workers", ""},
    {"PUT", "/v1/inputs/{sha256}", inputs_put, SCOPE_SUBMIT, true, inputs_begin, "putInput",
     "Send a file that jobs may read", "", "", "file", NULL, "200:Input 201:Input",
     "body_too_large digest_mismatch storage_full"},
    {"GET", "/v1/inputs/{sha256}", inputs_show, SCOPE_READ, false, NULL, "getInput",
     "Whether an input is there", "", "", NULL, NULL, "200:Input", "not_found"},
    {"DELETE", "/v1/inputs/{sha256}", inputs_delete, SCOPE_ADMIN, true, NULL, "deleteInput",
     "Delete an input", "", "", NULL, NULL, "204:-", "not_found"},
    {"POST", "/v1/admin/drain", status_drain, SCOPE_ADMIN, false, NULL, "drain",
     "Take no more jobs and start no attempts; what runs goes on", "", "", NULL, NULL, "200:Drain", ""},
    {"POST", "/v1/admin/resume", status_resume, SCOPE_ADMIN, false, NULL, "resume", "End a drain", "", "",
     NULL, NULL, "200:Drain", ""},
    {"GET", "/v1/backup", backup_send, SCOPE_ADMIN, true, NULL, "getBackup",
     "A whole copy of the database as it is now, to be kept", "", "", NULL, NULL, "200:file",
     "database_damaged storage_full"},
    {"GET", "/v1/openapi.json", openapi_show, 0, false, NULL, "getOpenapi", "This document", "", "", NULL,
     NULL, "200:Openapi", ""},
    {"GET", "/healthz", status_health, 0, false, NULL, "getHealth", "Whether the service is alive", "", "",
     NULL, NULL, "200:Health", ""},
    {"GET", "/readyz", status_ready, 0, false, NULL, "getReadiness", "Whether the service takes jobs", "", "",
     NULL, NULL, "200:Readiness", "database_damaged"},
    {"GET", "/metrics", status_metrics, SCOPE_READ, false, NULL, "getMetrics", "Figures for Prometheus", "",
     "", NULL, NULL, "200:text", ""},
    {"GET", "/version", status_version, 0, false, NULL, "getVersion", "What is running", "", "", NULL, NULL,
     "200:Version", ""},
};

#define COUNT (sizeof routes / sizeof *routes)

const route *route_at(size_t index)
{
    return index < COUNT ? &routes[index] : NULL;
}

/* A {..} takes any part of the path that is not empty. */
static bool fits(const char *pattern, const char *path, size_t *starts, size_t *lengths)
{
    size_t count = 0;
    const char *start = path;
    while (*pattern && *path) {
        if (*pattern == '{') {
            size_t have = strcspn(path, "/");
            if (!have) return false;
            starts[count] = (size_t)(path - start);
            lengths[count++] = have;
            pattern += strcspn(pattern, "/");
            path += have;
        } else if (*pattern++ != *path++) {
            return false;
        }
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
    for (size_t i = 0; !match->found && i < COUNT; i++) {
        size_t starts[HTTP_MAX_PARAMETERS] = {0}, lengths[HTTP_MAX_PARAMETERS] = {0};
        if (!fits(routes[i].pattern, path, starts, lengths)) continue;
        match->known = true;
        if (strcmp(routes[i].method, method) != 0) {
            allow(match, routes[i].method);
            continue;
        }
        match->found = &routes[i];
        strcpy(match->path, path);
        for (size_t p = 0; p < HTTP_MAX_PARAMETERS; p++) {
            if (!lengths[p]) continue;
            match->parameter[p] = match->path + starts[p];
            match->path[starts[p] + lengths[p]] = '\0';
        }
    }
}

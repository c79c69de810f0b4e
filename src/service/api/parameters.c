// SPDX-License-Identifier: Apache-2.0
#include "service/api/parameters.h"

#include <string.h>

#include "service/queue/queue.h"

static const char *state_at(size_t index)
{
    return index < QUEUE_STATE_COUNT ? queue_state_name((queue_state)index) : NULL;
}

/* The words of `sort`: for each order the descending one, with a minus, and the ascending one. */
static const char *const order_words[2 * QUEUE_ORDER_COUNT] = {
    [2 * QUEUE_BY_AGE] = "-created",       "created",  [2 * QUEUE_BY_NAME] = "-name",   "name",
    [2 * QUEUE_BY_OWNER] = "-owner",       "owner",    [2 * QUEUE_BY_STATE] = "-state", "state",
    [2 * QUEUE_BY_PRIORITY] = "-priority", "priority",
};

static const char *order_at(size_t index)
{
    return index < 2 * QUEUE_ORDER_COUNT ? order_words[index] : NULL;
}

const char *parameters_read_order(const http_request *request, queue_order *order, bool *rising)
{
    const char *word = parameter_text(request, "sort", order_words[0]);
    size_t i = 0;
    while (strcmp(order_words[i], word) != 0) i++;
    *order = (queue_order)(i / 2);
    *rising = i % 2;
    return order_words[i];
}

static const parameter parameters[] = {
    {.name = "id",
     .type = PARAMETER_TEXT,
     .low = 26,
     .high = 26,
     .pattern = "^[0-9a-z]{26}$",
     .example = "06faddpyxsd3g6zk16mtd9v23g",
     .prose = "The id of a job."},
    {.name = "name",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 255,
     .example = "points.ply",
     .prose =
         "The name of a result, as in the list of results; of a list of jobs: only those of this name; of an "
         "upload: the name of the file, which only its sender sees."},
    {.name = "sha256",
     .type = PARAMETER_TEXT,
     .low = 64,
     .high = 64,
     .pattern = "^[0-9a-f]{64}$",
     .example = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
     .prose = "The SHA-256 of the file: 64 hexadecimal digits in lower case."},
    {.name = "state",
     .type = PARAMETER_WORDS,
     .word = state_at,
     .schema = "State",
     .remark =
         "; converged, not_converged and unresolved are outcomes of succeeded jobs: list these (hexadctl list "
         "--state succeeded --json) and select by the member outcome",
     .prose = "Only jobs in this state, or in one of these: `queued,running`."},
    {.name = "limit",
     .type = PARAMETER_INTEGER,
     .low = 1,
     .high = 500,
     .otherwise = "50",
     .prose = "The maximum number of entries of a page. A page of jobs or events examines at most "
              "4096 entries and may be short or empty before the list ends: the list ends when "
              "`next` is null."},
    {.name = "owner",
     .type = PARAMETER_TEXT,
     .low = 0,
     .high = 64,
     .example = "alice",
     .prose = "Only jobs of this user, or their events."},
    {.name = "label",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 400,
     .example = "shot=010",
     .prose = "Only jobs with this label, or their events."},
    {.name = "depends_on",
     .type = PARAMETER_TEXT,
     .low = 26,
     .high = 26,
     .pattern = "^[0-9a-z]{26}$",
     .prose = "Only jobs whose `queue.depends_on` or `queue.after` contains this ID: those of the "
              "caller, or for an administrator those of all users."},
    {.name = "text",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 255,
     .example = "ball",
     .prose = "Only jobs with this text in their name; the case of ASCII letters does not matter."},
    {.name = "sort",
     .type = PARAMETER_WORD,
     .word = order_at,
     .otherwise = "-created",
     .prose = "The sort key of the list, over all its pages: ascending, or descending with a "
              "minus. Names are compared without regard to the case of ASCII letters. Jobs with "
              "equal keys are sorted by age, the newest first with a minus."},
    {.name = "created_after",
     .type = PARAMETER_TIME,
     .example = "2026-01-31T18:00:00Z",
     .prose = "Only jobs that were submitted at this time or later: RFC 3339, such as "
              "2026-01-31T18:00:00Z, or with another offset; without an offset, or as a date, UTC."},
    {.name = "created_before",
     .type = PARAMETER_TIME,
     .prose = "Only jobs that were submitted before this time."},
    {.name = "job",
     .type = PARAMETER_TEXT,
     .low = 26,
     .high = 26,
     .pattern = "^[0-9a-z]{26}$",
     .prose = "Only events of the job with this id."},
    {.name = "after",
     .type = PARAMETER_INTEGER,
     .low = 0,
     .high = 999999999999999999,
     .prose = "`next` or `position` of the previous page: the list continues after it. 0: from the"
              " oldest entry. Without it `/v1/events` begins now, and other lists at their"
              " beginning."},
    {.name = "path",
     .type = PARAMETER_TEXT,
     .low = 0,
     .high = 4096,
     .example = "/srv/volumes",
     .prose = "A directory below an input root. Without it, or empty: the roots themselves."},
    {.name = "progress",
     .type = PARAMETER_INTEGER,
     .low = 0,
     .high = 1,
     .otherwise = "0",
     .prose =
         "1: the stream has the progress of running attempts of the caller's jobs as well, whatever the label of "
         "these jobs; for an administrator of all jobs."},
    {.name = "all",
     .type = PARAMETER_INTEGER,
     .low = 0,
     .high = 1,
     .otherwise = "0",
     .prose =
         "1: the events of the jobs of all users; of an upload, as an administrator: delete it for all users, at "
         "once."},
    {.name = "dependents",
     .type = PARAMETER_INTEGER,
     .low = 0,
     .high = 1,
     .otherwise = "0",
     .prose = "1: also the jobs that ended as dependency_failed because of this one, directly or "
              "indirectly, if the caller may retry them."},
    {.name = "within_ms",
     .type = PARAMETER_INTEGER,
     .low = 1,
     .high = 600000,
     .prose = "The time limit of the estimate in milliseconds. A client that submits the spec next "
              "uses it to detect faults quickly. Default: the setting estimate_timeout_s."},
    {.name = "frame",
     .type = PARAMETER_INTEGER,
     .low = -2147483647,
     .high = 2147483647,
     .prose = "The frame of an array job."},
    {.name = "attempt",
     .type = PARAMETER_INTEGER,
     .low = 1,
     .high = 2147483647,
     .prose = "The number of the attempt. Default: the last one."},
    {.name = "Idempotency-Key",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 255,
     .example = "shot010-v3",
     .prose = "An identifier of this request. A repeated request with the same body creates no "
              "second job; with another body it is refused. A key belongs to its user and is valid "
              "until the job is deleted."},
    {.name = "traceparent",
     .type = PARAMETER_TEXT,
     .low = 55,
     .high = 55,
     .example = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
     .prose = "W3C Trace Context. It is stored with the job and goes into the logs, the environment of the "
              "worker (TRACEPARENT) and webhooks."},
    {.name = "If-Match",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 1000,
     .prose = "The ETag of the job: it changes only if it still has this ETag."},
    {.name = "If-None-Match",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 1000,
     .prose = "The known ETag: the answer is 304 if it is still valid."},
    {.name = "Prefer",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 1000,
     .example = "wait=30",
     .prose =
         "wait=SECONDS: the answer waits until the job has ended or, with If-None-Match, has changed, for "
         "at most SECONDS and at most the setting wait_limit_s. Preference-Applied in the answer has the "
         "time that was used."},
    {.name = "Range",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 1000,
     .example = "bytes=0-1023",
     .prose = "bytes=FIRST-LAST: a part of the file."},
    {.name = "If-Range",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 1000,
     .prose = "The ETag that Range refers to: with another ETag the whole file is sent."},
    {.name = "Last-Event-ID",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 18,
     .example = "4711",
     .prose = "The id of the last received event: the stream continues after it. It takes"
              " precedence over the parameter `after`."},
    {.name = "cursor",
     .type = PARAMETER_TEXT,
     .low = 1,
     .high = 1000, /* the longest cursor is a number and an encoded name of 200 characters */
     .prose = "`next` of the previous page; of jobs with the same `sort`."},
};

const parameter_table api_parameters = {parameters, sizeof parameters / sizeof *parameters};

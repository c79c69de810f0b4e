/* job_json: the JSON of jobs, their tasks, attempts, events and workers, as answers have it, and the ETag of a job. No
 * state; any thread.
 *
 * This is the one place that decides what a reader sees of a job of another user; doc/http.md has the list. Members that
 * the OpenAPI document requires are null, [], 0 or false there, and others are missing. Of a failure such a reader gets the
 * code and the title of that code. Functions without a viewer are for owners and administrators only. */
#ifndef HEXAD_API_JOB_JSON_H
#define HEXAD_API_JOB_JSON_H

#include <stdbool.h>
#include <stdint.h>

#include "auth/access.h"
#include "json/json.h"
#include "queue/queue.h"

#define JOB_JSON_TAG_SIZE 40

typedef enum job_json_viewer { JOB_JSON_READER, JOB_JSON_OWNER } job_json_viewer;

/* Administrators see what the owner sees. */
job_json_viewer job_json_viewer_of(const access_caller *caller, const char *owner);

/* `progress` is the last line of its worker, NULL: there is none. */
json *job_json_new(const queue_job *job, job_json_viewer viewer, const char *progress);

/* Adds `spec`, as it was submitted, and `paths`, the mapped ones of its paths; both are JSON text or NULL. */
void job_json_put_spec(json *object, job_json_viewer viewer, const char *stored_spec,
                       const char *stored_paths);

json *job_json_new_event(const queue_event *event, job_json_viewer viewer);

/* A worker that runs an attempt. */
void job_json_append_worker(json *list, const queue_claimed *running, job_json_viewer viewer);

/* Adds `notes`, what people should know of the result of a job or a frame of it: null where there is none. Only for who may
 * see the result. */
void job_json_put_notes(json *object, const char *work_dir, const char *id, int frame, bool succeeded);

/* Returns the task's object. */
json *job_json_append_task(json *list, const queue_task *task);
void job_json_append_attempt(json *list, const queue_job *job, const queue_attempt *attempt);

/* Puts a time as RFC 3339, null for 0. */
void job_json_put_time(json *object, const char *key, int64_t wall_ms);

/* Puts a text that the service stored as JSON, null for NULL. */
void job_json_put_stored(json *object, const char *key, const char *text);

/* The ETag of a job: its revision and, while there is progress, a hash of that: `"7"`, `"7.1f3a9c02"`. */
void job_json_print_tag(const queue_job *job, const char *progress, char tag[JOB_JSON_TAG_SIZE]);

/* Reads the revision out of an ETag; false when it is not one of a job. */
bool job_json_read_tag(const char *tag, int64_t *revision);

#endif

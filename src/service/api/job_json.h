// SPDX-License-Identifier: Apache-2.0
/* job_json: the JSON of jobs, their tasks, attempts, events and workers in answers, and the ETag of a job. No
 * state; any thread.
 *
 * Only this file decides which members a reader gets of a job of another user; doc/http.md lists them. Hidden
 * members that the OpenAPI document requires are null, [], 0 or false; other hidden members are missing.
 * Instead of the message of a failure such a reader gets the title of its code. Functions without the
 * parameter `viewer` are for owners and administrators only. */
#ifndef HEXAD_SERVICE_API_JOB_JSON_H
#define HEXAD_SERVICE_API_JOB_JSON_H

#include <stdbool.h>
#include <stdint.h>

#include "service/auth/access.h"
#include "base/json/json.h"
#include "service/queue/queue.h"
#include "service/uploads/upload_store.h"

#define JOB_JSON_TAG_SIZE 40 /* of an ETag, with the terminating 0 */

/* How much an answer shows of a job. An owner who is an administrator is the latter. The owner gets the same
 * members as an administrator, but learns less of other jobs to which the job is related
 * (service/queue/relation). */
typedef enum job_json_viewer { JOB_JSON_READER, JOB_JSON_OWNER, JOB_JSON_ADMINISTRATOR } job_json_viewer;

job_json_viewer job_json_viewer_of(const access_caller *caller, const char *owner);

/* The job whose result was reused; NULL: there is none, or the viewer may not learn of it. */
const char *job_json_cached_from(const queue_job *job, job_json_viewer viewer);

/* The set of outcomes (queue.h) of spec.accept. */
unsigned job_json_outcomes(unsigned accept);

/* Members of a document that can change while the revision of the job does not. */
typedef struct job_json_live {
    char *progress;      /* the last progress line of its worker (JSON text); NULL: none */
    char *input;         /* for a job without a name: the name of the first file of its surface; NULL: none */
    bool input_is_label; /* a user gave an uploaded file the name `input` */
    char *error_message; /* of the job, with names of uploaded files; NULL: as it is stored */
    int ahead;           /* see queue_count_ahead; -1: the job does not wait for its turn */
} job_json_live;

/* The text with the names that the user gave uploaded files: `sha256:HEX.obj` becomes `bunny.obj (sha256:8a73d5b2...)`.
 * NULL: it names no file of that user. The caller frees it. */
char *job_json_name_files(const char *text, const store_inputs *inputs, const char *user);

/* Names the files in the message of an error of a worker in this way. */
void job_json_name_files_of_error(error *e, const store_inputs *inputs, const char *user);

/* Sets `input`, `input_is_label` and `error_message`. The name of an uploaded file is the one that `user`, the caller,
 * gave it. */
void job_json_find_names(job_json_live *live, const queue_job *job, job_json_viewer viewer,
                         const store_inputs *inputs, const char *user);
void job_json_live_clear(job_json_live *live);
/* Whether the document of the job changes with its revision only. */
bool job_json_is_fixed(const job_json_live *live);

/* The document of a job without `spec`, `paths`, `notes` and `attempts`, to be freed. */
json *job_json_new(const queue_job *job, job_json_viewer viewer, const job_json_live *live);

/* Adds the members `spec`, with the paths of the client, and `paths`, the list of mapped paths
 * (service/api/paths.h). Both are stored as JSON text, or NULL. */
void job_json_put_spec(json *object, job_json_viewer viewer, const char *stored_spec,
                       const char *stored_paths);

/* The document of an event, to be freed. */
json *job_json_new_event(const queue_event *event, job_json_viewer viewer);

/* Appends the document of the worker that runs this attempt. `host` NULL: not known. */
void job_json_append_worker(json *list, const queue_claimed *running, job_json_viewer viewer,
                            const char *host);

/* Adds the member `notes` of a result (service/results/result.h); null if the job or frame has none. Call it
 * only for callers who may read the result. `frame` may be QUEUE_NO_FRAME. */
void job_json_put_notes(json *object, const char *work_dir, const char *id, int frame, bool succeeded);

/* Appends the document of a task and returns it; the list owns it. `inputs`, `user`: as above. */
json *job_json_append_task(json *list, const queue_task *task, const store_inputs *inputs, const char *user);
/* Appends the document of an attempt. */
void job_json_append_attempt(json *list, const queue_job *job, const queue_attempt *attempt);

/* Adds a time (wall clock) in the format of RFC 3339; null for 0. */
void job_json_put_time(json *object, const char *key, int64_t wall_ms);

/* Adds a value that the service stored as JSON text; null for NULL. */
void job_json_put_stored(json *object, const char *key, const char *text);

/* Prints the ETag of a job: its revision and, if the document is not fixed, a hash of `live`: `"7"`,
 * `"7.1f3a9c02"`. */
void job_json_print_tag(const queue_job *job, const job_json_live *live, char tag[JOB_JSON_TAG_SIZE]);

/* Reads the revision from an ETag; false if it is not an ETag of a job. */
bool job_json_read_tag(const char *tag, int64_t *revision);

#endif

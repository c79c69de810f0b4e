// SPDX-License-Identifier: Apache-2.0
/* cache: reuse of results for jobs that are equal to an earlier one.
 *
 * The key is a hash of the program's version and of those parts of the spec that a result depends on. For a
 * release candidate (a version with ~) it contains the commit, too. A job with a time target has no key. An entry describes every input file as it was when the result was computed:
 * path, size, device, inode, times of change, and SHA-256. The entry is valid while none of these has
 * changed. Checking that reads no file. Jobs with a task per frame are not cached. No state; any thread.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_CACHE_H
#define HEXAD_SERVICE_EXECUTOR_CACHE_H

#include <stdbool.h>
#include <stdint.h>

#include "base/json/json.h"
#include "service/results/result.h"
#include "files/file.h"
#include "files/root.h"

/* False: this is a release candidate that was built without its commit. Its keys are equal to those of other
 * such builds of the same version. */
bool cache_identifies_build(void);

/* The key of a normalised spec for this version of the program: equal keys, equal results. False: the result
 * of such a job is never reused. */
bool cache_key(const json *spec, char key[STORE_HASH_SIZE]);

/* Describes the state of the input files in a result's report, as a text that the caller frees. NULL (the
 * result cannot be cached): a path no longer leads to the file that the worker opened (the report has its
 * size, inode and times), or a file was changed after `since_ms` (wall clock, start of the attempt), or
 * cannot be examined. */
char *cache_describe_inputs(const store_roots *roots, const char *directory, int64_t since_ms);

/* Whether no input has changed since it was described. */
bool cache_is_fresh(const store_roots *roots, const char *inputs);

/* Compares the files of the result in `from` with their hashes. Then creates the directory `to` with hard links
 * to them, and with its own report, which has this spec. *r describes the result; the caller clears it. Reads
 * all files, until the deadline: for a thread of its own. Errors: those of result_read, result_compare and
 * own_report_copy. */
bool cache_link_result(const char *from, const char *to, const char *spec, const store_deadline *end,
                       result *r, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
/* own_report: the report of a job whose result was computed for an equal job.
 *
 * A report contains the spec, and with it data of the job's owner: name, labels, output.directory, webhook.
 * Jobs that share a result therefore share all its files except report.json; each job has a report.json with
 * its own spec. Early builds made a hard link to the report of the other job; the first start of a
 * later version replaces these links.
 */
#ifndef HEXAD_SERVICE_RESULTS_OWN_REPORT_H
#define HEXAD_SERVICE_RESULTS_OWN_REPORT_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/json/json.h"
#include "service/queue/queue.h"
#include "service/results/result.h"

/* Writes report.json in the directory `to`: a copy of the report in `from` with this spec (JSON text), and
 * its summary. `r` and `document` must come from result_read_short of `from`; `document` is changed. `to` may
 * equal `from`. An existing report.json is replaced by a new file, so other hard links to the old one stay
 * unchanged. The report is copied as a stream and never held in memory as a whole. Errors: input_damaged;
 * errors of reading and writing files. */
bool own_report_copy(const char *from, const char *to, const char *spec, const result *r, json *document,
                     error *e);

/* Replaces the report in the directory of a result if its spec differs from this one (JSON text). Errors:
 * those of result_read_report and own_report_copy. */
bool own_report_correct(const char *directory, const char *spec, error *e);

/* Corrects, once for a queue of an earlier version, the reports of all jobs whose results were computed for
 * other jobs. Skips damaged and missing results with a warning. Other errors stop it; the next start
 * repeats it. */
bool own_report_correct_all(queue *q, const char *work_dir, error *e);

#endif

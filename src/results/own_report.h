/* own_report: the report of a job whose result was computed for an equal job.
 *
 * A report contains the spec, and with it data of the job's owner: name, labels, output.directory, webhook. Jobs that share
 * a result share its other files only. Each has a report.json of its own, with its own spec. Versions before 1.1 gave such
 * a job a hard link to the report of the other job; a start replaces these once.
 */
#ifndef HEXAD_RESULTS_OWN_REPORT_H
#define HEXAD_RESULTS_OWN_REPORT_H

#include <stdbool.h>

#include "base/error.h"
#include "json/json.h"
#include "queue/queue.h"
#include "results/result.h"

/* Writes report.json in the directory `to`: a copy of the report in `from` with this spec (JSON text), and its summary. `r`
 * and `document` are what result_read_short read in `from`; the document is changed. `to` may be `from`. An existing report.json
 * is replaced, and the file that it was a hard link of stays as it is. The report may be long: it is copied piece by piece. */
bool own_report_copy(const char *from, const char *to, const char *spec, const result *r, json *document,
                     error *e);

/* Replaces the report in the directory of a result if it has another spec than this one. */
bool own_report_correct(const char *directory, const char *spec, error *e);

/* The step that is done once for a queue of an earlier version: corrects the reports of all jobs whose results were
 * computed for other jobs. A result that is damaged or missing is skipped, with a warning. */
bool own_report_correct_all(queue *q, const char *work_dir, error *e);

#endif

// SPDX-License-Identifier: Apache-2.0
/* results: the files of a finished job. Each is written under a temporary name, read from the disk again,
 * compared with what was written, and then renamed (files/file.h). */
#ifndef HEXAD_JOB_PHASES_RESULTS_H
#define HEXAD_JOB_PHASES_RESULTS_H

#include "job/phases/result_delivery.h"

/* The files of spec->output, in a directory, which is created if missing. The report is written last, after the
 * summary: a directory with a report is complete. Errors of delivery.points also: storage_failed if a file is not
 * read as it was written. The text of the name outlives the delivery. */
delivery results_in_directory(const char *directory);

#endif

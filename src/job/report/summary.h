// SPDX-License-Identifier: Apache-2.0
/* summary: console output for a finished job, from its report. */
#ifndef HEXAD_JOB_REPORT_SUMMARY_H
#define HEXAD_JOB_REPORT_SUMMARY_H

#include <stdio.h>

#include "base/json/json.h"

/* Prints one line of measures to `out`, and warnings, failed criteria and advice to `err`. */
void summary_print(const json *report, FILE *out, FILE *err);

#endif

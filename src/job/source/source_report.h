// SPDX-License-Identifier: Apache-2.0
/* source_report: describes an opened surface in the report. */
#ifndef HEXAD_JOB_SOURCE_SOURCE_REPORT_H
#define HEXAD_JOB_SOURCE_SOURCE_REPORT_H

#include "base/json/json.h"
#include "job/source/source.h"

/* Adds `inputs` to the report, the properties of a volume to `members`, and warnings to `warnings`. */
void source_describe(const source *s, json *report, json *members, json *warnings);

#endif

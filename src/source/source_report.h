/* source_report: what the report says of the surface that was opened. */
#ifndef HEXAD_SOURCE_SOURCE_REPORT_H
#define HEXAD_SOURCE_SOURCE_REPORT_H

#include "json/json.h"
#include "source/source.h"

/* Adds `inputs` to the report, those of a volume to `members`, and warnings. */
void source_describe(const source *s, json *report, json *members, json *warnings);

#endif

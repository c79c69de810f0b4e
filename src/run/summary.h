/* summary: what the console says of a finished job, from its report. */
#ifndef HEXAD_RUN_SUMMARY_H
#define HEXAD_RUN_SUMMARY_H

#include <stdio.h>

#include "json/json.h"

/* One line of measures to `out`; what was not as asked for, and why, to `err`. */
void summary_print(const json *report, FILE *out, FILE *err);

#endif

/* progress_bar: shows the progress of a job on standard error: on a terminal a bar that is redrawn, otherwise
 * a line whenever the state or the phase changes. One thread. */
#ifndef HEXAD_CLIENT_PROGRESS_BAR_H
#define HEXAD_CLIENT_PROGRESS_BAR_H

#include <stdbool.h>

#include "json/json.h"

typedef struct progress_bar {
    bool terminal, drawn;
    char last[64]; /* state and phase last shown */
} progress_bar;

void progress_bar_init(progress_bar *b);
void progress_bar_show(progress_bar *b, json_at job); /* `job` as GET /v1/jobs/{id} gives it */
void progress_bar_clear(progress_bar *b);             /* removes the bar */

#endif

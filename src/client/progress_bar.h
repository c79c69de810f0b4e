/* progress_bar: shows progress on standard error: on a terminal a bar that is redrawn, otherwise, for a job, a line
 * whenever its state, its phase or the number of its frames that have ended changes. One thread. */
#ifndef HEXAD_CLIENT_PROGRESS_BAR_H
#define HEXAD_CLIENT_PROGRESS_BAR_H

#include <stdbool.h>

#include "json/json.h"

typedef struct progress_bar {
    bool terminal, drawn;
    bool identify; /* whether a job is shown with its id and name; set after the init */
    char last[96]; /* what was shown last */
} progress_bar;

void progress_bar_init(progress_bar *b);
void progress_bar_show(progress_bar *b, json_at job);                /* `job` as GET /v1/jobs/{id} gives it */
void progress_bar_show_count(progress_bar *b, int done, int frames); /* on a terminal only */
void progress_bar_clear(progress_bar *b);                            /* removes the bar */

#endif

// SPDX-License-Identifier: Apache-2.0
/* progress_bar: shows progress on standard error. On a terminal it is a bar that is redrawn. Otherwise a line
 * is printed for a job whenever its state, its phase or its number of ended frames changes. One thread.
 */
#ifndef HEXAD_CLIENT_PROGRESS_BAR_H
#define HEXAD_CLIENT_PROGRESS_BAR_H

#include <stdbool.h>

#include "base/json/json.h"

typedef struct progress_bar {
    bool terminal, drawn;
    bool identify; /* show jobs with id and name; set it after the init */
    char last[96]; /* the text shown last */
} progress_bar;

void progress_bar_init(progress_bar *b);
/* `job` as in the answer to GET /v1/jobs/{id} */
void progress_bar_show(progress_bar *b, json_at job);
void progress_bar_show_text(progress_bar *b, const char *text);      /* on a terminal only */
void progress_bar_show_count(progress_bar *b, int done, int frames); /* on a terminal only */
void progress_bar_clear(progress_bar *b);                            /* removes the bar */

#endif

/* meter: shows the progress of a job on standard error. On a terminal a bar that is redrawn; else a
 * line whenever state or phase change. One thread. */
#ifndef HEXAD_CLIENT_METER_H
#define HEXAD_CLIENT_METER_H

#include <stdbool.h>

#include "json/json.h"

typedef struct meter {
    bool terminal, drawn;
    char last[64]; /* state and phase last shown */
} meter;

void meter_init(meter *m);
void meter_show(meter *m, json_at job); /* `job` as GET /v1/jobs/{id} gives it */
void meter_clear(meter *m);             /* takes the bar away */

#endif

/* inputs: the handlers of /v1/inputs, the files that clients upload for their jobs (store/inputs.h). */
#ifndef HEXAD_API_INPUTS_H
#define HEXAD_API_INPUTS_H

#include "api/context.h"

http_opener inputs_begin; /* of PUT: opens the sink that inputs_put finishes */
http_handler inputs_put, inputs_show, inputs_delete;

#endif

/* inputs: the handlers of /v1/inputs, files that clients send for their jobs (store/inputs.h). */
#ifndef HEXAD_API_INPUTS_H
#define HEXAD_API_INPUTS_H

#include "api/context.h"

http_opener inputs_begin; /* of PUT: opens a sink, which inputs_put ends */
http_handler inputs_put, inputs_show, inputs_delete;

#endif

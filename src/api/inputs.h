/* inputs: the handlers of /v1/inputs, the files that clients upload for their jobs (store/inputs.h). */
#ifndef HEXAD_API_INPUTS_H
#define HEXAD_API_INPUTS_H

#include "api/context.h"

/* Whether jobs of the caller may read the file of this hash: the caller has sent its bytes, or is an administrator, or
 * what is sent is shared. To know a hash is not enough. The file may be gone. */
bool inputs_may_use(const http_context *c, const access_caller *caller, const char *hex);

/* Whether a job of the caller may read the file at this path (no pattern), and it is there. If it was sent, it counts as used
 * from now on. Errors: those of store_open_input. */
bool inputs_check(const http_context *c, const access_caller *caller, const char *path, error *e);

http_opener inputs_begin; /* of PUT: opens the sink that inputs_put finishes */
http_handler inputs_put, inputs_show, inputs_delete, inputs_inspect;

#endif

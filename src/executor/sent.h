/* sent: what a worker may read, of which files that clients have sent are those that its spec names. */
#ifndef HEXAD_EXECUTOR_SENT_H
#define HEXAD_EXECUTOR_SENT_H

#include <stddef.h>

#include "store/inputs.h"

/* Paths, for sent_free_roots: of `inputs` (NULL: there are none) those files that members named "path" of the
 * spec name, whether they are there or not, which is a use of them; then the roots that are given. */
char **sent_list_roots(const char *spec, store_inputs *inputs, const char *const *given, size_t given_count,
                       size_t *count);
void sent_free_roots(char **roots, size_t count);

#endif

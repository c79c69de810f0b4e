// SPDX-License-Identifier: Apache-2.0
/* own_spec: the spec of one frame of a data set (queue.files), with the name of its file only. No state; any
 * thread. */
#ifndef HEXAD_SERVICE_RESULTS_OWN_SPEC_H
#define HEXAD_SERVICE_RESULTS_OWN_SPEC_H

/* A copy of a spec, both as text, with the list of this one name in queue.files; the caller frees it.
 * NULL: the text is not the JSON of an object. */
char *own_spec_make(const char *spec, const char *name);

#endif

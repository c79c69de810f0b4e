/* sent: which of the files that clients have sent a job reads. */
#ifndef HEXAD_EXECUTOR_SENT_H
#define HEXAD_EXECUTOR_SENT_H

#include <stddef.h>

typedef struct sent_files {
    char **path;
    size_t count;
} sent_files;

/* Those in `directory` (store/inputs.h) that members named "path" of the spec name, whether they are there or not.
 * NULL for a directory has none. */
sent_files sent_files_of(const char *spec, const char *directory);
void sent_files_clear(sent_files *files);

#endif

/* sandbox: what a process that reads files from outside may still do, for itself and all that it starts.
 *
 * Three walls, none of which can be taken down again: no new privileges; a seccomp filter that knows the
 * calls of a worker and answers ENOSYS to every other (no sockets but a stream between its own processes, no
 * tracing, no name spaces, no mounts, no rings); and Landlock, where the kernel has it: files are read below the places that were named, written
 * below one, and the only programs to execute are this one and its loader. Libraries stay readable where the
 * loader looks for them, as a worker loads those that it needs when it needs them. The only user of
 * libseccomp.
 *
 * A process enters before it has threads and before it looks at a byte from outside. Under the sanitizers the
 * filter knows the calls of their runtimes as well, /proc can be read, and leaks are not looked for.
 */
#ifndef HEXAD_BASE_SANDBOX_H
#define HEXAD_BASE_SANDBOX_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "base/words.h"

/* available: what the kernel has; required: an error where it lacks Landlock or filters */
#define SANDBOX_LIST(ENTRY, prefix)       \
    ENTRY(prefix, OFF, "off")             \
    ENTRY(prefix, AVAILABLE, "available") \
    ENTRY(prefix, REQUIRED, "required")

typedef enum sandbox_mode { SANDBOX_LIST(WORDS_ENUMERATOR, SANDBOX) SANDBOX_MODES } sandbox_mode;

typedef struct sandbox_places {
    const char *const *readable; /* files that can be read, and directories below which all can */
    size_t readable_count;
    const char *writable; /* a directory below which files can be made, read, renamed and removed */
} sandbox_places;

/* "off", "available", "required"; false and *mode untouched for any other name. */
bool sandbox_mode_from_name(const char *name, sandbox_mode *mode);
const char *sandbox_mode_name(sandbox_mode mode);

/* Whether this kernel can do what the mode asks for; internal and a message when not. */
bool sandbox_check(sandbox_mode mode, error *e);

/* Enters, for good. On failure the process may be restricted in part: it should end. SANDBOX_OFF does
 * nothing. Places must be there. */
bool sandbox_enter(sandbox_mode mode, const sandbox_places *places, error *e);

/* What sandbox_enter puts up on this kernel, for the log; asked before it. */
enum { SANDBOX_TEXT_SIZE = 96 };
const char *sandbox_describe(sandbox_mode mode, char text[SANDBOX_TEXT_SIZE]);

#endif

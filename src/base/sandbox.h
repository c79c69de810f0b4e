/* sandbox: restricts a process that reads untrusted files, and all that it starts. The only user of libseccomp.
 *
 * Three restrictions, none of which can be lifted again:
 * - no new privileges;
 * - a seccomp filter that allows the system calls of a worker. Others return ENOSYS: no sockets except stream pairs, no
 *   tracing, no namespaces, no mounts, no io_uring;
 * - Landlock, where the kernel has it: reading below the given places, writing below one, executing this program and
 *   its loader only. Libraries stay readable where the loader looks for them, since a worker loads modules late.
 *
 * A process enters before it starts threads and before it reads untrusted bytes. With the sanitizers the filter also
 * allows the calls of their runtimes, /proc is readable, and leaks are not searched.
 */
#ifndef HEXAD_BASE_SANDBOX_H
#define HEXAD_BASE_SANDBOX_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "base/words.h"

/* What the kernel tells of the process itself, its memory among it: readable in the sandbox too. */
#define SANDBOX_OWN_STATUS "/proc/self/status"

/* available: as much as the kernel supports; required: an error if it lacks Landlock or filters */
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

/* Whether this kernel supports the mode. Error: internal. */
bool sandbox_check(sandbox_mode mode, error *e);

/* Restricts the process for the rest of its life. After a failure it may be restricted in part and should end.
 * SANDBOX_OFF does nothing. The places must exist. */
bool sandbox_enter(sandbox_mode mode, const sandbox_places *places, error *e);

/* Describes for the log what sandbox_enter will do on this kernel; call it before. */
enum { SANDBOX_TEXT_SIZE = 96 };
const char *sandbox_describe(sandbox_mode mode, char text[SANDBOX_TEXT_SIZE]);

#endif

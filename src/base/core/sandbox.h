// SPDX-License-Identifier: Apache-2.0
/* sandbox: restricts a process that reads untrusted files, and all processes that it starts. The only user of
 * libseccomp.
 *
 * Three permanent restrictions:
 * - no new privileges;
 * - a seccomp filter that permits the system calls of a worker. Others return ENOSYS: no sockets except
 *   stream pairs, no tracing, no namespaces, no mounts, no io_uring. No call acts on another process or sends a
 *   signal, also to the process itself: abort ends by SIGSEGV (SIGTRAP on ARM), and a parent cannot kill a child;
 * - Landlock, if the kernel has it: reading below the given places, writing below one, executing only this
 *   program and its loader. Libraries remain readable where the loader searches them, since a worker loads
 *   modules late.
 *
 * A process enters before it starts threads and before it reads untrusted bytes. With sanitizers the filter
 * also permits the system calls of their runtimes, such as kill, /proc is readable, and leaks are not detected.
 */
#ifndef HEXAD_BASE_CORE_SANDBOX_H
#define HEXAD_BASE_CORE_SANDBOX_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "base/core/words.h"

/* Status of the process itself, such as its memory: readable in the sandbox, too. */
#define SANDBOX_OWN_STATUS "/proc/self/status"

/* available: as far as the kernel supports it; required: an error if it lacks Landlock or filters */
#define SANDBOX_LIST(ENTRY, prefix)       \
    ENTRY(prefix, OFF, "off")             \
    ENTRY(prefix, AVAILABLE, "available") \
    ENTRY(prefix, REQUIRED, "required")

typedef enum sandbox_mode { SANDBOX_LIST(WORDS_ENUMERATOR, SANDBOX) SANDBOX_MODES } sandbox_mode;

typedef struct sandbox_places {
    const char *const *readable; /* readable files, and directories below which all files are readable */
    size_t readable_count;
    /* directory below which files can be created, read, renamed and removed; NULL: there is none */
    const char *writable;
} sandbox_places;

/* "off", "available", "required". False, with *mode unchanged, for any other name. */
bool sandbox_mode_from_name(const char *name, sandbox_mode *mode);
const char *sandbox_mode_name(sandbox_mode mode);

/* Whether this kernel supports the mode. Error: internal. */
bool sandbox_check(sandbox_mode mode, error *e);

/* Restricts the process permanently. After a failure it may be partly restricted and should end. SANDBOX_OFF
 * does nothing. The places must exist. Error: internal. */
bool sandbox_enter(sandbox_mode mode, const sandbox_places *places, error *e);

/* Describes, for the log, the effect of sandbox_enter on this kernel; call it before. Returns `text`. */
enum { SANDBOX_TEXT_SIZE = 192 };
const char *sandbox_describe(sandbox_mode mode, char text[SANDBOX_TEXT_SIZE]);

#endif

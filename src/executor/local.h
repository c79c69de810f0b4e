/* local: the engine that runs an attempt as a process of this machine.
 *
 * The worker runs in a process group of its own, is killed when the daemon dies, holds no descriptor of the
 * daemon, leaves no core file, gains no privileges, writes no file longer than it may, is ended before the
 * daemon when memory runs out, and has an address space of its memory limit plus a headroom (not under
 * AddressSanitizer, whose shadow would not fit). What else it may not do it sees to itself, as it is told to
 * (base/sandbox). Its spec comes on standard input, progress lines leave on descriptor 3; of standard error
 * the last LOCAL_LOG_BYTES are kept.
 * Only async-signal-safe calls stand between fork and exec, so the daemon may have threads;
 * attempts must be started from a thread that lives as long as they do.
 */
#ifndef HEXAD_EXECUTOR_LOCAL_H
#define HEXAD_EXECUTOR_LOCAL_H

#include "executor/engine.h"

/* What memory_mb does not speak of: code and shared libraries; and for each thread that a worker
 * may start a stack (8 MiB) and an arena of the allocator (64 MiB of addresses, hardly any of
 * memory). */
#define LOCAL_HEADROOM_MB 512
#define LOCAL_HEADROOM_PER_CORE_MB 80
/* Descriptors of a worker beside those of its input roots: a job has a handful. */
#define LOCAL_OPEN_FILES 128
#define LOCAL_LOG_BYTES (64 * 1024)
/* Progress lines are some hundred bytes; a longer one is no progress line and is ignored. */
#define LOCAL_LINE_BYTES 4096

/* How much sooner the kernel ends a worker than the daemon when memory runs out (oom_score_adj): a worker that dies costs
 * an attempt, the daemon all of them. Half of the memory's size, so that other programs that grow without end still
 * come before a worker that takes little. */
#define LOCAL_OOM_SCORE 500

extern const engine engine_local;

#endif

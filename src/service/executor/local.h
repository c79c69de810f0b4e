// SPDX-License-Identifier: Apache-2.0
/* local: the engine that runs an attempt as a process of this machine.
 *
 * The worker runs in its own process group and is killed if the daemon dies. It inherits no descriptor of the
 * daemon, writes no core file, gains no privileges, and cannot write files above a maximum size. If memory is
 * exhausted, the kernel kills it before the daemon. Its address space is limited to its memory limit plus a
 * headroom (not under AddressSanitizer, whose shadow memory would not fit). With control groups the kernel
 * limits its memory. The worker enters its sandbox itself (base/core/sandbox). It reads its spec from
 * standard input and writes progress lines to descriptor 3. The last LOCAL_LOG_BYTES of its standard error
 * are kept. Only async-signal-safe calls are made between fork and exec, so that the daemon may have threads.
 * A thread that starts attempts must live as long as they do.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_LOCAL_H
#define HEXAD_SERVICE_EXECUTOR_LOCAL_H

#include "service/executor/engine.h"

/* Address space that memory_mb does not cover: code and shared libraries; and for each thread a stack (8 MiB)
 * and an arena of the allocator (64 MiB of addresses, but little memory). */
#define LOCAL_HEADROOM_MB 512
#define LOCAL_HEADROOM_PER_CORE_MB 80
/* Open files of a worker, in addition to its input roots. A job needs a handful. */
#define LOCAL_OPEN_FILES 128
#define LOCAL_LOG_BYTES (64 * 1024)
/* A progress line has some hundred bytes. A longer line than this is ignored. */
#define LOCAL_LINE_BYTES 4096

/* Added to the oom_score_adj of a worker, so that the kernel kills it before the daemon if memory is
 * exhausted: that loses one attempt instead of all. 500 corresponds to half of the memory, so that another
 * program that grows without limit is still killed before a small worker. */
#define LOCAL_OOM_SCORE 500

/* Added to the nice value of a worker: the daemon answers requests before workers compute. */
#define LOCAL_NICE 5

extern const engine engine_local;

#endif

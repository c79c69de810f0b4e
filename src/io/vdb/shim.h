// SPDX-License-Identifier: Apache-2.0
/* shim: shared by the C++ units of this folder. Not for C. */
#ifndef HEXAD_IO_VDB_SHIM_H
#define HEXAD_IO_VDB_SHIM_H

#include <exception>
#include <ios>
#include <iostream>
#include <new>
#include <stdexcept>
#include <string>

#include <tbb/global_control.h>

#include "io/vdb/vdb.h"

namespace shim {

/* An exception with an error code. */
struct fault : std::runtime_error {
    fault(error_code c, const std::string &message) : std::runtime_error(message), code(c) {}
    error_code code;
};

/* Closes std::cout, to which the library logs, because the program writes its answer there. The level of
 * logging cannot be set without log4cplus. */
struct quiet {
    quiet() : before(std::cout.rdbuf(nullptr)) {}
    ~quiet() { std::cout.rdbuf(before); }
    std::streambuf *before;
};

/* The library frees trees in parallel. Reading does not benefit from that, and a worker with a limited
 * address space has no memory for the stacks and heaps of a thread per core. The limit is not removed: its
 * end would start threads, which a fork would leave in an undefined state. */
inline void use_one_thread()
{
    static const tbb::global_control *const one =
        new tbb::global_control(tbb::global_control::max_allowed_parallelism, 1);
    (void)one;
}

/* Runs `body` and converts exceptions to *e. `what` names the object that is read or written. The library's
 * message is kept. */
template <typename Body> bool guard(error *e, error_code otherwise, const char *what, Body body)
{
    try {
        use_one_thread();
        quiet meanwhile;
        body();
        return true;
    } catch (const fault &f) {
        return error_set(e, f.code, "%s", f.what());
    } catch (const std::bad_alloc &) {
        return error_set(e, ERROR_LIMIT_MEMORY, "not enough memory for %s: raise limits.memory_mb", what);
    } catch (const std::length_error &) {
        return error_set(e, otherwise, "%s cannot be read: a length in it is impossible", what);
    } catch (const std::ios_base::failure &) {
        return error_set(e, otherwise, "ends within %s: it is truncated or damaged. Copy or save it again.",
                         what);
    } catch (const std::exception &x) {
        return error_set(e, otherwise, "%s failed: %s", what, x.what());
    } catch (...) {
        return error_set(e, otherwise, "%s failed", what);
    }
}

} // namespace shim

#ifdef __SANITIZE_ADDRESS__
/* OpenVDB 10.0 leaks one node if reading fails within a tree's topology. This cannot be prevented from
 * outside, and a leak report would change the exit code of a worker that reports a damaged file. The
 * library's functions have no names in a report, so the library itself is suppressed. Weak: each unit has
 * its own definition. */
extern "C" __attribute__((weak)) const char *__lsan_default_options(void);
extern "C" __attribute__((weak)) const char *__lsan_default_options(void)
{
    return "print_suppressions=0";
}
extern "C" __attribute__((weak)) const char *__lsan_default_suppressions(void);
extern "C" __attribute__((weak)) const char *__lsan_default_suppressions(void)
{
    return "leak:RootNode*readTopology\nleak:libopenvdb\n";
}
#endif

#endif

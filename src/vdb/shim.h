/* shim: what the two C++ units of this folder share. Not for C. */
#ifndef HEXAD_VDB_SHIM_H
#define HEXAD_VDB_SHIM_H

#include <cstdio>
#include <exception>
#include <new>
#include <stdexcept>
#include <string>

#include "vdb/vdb.h"

namespace shim {

/* A fault that already knows its code. */
struct fault : std::runtime_error {
    fault(error_code c, const std::string &message) : std::runtime_error(message), code(c) {}
    error_code code;
};

/* Runs `body` and turns whatever it throws into *e. Library messages are kept: they say what the
 * reader stumbled over. */
template <typename Body> bool guard(error *e, error_code otherwise, const char *doing, Body body)
{
    try {
        body();
        return true;
    } catch (const fault &f) {
        return error_set(e, f.code, "%s", f.what());
    } catch (const std::bad_alloc &) {
        return error_set(e, ERROR_LIMIT_MEMORY, "no memory left while %s", doing);
    } catch (const std::length_error &x) {
        return error_set(e, otherwise, "a length that cannot be, while %s (%s)", doing, x.what());
    } catch (const std::exception &x) {
        return error_set(e, otherwise, "failed while %s: %s", doing, x.what());
    } catch (...) {
        return error_set(e, otherwise, "failed while %s", doing);
    }
}

} // namespace shim

#endif

// SPDX-License-Identifier: Apache-2.0
#include "base/core/module.h"

#include <dlfcn.h>
#include <stddef.h>

void *module_symbol(const char *file, const char *symbol, error *e)
{
    /* found through the program's run path; lazy binding, since a job calls few functions of a library */
    void *module = dlopen(file, RTLD_LAZY | RTLD_LOCAL | RTLD_NODELETE);
    void *address = module ? dlsym(module, symbol) : NULL;
    if (!address) {
        const char *why = dlerror();
        error_set(e, ERROR_INTERNAL, "cannot load a module of hexad: %s. Install hexad again.",
                  why ? why : file);
    }
    if (module) dlclose(module); /* it is not unloaded (RTLD_NODELETE) */
    return address;
}

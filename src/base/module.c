#include "base/module.h"

#include <dlfcn.h>
#include <stddef.h>

void *module_symbol(const char *file, const char *symbol, error *e)
{
    /* found through the program's run path; lazily, as a job calls few of a library's functions */
    void *module = dlopen(file, RTLD_LAZY | RTLD_LOCAL | RTLD_NODELETE);
    void *address = module ? dlsym(module, symbol) : NULL;
    if (!address) {
        const char *why = dlerror();
        error_set(e, ERROR_INTERNAL, "cannot load a module of hexad: %s. Install hexad again.",
                  why ? why : file);
    }
    if (module) dlclose(module); /* it stays, as it is marked not to be unloaded */
    return address;
}

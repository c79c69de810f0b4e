/* module: loads a shared object of this program at its first use.
 *
 * For code whose libraries take longer to link at start than a small job takes: OpenVDB and assimp have more than a
 * hundred thousand relocations. Modules lie beside the program or in $(pkglibdir). A loaded module stays loaded, and
 * further calls are cheap. Any thread.
 */
#ifndef HEXAD_BASE_MODULE_H
#define HEXAD_BASE_MODULE_H

#include "base/error.h"

/* The address of `symbol` in the module `file`. NULL and an error (internal) if there is none: the installation is
 * incomplete. */
void *module_symbol(const char *file, const char *symbol, error *e);

#endif

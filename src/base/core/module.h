// SPDX-License-Identifier: Apache-2.0
/* module: loads a shared object of this program on first use.
 *
 * For code whose libraries take longer to link at start than a small job takes: OpenVDB and assimp have more
 * than a hundred thousand relocations. Modules are beside the program or in $(pkglibdir). A loaded module is
 * never unloaded; further calls are cheap. Any thread.
 */
#ifndef HEXAD_BASE_CORE_MODULE_H
#define HEXAD_BASE_CORE_MODULE_H

#include "base/core/error.h"

/* The address of `symbol` in the module `file`. Error: internal (it does not exist: the installation is
 * incomplete). */
void *module_symbol(const char *file, const char *symbol, error *e);

#endif

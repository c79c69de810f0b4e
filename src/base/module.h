/* module: a part of a program that lies in a file of its own and is loaded when it is first called for.
 *
 * For parts whose libraries take longer to be linked at start than a small job takes: OpenVDB and assimp
 * have more than a hundred thousand relocations. Modules lie beside the program or where it was installed.
 * Once loaded they stay; to ask again costs next to nothing. Any thread may ask.
 */
#ifndef HEXAD_BASE_MODULE_H
#define HEXAD_BASE_MODULE_H

#include "base/error.h"

/* The address of what the module `file` exports as `symbol`; NULL and an error (internal) when it is not to
 * be had, which means that the installation is incomplete. */
void *module_symbol(const char *file, const char *symbol, error *e);

#endif

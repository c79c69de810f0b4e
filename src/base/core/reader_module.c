// SPDX-License-Identifier: Apache-2.0
/* The function of reader.h for a program that loads a reader only in the process that reads. */
#include "base/core/module.h"
#include "base/core/reader.h"

int reader_run_module(const char *module, const char *symbol, int argc, char **argv)
{
    error e = {0};
    int (*program)(int, char **) = (int (*)(int, char **))module_symbol(module, symbol, &e);
    if (program) return program(argc, argv);
    return reader_refuse(e.code, e.message) ? 0 : 1;
}

// SPDX-License-Identifier: Apache-2.0
/* config_table: the settings of the daemon: name, type, range, default and help text of each (config.h). */
#ifndef HEXAD_SERVICE_CONFIG_CONFIG_TABLE_H
#define HEXAD_SERVICE_CONFIG_CONFIG_TABLE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/build_part.h"
#include "base/core/help_text.h"

typedef enum config_type {
    CONFIG_TEXT,
    CONFIG_LIST,  /* separated by `:` or `,`, and the key may be repeated */
    CONFIG_WORDS, /* separated by `,` only, and the key may be repeated */
    CONFIG_INTEGER,
    CONFIG_REAL,
    CONFIG_SANDBOX,
    CONFIG_LEVEL
} config_type;

/* Members that a row does not set are zero: no default, no unit, not reloaded. */
typedef struct config_row {
    const char *key;
    size_t offset, size; /* of the member in config, bytes */
    config_type type;
    option_rank rank;
    const char *default_text; /* in the syntax of the file; NULL: empty */
    double low, high;         /* of numbers; inclusive */
    bool or_zero;             /* 0 is permitted although it is below `low` */
    const char *unit;         /* NULL: none */
    bool reloads;             /* SIGHUP applies a new value; other settings need a restart */
    /* Part of the program to which the setting belongs. A build without it permits only the default, and 0
     * for a whole number. */
    build_part part;
    const char *help;
} config_row;

extern const config_row config_table[];
extern const size_t config_table_size;

#endif

/* config_table: the rows that describe the settings; see config.h. */
#ifndef HEXAD_CONFIG_CONFIG_TABLE_H
#define HEXAD_CONFIG_CONFIG_TABLE_H

#include <stdbool.h>
#include <stddef.h>

typedef enum config_type {
    CONFIG_TEXT,    /* char * */
    CONFIG_LIST,    /* config_list, separated by `:` or `,`, and the key may be repeated */
    CONFIG_WORDS,   /* config_list, separated by `,` only, and the key may be repeated */
    CONFIG_INTEGER, /* int64_t */
    CONFIG_REAL,    /* double */
    CONFIG_SANDBOX, /* sandbox_mode */
    CONFIG_LEVEL    /* log_level */
} config_type;

typedef struct config_row {
    const char *key;
    config_type type;
    const char *otherwise; /* the default, as it would be written */
    double low, high;      /* of numbers; inclusive */
    const char *unit;      /* "" for none */
    const char *prose;
    size_t offset; /* in config */
    bool reloads;  /* SIGHUP takes a new value over; other settings need a new start */
    bool or_zero;  /* 0 may be given, too, which is below `low` */
} config_row;

extern const config_row config_table[];
extern const size_t config_table_size;

#endif

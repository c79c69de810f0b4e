// SPDX-License-Identifier: Apache-2.0
#include "durable.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include <sqlite3.h>

#include "base/core/memory.h"

static _Noreturn void die(const char *what)
{
    fprintf(stderr, "bench/durable: %s\n", what);
    exit(2);
}

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

double durable_rows(const char *directory, double span_s)
{
    sqlite3 *d;
    sqlite3_stmt *s;
    char *path = mem_printf("%s/rows.db", directory);
    if (sqlite3_open(path, &d) != SQLITE_OK ||
        sqlite3_exec(d,
                     "PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
                     "CREATE TABLE IF NOT EXISTS row (id INTEGER PRIMARY KEY, text TEXT)",
                     NULL, NULL, NULL) != SQLITE_OK ||
        sqlite3_prepare_v2(d, "INSERT INTO row (text) VALUES ('of a job')", -1, &s, NULL) != SQLITE_OK)
        die(sqlite3_errmsg(d));
    int rows = 0;
    double start = now_s();
    for (; now_s() < start + span_s; rows++) {
        if (sqlite3_step(s) != SQLITE_DONE) die(sqlite3_errmsg(d));
        sqlite3_reset(s);
    }
    double rate = rows / (now_s() - start);
    sqlite3_finalize(s);
    sqlite3_close(d);
    free(path);
    return rate;
}

// SPDX-License-Identifier: Apache-2.0
/* durable: what this machine makes of SQLite's durable transactions, the measure of submissions. */
#ifndef HEXAD_BENCH_DURABLE_H
#define HEXAD_BENCH_DURABLE_H

/* Transactions of one row in a second, over `span_s` seconds, of one thread, in the database rows.db below
 * `directory`. Trouble ends the program with 2. */
double durable_rows(const char *directory, double span_s);

#endif

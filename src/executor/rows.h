/* rows: the newest progress lines of all attempts, for who follows a job live.
 *
 * A ring of ROWS_KEPT lines in memory; each has a number that rises. Nothing of it is stored: who is
 * slower than the ring, or comes after a restart, misses lines, and sees that from the numbers. Any thread.
 */
#ifndef HEXAD_EXECUTOR_ROWS_H
#define HEXAD_EXECUTOR_ROWS_H

#include <stddef.h>
#include <stdint.h>

#include "queue/ulid.h"

/* Attempts report ten times a second at most: this is six seconds of sixty attempts, and a megabyte. */
#define ROWS_KEPT 4096

typedef struct rows rows;

typedef struct rows_line {
    int64_t number;
    char id[ULID_SIZE]; /* of the job */
    int frame, attempt; /* QUEUE_NO_FRAME: the job is no array */
    char *text;         /* one JSON object */
} rows_line;

rows *rows_new(void);
void rows_free(rows *r); /* accepts NULL */

void rows_add(rows *r, const char *id, int frame, int attempt, const char *text);

/* Those of one job (NULL: of all) with numbers above `after`, oldest first, at most `limit`. *newest is
 * the number to ask after the next time. The caller frees by rows_lines_free. */
size_t rows_list(rows *r, const char *id, int64_t after, size_t limit, rows_line **lines, int64_t *newest);
void rows_lines_free(rows_line *lines, size_t count);

#endif

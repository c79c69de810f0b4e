/* reader: a process of its own for a library that reads files from strangers.
 *
 * It is this program started again with another command, the open file as its input and no other descriptor,
 * under limits of address space, processor time and descriptors: what crashes, hangs or takes all memory
 * there is an error here. Threads: a reader belongs to one thread.
 */
#ifndef HEXAD_BASE_READER_H
#define HEXAD_BASE_READER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/types.h>

#include "base/error.h"

typedef struct reader_params {
    const char *program;  /* NULL: this one */
    const char *command;  /* its first argument */
    const char *argument; /* its second */
    int fd;               /* the file; -1: input and output are one socket */
    size_t memory_limit;  /* bytes beyond what the process starts with */
    unsigned seconds;     /* of processor time */
} reader_params;

typedef struct reader {
    pid_t pid;
    FILE *stream; /* what it writes */
} reader;

/* Starts `program COMMAND ARGUMENT MEMORY SECONDS`; reader_end follows. Errors: internal. */
bool reader_start(const reader_params *params, reader *out, error *e);

/* Closes the stream and waits. `begun`: an answer has come; `ok`: it was good. A process that a signal ended
 * explains more than the answer that it could not finish; one that has begun to answer and is not wanted any
 * more is ended. Returns whether all is well; e is kept where it says what is wrong. */
bool reader_end(reader *r, bool begun, bool ok, error *e);

/* input_damaged for what is no file, an empty one, or a Git-LFS pointer; `what` it should be. */
bool reader_check_file(int fd, const char *what, off_t *size, error *e);

/* In the process: the limits that argv[2] and argv[3] say, of four arguments; no descriptor but the first
 * `descriptors`. Returns the memory limit, 0 when the arguments are none. */
size_t reader_limit(int argc, char **argv, unsigned descriptors);

/* In the process: writes all of it to the output; false when nobody reads any more. */
bool reader_write(const void *from, size_t count);

#endif

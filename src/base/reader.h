/* reader: runs a library that reads untrusted files in a process of its own.
 *
 * The process is this program, started again with another command. It gets the open file as its input, no other
 * descriptor, and limits of address space, processor time and descriptors. If it crashes, hangs or takes too much
 * memory, the caller gets an error. Threads: a reader belongs to one thread.
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

/* Closes the stream and waits for the process. `begun`: an answer has begun; `ok`: it was complete and valid. If the
 * answer began but is not ok, the process is killed and *e stays. Otherwise *e tells how a failed process
 * ended. Returns whether everything succeeded. In a build with sanitizers a process that a sanitizer stopped is always
 * an error: internal. */
bool reader_end(reader *r, bool begun, bool ok, error *e);

/* Fails with input_damaged unless fd is a regular, non-empty file and no Git-LFS pointer. `what` names the expected
 * content in the message. */
bool reader_check_file(int fd, const char *what, off_t *size, error *e);

/* In the process: sets the limits given in argv[2] (memory) and argv[3] (seconds), and allows only the first
 * `descriptors` descriptors. Returns the memory limit; 0 unless there are four arguments. */
size_t reader_limit(int argc, char **argv, unsigned descriptors);

/* In the process: writes all bytes to standard output. False if the other side has closed it. */
bool reader_write(const void *from, size_t count);

#endif

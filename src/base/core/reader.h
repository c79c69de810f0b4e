/* reader: runs a library that reads untrusted files in a separate process.
 *
 * The process is this program, started with another command. It receives the open file as standard input, no other
 * descriptor, and limits of address space, CPU time and descriptors. If it crashes, hangs or exceeds its memory, the
 * caller gets an error. A reader belongs to one thread.
 */
#ifndef HEXAD_BASE_CORE_READER_H
#define HEXAD_BASE_CORE_READER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/types.h>

#include "base/core/error.h"

typedef struct reader_params {
    const char *program;  /* NULL: this one */
    const char *command;  /* first argument */
    const char *argument; /* second argument */
    int fd;               /* the file; -1: standard input and output are one socket */
    size_t memory_limit;  /* bytes in addition to the memory of the program at start */
    unsigned seconds;     /* limit of CPU time */
} reader_params;

typedef struct reader {
    pid_t pid;
    FILE *stream; /* output of the process */
} reader;

/* Starts `program COMMAND ARGUMENT MEMORY SECONDS`; the caller calls reader_end. Error: internal. */
bool reader_start(const reader_params *params, reader *out, error *e);

/* Closes the stream and waits for the process. `begun`: an answer has begun; `ok`: it was complete and valid. If the
 * answer has begun but is not ok, the process is killed and *e is unchanged. Otherwise *e describes how a failed
 * process ended. Returns whether everything succeeded. In a build with sanitizers a process that a sanitizer stopped is
 * always an error: internal. */
bool reader_end(reader *r, bool begun, bool ok, error *e);

/* Checks that fd is a regular, non-empty file and not a Git LFS pointer. Error: input_damaged; `what` is the expected
 * content, for the message. */
bool reader_check_file(int fd, const char *what, off_t *size, error *e);

/* In the process: sets the limits in argv[2] (memory, bytes) and argv[3] (seconds), and permits only the first
 * `descriptors` descriptors. Returns the memory limit; 0 unless there are four arguments. */
size_t reader_limit(int argc, char **argv, unsigned descriptors);

/* Sends a request and the descriptor of an open file to a process that was started with a socket (fd -1). If `file`
 * is -1, no descriptor is sent. Error: input_damaged, since the process has ended. */
bool reader_send(reader *r, const void *request, size_t size, int file, error *e);

/* In the process: receives the next request of this size. *file is the descriptor that came with it, which the
 * caller closes, or -1. False: there are no further requests. */
bool reader_receive(void *request, size_t size, int *file);

/* In the process: writes all bytes to standard output. False: the other end is closed. */
bool reader_write(const void *from, size_t count);

#endif

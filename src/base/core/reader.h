// SPDX-License-Identifier: Apache-2.0
/* reader: runs a library that reads untrusted files in a separate process.
 *
 * The process is this program, started with another command. It receives the open file as standard input, no
 * other descriptor, and limits of address space, CPU time and descriptors. If it crashes, hangs or exceeds
 * its memory, the caller gets an error. It ends within 0.1 s after the caller has closed its output, also while it
 * computes. A reader belongs to one thread.
 *
 * All of these processes answer in one form: a reader_head; `text_length` bytes of text; `size` bytes of the
 * struct that the command answers; and what this struct announces. Numbers have the byte order of the
 * machine. An error is a head with the message as its text. A process with a socket answers requests until
 * the socket is closed.
 */
#ifndef HEXAD_BASE_CORE_READER_H
#define HEXAD_BASE_CORE_READER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
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

#define READER_MAGIC 0x3172656461656872u /* "rheader1" */

typedef struct reader_head {
    uint64_t magic;
    uint32_t code;        /* an error_code; ERROR_NONE: the answer follows */
    uint32_t text_length; /* at most READER_MESSAGE_MAX if `code` is an error */
    uint64_t size;        /* size of the struct of the answer; 0 if `code` is an error */
} reader_head;

enum { READER_MESSAGE_MAX = sizeof((error *)0)->message - 1 };

typedef struct reader {
    pid_t pid;
    FILE *stream; /* output of the process; NULL: there is no process */
    bool begun;   /* an answer to the last request has begun */
    bool refused; /* the answer was an error, complete: the process can take another request */
} reader;

/* Starts `program COMMAND ARGUMENT MEMORY SECONDS`; the caller calls reader_end. Error: internal. */
bool reader_start(const reader_params *params, reader *out, error *e);

/* Closes the stream, which ends the process, and waits for it. `ok`: its answer was complete and valid. If the
 * answer has begun but is not ok, *e is unchanged. Otherwise *e describes how a failed process ended. Returns
 * whether everything succeeded. In a build with sanitizers a process that a sanitizer stopped is always an error:
 * internal. */
bool reader_end(reader *r, bool ok, error *e);

/* Checks that fd is a regular, non-empty file and not a Git LFS pointer. Error: input_damaged; `what` is the
 * expected content, for the message. */
bool reader_check_file(int fd, const char *what, off_t *size, error *e);

/* In the process: sets the limits in argv[2] (memory, bytes) and argv[3] (seconds), permits only the first
 * `descriptors` descriptors, and starts the thread that ends the process with its output. Returns the memory
 * limit; 0 unless there are four arguments. */
size_t reader_limit(int argc, char **argv, unsigned descriptors);

/* Sends a request and the descriptor of an open file to a process that was started with a socket (fd -1). If
 * `file` is -1, no descriptor is sent. Error: input_damaged, since the process has ended. */
bool reader_send(reader *r, const void *request, size_t size, int file, error *e);

/* In the process: receives the next request of this size. *file is the descriptor that came with it, which
 * the caller closes, or -1. False: there are no further requests. */
bool reader_receive(void *request, size_t size, int *file);

/* Receives the beginning of an answer: the struct of this size, and a text of at most `most` bytes, which the
 * caller frees; `text` NULL: there is none. *text is unchanged on failure. Errors: the one that the
 * process answers; input_damaged. */
bool reader_get_answer(reader *r, void *answer, size_t size, char **text, size_t most, error *e);

/* Receives data whose count the answer states. Error: input_damaged. */
bool reader_get(reader *r, void *to, size_t size, size_t count, error *e);

/* Replaces control characters of a text that may quote a file, except those in `kept`, by spaces. */
void reader_blank(char *text, const char *kept);

/* Sets the error of an answer that is not possible: input_damaged. Returns false. */
bool reader_invalid(error *e);

/* After a request: ends a process whose answer was neither complete (`ok`) nor an error. Returns ok. */
bool reader_settle(reader *r, bool ok, error *e);

/* Ends a process that waits for requests, if there is one. */
void reader_close(reader *r);

/* In the process: writes all bytes to standard output. False, here and in the next functions: the other
 * end is closed. */
bool reader_write(const void *from, size_t count);

/* In the process: writes the beginning of an answer. */
bool reader_answer(const void *answer, size_t size, const char *text, size_t text_length);

/* In the process: writes an error as the answer. */
bool reader_refuse(error_code code, const char *message);

/* In the process: runs the function `symbol` of a module with these arguments, or answers that there is no
 * such module. Returns the exit status. */
int reader_run_module(const char *module, const char *symbol, int argc, char **argv);

#endif

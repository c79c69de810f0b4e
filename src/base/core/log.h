// SPDX-License-Identifier: Apache-2.0
/* log: one-line records on standard error.
 *
 * A record is `TIME LEVEL message key=value ...`, written by a single write(2), so that records of several
 * threads do not mix. If standard error is connected to the journal, it receives fields instead: the message,
 * its priority, and HEXAD_JOB, HEXAD_ATTEMPT and HEXAD_WORKER, which are the values of the first job=,
 * attempt= and worker= in the message. Callers write these before any text from outside. The message is
 * escaped as base/core/terminal_text describes: tabs stay, line breaks within it are escaped, so that such
 * text cannot forge a record; line breaks at its end are removed. Callers do not log secrets (tokens,
 * credentials). Any thread may log. Only programs that call log_set_journal write to the journal, so that
 * others need no libsystemd.
 */
#ifndef HEXAD_BASE_CORE_LOG_H
#define HEXAD_BASE_CORE_LOG_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/uio.h>

#include "base/core/words.h"

#define LOG_LEVEL_LIST(ENTRY, prefix) \
    ENTRY(prefix, ERROR, "error")     \
    ENTRY(prefix, WARNING, "warning") \
    ENTRY(prefix, INFO, "info")       \
    ENTRY(prefix, DEBUG, "debug")

typedef enum log_level { LOG_LEVEL_LIST(WORDS_ENUMERATOR, LOG_LEVEL) LOG_LEVEL_COUNT } log_level;

/* Records above the level are dropped; initially LOG_LEVEL_INFO. */
void log_set_level(log_level level);

/* Writes fields, each NAME=value, to the journal. False: not written. */
typedef bool log_journal(const struct iovec *fields, size_t count);

/* Sets the destination of records; NULL (initially): lines on standard error. Call it before starting
 * threads. */
void log_set_journal(log_journal *journal);

/* "error", "warning", "info", "debug". False, with *level unchanged, for any other name. */
bool log_level_from_name(const char *name, log_level *level);

void log_write(log_level level, const char *format, ...) __attribute__((format(printf, 2, 3)));
void log_write_list(log_level level, const char *format, va_list arguments)
    __attribute__((format(printf, 2, 0)));

#endif

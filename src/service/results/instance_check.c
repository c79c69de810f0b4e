// SPDX-License-Identifier: Apache-2.0
#include "service/results/instance_check.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/database/header.h"
#include "files/file.h"

#define WAYS_OUT "restore a backup of " DATABASE_FILE_NAME ", or start once with --adopt"

/* Reads the id of the directory; "" if it has no file `instance`. A file without a valid id: spec_invalid. */
static bool read_file(const char *work_dir, char id[ULID_SIZE], error *e)
{
    error why = {0};
    size_t length = 0;
    char *path = mem_printf("%s/" INSTANCE_CHECK_FILE_NAME, work_dir);
    char *text = store_file_read(path, 64, &length, &why);
    bool absent = !text && errno == ENOENT, strange = text || errno == EFBIG, ok = absent;
    id[0] = '\0';
    if (text && length == ULID_SIZE && text[ULID_SIZE - 1] == '\n') {
        text[ULID_SIZE - 1] = '\0';
        ok = ulid_is_valid(text);
        if (ok) memcpy(id, text, ULID_SIZE);
    }
    if (!ok && strange)
        error_set(e, ERROR_SPEC_INVALID,
                  "%s does not contain the ID of an instance: restore it from a backup, or start once "
                  "with --adopt",
                  path);
    else if (!ok && e)
        *e = why;
    free(text);
    free(path);
    return ok;
}

static bool write_file(const char *work_dir, const char *id, error *e)
{
    char *path = mem_printf("%s/" INSTANCE_CHECK_FILE_NAME, work_dir), *line = mem_printf("%s\n", id);
    bool ok = store_file_write(path, line, strlen(line), e);
    free(path);
    free(line);
    return ok;
}

/* Removes what a killed process has left of write_file. The caller holds the lock of the state directory. */
static void clear_temporary(const char *work_dir)
{
    char *path = mem_printf("%s/" INSTANCE_CHECK_FILE_NAME, work_dir);
    store_file_clear(path);
    free(path);
}

/* Whether results/ contains an entry that is not hidden. A directory that exists but cannot be read counts
 * as one with entries. */
static bool holds_results(const char *work_dir)
{
    char *path = mem_printf("%s/results", work_dir);
    DIR *listing = opendir(path);
    bool any = !listing && errno != ENOENT;
    for (struct dirent *entry; !any && listing && (entry = readdir(listing));) any = entry->d_name[0] != '.';
    if (listing) closedir(listing);
    free(path);
    return any;
}

static bool refuse_new(const char *state_dir, const char *work_dir, error *e)
{
    return error_set(e, ERROR_INTERNAL,
                     "%s/" DATABASE_FILE_NAME
                     " is missing or empty, but %s/results contains results: " WAYS_OUT
                     ", which adopts them into a new queue",
                     state_dir, work_dir);
}

static bool check(queue *q, const char *state_dir, const char *work_dir, const char *own, error *e)
{
    queue_instance its = {0};
    bool found = false;
    if (!queue_get_instance(q, &its, &found, e)) return false;
    if (!found)
        return !holds_results(work_dir) ||
               error_set(e, ERROR_INTERNAL,
                         "%s/" DATABASE_FILE_NAME
                         " belongs to no instance yet, but %s/results contains results (--adopt may have "
                         "been interrupted): " WAYS_OUT,
                         state_dir, work_dir);
    if (!*own || strcmp(own, its.id) == 0) return true;
    if (!*its.id)
        return error_set(
            e, ERROR_INTERNAL,
            "%s/" DATABASE_FILE_NAME
            " is from an older hexad and has no instance ID, and the state directory belongs to "
            "instance %s: restore a backup of this instance, or start once with --adopt if it is "
            "the right one",
            state_dir, own);
    return error_set(e, ERROR_INTERNAL,
                     "%s/" DATABASE_FILE_NAME
                     " belongs to instance %s and the state directory to instance %s: restore the"
                     " one that belongs here, or start once with --adopt to take this one",
                     state_dir, its.id, own);
}

queue *instance_check_open_queue(const char *state_dir, const char *work_dir, bool adopt, error *e)
{
    char own[ULID_SIZE] = "";
    error why = {0};
    if (!read_file(work_dir, own, &why) && !(adopt && why.code == ERROR_SPEC_INVALID)) {
        if (why.code == ERROR_SPEC_INVALID)
            why.code = ERROR_INTERNAL; /* spec_invalid would blame a setting */
        if (e) *e = why;
        return NULL;
    }
    /* before queue_open, which creates a missing database and deletes files of the missing one (its log)
     * beside it */
    bool lost = !header_exists(state_dir);
    if (lost && !adopt && holds_results(work_dir)) {
        refuse_new(state_dir, work_dir, e);
        return NULL;
    }
    queue *q = queue_open(state_dir, e);
    if (q) clear_temporary(work_dir);
    if (q && !adopt && !check(q, state_dir, work_dir, own, e)) {
        queue_close(q);
        return NULL;
    }
    if (q && lost && *own && !adopt)
        log_write(LOG_LEVEL_WARNING,
                  "%s/" DATABASE_FILE_NAME
                  " was missing or empty, so a new queue starts without the jobs that waited. There "
                  "are no results",
                  state_dir);
    else if (q && lost)
        log_write(LOG_LEVEL_INFO, "a new queue is created in %s", state_dir);
    return q;
}

bool instance_check_join(queue *q, const char *work_dir, const char *boot_id, error *e)
{
    queue_instance now = {0}, joined = {0};
    char own[ULID_SIZE] = "";
    bool found = false;
    error why = {0};
    if (!queue_get_instance(q, &now, &found, e)) return false;
    read_file(work_dir, own, NULL);
    if (*own)
        memcpy(joined.id, own, sizeof own);
    else if (*now.id)
        memcpy(joined.id, now.id, sizeof now.id);
    else
        ulid_make(clock_wall_ms(), joined.id);
    snprintf(joined.boot_id, sizeof joined.boot_id, "%s", boot_id);
    bool same = strcmp(now.id, joined.id) == 0;
    if (!same || strcmp(now.boot_id, joined.boot_id) != 0) {
        if (!queue_set_instance(q, &joined, &why) && !same) {
            if (e) *e = why;
            return false;
        }
    }
    if (!*own && !write_file(work_dir, joined.id, &why)) /* the next start tries again */
        log_write(LOG_LEVEL_WARNING, "the ID of this instance is stored in the database only: %s",
                  why.message);
    return true;
}

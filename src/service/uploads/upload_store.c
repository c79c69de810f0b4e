// SPDX-License-Identifier: Apache-2.0
#include "service/uploads/upload_store.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nettle/sha2.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"

/* Rows that one query reads, and files that are examined while none can be stored. */
#define AT_ONCE 100
/* For remove_file, instead of the time for which unused files are kept. */
#define IN_ANY_CASE INT64_C(-1)

struct store_inputs {
    char *directory;
    int64_t most_bytes, total_bytes;
    queue *q;       /* which users hold which files */
    ledger *counts; /* its holders are the hashes of the users' names, as in the queue */
    /* shared while a file is stored and held, exclusive while files and their rows are removed; taken before `mutex` */
    pthread_rwlock_t storing;
    pthread_mutex_t
        mutex; /* for steps that never wait: guards used_bytes, and files between decision and removal */
    int64_t used_bytes; /* of stored files and unfinished uploads */
};

struct store_upload {
    store_inputs *owner;
    char *user;
    store_file file;
    struct sha256_ctx hash;
    char wanted[STORE_INPUT_HEX + 1];
    int64_t bytes; /* arrived bytes; their space is reserved */
    store_upload_outcome outcome;
    bool committed;
};

/* A user's name may contain any byte: the queue and the ledger have its hash. */
typedef struct sender {
    char hash[STORE_INPUT_HEX + 1];
} sender;

static sender sender_of(const char *user)
{
    sender of;
    store_hash(user, strlen(user), of.hash);
    return of;
}

static char *path_of(const store_inputs *s, const char *hex)
{
    return mem_printf("%s/" STORE_INPUT_PREFIX "%s", s->directory, hex);
}

static int64_t time_ms(struct timespec t)
{
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

static bool fail(const char *what, const char *path, error *e)
{
    return error_set(e, ERROR_INTERNAL, "cannot %s %s: %s", what, path, strerror(errno));
}

/* "HEX:USER" behind this prefix in the name of a file; NULL: it has another form. */
static const char *find_hashes(const char *entry, const char *prefix)
{
    const size_t length = strlen(prefix);
    return strncmp(entry, prefix, length) == 0 && strlen(entry) == length + 2 * STORE_INPUT_HEX + 1
               ? entry + length
               : NULL;
}

/* Reads a record of a build of schema 21 or older: the time of an empty file sender:HEX:USER, since which the user holds
 * the file, or the text of name:HEX:USER. False: it is none, or cannot be read. */
static bool read_old_record(const store_inputs *s, const char *entry, queue_upload *record)
{
    struct stat info;
    size_t length = 0;
    const char *held = find_hashes(entry, "sender:"), *hashes = held ? held : find_hashes(entry, "name:");
    if (!hashes) return false;
    *record = (queue_upload){.sent_ms = QUEUE_NOT_HELD};
    snprintf(record->hash, sizeof record->hash, "%.*s", STORE_INPUT_HEX, hashes);
    snprintf(record->user, sizeof record->user, "%s", hashes + STORE_INPUT_HEX + 1);
    char *path = mem_printf("%s/%s", s->directory, entry);
    if (!held)
        record->name = store_file_read(path, STORE_INPUT_FILE_NAME_MOST, &length, NULL);
    else if (lstat(path, &info) == 0)
        record->sent_ms = time_ms(info.st_mtim);
    free(path);
    record->bytes = store_inputs_find(s, record->hash, NULL); /* -1: count_holds forgets the record */
    return record->name || record->sent_ms != QUEUE_NOT_HELD;
}

/* Moves such records to the queue. count_files then removes the files; if that is interrupted, the next start stores
 * the same records, before a user can change them. */
static bool store_old_records(store_inputs *s, error *e)
{
    queue_upload records[AT_ONCE];
    DIR *directory = opendir(s->directory);
    bool ok = directory || fail("read", s->directory, e);
    for (size_t count = AT_ONCE, added; ok && count == AT_ONCE;) {
        count = 0;
        for (struct dirent *d; count < AT_ONCE && (d = readdir(directory));)
            count += read_old_record(s, d->d_name, &records[count]);
        ok = !count || queue_hold_uploads(s->q, records, count, &added, e);
        for (size_t i = 0; i < count; i++) free(records[i].name);
    }
    if (directory) closedir(directory);
    return ok;
}

/* Counts the stored files, and removes all others, such as unfinished uploads. */
static bool count_files(store_inputs *s, error *e)
{
    struct stat info;
    bool removed = false;
    DIR *directory = opendir(s->directory);
    if (!directory) return fail("read", s->directory, e);
    for (struct dirent *d; (d = readdir(directory));) {
        if (fstatat(dirfd(directory), d->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(info.st_mode))
            continue;
        if (sent_file_is_name(d->d_name))
            s->used_bytes += info.st_size;
        else
            removed |= unlinkat(dirfd(directory), d->d_name, 0) == 0;
    }
    closedir(directory);
    return !removed || store_directory_sync(s->directory, e);
}

/* Forgets uploads, and releases the bytes of the holds that end. */
static bool forget(store_inputs *s, queue_forgetting what, const queue_upload *uploads, size_t count,
                   error *e)
{
    queue_upload *ended = NULL;
    size_t ended_count = 0;
    bool ok = queue_forget_uploads(s->q, what, uploads, count, &ended, &ended_count, e);
    for (size_t i = 0; i < ended_count; i++)
        ledger_give_back(s->counts, LEDGER_UPLOAD_BYTES, ended[i].user, ended[i].bytes);
    free(ended);
    return ok;
}

/* Counts what users hold, and forgets files that are missing: the database is older than their removal, or the removal
 * was interrupted. */
static bool count_holds(store_inputs *s, error *e)
{
    queue_upload last = {0}, *rows = NULL;
    bool ok = true;
    for (size_t count = AT_ONCE, missing; ok && count == AT_ONCE; free(rows)) {
        ok = queue_list_uploads(s->q, NULL, &last, AT_ONCE, &rows, &count, e);
        missing = 0;
        for (size_t i = 0; ok && i < count; i++) {
            last = rows[i];
            if (last.sent_ms != QUEUE_NOT_HELD)
                ledger_add(s->counts, LEDGER_UPLOAD_BYTES, last.user, last.bytes);
            if (store_inputs_find(s, last.hash, NULL) < 0) rows[missing++] = last;
        }
        ok = ok && forget(s, QUEUE_FORGET_USER, rows, missing, e);
    }
    return ok;
}

store_inputs *store_inputs_open(const char *directory, int64_t most_bytes, int64_t total_bytes, queue *q,
                                ledger *counts, error *e)
{
    pthread_rwlockattr_t kind; /* a removal must not wait for ever while users send files */
    store_inputs *s = mem_alloc(sizeof *s);
    s->directory = mem_strdup(directory);
    s->most_bytes = most_bytes;
    s->total_bytes = total_bytes;
    s->q = q;
    s->counts = counts;
    pthread_mutex_init(&s->mutex, NULL);
    pthread_rwlockattr_init(&kind);
    pthread_rwlockattr_setkind_np(&kind, PTHREAD_RWLOCK_PREFER_WRITER_NONRECURSIVE_NP);
    pthread_rwlock_init(&s->storing, &kind);
    pthread_rwlockattr_destroy(&kind);
    if (store_directory_create(directory, e) && store_old_records(s, e) && count_files(s, e) &&
        count_holds(s, e))
        return s;
    store_inputs_close(s);
    return NULL;
}

void store_inputs_close(store_inputs *s)
{
    if (!s) return;
    pthread_rwlock_destroy(&s->storing);
    pthread_mutex_destroy(&s->mutex);
    free(s->directory);
    free(s);
}

int64_t store_inputs_find(const store_inputs *s, const char *hex, int64_t *used_ms)
{
    struct stat info;
    char *path = path_of(s, hex);
    bool there = lstat(path, &info) == 0 && S_ISREG(info.st_mode);
    free(path);
    if (there && used_ms) *used_ms = time_ms(info.st_mtim);
    return there ? (int64_t)info.st_size : -1;
}

int64_t store_inputs_use(store_inputs *s, const char *hex)
{
    char *path = path_of(s, hex);
    pthread_mutex_lock(&s->mutex); /* protects the file from removal */
    int64_t bytes = store_inputs_find(s, hex, NULL);
    if (bytes >= 0) utimensat(AT_FDCWD, path, NULL, AT_SYMLINK_NOFOLLOW);
    pthread_mutex_unlock(&s->mutex);
    free(path);
    return bytes;
}

/* ---- holds */

int64_t store_inputs_find_sent(const store_inputs *s, const char *hex, const char *user, char **name)
{
    int64_t sent_ms;
    queue_find_upload(s->q, hex, sender_of(user).hash, &sent_ms, name, NULL);
    return sent_ms;
}

bool store_inputs_holds(const store_inputs *s, const char *hex, const char *user, const char *name)
{
    char *given;
    const bool held = store_inputs_find_sent(s, hex, user, &given) != QUEUE_NOT_HELD,
               same = !name || (given && strcmp(given, name) == 0);
    free(given);
    return held && same;
}

int64_t store_inputs_count_bytes(store_inputs *s, const char *user)
{
    return ledger_held(s->counts, LEDGER_UPLOAD_BYTES, sender_of(user).hash);
}

bool store_inputs_list(store_inputs *s, const char *user, const queue_upload *after, int limit,
                       queue_upload **list, size_t *count, error *e)
{
    return queue_list_uploads(s->q, sender_of(user).hash, after, limit, list, count, e);
}

/* Records that the user holds a file of this length, with its name unless that is NULL. The caller holds `storing`. */
static bool note_hold(store_inputs *s, const char *hex, const char *user, int64_t bytes, const char *name,
                      error *e)
{
    queue_upload row = {.bytes = bytes, .sent_ms = clock_wall_ms(), .name = (char *)name};
    size_t added = 0;
    strcpy(row.hash, hex);
    strcpy(row.user, sender_of(user).hash);
    bool ok = queue_hold_uploads(s->q, &row, 1, &added, e);
    if (added) ledger_add(s->counts, LEDGER_UPLOAD_BYTES, row.user, bytes);
    return ok;
}

store_upload_outcome store_inputs_hold(store_inputs *s, const char *hex, const char *user, const char *name,
                                       error *e)
{
    store_upload_outcome outcome = STORE_UPLOAD_GOOD;
    pthread_rwlock_rdlock(&s->storing);
    const int64_t bytes = store_inputs_find(s, hex, NULL),
                  more = store_inputs_holds(s, hex, user, NULL) ? 0 : bytes;
    if (bytes < 0)
        outcome = STORE_UPLOAD_GONE;
    else if (ledger_check(s->counts, LEDGER_UPLOAD_BYTES, sender_of(user).hash, more) != LEDGER_FITS)
        outcome = STORE_UPLOAD_USER_FULL;
    else if (!note_hold(s, hex, user, bytes, name, e))
        outcome = STORE_UPLOAD_FAILED;
    pthread_rwlock_unlock(&s->storing);
    return outcome;
}

/* ---- removal */

/* Removes a file that no unfinished job reads, if it was unused for keep_ms (0: without limit) or all users have
 * released it; or IN_ANY_CASE. *gone: it was removed. The caller holds `storing` exclusively, then forgets the file and
 * flushes the directory. */
static bool remove_file(store_inputs *s, const char *hex, int64_t keep_ms, bool *gone, error *e)
{
    int64_t used_ms = 0;
    char *path = path_of(s, hex);
    pthread_mutex_lock(&s->mutex); /* a use comes before the decision, or does not find the file */
    const int64_t bytes = store_inputs_find(s, hex, &used_ms);
    const bool over = keep_ms > 0 && running_time_is_over(queue_running(s->q), used_ms, keep_ms);
    bool goes = keep_ms == IN_ANY_CASE, ok = goes || queue_may_remove_upload(s->q, hex, over, &goes, e);
    *gone = bytes >= 0 && goes && unlink(path) == 0;
    ok = ok && (*gone || bytes < 0 || !goes || fail("remove", path, e));
    if (*gone) s->used_bytes -= bytes;
    pthread_mutex_unlock(&s->mutex);
    free(path);
    return ok;
}

/* Removes one file like remove_file, and forgets it or only its holds. */
static bool remove_one(store_inputs *s, const char *hex, int64_t keep_ms, queue_forgetting what, bool *gone,
                       error *e)
{
    queue_upload file = {0};
    strcpy(file.hash, hex);
    return remove_file(s, hex, keep_ms, gone, e) &&
           (!*gone || (forget(s, what, &file, 1, e) && store_directory_sync(s->directory, e)));
}

bool store_inputs_remove(store_inputs *s, const char *hex, bool *found, error *e)
{
    pthread_rwlock_wrlock(&s->storing);
    bool ok = remove_one(s, hex, IN_ANY_CASE, QUEUE_FORGET_FILE, found, e);
    pthread_rwlock_unlock(&s->storing);
    return ok;
}

bool store_inputs_release(store_inputs *s, const char *hex, const char *user, bool *found, error *e)
{
    queue_upload row = {0};
    bool gone;
    strcpy(row.hash, hex);
    strcpy(row.user, sender_of(user).hash);
    *found = store_inputs_holds(s, hex, user, NULL);
    if (!*found) return true;
    if (!forget(s, QUEUE_FORGET_USER, &row, 1, e)) return false;
    pthread_rwlock_wrlock(&s->storing);
    bool ok = remove_one(s, hex, 0, QUEUE_FORGET_FILE, &gone, e);
    pthread_rwlock_unlock(&s->storing);
    return ok;
}

bool store_inputs_collect(store_inputs *s, int64_t keep_ms, size_t *gone, error *e)
{
    DIR *directory = opendir(s->directory);
    struct dirent *d = NULL;
    bool ok = directory || fail("read", s->directory, e);
    *gone = 0;
    for (bool more = ok; ok && more; more = d != NULL) {
        queue_upload removed[AT_ONCE];
        size_t count = 0;
        pthread_rwlock_wrlock(&s->storing);
        for (int i = 0; i < AT_ONCE && (d = readdir(directory)); i++) {
            bool goes = false;
            const char *hex = d->d_name + strlen(STORE_INPUT_PREFIX);
            if (!sent_file_is_name(d->d_name)) continue;
            remove_file(s, hex, keep_ms, &goes, NULL); /* what cannot be removed is tried again later */
            if (goes) strcpy(removed[count++].hash, hex);
        }
        ok = forget(s, QUEUE_FORGET_FILE, removed, count, e);
        pthread_rwlock_unlock(&s->storing);
        *gone += count;
    }
    if (directory) closedir(directory);
    return ok && (!*gone || store_directory_sync(s->directory, e));
}

/* ---- space */

const char *store_inputs_directory(const store_inputs *s)
{
    return s->directory;
}

store_inputs_space store_inputs_get_space(store_inputs *s)
{
    pthread_mutex_lock(&s->mutex);
    store_inputs_space space = {s->used_bytes, s->total_bytes, s->most_bytes};
    pthread_mutex_unlock(&s->mutex);
    return space;
}

/* Whether there is space for `bytes` more bytes, of which `taken` are reserved at once; otherwise the limit that is
 * reached. */
static store_upload_outcome find_space(store_inputs *s, const char *user, int64_t bytes, int64_t taken)
{
    const sender of = sender_of(user);
    store_upload_outcome outcome = STORE_UPLOAD_GOOD;
    pthread_mutex_lock(&s->mutex);
    if (bytes > s->total_bytes - s->used_bytes)
        outcome = STORE_UPLOAD_ALL_FULL;
    else if (ledger_check(s->counts, LEDGER_UPLOAD_BYTES, of.hash, bytes) != LEDGER_FITS)
        outcome = STORE_UPLOAD_USER_FULL;
    if (outcome == STORE_UPLOAD_GOOD) {
        s->used_bytes += taken;
        ledger_add(s->counts, LEDGER_UPLOAD_BYTES, of.hash, taken);
    }
    pthread_mutex_unlock(&s->mutex);
    return outcome;
}

/* ---- damage */

/* As store_inputs_compare, for a path. */
static bool compare_file(const char *path, const char *hex, error *e)
{
    char found[STORE_HASH_SIZE];
    uint64_t bytes;
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    bool ok = fd >= 0 ? store_file_hash(fd, found, &bytes, e)
                      : error_set(e, ERROR_INTERNAL, "it cannot be opened: %s", strerror(errno));
    if (ok && strcmp(found, hex) != 0) ok = error_set(e, ERROR_INPUT_DAMAGED, "its bytes have another hash");
    if (fd >= 0) close(fd);
    return ok;
}

bool store_inputs_compare(const char *directory, const char *name, error *e)
{
    char *path = mem_printf("%s/%s", directory, name);
    bool ok = compare_file(path, name + strlen(STORE_INPUT_PREFIX), e);
    free(path);
    return ok;
}

void store_inputs_discard_damaged(store_inputs *s, const char *name, const store_deadline *end)
{
    struct stat read, now;
    char found[STORE_HASH_SIZE];
    uint64_t bytes;
    bool gone = false;
    const char *hex = name + strlen(STORE_INPUT_PREFIX);
    char *path = path_of(s, hex);
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    /* a file that cannot be read may be readable again soon */
    const bool differs =
        fd >= 0 && store_file_hash_until(fd, end, found, &bytes, NULL) && strcmp(found, hex) != 0;
    pthread_rwlock_wrlock(&s->storing);
    /* a file that was sent again in the meantime is another one */
    if (differs && fstat(fd, &read) == 0 && lstat(path, &now) == 0 && now.st_ino == read.st_ino)
        remove_one(s, hex, IN_ANY_CASE, QUEUE_FORGET_HOLDS, &gone, NULL);
    pthread_rwlock_unlock(&s->storing);
    if (gone) log_write(LOG_LEVEL_WARNING, "damaged input removed sha256=%s: send it again", hex);
    if (fd >= 0) close(fd);
    free(path);
}

/* ---- uploads */

store_upload_outcome store_upload_begin(store_inputs *s, const char *hex, const char *user, int64_t announced,
                                        store_upload **upload)
{
    const sender of = sender_of(user);
    if (announced > s->most_bytes) return STORE_UPLOAD_TOO_LARGE;
    if (ledger_take(s->counts, LEDGER_UPLOADS, of.hash, 1) != LEDGER_FITS) return STORE_UPLOAD_TOO_MANY;
    store_upload_outcome outcome = find_space(s, user, announced > 0 ? announced : 0, 0);
    if (outcome != STORE_UPLOAD_GOOD) {
        ledger_give_back(s->counts, LEDGER_UPLOADS, of.hash, 1);
        return outcome;
    }
    store_upload *u = mem_alloc(sizeof *u);
    u->owner = s;
    u->user = mem_strdup(user);
    sha256_init(&u->hash);
    strcpy(u->wanted, hex);
    *upload = u;
    return STORE_UPLOAD_GOOD;
}

/* The outcome of a call that failed. */
static store_upload_outcome outcome_of_errno(void)
{
    return errno == ENOSPC || errno == EDQUOT ? STORE_UPLOAD_DISK_FULL : STORE_UPLOAD_FAILED;
}

store_upload_outcome store_upload_open(store_upload *u, error *e)
{
    char *path = path_of(u->owner, u->wanted);
    if (!store_file_begin(path, &u->file, e)) u->outcome = outcome_of_errno();
    free(path);
    return u->outcome;
}

store_upload_outcome store_upload_write(store_upload *u, const void *bytes, size_t count, error *e)
{
    if (u->outcome != STORE_UPLOAD_GOOD) return u->outcome;
    if (u->bytes + (int64_t)count > u->owner->most_bytes) return u->outcome = STORE_UPLOAD_TOO_LARGE;
    u->outcome = find_space(u->owner, u->user, (int64_t)count, (int64_t)count);
    if (u->outcome != STORE_UPLOAD_GOOD) return u->outcome;
    u->bytes += (int64_t)count;
    sha256_update(&u->hash, count, bytes);
    if (fwrite(bytes, 1, count, u->file.stream) == count) return STORE_UPLOAD_GOOD;
    error_set(e, ERROR_INTERNAL, "%s cannot be written: %s", u->file.path, strerror(errno));
    return u->outcome = outcome_of_errno();
}

/* Puts the written file in its place, unless the same one is there. The caller holds `storing`. */
static bool place(store_upload *u, bool damaged, error *e)
{
    store_inputs *s = u->owner;
    pthread_mutex_lock(&s->mutex);
    /* if the file exists and is not damaged, it is kept, since workers may be reading it */
    const int64_t stored = store_inputs_find(s, u->wanted, NULL);
    const bool there = stored >= 0 && !damaged;
    bool ok = there ? utimensat(AT_FDCWD, u->file.path, NULL, AT_SYMLINK_NOFOLLOW) == 0
                    : store_file_place(&u->file, e);
    u->committed = ok && !there;
    if (u->committed && stored > 0) s->used_bytes -= stored;
    pthread_mutex_unlock(&s->mutex);
    return ok && (there || store_directory_sync(s->directory, e));
}

store_upload_outcome store_upload_commit(store_upload *u, const char *name, error *e)
{
    char hex[STORE_INPUT_HEX + 1];
    store_inputs *s = u->owner;
    if (u->outcome != STORE_UPLOAD_GOOD) return u->outcome;
    store_print_digest(&u->hash, hex);
    if (strcmp(hex, u->wanted) != 0) return u->outcome = STORE_UPLOAD_MISMATCH;
    /* outside of the locks, since these are slow */
    const bool damaged = store_inputs_find(s, hex, NULL) >= 0 && !compare_file(u->file.path, hex, NULL);
    bool ok = store_file_flush(&u->file, e);
    pthread_rwlock_rdlock(&s->storing); /* the file is not removed before its user holds it */
    if (!ok || !place(u, damaged, e))
        u->outcome = outcome_of_errno();
    else if (!note_hold(s, hex, u->user, u->bytes, name, e))
        u->outcome = STORE_UPLOAD_FAILED;
    pthread_rwlock_unlock(&s->storing);
    if (u->committed && damaged) log_write(LOG_LEVEL_WARNING, "damaged input replaced sha256=%s", hex);
    return u->outcome;
}

void store_upload_end(store_upload *u)
{
    if (!u) return;
    store_inputs *s = u->owner;
    store_file_abort(&u->file);
    pthread_mutex_lock(&s->mutex);
    if (!u->committed) s->used_bytes -= u->bytes; /* those of a stored file stay */
    pthread_mutex_unlock(&s->mutex);
    const sender of = sender_of(u->user); /* note_hold has counted a stored file */
    ledger_give_back(s->counts, LEDGER_UPLOAD_BYTES, of.hash, u->bytes);
    ledger_give_back(s->counts, LEDGER_UPLOADS, of.hash, 1);
    free(u->user);
    free(u);
}

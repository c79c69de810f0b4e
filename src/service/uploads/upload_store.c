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

#include "base/core/log.h"
#include "base/core/memory.h"

#define SENDER_PREFIX "sender:"
#define FILE_NAME_PREFIX "name:"

struct store_inputs {
    char *directory;
    int64_t most_bytes, total_bytes;
    ledger *counts; /* its holders are the hashes of the users' names: the directory has no others */
    pthread_mutex_t mutex;
    int64_t used_bytes; /* of stored files and unfinished uploads */
};

struct store_upload {
    store_inputs *owner;
    char sender[STORE_INPUT_HEX + 1]; /* the hash of the user's name */
    store_file file;
    struct sha256_ctx hash;
    char wanted[STORE_INPUT_HEX + 1];
    int64_t bytes; /* arrived bytes; their space is reserved */
    store_upload_outcome outcome;
    bool committed;
};

static char *path_of(const store_inputs *s, const char *hex)
{
    return mem_printf("%s/" STORE_INPUT_PREFIX "%s", s->directory, hex);
}

/* A user's name may contain any byte, so file names contain its hash. */
static void hash_name(const char *user, char name[STORE_INPUT_HEX + 1])
{
    struct sha256_ctx hash;
    sha256_init(&hash);
    sha256_update(&hash, strlen(user), (const uint8_t *)user);
    store_print_digest(&hash, name);
}

/* The path of a record about a file. `sender` is the hash of a user's name. */
static char *record_path(const store_inputs *s, const char *prefix, const char *hex, const char *sender)
{
    return mem_printf("%s/%s%s:%s", s->directory, prefix, hex, sender);
}

/* The path of the record of a user about a file. */
static char *user_record_path(const store_inputs *s, const char *prefix, const char *hex, const char *user)
{
    char sender[STORE_INPUT_HEX + 1];
    hash_name(user, sender);
    return record_path(s, prefix, hex, sender);
}

/* The hash of the file in the name of a record, followed by ":USER"; NULL: it is no record with this prefix. */
static const char *record_hash(const char *name, const char *prefix)
{
    const size_t length = strlen(prefix);
    bool is_record = strncmp(name, prefix, length) == 0 && strlen(name) == length + 2 * STORE_INPUT_HEX + 1;
    return is_record ? name + length : NULL;
}

static const char *sender_in(const char *entry)
{
    return entry + strlen(SENDER_PREFIX) + STORE_INPUT_HEX + 1;
}

/* Whether the file with the hash at the beginning of the text exists. If so, *bytes is its length. */
static bool has_file(int directory, const char *hex, int64_t *bytes)
{
    char input[STORE_INPUT_NAME_SIZE];
    struct stat info;
    snprintf(input, sizeof input, STORE_INPUT_PREFIX "%.*s", STORE_INPUT_HEX, hex);
    if (!sent_file_is_name(input) || fstatat(directory, input, &info, AT_SYMLINK_NOFOLLOW) != 0) return false;
    *bytes = info.st_size;
    return true;
}

/* Counts the stored files and removes unfinished uploads and records without a file. */
static bool take_stock(store_inputs *s, error *e)
{
    DIR *directory = opendir(s->directory);
    if (!directory)
        return error_set(e, ERROR_INTERNAL, "%s cannot be read: %s", s->directory, strerror(errno));
    for (struct dirent *d; (d = readdir(directory));) {
        struct stat info;
        int64_t bytes = 0;
        const char *sender = record_hash(d->d_name, SENDER_PREFIX),
                   *file_name = record_hash(d->d_name, FILE_NAME_PREFIX);
        if (fstatat(dirfd(directory), d->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(info.st_mode))
            continue;
        if (sent_file_is_name(d->d_name))
            s->used_bytes += info.st_size;
        else if (sender && has_file(dirfd(directory), sender, &bytes))
            ledger_add(s->counts, LEDGER_UPLOAD_BYTES, sender_in(d->d_name), bytes);
        else if (!file_name || !has_file(dirfd(directory), file_name, &bytes))
            unlinkat(dirfd(directory), d->d_name, 0);
    }
    closedir(directory);
    return true;
}

store_inputs *store_inputs_open(const char *directory, int64_t most_bytes, int64_t total_bytes,
                                ledger *counts, error *e)
{
    store_inputs *s = mem_alloc(sizeof *s);
    s->directory = mem_strdup(directory);
    s->most_bytes = most_bytes;
    s->total_bytes = total_bytes;
    s->counts = counts;
    pthread_mutex_init(&s->mutex, NULL);
    if (store_directory_create(directory, e) && take_stock(s, e)) return s;
    store_inputs_close(s);
    return NULL;
}

void store_inputs_close(store_inputs *s)
{
    if (!s) return;
    pthread_mutex_destroy(&s->mutex);
    free(s->directory);
    free(s);
}

int64_t store_inputs_find(store_inputs *s, const char *hex)
{
    struct stat info;
    char *path = path_of(s, hex);
    bool there = lstat(path, &info) == 0 && S_ISREG(info.st_mode);
    free(path);
    return there ? (int64_t)info.st_size : -1;
}

int64_t store_inputs_use(store_inputs *s, const char *hex)
{
    char *path = path_of(s, hex);
    pthread_mutex_lock(&s->mutex); /* protects the file from collection */
    int64_t bytes = store_inputs_find(s, hex);
    if (bytes >= 0) utimensat(AT_FDCWD, path, NULL, AT_SYMLINK_NOFOLLOW);
    pthread_mutex_unlock(&s->mutex);
    free(path);
    return bytes;
}

static int64_t time_ms(struct timespec t)
{
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

/* Records that the sender holds a file of this length, and counts it once. The caller holds the mutex, and then
 * flushes the directory. */
static bool note_sender(store_inputs *s, const char *hex, const char *sender, int64_t bytes, error *e)
{
    char *path = record_path(s, SENDER_PREFIX, hex, sender);
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    bool ok = fd >= 0 || errno == EEXIST || error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    if (fd >= 0) {
        close(fd);
        ledger_add(s->counts, LEDGER_UPLOAD_BYTES, sender, bytes);
    }
    free(path);
    return ok;
}

int64_t store_inputs_find_sent(store_inputs *s, const char *hex, const char *user)
{
    struct stat info;
    char *path = user_record_path(s, SENDER_PREFIX, hex, user);
    bool noted = lstat(path, &info) == 0;
    free(path);
    return noted && store_inputs_find(s, hex) >= 0 ? time_ms(info.st_mtim) : -1;
}

/* Removes the record at the path, which it frees. *found is set if the record existed. */
static bool remove_record(char *path, bool *found, error *e)
{
    bool gone = unlink(path) == 0;
    bool ok = gone || errno == ENOENT || error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    *found = *found || gone;
    free(path);
    return ok;
}

bool store_inputs_release(store_inputs *s, const char *hex, const char *user, bool *found, error *e)
{
    char sender[STORE_INPUT_HEX + 1];
    bool held = false, named = false;
    hash_name(user, sender);
    pthread_mutex_lock(&s->mutex);
    const int64_t bytes = store_inputs_find(s, hex);
    bool ok = remove_record(record_path(s, SENDER_PREFIX, hex, sender), &held, e) &&
              remove_record(record_path(s, FILE_NAME_PREFIX, hex, sender), &named, e);
    if (held && bytes > 0) ledger_add(s->counts, LEDGER_UPLOAD_BYTES, sender, -bytes);
    pthread_mutex_unlock(&s->mutex);
    if (!ok) return false;
    *found = held || named;
    return !*found || store_directory_sync(s->directory, e);
}

int64_t store_inputs_count_bytes(store_inputs *s, const char *user)
{
    char sender[STORE_INPUT_HEX + 1];
    hash_name(user, sender);
    return ledger_held(s->counts, LEDGER_UPLOAD_BYTES, sender);
}

/* The newest first, of the same time in the order of the hashes. */
static int compare_inputs(const void *a, const void *b)
{
    const store_input *x = a, *y = b;
    const int order = (x->sent_ms < y->sent_ms) - (x->sent_ms > y->sent_ms);
    return order ? order : strcmp(x->hex, y->hex);
}

/* Fills in a file from the record with this name. False: the file or its record does not exist. */
static bool read_input(int directory, const char *record, const char *hex, store_input *out)
{
    struct stat info, noted;
    char name[STORE_INPUT_NAME_SIZE];
    snprintf(out->hex, sizeof out->hex, "%.*s", STORE_INPUT_HEX, hex);
    snprintf(name, sizeof name, STORE_INPUT_PREFIX "%s", out->hex);
    if (!sent_file_is_name(name) || fstatat(directory, name, &info, AT_SYMLINK_NOFOLLOW) != 0 ||
        fstatat(directory, record, &noted, AT_SYMLINK_NOFOLLOW) != 0)
        return false;
    out->bytes = info.st_size;
    out->used_ms = time_ms(info.st_mtim);
    out->sent_ms = time_ms(noted.st_mtim);
    return true;
}

bool store_inputs_list(store_inputs *s, const char *user, store_input **list, size_t *count, error *e)
{
    char sender[STORE_INPUT_HEX + 1];
    store_input *read = NULL;
    size_t used = 0, capacity = 0;
    DIR *directory = opendir(s->directory);
    if (!directory)
        return error_set(e, ERROR_INTERNAL, "%s cannot be read: %s", s->directory, strerror(errno));
    hash_name(user, sender);
    for (struct dirent *d; (d = readdir(directory));) {
        const char *hex = record_hash(d->d_name, SENDER_PREFIX);
        if (!hex || strcmp(sender_in(d->d_name), sender) != 0) continue;
        if (used == capacity) read = mem_resize(read, (capacity = capacity * 2 + 16) * sizeof *read);
        used += read_input(dirfd(directory), d->d_name, hex, &read[used]);
    }
    closedir(directory);
    if (used) qsort(read, used, sizeof *read, compare_inputs);
    *list = read;
    *count = used;
    return true;
}

char *store_inputs_get_file_name(const store_inputs *s, const char *hex, const char *user)
{
    size_t count = 0;
    char *path = user_record_path(s, FILE_NAME_PREFIX, hex, user),
         *file_name = store_file_read(path, STORE_INPUT_FILE_NAME_MOST, &count, NULL);
    free(path);
    return file_name;
}

bool store_inputs_set_file_name(store_inputs *s, const char *hex, const char *user, const char *file_name,
                                error *e)
{
    char *path = user_record_path(s, FILE_NAME_PREFIX, hex, user),
         *old = store_inputs_get_file_name(s, hex, user);
    bool ok = (old && strcmp(old, file_name) == 0) || store_file_write(path, file_name, strlen(file_name), e);
    free(old);
    free(path);
    return ok;
}

typedef char input_hash[STORE_INPUT_HEX + 1];

static int compare_hashes(const void *a, const void *b)
{
    return strcmp(a, b);
}

/* The hashes of all files that users hold, sorted, one for each hold; the caller frees the list. */
static input_hash *list_held(DIR *directory, size_t *count)
{
    input_hash *held = NULL;
    size_t capacity = 0;
    *count = 0;
    rewinddir(directory);
    for (struct dirent *d; (d = readdir(directory));) {
        const char *hex = record_hash(d->d_name, SENDER_PREFIX);
        if (!hex) continue;
        if (*count == capacity) held = mem_resize(held, (capacity = capacity * 2 + 16) * sizeof *held);
        snprintf(held[(*count)++], sizeof *held, "%.*s", STORE_INPUT_HEX, hex);
    }
    if (*count) qsort(held, *count, sizeof *held, compare_hashes);
    rewinddir(directory);
    return held;
}

/* Whether a user holds the file. */
static bool is_held(const store_inputs *s, const char *hex)
{
    bool held = false;
    DIR *directory = opendir(s->directory);
    if (!directory) return true;
    for (struct dirent *d; !held && (d = readdir(directory));) {
        const char *of = record_hash(d->d_name, SENDER_PREFIX);
        held = of && strncmp(of, hex, STORE_INPUT_HEX) == 0;
    }
    closedir(directory);
    return held;
}

/* Removes the records about a removed file, and releases its bytes of the users who held it. `keep_names`: the names
 * stay, for messages and until the next opening. The caller holds the mutex, so that no user sends the file again or
 * releases it in between. */
static void remove_records(store_inputs *s, const char *hex, int64_t bytes, bool keep_names)
{
    DIR *directory = opendir(s->directory);
    if (!directory) return;
    for (struct dirent *d; (d = readdir(directory));) {
        const char *sender = record_hash(d->d_name, SENDER_PREFIX),
                   *of = sender || keep_names ? sender : record_hash(d->d_name, FILE_NAME_PREFIX);
        if (!of || strncmp(of, hex, STORE_INPUT_HEX) != 0) continue;
        if (unlinkat(dirfd(directory), d->d_name, 0) == 0 && sender)
            ledger_add(s->counts, LEDGER_UPLOAD_BYTES, sender_in(d->d_name), -bytes);
    }
    closedir(directory);
}

/* Removes a file and its records, if may_go permits it and the file is held as it was when `held` was found. */
static bool collect_file(store_inputs *s, int directory, const char *name, bool held,
                         store_inputs_decision *may_go, void *context)
{
    struct stat info;
    const char *hex = name + strlen(STORE_INPUT_PREFIX);
    pthread_mutex_lock(&s->mutex);
    bool there = fstatat(directory, name, &info, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(info.st_mode);
    bool gone = there && may_go(context, name, time_ms(info.st_mtim), held) && (held || !is_held(s, hex)) &&
                unlinkat(directory, name, 0) == 0;
    if (gone) {
        s->used_bytes -= info.st_size;
        remove_records(s, hex, info.st_size, false);
    }
    pthread_mutex_unlock(&s->mutex);
    return gone;
}

bool store_inputs_collect(store_inputs *s, store_inputs_decision *may_go, void *context, size_t *gone,
                          error *e)
{
    DIR *directory = opendir(s->directory);
    size_t held_count = 0;
    *gone = 0;
    if (!directory)
        return error_set(e, ERROR_INTERNAL, "%s cannot be read: %s", s->directory, strerror(errno));
    input_hash *held = list_held(directory, &held_count);
    for (struct dirent *d; (d = readdir(directory));) {
        const char *hex = d->d_name + strlen(STORE_INPUT_PREFIX);
        if (!sent_file_is_name(d->d_name)) continue;
        const bool holds = held_count && bsearch(hex, held, held_count, sizeof *held, compare_hashes);
        *gone += collect_file(s, dirfd(directory), d->d_name, holds, may_go, context);
    }
    closedir(directory);
    free(held);
    return !*gone || store_directory_sync(s->directory, e);
}

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

/* Whether there is space for `bytes` more bytes, and otherwise the limit that is reached. The caller holds
 * the mutex. */
static store_upload_outcome find_space(const store_inputs *s, const char *sender, int64_t bytes)
{
    if (bytes > s->total_bytes - s->used_bytes) return STORE_UPLOAD_ALL_FULL;
    return ledger_check(s->counts, LEDGER_UPLOAD_BYTES, sender, bytes) == LEDGER_FITS
               ? STORE_UPLOAD_GOOD
               : STORE_UPLOAD_USER_FULL;
}

/* Reserves space for arrived bytes. */
static store_upload_outcome reserve(store_upload *u, int64_t bytes)
{
    store_inputs *s = u->owner;
    pthread_mutex_lock(&s->mutex);
    store_upload_outcome outcome = find_space(s, u->sender, bytes);
    if (outcome == STORE_UPLOAD_GOOD) {
        s->used_bytes += bytes;
        ledger_add(s->counts, LEDGER_UPLOAD_BYTES, u->sender, bytes);
        u->bytes += bytes;
    }
    pthread_mutex_unlock(&s->mutex);
    return outcome;
}

static void release(store_inputs *s, int64_t bytes)
{
    pthread_mutex_lock(&s->mutex);
    s->used_bytes -= bytes;
    pthread_mutex_unlock(&s->mutex);
}

bool store_inputs_remove(store_inputs *s, const char *hex, bool also_held, bool *found, error *e)
{
    char *path = path_of(s, hex);
    pthread_mutex_lock(&s->mutex); /* so that no upload of the same file ends in between */
    int64_t bytes = also_held || !is_held(s, hex) ? store_inputs_find(s, hex) : -1;
    bool gone = bytes >= 0 && unlink(path) == 0;
    bool ok =
        bytes < 0 || gone || errno == ENOENT || error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    if (gone) {
        s->used_bytes -= bytes;
        remove_records(s, hex, bytes, false);
    }
    pthread_mutex_unlock(&s->mutex);
    if (ok) *found = gone;
    free(path);
    return ok && (!gone || store_directory_sync(s->directory, e));
}

/* Whether a stored file has the bytes of its name. Errors: input_damaged: it has others; otherwise it cannot be
 * read. */
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
    const char *hex = name + strlen(STORE_INPUT_PREFIX);
    char *path = path_of(s, hex);
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    /* a file that cannot be read may be readable again soon */
    const bool differs =
        fd >= 0 && store_file_hash_until(fd, end, found, &bytes, NULL) && strcmp(found, hex) != 0;
    pthread_mutex_lock(&s->mutex);
    /* a file that was sent again in the meantime is another one */
    bool gone = differs && fstat(fd, &read) == 0 && lstat(path, &now) == 0 && now.st_ino == read.st_ino &&
                unlink(path) == 0;
    if (gone) {
        s->used_bytes -= now.st_size;
        remove_records(s, hex, now.st_size, true);
    }
    pthread_mutex_unlock(&s->mutex);
    if (gone) {
        log_write(LOG_LEVEL_WARNING, "damaged input removed sha256=%s: send it again", hex);
        store_directory_sync(s->directory, NULL);
    }
    if (fd >= 0) close(fd);
    free(path);
}

/* Begins an upload if the user may have one more and there is space for the announced bytes. */
static store_upload_outcome enter(store_inputs *s, const char *sender, int64_t announced)
{
    if (ledger_take(s->counts, LEDGER_UPLOADS, sender, 1) != LEDGER_FITS) return STORE_UPLOAD_TOO_MANY;
    pthread_mutex_lock(&s->mutex);
    store_upload_outcome outcome = find_space(s, sender, announced > 0 ? announced : 0);
    pthread_mutex_unlock(&s->mutex);
    if (outcome != STORE_UPLOAD_GOOD) ledger_give_back(s->counts, LEDGER_UPLOADS, sender, 1);
    return outcome;
}

/* Releases the space of an upload except `kept` bytes, which stay in place. */
static void leave(store_inputs *s, const char *sender, int64_t bytes, int64_t kept)
{
    release(s, bytes - kept);
    /* note_sender counts a file that stays */
    ledger_give_back(s->counts, LEDGER_UPLOAD_BYTES, sender, bytes);
    ledger_give_back(s->counts, LEDGER_UPLOADS, sender, 1);
}

store_upload_outcome store_upload_begin(store_inputs *s, const char *hex, const char *user, int64_t announced,
                                        store_upload **upload)
{
    if (announced > s->most_bytes) return STORE_UPLOAD_TOO_LARGE;
    char sender[STORE_INPUT_HEX + 1];
    hash_name(user, sender);
    store_upload_outcome outcome = enter(s, sender, announced);
    if (outcome != STORE_UPLOAD_GOOD) return outcome;
    store_upload *u = mem_alloc(sizeof *u);
    u->owner = s;
    strcpy(u->sender, sender);
    sha256_init(&u->hash);
    strcpy(u->wanted, hex);
    *upload = u;
    return STORE_UPLOAD_GOOD;
}

store_upload_outcome store_upload_open(store_upload *u, error *e)
{
    char *path = path_of(u->owner, u->wanted);
    if (!store_file_begin(path, &u->file, e))
        u->outcome = errno == ENOSPC || errno == EDQUOT ? STORE_UPLOAD_DISK_FULL : STORE_UPLOAD_FAILED;
    free(path);
    return u->outcome;
}

store_upload_outcome store_upload_write(store_upload *u, const void *bytes, size_t count, error *e)
{
    if (u->outcome != STORE_UPLOAD_GOOD) return u->outcome;
    if (u->bytes + (int64_t)count > u->owner->most_bytes) return u->outcome = STORE_UPLOAD_TOO_LARGE;
    u->outcome = reserve(u, (int64_t)count);
    if (u->outcome != STORE_UPLOAD_GOOD) return u->outcome;
    sha256_update(&u->hash, count, bytes);
    if (fwrite(bytes, 1, count, u->file.stream) == count) return STORE_UPLOAD_GOOD;
    error_set(e, ERROR_INTERNAL, "%s cannot be written: %s", u->file.path, strerror(errno));
    return u->outcome = errno == ENOSPC || errno == EDQUOT ? STORE_UPLOAD_DISK_FULL : STORE_UPLOAD_FAILED;
}

store_upload_outcome store_upload_commit(store_upload *u, error *e)
{
    char hex[STORE_INPUT_HEX + 1];
    if (u->outcome != STORE_UPLOAD_GOOD) return u->outcome;
    store_print_digest(&u->hash, hex);
    if (strcmp(hex, u->wanted) != 0) return u->outcome = STORE_UPLOAD_MISMATCH;
    /* outside the mutex, since these are slow */
    const bool damaged = store_inputs_find(u->owner, hex) >= 0 && !compare_file(u->file.path, hex, NULL);
    bool ok = store_file_flush(&u->file, e);
    if (ok) {
        /* under the mutex, so that an existing file is not collected in between: its space would be
         * released twice */
        pthread_mutex_lock(&u->owner->mutex);
        /* if the file exists and is not damaged, it is kept, since workers may be reading it */
        const int64_t stored = store_inputs_find(u->owner, hex);
        bool there = stored >= 0 && !damaged;
        ok = there ? utimensat(AT_FDCWD, u->file.path, NULL, AT_SYMLINK_NOFOLLOW) == 0
                   : store_file_commit(&u->file, e);
        u->committed = ok && !there;
        if (u->committed && stored > 0) u->owner->used_bytes -= stored;
        ok = ok && note_sender(u->owner, hex, u->sender, u->bytes, e);
        pthread_mutex_unlock(&u->owner->mutex);
        ok = ok && store_directory_sync(u->owner->directory, e);
    }
    if (ok && damaged) log_write(LOG_LEVEL_WARNING, "damaged input replaced sha256=%s", hex);
    if (ok) return STORE_UPLOAD_GOOD;
    return u->outcome = errno == ENOSPC || errno == EDQUOT ? STORE_UPLOAD_DISK_FULL : STORE_UPLOAD_FAILED;
}

void store_upload_end(store_upload *u)
{
    if (!u) return;
    store_file_abort(&u->file);
    leave(u->owner, u->sender, u->bytes, u->committed ? u->bytes : 0);
    free(u);
}

store_upload_outcome store_inputs_hold(store_inputs *s, const char *hex, const char *user, error *e)
{
    char sender[STORE_INPUT_HEX + 1];
    if (store_inputs_find_sent(s, hex, user) >= 0) return STORE_UPLOAD_GOOD;
    hash_name(user, sender);
    pthread_mutex_lock(&s->mutex);
    const int64_t bytes = store_inputs_find(s, hex);
    store_upload_outcome outcome =
        bytes < 0                                                                    ? STORE_UPLOAD_GONE
        : ledger_check(s->counts, LEDGER_UPLOAD_BYTES, sender, bytes) != LEDGER_FITS ? STORE_UPLOAD_USER_FULL
        : note_sender(s, hex, sender, bytes, e)                                      ? STORE_UPLOAD_GOOD
                                                                                     : STORE_UPLOAD_FAILED;
    pthread_mutex_unlock(&s->mutex);
    if (outcome == STORE_UPLOAD_GOOD && !store_directory_sync(s->directory, e)) outcome = STORE_UPLOAD_FAILED;
    return outcome;
}

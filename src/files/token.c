// SPDX-License-Identifier: Apache-2.0
#include "files/token.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nettle/memops.h>
#include <nettle/sha2.h>

#include "files/scope.h"
#include "base/core/clock.h"
#include "base/core/denial.h"
#include "base/core/hex.h"
#include "base/core/memory.h"
#include "files/file.h"

#define SECRET_BYTES 32
#define LINE_BYTES 512
#define MOST_PRIORITY 1000 /* the limit of priorities in specs */

static const char user_letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._@-";

static void hash_text(const char *text, uint8_t hash[32])
{
    struct sha256_ctx context;
    sha256_init(&context);
    sha256_update(&context, strlen(text), (const uint8_t *)text);
    sha256_digest(&context, 32, hash);
}

static bool is_user(const char *text)
{
    size_t length = strlen(text);
    return length > 0 && length < TOKEN_USER_SIZE && strspn(text, user_letters) == length;
}

static token *append(token_set *set, const token *t)
{
    set->item = mem_resize(set->item, (set->count + 1) * sizeof *set->item);
    set->item[set->count] = *t;
    return &set->item[set->count++];
}

bool token_parse_priority(const char *text, int *priority)
{
    char *end = NULL;
    long number = strtol(text, &end, 10);
    if (end == text || *end || number < -MOST_PRIORITY || number > MOST_PRIORITY) return false;
    *priority = (int)number;
    return true;
}

/* Parses a line that is neither empty nor a comment. */
static bool read_token(char *line, token *t)
{
    char *rest = NULL, *word[6], *end = NULL;
    size_t count = 0;
    for (char *w = strtok_r(line, " \t", &rest); w; w = strtok_r(NULL, " \t", &rest)) {
        if (count == 6) return false;
        word[count++] = w;
    }
    if (count < 5 || !is_user(word[1]) || !scope_parse(word[2], &t->scopes) ||
        !hex_read(word[3], t->hash, sizeof t->hash) || word[3][2 * sizeof t->hash])
        return false;
    if (strlen(word[0]) != TOKEN_ID_SIZE - 1 || strncmp(word[0], word[3], TOKEN_ID_SIZE - 1) != 0)
        return false;
    t->max_priority = TOKEN_ANY_PRIORITY;
    if (count == 6 && !token_parse_priority(word[5], &t->max_priority)) return false;
    strcpy(t->id, word[0]);
    strcpy(t->user, word[1]);
    errno = 0;
    t->created_ms = strtoll(word[4], &end, 10);
    return !errno && !*end;
}

/* Sets the error for an existing file that this process cannot read. */
static bool fail_to_read(const char *path, error *e)
{
    const int fault = errno;
    bool lasts = fault == EACCES || fault == EPERM || fault == EISDIR || fault == ENXIO;
    char *why = denial_explain(path, fault, DENIAL_SECRET, "");
    error_set(e, lasts ? ERROR_SPEC_INVALID : ERROR_INTERNAL, "%s cannot be read: %s%s", path,
              strerror(fault), why);
    free(why);
    return false;
}

static bool read_lines(FILE *file, const char *path, token_set *set, error *e)
{
    char line[LINE_BYTES];
    for (int number = 1; fgets(line, sizeof line, file); number++) {
        token t = {0};
        size_t length = strcspn(line, "\n");
        bool whole = line[length] == '\n' || feof(file);
        line[length] = '\0';
        if (whole && line[strspn(line, " \t")] == '\0') continue;
        if (whole && *line == '#') continue;
        if (!whole || !read_token(line, &t))
            return error_set(e, ERROR_SPEC_INVALID,
                             "%s:%d: the line must be \"ID USER SCOPES SHA256 CREATED [MAX_PRIORITY]\"", path,
                             number);
        append(set, &t);
    }
    return !ferror(file) || fail_to_read(path, e);
}

/* Whether only its owner, who is not root, has access to the file. */
static bool is_private_of_user(int fd)
{
    struct stat info;
    return fstat(fd, &info) == 0 && S_ISREG(info.st_mode) && info.st_uid != 0 && !(info.st_mode & 0077);
}

static bool read_set(const char *path, bool any_owner, token_set *set, error *e)
{
    token_set read = {0};
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0 && errno == ENOENT) {
        *set = read;
        return true;
    }
    FILE *file = fd < 0 ? NULL : fdopen(fd, "r");
    if (!file) {
        fail_to_read(path, e);
        if (fd >= 0) close(fd);
        return false;
    }
    bool ok = ((any_owner && is_private_of_user(fd)) || store_file_check_private(fd, path, e)) &&
              read_lines(file, path, &read, e);
    fclose(file);
    if (ok)
        *set = read;
    else
        token_set_clear(&read);
    return ok;
}

bool token_set_read(const char *path, token_set *set, error *e)
{
    return read_set(path, false, set, e);
}

bool token_set_read_of_any_owner(const char *path, token_set *set, error *e)
{
    return read_set(path, geteuid() == 0, set, e);
}

void token_set_clear(token_set *set)
{
    free(set->item);
    *set = (token_set){0};
}

const token *token_set_find(const token_set *set, const char *text)
{
    uint8_t hash[32];
    const token *found = NULL;
    hash_text(text, hash);
    for (size_t i = 0; i < set->count; i++)
        if (memeql_sec(hash, set->item[i].hash, sizeof hash)) found = &set->item[i];
    return found;
}

const token *token_set_add(token_set *set, const char *user, unsigned scopes, int max_priority,
                           char text[TOKEN_SIZE], error *e)
{
    uint8_t secret[SECRET_BYTES];
    token t = {.scopes = scopes, .created_ms = clock_wall_ms(), .max_priority = max_priority};
    if (strcmp(user, ".") == 0 || strcmp(user, "..") == 0) {
        error_set(
            e, ERROR_SPEC_INVALID,
            "the user name must not be \"%s\", which is a directory where names of users are parts of paths: "
            "give another name",
            user);
        return NULL;
    }
    if (!is_user(user)) {
        error_set(e, ERROR_SPEC_INVALID,
                  "the user name must have 1 to %d letters, digits and \"._@-\" (given %.100s)",
                  TOKEN_USER_SIZE - 1, user);
        return NULL;
    }
    if (getrandom(secret, sizeof secret, 0) != sizeof secret) {
        error_set(e, ERROR_INTERNAL, "cannot get random numbers from the system: %s", strerror(errno));
        return NULL;
    }
    strcpy(text, TOKEN_PREFIX);
    hex_print(secret, sizeof secret, text + strlen(TOKEN_PREFIX));
    hash_text(text, t.hash);
    hex_print(t.hash, (TOKEN_ID_SIZE - 1) / 2, t.id);
    strcpy(t.user, user);
    return append(set, &t);
}

bool token_set_remove(token_set *set, const char *id)
{
    for (size_t i = 0; i < set->count; i++) {
        if (strcmp(set->item[i].id, id) != 0) continue;
        memmove(&set->item[i], &set->item[i + 1], (--set->count - i) * sizeof *set->item);
        return true;
    }
    return false;
}

/* The group that may read the file that root writes; 0: none. */
static gid_t find_group(const char *path, gid_t given)
{
    struct stat info;
    if (lstat(path, &info) == 0 && S_ISREG(info.st_mode) && info.st_gid != 0) return info.st_gid;
    if (given != TOKEN_NO_GROUP) return given;
    char *copy = mem_strdup(path); /* dirname modifies its argument */
    gid_t group = stat(dirname(copy), &info) == 0 ? info.st_gid : 0;
    free(copy);
    return group;
}

/* Sets the owner and the mode of the new file. Root keeps those of an existing file of another user. */
static bool set_permissions(int fd, const char *path, gid_t given, error *e)
{
    struct stat info;
    if (geteuid() == 0 && lstat(path, &info) == 0 && S_ISREG(info.st_mode) && info.st_uid != 0)
        return (fchown(fd, info.st_uid, info.st_gid) == 0 && fchmod(fd, info.st_mode & 0700) == 0) ||
               error_set(e, ERROR_INTERNAL, "%s cannot be given the owner %u: %s", path,
                         (unsigned)info.st_uid, strerror(errno));
    gid_t group = geteuid() == 0 ? find_group(path, given) : 0;
    mode_t mode = group ? 0640 : 0600;
    return (fchmod(fd, 0600) == 0 && (!group || fchown(fd, 0, group) == 0) && fchmod(fd, mode) == 0) ||
           error_set(e, ERROR_INTERNAL, "%s cannot be given mode %04o: %s", path, (unsigned)mode,
                     strerror(errno));
}

bool token_set_write(const char *path, const token_set *set, gid_t group, error *e)
{
    store_file file = {0};
    store_file_clear(path); /* left by a killed process; the caller has locked the directory */
    if (!store_file_begin(path, &file, e)) return false;
    if (!set_permissions(fileno(file.stream), path, group, e)) {
        store_file_abort(&file);
        return false;
    }
    fputs("# Tokens of hexad, by their hashes; hexadctl token makes, lists and revokes them.\n", file.stream);
    for (size_t i = 0; i < set->count; i++) {
        const token *t = &set->item[i];
        char scopes[SCOPE_TEXT_SIZE], hash[2 * sizeof t->hash + 1];
        hex_print(t->hash, sizeof t->hash, hash);
        fprintf(file.stream, "%s %s %s %s %lld", t->id, t->user, scope_print(t->scopes, scopes), hash,
                (long long)t->created_ms);
        if (t->max_priority != TOKEN_ANY_PRIORITY) fprintf(file.stream, " %d", t->max_priority);
        fputc('\n', file.stream);
    }
    return store_file_commit(&file, e);
}

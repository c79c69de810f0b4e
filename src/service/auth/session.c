// SPDX-License-Identifier: Apache-2.0
#include "service/auth/session.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nettle/hmac.h>
#include <nettle/memops.h>

#include "base/core/denial.h"
#include "base/core/hex.h"
#include "files/file.h"

static bool make_key(const char *path, error *e)
{
    uint8_t bytes[SESSION_KEY_BYTES];
    store_file file = {0};
    if (getrandom(bytes, sizeof bytes, 0) != sizeof bytes)
        return error_set(e, ERROR_INTERNAL, "cannot get random numbers from the system: %s", strerror(errno));
    if (!store_file_begin(path, &file, e)) return false;
    if (fchmod(fileno(file.stream), 0600) != 0) {
        error_set(e, ERROR_INTERNAL, "%s cannot be given mode 0600: %s", path, strerror(errno));
        store_file_abort(&file);
        return false;
    }
    fwrite(bytes, 1, sizeof bytes, file.stream); /* commit checks the stream's error flag */
    return store_file_commit(&file, e);
}

bool session_key_open(const char *path, session_key *key, error *e)
{
    session_key k = {0};
    store_file_clear(path); /* left by a killed process */
    if (access(path, F_OK) != 0 && !make_key(path, e)) return false;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) {
        const int fault = errno;
        char *why = denial_explain(path, fault, DENIAL_OWN, "");
        error_set(e, ERROR_SPEC_INVALID, "%s cannot be read: %s%s", path, strerror(fault), why);
        free(why);
        return false;
    }
    uint8_t more;
    bool ok = store_file_check_private(fd, path, e);
    if (ok && (read(fd, k.bytes, sizeof k.bytes) != sizeof k.bytes || read(fd, &more, 1) != 0))
        ok = error_set(e, ERROR_SPEC_INVALID,
                       "the session key %s is not valid: remove the file; hexad creates a new one", path);
    close(fd);
    if (!ok) return false;
    char hash[STORE_HASH_SIZE];
    store_hash(k.bytes, sizeof k.bytes, hash);
    snprintf(k.cookie, sizeof k.cookie, "hexad_%.8s", hash);
    *key = k;
    return true;
}

void session_begin(const session_key *key, const token *of, int64_t ends_ms, char text[SESSION_SIZE])
{
    struct hmac_sha256_ctx mac;
    uint8_t digest[32];
    int length = snprintf(text, SESSION_SIZE, "%s.%lld", of->id, (long long)(ends_ms / 1000));
    hmac_sha256_set_key(&mac, sizeof key->bytes, key->bytes);
    hmac_sha256_update(&mac, sizeof of->hash, of->hash);
    hmac_sha256_update(&mac, (size_t)length, (const uint8_t *)text);
    hmac_sha256_digest(&mac, sizeof digest, digest);
    text[length++] = '.';
    hex_print(digest, sizeof digest, text + length);
}

const token *session_find(const session_key *key, const token_set *set, const char *text, int64_t *ends_ms)
{
    size_t length = strlen(text);
    if (length >= SESSION_SIZE || length < TOKEN_ID_SIZE || text[TOKEN_ID_SIZE - 1] != '.') return NULL;
    long long ends_s = strtoll(text + TOKEN_ID_SIZE, NULL, 10);
    if (ends_s > INT64_MAX / 1000 || ends_s < 0) return NULL;
    for (size_t i = 0; i < set->count; i++) {
        char right[SESSION_SIZE];
        if (memcmp(set->item[i].id, text, TOKEN_ID_SIZE - 1) != 0) continue;
        session_begin(key, &set->item[i], ends_s * 1000, right);
        if (strlen(right) != length || !memeql_sec(right, text, length)) continue;
        *ends_ms = ends_s * 1000;
        return &set->item[i];
    }
    return NULL;
}

// SPDX-License-Identifier: Apache-2.0
#include "service/executor/cache.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "config.h"

#include "base/core/memory.h"
#include "base/json/json.h"
#include "service/executor/commit.inc"
#include "service/results/own_report.h"
#include "service/results/result.h"
#include "service/uploads/upload_store.h"

/* Files changed within this time before the attempt are not trusted: time stamps are coarse, and file servers
 * have their own clocks. */
#define CLOCK_DOUBT_MS 2000

/* Copies an object without the members that do not affect a result. */
static json *copy_without(json_at object, const char *const *members, size_t count)
{
    json *copy = json_new_object();
    for (json_at member = json_first(&object); member.node; member = json_next(&member)) {
        bool wanted = true;
        for (size_t k = 0; k < count; k++) wanted &= strcmp(member.key, members[k]) != 0;
        if (wanted) json_put(copy, member.key, json_copy(member.node));
    }
    return copy;
}

bool cache_identifies_build(void)
{
    return !strchr(PACKAGE_VERSION, '~') || *HEXAD_COMMIT;
}

/* A release candidate has the version of other commits. */
static const char *build_name(void)
{
    return strchr(PACKAGE_VERSION, '~') ? PACKAGE_VERSION "\n" HEXAD_COMMIT : PACKAGE_VERSION;
}

bool cache_key(const json *spec, char key[STORE_HASH_SIZE])
{
    static const char *const of_the_job[] = {"name", "limits", "queue", "output"};
    static const char *const of_the_output[] = {"directory"};
    json_at root = json_root(spec);
    json_at output = json_member(&root, "output");
    bool can = json_type_of(root) == JSON_OBJECT;
    if (can) {
        json *rest = copy_without(root, of_the_job, sizeof of_the_job / sizeof *of_the_job);
        json_put(rest, "output", copy_without(output, of_the_output, 1));
        char *text = json_print(rest), *whole = mem_printf("%s\n%s", build_name(), text);
        store_hash(whole, strlen(whole), key);
        free(whole);
        free(text);
        json_free(rest);
    }
    return can;
}

/* JSON numbers cannot hold 64 bits, so such a number is stored as a text. */
static void put_number(json *o, const char *key, int64_t number)
{
    char *text = mem_printf("%lld", (long long)number);
    json_put_string(o, key, text);
    free(text);
}

/* The present state of a file. */
typedef struct present {
    bool named_by_hash; /* an uploaded file, whose name identifies it: the rest is not set */
    dev_t device;
    store_identity identity;
} present;

/* False when it cannot be examined. */
static bool look_at(const store_roots *roots, const char *path, const char *sha256, present *now)
{
    struct stat info;
    char name[STORE_INPUT_NAME_SIZE];
    *now = (present){0};
    int fd = store_open_input(roots, path, NULL);
    if (fd < 0) return false;
    bool ok = fstat(fd, &info) == 0 && store_identify(fd, &now->identity);
    close(fd);
    if (!ok) return false;
    now->device = info.st_dev;
    now->named_by_hash =
        sent_file_match(path, name) && strcmp(name + strlen(STORE_INPUT_PREFIX), sha256) == 0;
    return true;
}

static json *describe(const char *path, const char *sha256, const present *now)
{
    json *o = json_new_object();
    json_put_string(o, "path", path);
    json_put_string(o, "sha256", sha256);
    if (now->named_by_hash) return o;
    put_number(o, "bytes", (int64_t)now->identity.bytes);
    put_number(o, "device", (int64_t)now->device);
    put_number(o, "inode", (int64_t)now->identity.inode);
    put_number(o, "mtime_ns", now->identity.mtime_ns);
    put_number(o, "ctime_ns", now->identity.ctime_ns);
    return o;
}

static int64_t read_number(json_at input, const char *key)
{
    return strtoll(json_string(json_member(&input, key), "-1"), NULL, 10);
}

/* Whether the path leads to the file that the worker opened, by the description of its descriptor in the
 * report. The device is not compared, since nodes of a farm may number devices differently. */
static bool is_what_was_read(json_at input, const present *now)
{
    double bytes = json_number(json_member(&input, "bytes"), -1);
    if (now->named_by_hash) return true;
    if (!(bytes >= 0 && bytes <= 0x1p53)) return false;
    const store_identity read = {(uint64_t)bytes, (uint64_t)read_number(input, "inode"),
                                 read_number(input, "mtime_ns"), read_number(input, "ctime_ns")};
    return store_identity_equals(&read, &now->identity);
}

char *cache_describe_inputs(const store_roots *roots, const char *directory, int64_t since_ms)
{
    result r = {0};
    char *found = NULL;
    json *document = result_read_short(directory, &r, NULL), *list = json_new_array();
    json_at root = json_root(document), inputs = json_member(&root, "inputs");
    bool ok = json_type_of(inputs) == JSON_ARRAY;
    for (json_at input = json_first(&inputs); input.node && ok; input = json_next(&input)) {
        const char *name = json_string(json_member(&input, "path"), "");
        const char *sha256 = json_string(json_member(&input, "sha256"), "");
        present now;
        ok = look_at(roots, name, sha256, &now) && is_what_was_read(input, &now) &&
             (now.named_by_hash || now.identity.ctime_ns / 1000000 < since_ms - CLOCK_DOUBT_MS);
        if (ok) json_append(list, describe(name, sha256, &now));
    }
    if (ok) found = json_print(list);
    json_free(list);
    json_free(document);
    result_clear(&r);
    return found;
}

bool cache_is_fresh(const store_roots *roots, const char *inputs)
{
    json *then = json_parse(inputs, strlen(inputs), NULL);
    json_at root = json_root(then);
    bool fresh = json_type_of(root) == JSON_ARRAY;
    for (json_at file = json_first(&root); file.node && fresh; file = json_next(&file)) {
        const char *path = json_string(json_member(&file, "path"), "");
        const char *sha256 = json_string(json_member(&file, "sha256"), "");
        present now;
        json *described = look_at(roots, path, sha256, &now) ? describe(path, sha256, &now) : NULL;
        char *a = json_print(file.node), *b = described ? json_print(described) : NULL;
        fresh = b && strcmp(a, b) == 0;
        json_free(described);
        free(a);
        free(b);
    }
    json_free(then);
    return fresh;
}

static bool link_file(const char *from, const char *to, const char *name, error *e)
{
    char *source = mem_printf("%s/%s", from, name), *target = mem_printf("%s/%s", to, name);
    bool ok = link(source, target) == 0 || error_set(e, ERROR_INTERNAL, "cannot link %s into %s", source, to);
    free(source);
    free(target);
    return ok;
}

bool cache_link_result(const char *from, const char *to, const char *spec, const store_deadline *end,
                       result *r, error *e)
{
    json *document = result_read_short(from, r, e);
    if (!document) return false;
    bool ok = result_compare(from, r, end, e) && store_directory_add(to, e);
    for (size_t i = 0; ok && i < r->output_count; i++) ok = link_file(from, to, r->output[i].name, e);
    ok = ok && own_report_copy(from, to, spec, r, document, e); /* which flushes the directory, too */
    json_free(document);
    if (!ok) result_clear(r);
    return ok;
}

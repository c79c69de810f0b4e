// SPDX-License-Identifier: Apache-2.0
/* uploads_command: the commands uploads and delete-upload of hexadctl: the files that the user has uploaded. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "client/job_table.h"
#include "client/print.h"
#include "client/table.h"
#include "files/sent_file.h"
#include "spec/sample_spec.h"

static const char *text_of(json_at object, const char *key, const char *otherwise)
{
    return json_string(json_member(&object, key), otherwise);
}

/* Reads the list of uploads. *uploads is an array that the caller frees. */
static int read_uploads(client *c, json **uploads)
{
    char *path = mem_printf("/v1/inputs?limit=%d", COMMAND_PAGE_MOST);
    const int code = command_read_all(c, path, "inputs", uploads);
    free(path);
    return code;
}

/* The path by which a spec names the upload, with the extension of its name; the caller frees it. */
static char *path_of(json_at upload)
{
    return mem_printf("%s%s", text_of(upload, "path", "?"), sample_spec_ending(text_of(upload, "name", "")));
}

/* A length in bytes, KiB or MiB; the caller frees it. */
static char *size_of(double bytes)
{
    if (bytes < 1 << 10) return mem_printf("%.0f B", bytes);
    return bytes < 1 << 20 ? mem_printf("%.1f KiB", bytes / (1 << 10))
                           : mem_printf("%.1f MiB", bytes / (1 << 20));
}

static void add_row(table *t, json_at upload)
{
    const double all = json_number(json_member(&upload, "job_count"), 0),
                 unfinished = json_number(json_member(&upload, "unfinished_count"), 0);
    table_add(t, mem_strdup(text_of(upload, "name", "-")));
    table_add(t, size_of(json_number(json_member(&upload, "bytes"), 0)));
    table_add(t, job_table_new_age(upload, "sent"));
    table_add(t, job_table_new_age(upload, "used"));
    table_add(t, unfinished > 0 ? mem_printf("%.0f, %.0f unfinished", all, unfinished)
                                : mem_printf("%.0f", all));
    table_add(t, path_of(upload));
}

int command_uploads(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    static const char *const titles[] = {"NAME", "SIZE", "AGE", "LAST_USE", "JOBS", "PATH"};
    json *uploads = NULL;
    int code = read_uploads(c, &uploads);
    if (code != COMMAND_OK) return code;
    if (options->json) {
        json *document = json_new_object();
        json_put(document, "inputs", uploads);
        print_document(document);
        json_free(document);
        return COMMAND_OK;
    }
    table rows = table_new(titles, sizeof titles / sizeof *titles);
    json_at list = json_root(uploads);
    for (json_at upload = json_first(&list); upload.node; upload = json_next(&upload)) add_row(&rows, upload);
    table_print(&rows);
    table_clear(&rows);
    json_free(uploads);
    return COMMAND_OK;
}

/* The hash of an upload that is given as a hash, or as a path in a spec; the caller frees it. NULL: any other
 * text. */
static char *hash_of(const char *given)
{
    char name[STORE_INPUT_NAME_SIZE];
    if (sent_file_is_hash(given)) return mem_strdup(given);
    return sent_file_match(given, name) ? mem_strdup(name + strlen(STORE_INPUT_PREFIX)) : NULL;
}

static bool is_named(json_at upload, const char *name)
{
    const char *own = text_of(upload, "name", NULL);
    return own && strcmp(own, name) == 0;
}

static int refuse_several(const char *name, size_t count, json_at list)
{
    print_failure("%s is the name of %zu uploads: give a path", name, count);
    for (json_at upload = json_first(&list); upload.node; upload = json_next(&upload)) {
        if (!is_named(upload, name)) continue;
        char *path = path_of(upload), *age = job_table_new_age(upload, "sent");
        terminal_text_print(stderr, "  %s, sent %s ago\n", path, age);
        free(path);
        free(age);
    }
    return COMMAND_USAGE;
}

/* Finds the one upload of the caller with this name. *hex: its hash, which the caller frees. */
static int find_named(client *c, const char *name, bool all, char **hex)
{
    json *uploads = NULL;
    if (!*name) {
        print_failure("delete-upload: a name is empty: give the name, the path or the SHA-256 of an upload");
        return COMMAND_USAGE;
    }
    int code = read_uploads(c, &uploads);
    if (code != COMMAND_OK) return code;
    size_t count = 0;
    json_at list = json_root(uploads), found = {0};
    for (json_at upload = json_first(&list); upload.node; upload = json_next(&upload))
        if (is_named(upload, name) && ++count == 1) found = upload;
    if (count == 1)
        *hex = mem_strdup(text_of(found, "sha256", ""));
    else if (count > 1)
        code = refuse_several(name, count, list);
    else {
        print_failure("no upload of this user has the name %s: %s", name,
                      all ? "give the path or sha256 of an upload of another user"
                          : "run \"hexadctl uploads\" for the names and paths");
        code = COMMAND_MISSING;
    }
    json_free(uploads);
    return code;
}

int command_delete_upload(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    int code = COMMAND_OK;
    char *hex = hash_of(argument);
    if (!hex) code = find_named(c, argument, options->all, &hex);
    if (code == COMMAND_OK) {
        char *path = mem_printf("/v1/inputs/%s%s", hex, options->all ? "?all=1" : "");
        code = command_ask(c, "DELETE", path, NULL, &document);
        free(path);
    }
    if (code == COMMAND_OK && !options->json) terminal_text_print(stdout, "%s deleted\n", argument);
    json_free(document);
    free(hex);
    return code;
}

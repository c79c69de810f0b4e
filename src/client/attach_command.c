// SPDX-License-Identifier: Apache-2.0
/* attach_command: the command attach of hexadctl, which places the points of a job on other frames of its
 * meshes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "client/command.h"
#include "client/print.h"
#include "spec/attach_spec.h"
#include "files/file.h"
#include "files/sent_file.h"

static const char points_name[] = "points.ply";

/* The path of the list of results of a job, or of a frame of an array; the caller frees it. NULL, after a
 * message, if the arguments do not name one. */
static char *list_path(client *c, const char *id, json_at job, const command_options *options)
{
    const bool is_array = json_bool(json_member(&job, "array"), false);
    if (is_array != (options->frame != NULL)) {
        print_failure(
            is_array
                ? "attach: the job %s is an array: choose the frame whose points are attached with --frame"
                : "attach: the job %s has no frames: omit --frame",
            id);
        return NULL;
    }
    if (!is_array) return command_job_path(id, "/results");
    char *frame = client_escape(c, options->frame), *rest = mem_printf("/results?frame=%s", frame),
         *path = command_job_path(id, rest);
    free(frame);
    free(rest);
    return path;
}

/* Downloads the points to a temporary file and uploads them as an input. *path is the path of the input in a
 * spec; the caller frees it. */
static int send_points(client *c, json_at item, char **path)
{
    error e = {0};
    client_reply reply = {0};
    const char *href = json_string(json_member(&item, "href"), ""),
               *sha256 = json_string(json_member(&item, "sha256"), "");
    const double bytes = json_number(json_member(&item, "bytes"), 0);
    FILE *file = tmpfile();
    char *to = mem_printf("/v1/inputs/%s?name=points.ply", sha256);
    int code = COMMAND_OK;
    if (!file)
        code = print_failure("attach: no temporary file can be written: %m");
    else if (strncmp(href, "/v1/", 4) != 0)
        code = print_failure("attach: the server lists a result outside of /v1/: report this as a fault");
    else if (!client_download(c, href, file, &reply, &e))
        code = ferror(file) ? print_failure("attach: the temporary file cannot be written")
                            : print_unreachable(&e);
    else if (reply.status != 200)
        code = print_refused(&reply);
    else if (!command_compare(file, points_name, sha256, &e))
        code = print_failure("%s", e.message);
    client_reply_clear(&reply);
    if (code == COMMAND_OK) {
        rewind(file);
        if (!client_upload(c, to, file, (int64_t)bytes, false, &reply, &e))
            code = print_unreachable(&e);
        else if (reply.status >= 300)
            code = print_refused(&reply);
        client_reply_clear(&reply);
    }
    if (code == COMMAND_OK) *path = mem_printf(STORE_INPUT_PREFIX "%s.ply", sha256);
    if (file) fclose(file);
    free(to);
    return code;
}

/* Uploads points.ply of a job as an input. */
static int send_result(client *c, const char *list, char **path)
{
    json *document = NULL;
    int code = command_ask(c, "GET", list, NULL, &document);
    json_at root = json_root(document), results = json_member(&root, "results");
    for (json_at item = json_first(&results); item.node && code == COMMAND_OK && !*path;
         item = json_next(&item)) {
        if (strcmp(json_string(json_member(&item, "name"), ""), points_name) == 0)
            code = send_points(c, item, path);
    }
    if (code == COMMAND_OK && !*path) {
        print_failure("attach: the job has no %s", points_name);
        code = COMMAND_MISSING;
    }
    json_free(document);
    return code;
}

/* The spec of the new job as text, which the caller frees. NULL, after a message, if the job has no
 * suitable spec. */
static char *new_spec(json_at job, const char *points, const command_options *options)
{
    error e = {0};
    json_at sampled = json_member(&job, "spec");
    json *spec = json_type_of(sampled) == JSON_OBJECT
                     ? attach_spec_make(sampled.node, points, options->mesh, options->mesh_count, &e)
                     : NULL;
    if (!spec) {
        print_failure("attach: %s", *e.message ? e.message : "the spec of the job cannot be read by you");
        return NULL;
    }
    json *output = json_find(spec, "/output");
    if (output) json_remove(output, "directory"); /* the directory of the existing result */
    char *text = json_print(spec);
    json_free(spec);
    return text;
}

int command_attach(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    char *path = command_job_path(argument, ""), *list = NULL, *points = NULL, *spec = NULL;
    if (!path) return COMMAND_USAGE;
    int code = command_ask(c, "GET", path, NULL, &document);
    json_at job = json_root(document);
    if (code == COMMAND_OK && !(list = list_path(c, argument, job, options))) code = COMMAND_USAGE;
    if (code == COMMAND_OK) code = send_result(c, list, &points);
    if (code == COMMAND_OK && !(spec = new_spec(job, points, options))) code = COMMAND_USAGE;
    if (code == COMMAND_OK) code = command_submit_text(c, spec, options);
    json_free(document);
    free(path);
    free(list);
    free(points);
    free(spec);
    return code;
}

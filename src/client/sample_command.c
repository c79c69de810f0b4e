// SPDX-License-Identifier: Apache-2.0
/* sample_command: the command sample of hexadctl: from a file to points. It sends the file, asks the service
 * for a spec that samples it, submits a job, waits for its end and fetches the result. */
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/file_format.h"
#include "base/core/frames.h"
#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "client/print.h"
#include "client/progress_bar.h"
#include "files/file.h"
#include "files/sent_file.h"
#include "spec/sample_spec.h"

#define ON_SERVICE                                                                                \
    "put the files below an input root of the service and add --on-service, or run hexad-worker " \
    "sample on this machine"

/* How long the command asks again for an inspection while the service has as many as it permits (setting
 * estimates). */
#define INSPECT_WITHIN_MS 60000

/* The member of a surface that names files of this format. NULL: they are not read. */
static const char *member_of(file_format format)
{
    const file_format_row *row = &file_formats[format];
    const bool is_surface =
        row->kind == FILE_FORMAT_MESHES || row->kind == FILE_FORMAT_GRIDS || row->kind == FILE_FORMAT_VOLUMES;
    return is_surface && row->reading != FILE_FORMAT_NOT_READ ? sample_spec_member(format) : NULL;
}

/* Why a path that is not a single file cannot be sent; NULL: it may be a single file. *member: see
 * member_of. */
static const char *unsendable(const char *path, const char **member)
{
    struct stat info;
    if (stat(path, &info) != 0)
        return frames_is_pattern(path) ? "is a pattern of several files, and one file can be sent" : NULL;
    if (S_ISDIR(info.st_mode)) return "is a directory, and one file can be sent";
    FILE *file = S_ISREG(info.st_mode) ? fopen(path, "rb") : NULL;
    const file_format format = file ? file_format_of_file(fileno(file), path) : FILE_FORMAT_UNKNOWN;
    if (file) fclose(file);
    *member = member_of(format);
    return format == FILE_FORMAT_EXR ? "is one image of a stack, and one file can be sent" : NULL;
}

static void print_sending(const char *path, uint64_t bytes, bool known)
{
    terminal_text_put(stderr, path);
    if (known)
        fputs(": the service has this file\n", stderr);
    else if (bytes < 1 << 20)
        fprintf(stderr, ": sending %.0f KiB\n", ceil((double)bytes / (1 << 10)));
    else
        fprintf(stderr, ": sending %.1f MiB\n", (double)bytes / (1 << 20));
}

/* Sends the file, or only its name if the service has it. *in_spec is its path in a spec; the caller frees it. */
static int send_input(client *c, const char *path, bool quiet, char **in_spec)
{
    char hex[STORE_HASH_SIZE] = "";
    uint64_t bytes = 0;
    FILE *file = NULL;
    json *document = NULL;
    int code = command_open_file(path, &file, hex, &bytes);
    if (code != COMMAND_OK) return code;
    bool known = false;
    code = command_knows_file(c, hex, &known);
    if (code == COMMAND_OK && !quiet) print_sending(path, bytes, known);
    if (code == COMMAND_OK) code = command_send_file(c, file, path, hex, known ? 0 : bytes, false, &document);
    if (code == COMMAND_OK) *in_spec = mem_printf(STORE_INPUT_PREFIX "%s%s", hex, sample_spec_ending(path));
    fclose(file);
    json_free(document);
    return code;
}

/* Replaces the name of the sent file at the beginning of a message, `bunny.obj (sha256:8a73d5b2...)`, by the path on the
 * command line. */
static void name_file(json *problem, const char *in_spec, const char *path)
{
    enum { SHOWN = sizeof STORE_INPUT_PREFIX - 1 + STORE_INPUT_SHOWN };
    json *detail = problem ? json_find(problem, "/detail") : NULL;
    char *mark = mem_printf(" (%.*s...)", (int)SHOWN, in_spec);
    const char *found = strstr(json_string(json_root(detail), ""), mark);
    char *named = found ? mem_printf("%s%s", path, found + strlen(mark)) : NULL;
    if (named) json_set_string(detail, named);
    free(named);
    free(mark);
}

static sample_options wanted_of(const command_options *options)
{
    return (sample_options){.count = options->count,
                            .spacing = options->spacing,
                            .grade = options->grade,
                            .pattern = options->pattern,
                            .frames = options->frames,
                            .name = options->name,
                            .set = options->set.item,
                            .set_count = options->set.count};
}

/* Asks for an inspection if one is needed, again while the service is busy. If the service cannot inspect the file, or not within
 * its time limit (setting estimate_timeout_s), the surface is the whole mesh, or the volume if the options name all
 * of the spec. */
static int inspect(client *c, const char *in_spec, const char *path, const char *member,
                   const command_options *options, json **inspection)
{
    const sample_options wanted = wanted_of(options);
    const bool is_mesh = member && strcmp(member, "mesh") == 0,
               has_grids = member && strcmp(member, "vdb") == 0,
               is_complete = member && sample_spec_is_complete(member, &wanted);
    if (member && !sample_spec_needs_inspection(member, &wanted)) {
        *inspection = sample_spec_unseen(member, in_spec);
        return COMMAND_OK;
    }
    if (!options->json) terminal_text_print(stderr, "inspecting %s\n", path);
    json *asked = json_new_object();
    json_put_string(asked, "path", in_spec);
    char *body = json_print(asked);
    const int64_t until_ms = clock_monotonic_ms() + INSPECT_WITHIN_MS;
    int code = COMMAND_OK;
    progress_bar bar;
    progress_bar_init(&bar);
    for (bool again = true; again;) {
        error e = {0};
        client_reply reply = {0};
        again = false;
        const bool answered = client_call(c, "POST", "/v1/inputs:inspect", body, strlen(body), &reply, &e);
        progress_bar_clear(&bar);
        if (!answered) {
            code = print_unreachable(&e);
        } else if (reply.status == 503 && reply.again_s > 0 && clock_monotonic_ms() < until_ms) {
            again = true;
            progress_bar_show_text(&bar, "waiting: the service inspects other files");
            poll(NULL, 0, (int)reply.again_s * 1000);
        } else if (reply.status == 503 && (is_mesh || is_complete)) {
            *inspection = sample_spec_unseen(member, in_spec);
        } else if (reply.status >= 300 || !reply.document) {
            name_file(reply.document, in_spec, path);
            code = print_refused(&reply);
            if (reply.status == 503)
                print_failure("sample: run hexad-worker sample FILE, whose inspection has no limit%s%s%s%s",
                              member ? ", or give --count and --set /surface/" : "", member ? member : "",
                              member ? "/isovalue=V" : "",
                              has_grids ? ", and --set /surface/vdb/grid=NAME if the file has several grids"
                                        : "");
            if (reply.status == 503 && member && strcmp(member, "volume") == 0)
                print_failure("sample: if the values are labels, submit this spec: "
                              "{\"version\":1,\"surface\":{\"labels\":{\"path\":\"%s\"}},"
                              "\"sampling\":{\"count\":%d}}",
                              in_spec, SAMPLE_SPEC_COUNT_MOST);
        } else {
            *inspection = reply.document;
            reply.document = NULL;
        }
        client_reply_clear(&reply);
    }
    free(body);
    json_free(asked);
    return code;
}

/* Checks what can be checked before the file is sent. *member: see member_of; of a path of the service, by its
 * name. *inspected: see sample_spec_inspected; the caller frees it. */
static bool check(const char *path, const char *directory, const command_options *options,
                  const char **member, char **inspected)
{
    error e = {0};
    const sample_options wanted = wanted_of(options);
    const char *why = options->on_service ? NULL : unsendable(path, member);
    const bool is_sequence = why && frames_is_pattern(path) && file_format_of_name(path) != FILE_FORMAT_EXR;
    if (options->on_service) *member = member_of(file_format_of_name(path));
    bool ok = sample_spec_check(&wanted, &e);
    ok = ok && (!why || error_set(&e, ERROR_SPEC_INVALID, "%s %s: " ON_SERVICE "%s%s%s", path, why,
                                  is_sequence ? ", or send the files with hexadctl upload '" : "",
                                  is_sequence ? path : "",
                                  is_sequence ? "', which says how to sample them by one job" : ""));
    ok = ok && (*inspected = sample_spec_inspected(path, &wanted, &e));
    if (ok && !store_directory_is_free(directory, options->output != NULL))
        ok = error_set(&e, ERROR_SPEC_INVALID, STORE_DIRECTORY_TAKEN, directory);
    if (!ok) print_failure("sample: %s", e.message);
    return ok;
}

/* The text of the spec, which the caller frees; NULL after a message. */
static char *make_spec(const json *inspection, const char *path, const command_options *options)
{
    error e = {0};
    const sample_options wanted = wanted_of(options);
    json *spec = sample_spec_make(inspection, path, &wanted, &e);
    char *text = spec ? json_print(spec) : NULL;
    if (!spec) print_failure("sample: %s", e.message);
    char *of_isovalue = NULL, *of_volume = NULL;
    if (spec && !options->json) {
        of_isovalue = sample_spec_isovalue_note(inspection, &wanted);
        of_volume = sample_spec_volume_note(inspection, &wanted);
    }
    if (of_volume) terminal_text_print(stderr, "%s\n", of_volume);
    if (of_isovalue) terminal_text_print(stderr, "%s\n", of_isovalue);
    free(of_volume);
    free(of_isovalue);
    json_free(spec);
    return text;
}

/* What a terminating signal prints while the command waits. */
static char interrupted_text[256];

static void print_interruption(int number)
{
    const ssize_t written = write(STDERR_FILENO, interrupted_text, strlen(interrupted_text));
    (void)written; /* the process ends in any case; SA_RESETHAND restored the default action */
    raise(number);
}

static const int terminating[] = {SIGINT, SIGTERM};
enum { TERMINATING = sizeof terminating / sizeof *terminating };

/* From now on an interruption prints that the job continues. A signal that the process ignores stays ignored.
 * `former`: the actions until now. */
static void explain_interruptions(const char *id, struct sigaction former[TERMINATING])
{
    const struct sigaction action = {.sa_handler = print_interruption, .sa_flags = SA_RESETHAND};
    snprintf(
        interrupted_text, sizeof interrupted_text,
        "\nhexadctl: the job %.40s continues: \"hexadctl wait %.40s\" waits for its end, and \"hexadctl cancel %.40s\" cancels it\n",
        id, id, id);
    for (size_t i = 0; i < TERMINATING; i++) {
        sigaction(terminating[i], NULL, &former[i]);
        if (former[i].sa_handler != SIG_IGN) sigaction(terminating[i], &action, NULL);
    }
}

static void restore_actions(const struct sigaction former[TERMINATING])
{
    for (size_t i = 0; i < TERMINATING; i++) sigaction(terminating[i], &former[i], NULL);
}

/* Waits for the end of the job, and fetches its result into the directory, with the spec. Returns the exit
 * code of the wait, or of a fetch that failed. */
static int take_result(client *c, const char *id, const char *spec, const char *directory,
                       const command_options *options)
{
    error e = {0};
    char *path = command_job_path(id, ""), *beside = mem_printf("%s/" SAMPLE_SPEC_NAME, directory);
    struct sigaction former[TERMINATING];
    explain_interruptions(id, former);
    int code = path ? command_wait_for(c, path, options) : COMMAND_FAILED;
    restore_actions(former);
    const bool has_result = code == COMMAND_OK || code == COMMAND_NOT_CONVERGED || code == COMMAND_UNRESOLVED;
    int fetched = COMMAND_OK;
    if (has_result) {
        fetched = command_fetch_into(c, id, directory);
        if (fetched == COMMAND_OK && !store_file_write(beside, spec, strlen(spec), &e))
            fetched = print_failure("%s", e.message);
    }
    char *points = mem_printf("%s/points.ply", directory); /* an array has a directory for each frame */
    if (has_result && fetched == COMMAND_OK && !options->json)
        terminal_text_print(stdout, "the points are in %s\n", access(points, F_OK) == 0 ? points : directory);
    free(points);
    free(path);
    free(beside);
    return fetched == COMMAND_OK ? code : fetched;
}

int command_sample(client *c, const char *argument, const command_options *options)
{
    char *stem = sample_spec_stem(argument), *inspected = NULL, *in_spec = NULL, *spec = NULL;
    const char *directory = options->output ? options->output : stem;
    json *inspection = NULL, *job = NULL;
    const char *member = NULL;
    int code = check(argument, directory, options, &member, &inspected) ? COMMAND_OK : COMMAND_USAGE;
    if (code == COMMAND_OK && options->on_service)
        in_spec = mem_strdup(inspected);
    else if (code == COMMAND_OK)
        code = send_input(c, argument, options->json, &in_spec);
    if (code == COMMAND_OK) code = inspect(c, in_spec, inspected, member, options, &inspection);
    if (code == COMMAND_OK && !(spec = make_spec(inspection, argument, options))) code = COMMAND_USAGE;
    if (code == COMMAND_OK) {
        const command_options plain = {.json = options->json};
        if (!options->json) terminal_text_print(stdout, "spec: %s\n", spec);
        fflush(stdout);
        code = command_post_text(c, spec, !options->on_service, &plain, &job);
    }
    if (code == COMMAND_OK) {
        json_at root = json_root(job);
        const char *id = json_string(json_member(&root, "id"), "");
        /* printed first, so that the id is known if the wait is interrupted */
        terminal_text_print(stderr, "job %s\n", id);
        code = take_result(c, id, spec, directory, options);
    }
    json_free(inspection);
    json_free(job);
    free(stem);
    free(inspected);
    free(in_spec);
    free(spec);
    return code;
}

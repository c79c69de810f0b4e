// SPDX-License-Identifier: Apache-2.0
/* hexad-worker: runs one job and ends. Wiring only; see ARCHITECTURE.md for the contract. */
#include "config.h"

#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/build_part.h"
#include "base/core/error.h"
#include "base/core/frames.h"
#include "base/core/help_text.h"
#include "base/core/memory.h"
#include "base/core/nearest_name.h"
#include "base/core/options.h"
#include "base/core/reader.h"
#include "base/core/sandbox.h"
#include "base/core/terminal_text.h"
#include "base/core/worker_contract.h"
#include "io/images/image_reader.h"
#include "io/volumes/exr_reader.h"
#include "io/volumes/volume_header.h"
#include "io/volumes/tiff_reader.h"
#include "io/volumes/zarr_reader.h"
#include "io/pictures/thumbnail.h"
#include "job/inspect/inspection.h"
#include "base/json/json.h"
#include "io/meshes/mesh_reader.h"
#include "sampling/packing/energy.h"
#include "job/phases/result_arrays.h"
#include "job/phases/results.h"
#include "job/phases/run.h"
#include "job/report/summary.h"
#include "spec/attach_spec.h"
#include "spec/json_schema.h"
#include "spec/sample_spec.h"
#include "spec/spec.h"
#include "spec/spec_table.h"
#include "files/file.h"
#include "files/root.h"
#include "surface/volume/example.h"

/* Maximum bytes of a spec; a larger file is not a spec. */
static const size_t SPEC_LIMIT = 16u << 20;
static const int64_t DEFAULT_MEMORY_MB = 4096;

#define COMMAND_ATTACH "attach"
#define COMMAND_SAMPLE "sample"

/* Where texts of the help begin. */
enum { HELP_COLUMN = 20 };

static volatile sig_atomic_t cancel_requested;
static int arrays_fd = -1; /* where the result and errors are written as arrays; -1: nowhere */

static void request_cancel(int number)
{
    cancel_requested = number;
}

static worker_exit exit_code_of(error_code code)
{
    switch (code) {
    case ERROR_SPEC_INVALID:
    case ERROR_NOT_SUPPORTED:
        return WORKER_EXIT_SPEC;
    case ERROR_PATH_FORBIDDEN:
    case ERROR_INPUT_MISSING:
    case ERROR_INPUT_DAMAGED:
    case ERROR_INPUT_UNSUPPORTED:
    case ERROR_GRID_MISSING:
    case ERROR_GRID_AMBIGUOUS:
    case ERROR_ATTRIBUTE_MISSING:
    case ERROR_ISOVALUE_REQUIRED:
        return WORKER_EXIT_INPUT;
    case ERROR_NO_SURFACE:
        return WORKER_EXIT_SURFACE;
    case ERROR_LIMIT_MEMORY:
    case ERROR_LIMIT_TIME:
    case ERROR_LIMIT_FILE:
    case ERROR_STALLED:
        return WORKER_EXIT_LIMIT;
    case ERROR_CANCELLED:
        return WORKER_EXIT_CANCELLED;
    case ERROR_STORAGE_FULL:
    case ERROR_STORAGE_FAILED:
        return WORKER_EXIT_STORAGE;
    default:
        return WORKER_EXIT_INTERNAL;
    }
}

/* Prints the last line of a failed run. */
static int fail(const error *e, const spec_faults *faults)
{
    json *line = json_new_object();
    json_put_string(line, "code", error_code_name(e->code));
    json_put_string(line, "message", e->message);
    if (faults && faults->count > 0) {
        json *array = json_put_array(line, "errors");
        for (size_t k = 0; k < faults->count; k++) {
            json *item = json_append_object(array);
            json_put_string(item, "pointer", faults->item[k].pointer);
            json_put_string(item, "detail", faults->item[k].detail);
        }
    }
    char *text = json_print(line);
    terminal_text_write(stderr, TERMINAL_TEXT_JSON, text, strlen(text));
    fputc('\n', stderr);
    free(text);
    json_free(line);
    if (arrays_fd >= 0) result_arrays_write(NULL, e, arrays_fd, NULL);
    return exit_code_of(e->code);
}

/* Ends a job that hangs in a library; its threads run until the process ends. */
static void leave(const error *e)
{
    _exit(fail(e, NULL));
}

typedef struct arguments {
    const char *spec_path, *output, *previous, *preview;
    const char *const *meshes; /* of the command attach */
    size_t mesh_count;
    sample_options sample; /* of the command sample */
    option_words set, roots;
    bool progress, json, accept;
    long arrays_fd, progress_fd, memory_mb, most_memory_mb, threads, frame; /* -1: none */
    const char *sandbox_name;
    sandbox_mode sandbox;
} arguments;

static void free_arguments(arguments *a)
{
    free(a->roots.item);
    free(a->set.item);
}

/* Those without a text are not in the help: the library uses them. */
static const option_row worker_options[] = {
    {OPTION_BASIC, WORKER_OPTION_OUTPUT, "DIR", OPTION_WORD, offsetof(arguments, output), NULL,
     .text = "directory of the results; created if missing (required, except by inspect and sample)"},
    {OPTION_BASIC, "count", "N", OPTION_WORD, offsetof(arguments, sample.count), COMMAND_SAMPLE,
     .text = "the number of points"},
    {OPTION_BASIC, "spacing", "S", OPTION_WORD, offsetof(arguments, sample.spacing), COMMAND_SAMPLE,
     .text = "the distance between neighbours, instead of their number"},
    {OPTION_BASIC, "grade", "curvature[=RATIO]", OPTION_WORD, offsetof(arguments, sample.grade),
     COMMAND_SAMPLE, .text = "closer together where the surface is curved, by up to RATIO (default 4)"},
    {OPTION_BASIC, "pattern", "blue_noise", OPTION_WORD, offsetof(arguments, sample.pattern), COMMAND_SAMPLE,
     .text = "without regular order"},
    {OPTION_BASIC, "set", "/MEMBER=VALUE", OPTION_WORDS, offsetof(arguments, set), COMMAND_SAMPLE,
     .text =
         "a member of the spec and its value, JSON or a text: --set /output/mesh=true. It may be given several times"},
    {OPTION_ADVANCED, "frames", "FRAMES", OPTION_WORD, offsetof(arguments, sample.frames), COMMAND_SAMPLE,
     .text =
         "the frames of a sequence, such as 1-100, with FILE a pattern such as a.####.obj: its first frame is "
         "inspected, and --frame N is sampled"},
    {OPTION_ADVANCED, "name", "NAME", OPTION_WORD, offsetof(arguments, sample.name), COMMAND_SAMPLE,
     .text = "the name of the job (default: that of FILE)"},
    {OPTION_ADVANCED, "accept", NULL, OPTION_FLAG, offsetof(arguments, accept), COMMAND_SAMPLE,
     .text = "exit with 0 if queue.accept of the spec contains the outcome (default: any outcome)"},
    {OPTION_BASIC, "json", NULL, OPTION_FLAG, offsetof(arguments, json), WORKER_COMMAND_INSPECT,
     .text = "the inspection as a JSON object"},
    {OPTION_BASIC, "preview", "FILE.png", OPTION_WORD, offsetof(arguments, preview), WORKER_COMMAND_INSPECT,
     .text = "samples the first spec and draws the points"},
    {OPTION_ADVANCED, "progress", NULL, OPTION_FLAG, offsetof(arguments, progress), NULL,
     .text = "a progress bar on standard error (sample, inspect: by default, if that is a terminal)"},
    {OPTION_ADVANCED, WORKER_OPTION_PROGRESS_FD, "N", OPTION_NUMBER, offsetof(arguments, progress_fd), NULL,
     .text = "progress as JSON lines on descriptor N"},
    {OPTION_ADVANCED, WORKER_OPTION_ARRAYS_FD, "N", OPTION_NUMBER, offsetof(arguments, arrays_fd), NULL,
     .text = NULL},
    {OPTION_ADVANCED, WORKER_OPTION_INPUT_ROOT, "DIR", OPTION_WORDS, offsetof(arguments, roots), NULL,
     .text =
         "input files must be below DIR, which may also be a single file that jobs name without its directory; may be "
         "given several times"},
    {OPTION_BASIC, WORKER_OPTION_MEMORY_MB, "N", OPTION_NUMBER, offsetof(arguments, memory_mb), NULL,
     .text = "memory limit of a job without limits.memory_mb (MiB, default 4096)",
     .low = WORKER_MEMORY_LEAST_MB},
    {OPTION_ADVANCED, WORKER_OPTION_MOST_MEMORY_MB, "N", OPTION_NUMBER, offsetof(arguments, most_memory_mb),
     NULL, .text = "the largest limits.memory_mb that messages suggest (default: no maximum)",
     .low = WORKER_MEMORY_LEAST_MB},
    {OPTION_BASIC, WORKER_OPTION_THREADS, "N", OPTION_NUMBER, offsetof(arguments, threads), NULL,
     .text =
         "maximum number of threads. It is the number for a job without solver.threads, too (default: no maximum, and "
         "one thread per processor)",
     .low = 1},
    {OPTION_BASIC, WORKER_OPTION_FRAME, "N", OPTION_NUMBER, offsetof(arguments, frame), NULL,
     .text = "the frame of a spec with queue.frames, or the file of one with queue.files, from 0"},
    {OPTION_ADVANCED, WORKER_OPTION_PREVIOUS, "DIR", OPTION_WORD, offsetof(arguments, previous), NULL,
     .text =
         "results of the previous frame; a frame with queue.coherent starts from its points (default: the frame is "
         "the first of the sequence)"},
    {OPTION_ADVANCED, WORKER_OPTION_SANDBOX, "MODE", OPTION_WORD, offsetof(arguments, sandbox_name), NULL,
     .text =
         "required: no network, no other programs, and no files outside the input roots and DIR; available: as much "
         "of this as the kernel supports; off (default)"},
};
enum { WORKER_OPTION_COUNT = sizeof worker_options / sizeof *worker_options };
static const option_table known_options = {"hexad-worker", worker_options, WORKER_OPTION_COUNT};

/* Inserts the name of the frame's file into the spec of a data set. A list of one name is the name of any frame:
 * the service sends such a list. */
static bool choose_file(spec *s, long frame, error *e)
{
    if (s->files.is_pattern)
        return error_set(e, ERROR_SPEC_INVALID,
                         "/queue/files: only the service finds the names of a pattern: write a list");
    if (frame < 0 || (s->files.count > 1 && (size_t)frame >= s->files.count))
        return error_set(
            e, ERROR_SPEC_INVALID,
            "/queue/files: the spec is a data set of %zu files: choose one with --frame N, from 0",
            s->files.count);
    spec_set_frame(s, (int)frame);
    spec_set_file(s, s->files.name[s->files.count > 1 ? frame : 0]);
    return true;
}

/* Checks that a sequence has the number of one frame, and any other spec has none. If values depend on the
 * frame, *s becomes the spec of that frame, which still lists the numbers of all frames. */
static bool choose_frame(spec **s, long frame, bool previous, spec_faults *faults, error *e)
{
    spec *whole = *s;
    size_t i = 0;
    if (previous && !whole->coherent)
        return error_set(e, ERROR_SPEC_INVALID,
                         "--previous requires a spec with queue.coherent: omit it, or set queue.coherent");
    if (whole->files.count) return choose_file(whole, frame, e);
    if (!whole->frames && frame < 0) return true;
    if (!whole->frames)
        return error_set(
            e, ERROR_SPEC_INVALID,
            "--frame requires a spec with queue.frames or queue.files: omit it, or add one of them");
    if (strcmp(whole->frames, FRAMES_ALL) == 0)
        return error_set(e, ERROR_SPEC_INVALID,
                         "/queue/frames: only the service finds the numbers of \"" FRAMES_ALL
                         "\": write the numbers");
    while (i < whole->frame_count && whole->frame[i] != frame) i++;
    if (i == whole->frame_count)
        return error_set(e, ERROR_SPEC_INVALID,
                         "/queue/frames: the spec is a sequence, \"%.100s\": choose one frame with --frame N",
                         whole->frames);
    if (whole->has_frame_values) {
        spec *one = spec_of_frame(whole, i, faults, e);
        if (!one) return false;
        free(one->frame);
        one->frame = whole->frame;
        one->frame_count = whole->frame_count;
        whole->frame = NULL;
        spec_free(whole);
        *s = one;
    }
    spec_set_frame(*s, (int)frame);
    return true;
}

/* Puts "./" before words that begin with a single `-`, as -lead.obj: the worker has no short options, so they are files.
 * The words are never freed. */
static void name_files(int argc, char **argv)
{
    bool is_value = false;
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++) {
        const bool is_option = strncmp(argv[i], "--", 2) == 0;
        if (!is_value && !is_option && argv[i][0] == '-' && argv[i][1]) argv[i] = mem_printf("./%s", argv[i]);
        is_value = false;
        for (size_t k = 0; is_option && k < WORKER_OPTION_COUNT; k++)
            is_value |= worker_options[k].value && strcmp(argv[i] + 2, worker_options[k].name) == 0;
    }
}

static bool take_options(int argc, char **argv, arguments *a, error *e)
{
    int k;
    while ((k = options_next(&known_options, argc, argv, false, a, e)) >= 0) {
        const option_row *o = &worker_options[k];
        if (o->command && strcmp(o->command, argv[0]) != 0)
            return error_set(e, ERROR_SPEC_INVALID, "--%s is an option of %s: omit it", o->name, o->command);
        arrays_fd = (int)a->arrays_fd;
    }
    a->sample.set = a->set.item;
    a->sample.set_count = a->set.count;
    if (k == OPTIONS_END && a->sandbox_name && !sandbox_mode_from_name(a->sandbox_name, &a->sandbox))
        return error_set(e, ERROR_SPEC_INVALID, "--sandbox must be required, available or off (given %s)",
                         a->sandbox_name);
    return k == OPTIONS_END;
}

static bool parse_arguments(int argc, char **argv, arguments *a, error *e)
{
    *a = (arguments){.arrays_fd = -1, .progress_fd = -1, .frame = -1, .memory_mb = DEFAULT_MEMORY_MB};
    name_files(argc, argv);
    if (!take_options(argc, argv, a, e)) return false;
    bool inspects = strcmp(argv[0], WORKER_COMMAND_INSPECT) == 0;
    if (strcmp(argv[0], COMMAND_ATTACH) == 0) {
        if (argc - optind < 2 || !a->output)
            return error_set(
                e, ERROR_SPEC_INVALID,
                "attach requires RESULT, one or more MESH, and --output DIR: see hexad-worker --help");
        a->meshes = (const char *const *)argv + optind + 1;
        a->mesh_count = (size_t)(argc - optind - 1);
        argc = optind + 1;
    }
    bool samples = strcmp(argv[0], COMMAND_SAMPLE) == 0;
    if (a->arrays_fd >= 0 && (a->output || strcmp(argv[0], WORKER_COMMAND_RUN) != 0))
        return error_set(e, ERROR_SPEC_INVALID,
                         "--" WORKER_OPTION_ARRAYS_FD " is an option of run, in place of --output: omit it");
    if (argc - optind != 1 || (!a->output && a->arrays_fd < 0 && !inspects && !samples))
        return error_set(e, ERROR_SPEC_INVALID, "%s requires one %s: see hexad-worker --help", argv[0],
                         inspects || samples ? "FILE" : "SPEC.json (or -) and --output DIR");
    if (a->preview && build_part_missing(BUILD_PART_PREVIEW))
        return error_set(e, ERROR_NOT_SUPPORTED, "--preview: %s", build_part_missing(BUILD_PART_PREVIEW));
    a->spec_path = argv[optind];
    return true;
}

static FILE *open_spec(const char *path, error *e)
{
    FILE *file = strcmp(path, "-") == 0 ? stdin : fopen(path, "rb");
    if (!file)
        error_set(e, ERROR_SPEC_INVALID, "cannot read the spec %s: %s. Check the path.", path,
                  strerror(errno));
    return file;
}

/* The whole text of a spec. NULL and an error if it cannot be read. */
static char *read_spec(FILE *file, const char *path, size_t *length, error *e)
{
    char *text = store_stream_read(file, SPEC_LIMIT, length);
    if (!text)
        error_set(e, ERROR_SPEC_INVALID,
                  errno == EFBIG ? "the spec %s is too large: put long arrays into files that the spec names"
                                 : "cannot read the spec %s",
                  path);
    return text;
}

/* The spec that places the points of a result on other meshes. `report` is the report of the result. */
static json *attached_spec(const arguments *a, json *report, error *e)
{
    json *sampled = json_find(report, "/spec");
    char *path =
        mem_printf("%.*spoints.ply", (int)(strlen(a->spec_path) - strlen(WORKER_REPORT_NAME)), a->spec_path);
    json *document = NULL;
    if (sampled)
        document = attach_spec_make(sampled, path, a->meshes, a->mesh_count, e);
    else
        error_set(e, ERROR_SPEC_INVALID, "%s has no spec: name the directory of a result", a->spec_path);
    free(path);
    return document;
}

static spec *load_spec(FILE *file, const arguments *a, spec_faults *faults, error *e)
{
    size_t length;
    char *text = read_spec(file, a->spec_path, &length, e);
    json *document = text ? json_parse(text, length, e) : NULL;
    if (!document && !a->meshes) {
        if (text) error_prefix(e, "a spec must be a valid JSON document");
        sample_spec_advise("hexad-worker", a->spec_path, e);
    }
    free(text);
    if (document && a->meshes) {
        json *report = document;
        document = attached_spec(a, report, e);
        json_free(report);
    }
    if (!document) return NULL;
    spec *s = spec_parse(document, faults, e);
    json_free(document);
    return s;
}

static void handle_signals(void)
{
    struct sigaction action = {.sa_handler = request_cancel};
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGALRM, &action, NULL);
    signal(SIGPIPE, SIG_IGN); /* the job continues if the reader of progress has ended */
    signal(SIGXFSZ, SIG_IGN); /* makes a write beyond the size limit an error, like a full disk */
}

/* Applies limits.timeout_s by a signal, which acts like a cancellation. */
static void start_timer(double seconds)
{
    if (seconds <= 0) return;
    struct itimerval timer = {.it_value = {(time_t)seconds, (suseconds_t)(1e6 * fmod(seconds, 1))}};
    if (timer.it_value.tv_sec == 0 && timer.it_value.tv_usec == 0) timer.it_value.tv_usec = 1;
    setitimer(ITIMER_REAL, &timer, NULL);
}

/* Opens the files of the command line, and enters the sandbox. With a sandbox and without input roots no
 * input file can be read. */
static bool prepare(const arguments *a, store_roots **roots, FILE **spec_file, sequence_files *previous,
                    error *e)
{
    const sandbox_places places = {a->roots.item, a->roots.count, a->output};
    if (spec_file && !(*spec_file = open_spec(a->spec_path, e))) return false;
    if (a->previous && !sequence_open(a->previous, previous, e)) return false;
    if ((a->roots.count > 0 || a->sandbox != SANDBOX_OFF) &&
        !(*roots = store_roots_open(NULL, a->roots.item, a->roots.count, e)))
        return false;
    if (a->sandbox == SANDBOX_OFF) return true;
    if (!a->output && a->arrays_fd < 0)
        return error_set(e, ERROR_SPEC_INVALID, "--sandbox requires --output DIR: add it");
    char text[SANDBOX_TEXT_SIZE];
    sandbox_describe(a->sandbox, text); /* before the process enters it: inside, /proc cannot be read */
    if ((a->output && !store_directory_create(a->output, e)) || !sandbox_enter(a->sandbox, &places, e))
        return false;
    terminal_text_print(stderr, "sandbox: %s\n", text);
    return true;
}

/* Executes a parsed spec. Returns the exit status, or -1 and an error. */
typedef int command(const spec *s, const run_options *options, error *e);

static const worker_exit exit_of_outcome[OUTCOME_KINDS] = {
    [OUTCOME_CONVERGED] = WORKER_EXIT_CONVERGED,
    [OUTCOME_UNRESOLVED] = WORKER_EXIT_UNRESOLVED,
    [OUTCOME_NOT_CONVERGED] = WORKER_EXIT_NOT_CONVERGED,
};

static int run(const spec *s, const run_options *options, error *e)
{
    outcome_kind outcome;
    json *report = NULL;
    start_timer(s->timeout_s);
    if (!run_job(s, options, &outcome, &report, e)) return -1;
    summary_print(report, stdout, stderr);
    json_free(report);
    return exit_of_outcome[outcome];
}

static int estimate(const spec *s, const run_options *options, error *e)
{
    json *document = run_estimate(s, options, e);
    if (!document) return -1;
    char *text = json_print(document), *path = mem_printf("%s/" WORKER_ESTIMATE_NAME, options->output);
    store_file_clear(path); /* left by a killed process */
    bool ok = store_directory_create(options->output, e) && store_file_write(path, text, strlen(text), e);
    if (ok) puts(text);
    free(path);
    free(text);
    json_free(document);
    return ok ? WORKER_EXIT_CONVERGED : -1;
}

static int obey(int argc, char **argv, command *what)
{
    error e = {0};
    spec_faults faults = {0};
    arguments a;
    spec *s = NULL;
    store_roots *roots = NULL;
    FILE *spec_file = NULL;
    sequence_files previous = {0};
    result_arrays arrays = {0};
    int code;
    char *report_path = NULL;
    handle_signals();
    mem_begin();
    bool parsed = parse_arguments(argc, argv, &a, &e);
    if (parsed && a.meshes) a.spec_path = report_path = mem_printf("%s/" WORKER_REPORT_NAME, a.spec_path);
    if (!parsed || !prepare(&a, &roots, &spec_file, &previous, &e)) goto fail;
    if (!(s = load_spec(spec_file, &a, &faults, &e))) goto fail;
    if (!choose_frame(&s, a.frame, a.previous != NULL, &faults, &e)) goto fail;
    run_options options = {
        .output = a.output,
        .delivery = a.arrays_fd < 0 ? results_in_directory(a.output) : results_in_memory(&arrays),
        .roots = roots,
        .memory_mb = a.memory_mb,
        .most_memory_mb = a.most_memory_mb,
        .threads = (int)a.threads,
        .frame = (int)a.frame,
        .previous = a.previous ? &previous : NULL,
        .progress_fd = (int)a.progress_fd,
        .progress_bar = a.progress,
        .cancel = &cancel_requested,
        .leave = leave,
    };
    if ((code = what(s, &options, &e)) < 0) goto fail;
    if (arrays_fd >= 0 && !result_arrays_write(&arrays, NULL, arrays_fd, &e)) goto fail;
    goto done;
fail:
    code = fail(&e, &faults);
done:
    result_arrays_free(&arrays);
    if (spec_file && spec_file != stdin) fclose(spec_file);
    sequence_close(&previous);
    spec_free(s);
    store_roots_close(roots);
    free_arguments(&a);
    free(report_path);
    return code;
}

/* Samples the first suggestion of the inspection with the given options, and moves the picture to `to`. */
static bool draw_preview(const json *inspection, const run_options *options, const char *to, error *e)
{
    const json *suggested = sample_spec_suggested(inspection);
    outcome_kind outcome;
    json *report = NULL;
    if (!suggested) return error_set(e, ERROR_NO_SURFACE, "no picture was drawn: the file has no surface");
    spec *s = spec_parse(suggested, NULL, e);
    run_options own = *options;
    char *directory = mem_printf("%s.XXXXXX", to), *picture = NULL;
    bool ok =
        s && (mkdtemp(directory) || error_set(e, error_code_of_errno(errno), "cannot write %s: %m", to));
    if (ok) {
        own.output = directory;
        own.delivery = results_in_directory(directory);
        picture = mem_printf("%s/preview.png", directory);
        ok =
            run_job(s, &own, &outcome, &report, e) &&
            (rename(picture, to) == 0 || error_set(e, error_code_of_errno(errno), "cannot write %s: %m", to));
        store_remove(directory, NULL);
    }
    json_free(report);
    spec_free(s);
    free(picture);
    free(directory);
    return ok;
}

/* The path of the file to inspect: the argument, or a member of the object on standard input. The caller
 * frees it. */
static char *read_path(const char *argument, error *e)
{
    size_t length;
    if (strcmp(argument, WORKER_SPEC_ON_STDIN) != 0) return mem_strdup(argument);
    char *text = read_spec(stdin, argument, &length, e), *path = NULL;
    json *document = text ? json_parse(text, length, e) : NULL;
    json_at root = json_root(document);
    const char *named = json_string(json_member(&root, "path"), NULL);
    if (named)
        path = mem_strdup(named);
    else if (document)
        error_set(e, ERROR_SPEC_INVALID, "standard input contains no path");
    json_free(document);
    free(text);
    return path;
}

/* Prints the inspection. With an output directory the document also contains the text, so that clients need
 * not print it themselves. */
static bool show_inspection(const arguments *a, json *inspection, error *e)
{
    char *page = NULL;
    size_t length;
    FILE *out = open_memstream(&page, &length);
    inspection_print(inspection, out);
    fclose(out);
    if (a->output) json_put_string(inspection, "text", page);
    char *text = json_print(inspection),
         *name = mem_printf("%s/" WORKER_INSPECTION_NAME, a->output ? a->output : "");
    if (a->output) store_file_clear(name); /* left by a killed process */
    bool ok =
        !a->output || (store_directory_create(a->output, e) && store_file_write(name, text, strlen(text), e));
    if (ok && a->json)
        puts(text);
    else if (ok)
        fputs(page, stdout);
    free(page);
    free(name);
    free(text);
    return ok;
}

/* Makes the inspection. If `shows`, a line on standard error names the file until the inspection ends. */
static json *inspect_shown(const char *path, const run_options *options, bool shows, error *e)
{
    if (shows) {
        terminal_text_print(stderr, "inspecting %s: all of it is read", path);
        fflush(stderr);
    }
    json *inspection = inspection_make(path, options, e);
    if (shows) fputs("\r\033[K", stderr);
    return inspection;
}

static int inspect(int argc, char **argv)
{
    error e = {0};
    arguments a;
    store_roots *roots = NULL;
    char *path = NULL;
    json *inspection = NULL;
    handle_signals();
    bool ok = parse_arguments(argc, argv, &a, &e) && prepare(&a, &roots, NULL, NULL, &e) &&
              (path = read_path(a.spec_path, &e));
    const run_options options = {.output = a.output,
                                 .roots = roots,
                                 .memory_mb = a.memory_mb,
                                 .most_memory_mb = a.most_memory_mb,
                                 .threads = (int)a.threads,
                                 .progress_fd = (int)a.progress_fd,
                                 .cancel = &cancel_requested,
                                 .leave = leave};
    const bool shows = a.progress || isatty(STDERR_FILENO) == 1;
    ok = ok && (inspection = inspect_shown(path, &options, shows, &e)) &&
         show_inspection(&a, inspection, &e) &&
         (!a.preview || draw_preview(inspection, &options, a.preview, &e));
    json_free(inspection);
    free(path);
    store_roots_close(roots);
    free_arguments(&a);
    return ok ? WORKER_EXIT_CONVERGED : fail(&e, NULL);
}

/* Samples the surface of a spec, and writes the spec beside the points. `accept`: an outcome that the spec accepts
 * counts as converged. Returns the exit code, or -1 and an error. */
static int run_sample(const json *document, const run_options *options, bool accept, spec_faults *faults,
                      error *e)
{
    spec *s = spec_parse(document, faults, e);
    const bool chosen = s && choose_frame(&s, options->frame, false, faults, e);
    char *text = json_print(document), *beside = mem_printf("%s/" SAMPLE_SPEC_NAME, options->output),
         *summary = mem_printf("%s/" WORKER_SUMMARY_NAME, options->output); /* for the daemon only */
    terminal_text_print(stdout, "spec: %s\n", text);
    int code = chosen ? run(s, options, e) : -1;
    for (int k = 0; accept && k < OUTCOME_KINDS; k++)
        if (code == (int)exit_of_outcome[k] && s->accept >> k & 1) code = WORKER_EXIT_CONVERGED;
    if (code >= 0) unlink(summary);
    if (code >= 0 && !store_file_write(beside, text, strlen(text), e)) code = -1;
    if (code >= 0) terminal_text_print(stdout, "the points are in %s/points.ply\n", options->output);
    spec_free(s);
    free(text);
    free(beside);
    free(summary);
    return code;
}

/* From a file to points, with the spec that an inspection suggests. */
static int sample(int argc, char **argv)
{
    error e = {0};
    spec_faults faults = {0};
    arguments a;
    store_roots *roots = NULL;
    char *stem = NULL, *inspected = NULL, *note = NULL, *of_volume = NULL;
    json *inspection = NULL, *document = NULL;
    int code = -1;
    handle_signals();
    mem_begin();
    if (!parse_arguments(argc, argv, &a, &e)) goto done;
    if (!a.output) a.output = stem = sample_spec_stem(a.spec_path);
    if (!sample_spec_check(&a.sample, &e)) goto done;
    struct stat info;
    if (stem && !store_directory_is_free(stem, false) && stat(a.spec_path, &info) == 0 &&
        S_ISDIR(info.st_mode)) {
        error_set(&e, ERROR_SPEC_INVALID,
                  "%s is a directory: give a file, or a pattern such as name.####.obj with --frames. For an "
                  "OME-Zarr image, name the directory for the result with --output",
                  a.spec_path);
        goto done;
    }
    if (!store_directory_is_free(a.output, !stem)) {
        error_set(&e, ERROR_SPEC_INVALID, STORE_DIRECTORY_TAKEN, a.output);
        goto done;
    }
    if (!prepare(&a, &roots, NULL, NULL, &e)) goto done;
    run_options options = {
        .output = a.output,
        .delivery = results_in_directory(a.output),
        .roots = roots,
        .memory_mb = a.memory_mb,
        .threads = (int)a.threads,
        .frame = (int)a.frame,
        .progress_fd = (int)a.progress_fd,
        .cancel = &cancel_requested,
        .leave = leave,
    };
    if (!(inspected = sample_spec_inspected(a.spec_path, &a.sample, &e))) goto done;
    const char *member = inspection_member(inspected, &options);
    if (member && !sample_spec_needs_inspection(member, &a.sample)) {
        inspection = sample_spec_unseen(member, inspected);
    } else {
        terminal_text_print(stderr, "inspecting %s\n", inspected);
        inspection = inspection_make(inspected, &options, &e);
    }
    if (!inspection) goto done;
    if (!(document = sample_spec_make(inspection, a.spec_path, &a.sample, &e))) goto done;
    if ((of_volume = sample_spec_volume_note(inspection, &a.sample)))
        terminal_text_print(stderr, "%s\n", of_volume);
    if ((note = sample_spec_isovalue_note(inspection, &a.sample))) terminal_text_print(stderr, "%s\n", note);
    options.progress_bar = a.progress || isatty(STDERR_FILENO) == 1;
    code = run_sample(document, &options, a.accept, &faults, &e);
done:
    if (code < 0) code = fail(&e, &faults);
    json_free(inspection);
    json_free(document);
    store_roots_close(roots);
    free_arguments(&a);
    free(stem);
    free(inspected);
    free(note);
    free(of_volume);
    return code;
}

static int make_example(int argc, char **argv)
{
    error e = {0};
    store_file file = {0};
    if (argc != 2) {
        error_set(&e, ERROR_SPEC_INVALID, "make-example requires one FILE.vdb: see hexad-worker --help");
        return fail(&e, NULL);
    }
    const char *path = argv[1];
    store_file_clear(path); /* left by a killed process */
    bool ok = store_file_begin(path, &file, &e) && example_write(fileno(file.stream), &e) &&
              store_file_commit(&file, &e);
    store_file_abort(&file);
    return ok ? 0 : fail(&e, NULL);
}

/* Prints the data of Figure 2: potentials and forces against the distance in units of the support. */
static int print_energies(int argc, char **argv)
{
    (void)argc, (void)argv;
    const energy_function *const all[] = {&energy_gaussian, &energy_electrostatic, &energy_cotangent};
    enum { COUNT = sizeof all / sizeof all[0], STEPS = 120 };
    printf("u");
    for (int k = 0; k < COUNT; k++)
        terminal_text_print(stdout, ",%s_energy,%s_force", all[k]->name, all[k]->name);
    for (int i = 1; i <= STEPS; i++) {
        double u = i / 100.0;
        printf("\n%.2f", u);
        for (int k = 0; k < COUNT; k++) printf(",%.9g,%.9g", all[k]->value(u), all[k]->first(u));
    }
    return puts("") < 0;
}

static int print_schema(int argc, char **argv)
{
    (void)argc, (void)argv;
    json *schema = json_schema_new(JSON_SCHEMA_ALONE);
    char *text = json_print_pretty(schema);
    bool ok = fputs(text, stdout) >= 0;
    free(text);
    json_free(schema);
    return !ok;
}

/* Prints help for a terminal. Unlike the other commands it reports a fault as text. */
static int print_spec_help(int argc, char **argv)
{
    const char *member = argc > 1 ? argv[1] : NULL;
    const size_t printed = spec_print_help(stdout, member);
    if (!member)
        printf(
            "%zu of %zu members. hexad-worker spec-help all prints every one, spec-help MEMBER those of a group.\n",
            printed, spec_row_count);
    if (printed > 0) return 0;
    nearest_name n = nearest_name_to(member, strlen(member));
    for (size_t i = 0; i < spec_row_count; i++) nearest_name_offer(&n, spec_row_key(&spec_rows[i]));
    if (n.name)
        terminal_text_print(stderr, "hexad-worker: unknown member %s; did you mean %s?\n", member, n.name);
    else
        terminal_text_print(
            stderr, "hexad-worker: unknown member %s: run hexad-worker spec-help all for all members\n",
            member);
    return WORKER_EXIT_SPEC;
}

static int obey_run(int argc, char **argv)
{
    return obey(argc, argv, run);
}

static int obey_estimate(int argc, char **argv)
{
    return obey(argc, argv, estimate);
}

static const struct worker_command {
    option_rank rank;
    const char *name, *arguments;
    int (*run)(int argc, char **argv); /* argv[0] is the name of the command */
    const char *text;
} commands[] = {
    {OPTION_BASIC, COMMAND_SAMPLE,
     "FILE [--count N | --spacing S] [--grade curvature[=RATIO]] [--pattern blue_noise] [--set /MEMBER=VALUE]... "
     "[--frames FRAMES --frame N] [--name NAME] [--output DIR] [--accept]",
     sample,
     "from a file to points, without a spec. It samples the first surface that inspect suggests, and writes "
     "points.ply, previews, report.json and the spec (" SAMPLE_SPEC_NAME
     ") into DIR, which has no files, or into ./NAME for NAME.obj, which does not exist"},
    {OPTION_BASIC, WORKER_COMMAND_RUN, "SPEC.json|- --output DIR", obey_run,
     "samples the surface that SPEC.json describes (-: standard input). It writes points.ply, previews and "
     "report.json into DIR. report.json is written last: it marks the result as complete"},
    {OPTION_BASIC, WORKER_COMMAND_ESTIMATE, "SPEC.json|- --output DIR", obey_estimate,
     "prints the number of points, the area, and the memory and time that the job needs. They are a JSON object, "
     "which is written into DIR as " WORKER_ESTIMATE_NAME ", too"},
    {OPTION_BASIC, WORKER_COMMAND_INSPECT, "FILE [--json] [--preview FILE.png]", inspect,
     "prints the contents of a volume or mesh file, and specs that sample it. --preview samples the first spec and "
     "draws the points. --output is optional: inspection.json is written there"},
    {OPTION_ADVANCED, COMMAND_ATTACH, "RESULT MESH... --output DIR", obey_run,
     "places the points of the result in the directory RESULT, which have the attribute source, on another frame of "
     "its mesh (or of its meshes, in the order of the spec), and writes the same files into DIR"},
    {OPTION_BASIC, "make-example", "FILE.vdb", make_example, "writes a small level set as an example input"},
    {OPTION_RESEARCH, "energies", "", print_energies,
     "prints the pair potentials and their forces as CSV (the paper's Figure 2)"},
    {OPTION_BASIC, "spec-help", "[MEMBER | all]", print_spec_help,
     "lists the basic members of a job spec with type, range and default. With MEMBER, that member and those below "
     "it; MEMBER is /sampling, sampling/count or count. all: every member"},
    {OPTION_ADVANCED, "schema", "", print_schema, "prints the members of a job spec as a JSON Schema"},
};
enum { COMMAND_COUNT = sizeof commands / sizeof *commands };

static void print_help_of_command(const struct worker_command *c, bool brief)
{
    char *term = mem_printf("%s %s", c->name, c->arguments);
    help_text_item(stdout, HELP_COLUMN, term, c->text, brief);
    free(term);
}

static void print_help_of_options(option_rank last)
{
    for (size_t i = 0; i < WORKER_OPTION_COUNT; i++) {
        const option_row *o = &worker_options[i];
        if (!o->text || o->rank > last) continue;
        char *term = mem_printf("--%s%s%s", o->name, o->value ? " " : "", o->value ? o->value : "");
        char *text = mem_printf("%s%s%s", o->command ? o->command : "", o->command ? ": " : "", o->text);
        help_text_item(stdout, HELP_COLUMN, term, text, last == OPTION_BASIC);
        free(term);
        free(text);
    }
}

/* Prints what commands and options mean, up to a rank. */
static int print_help(option_rank last)
{
    const bool brief = last == OPTION_BASIC;
    puts("usage: hexad-worker COMMAND ... [OPTION ...]");
    for (option_rank rank = OPTION_BASIC; rank <= last; rank++) {
        puts("");
        for (size_t i = 0; i < COMMAND_COUNT; i++)
            if (commands[i].rank == rank) print_help_of_command(&commands[i], brief);
    }
    puts("");
    print_help_of_options(last);
    help_text_item(stdout, HELP_COLUMN, "--help, --version", "--help all: all commands and options", false);
    if (!brief)
        fputs(
            "\nExit codes: 0 succeeded with the outcome converged, 10 not_converged, 11 unresolved; 2 bad spec,\n"
            "3 bad input file, 4 no surface found, 5 limit exceeded, 6 cancelled, 7 disk full or failed,\n"
            "1 any other error. The last line on standard error of a failed run is a JSON object with code and message.\n",
            stdout);
    return ferror(stdout) != 0;
}

static int refuse_command(const char *name)
{
    error e = {0};
    nearest_name n = nearest_name_to(name, strlen(name));
    for (size_t i = 0; i < COMMAND_COUNT; i++) nearest_name_offer(&n, commands[i].name);
    if (n.name)
        error_set(&e, ERROR_SPEC_INVALID, "unknown command %s; did you mean %s?", name, n.name);
    else
        error_set(&e, ERROR_SPEC_INVALID, "unknown command %s: see hexad-worker --help", name);
    return fail(&e, NULL);
}

/* The programs that read untrusted files. Jobs start them as processes with these commands. */
typedef struct reader_program {
    const char *command;
    int (*run)(int argc, char **argv); /* NULL: a function of a module */
    const char *module, *symbol;
} reader_program;

static const reader_program *find_reader(const char *name)
{
    static const reader_program programs[] = {
        {MESH_READER_COMMAND, NULL, MESH_READER_MODULE, "mesh_reader_main"},
        {MESH_VALUES_COMMAND, NULL, MESH_READER_MODULE, "mesh_reader_main"},
        {MESH_POLYGONS_COMMAND, NULL, MESH_READER_MODULE, "mesh_reader_main"},
        {MESH_TEXTURES_COMMAND, NULL, MESH_READER_MODULE, "mesh_reader_main"},
        {MESH_MATERIALS_COMMAND, NULL, MESH_READER_MODULE, "mesh_reader_main"},
        {VOLUME_HEADER_COMMAND, NULL, VOLUME_HEADER_MODULE, "header_reader_main"},
        {TIFF_READER_COMMAND, NULL, TIFF_READER_MODULE, "tiff_reader_main"},
        {ZARR_READER_COMMAND, NULL, ZARR_READER_MODULE, "zarr_reader_main"},
        {IMAGE_READER_COMMAND, NULL, IMAGE_READER_MODULE, "image_reader_main"},
        {EXR_READER_COMMAND, exr_reader_main, NULL, NULL},
        {THUMBNAIL_COMMAND, thumbnail_main, NULL, NULL}};
    for (size_t k = 0; k < sizeof programs / sizeof *programs; k++)
        if (strcmp(name, programs[k].command) == 0) return &programs[k];
    return NULL;
}

int main(int argc, char **argv)
{
    const char *name = argc > 1 ? argv[1] : "--help";
    const reader_program *reads = find_reader(name);
    if (reads)
        return reads->run ? reads->run(argc - 1, argv + 1)
                          : reader_run_module(reads->module, reads->symbol, argc - 1, argv + 1);
    const bool all = argc > 2 && strcmp(argv[2], "all") == 0;
    if (strcmp(name, "--help") == 0) return print_help(all ? OPTION_RESEARCH : OPTION_BASIC);
    if (argc > 2 && strcmp(argv[2], "--help") == 0) return print_help(OPTION_RESEARCH);
    if (strcmp(name, "--version") == 0) return puts("hexad-worker " VERSION) < 0;
    for (size_t i = 0; i < COMMAND_COUNT; i++)
        if (strcmp(name, commands[i].name) == 0) return commands[i].run(argc - 1, argv + 1);
    return refuse_command(name);
}

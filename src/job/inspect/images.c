// SPDX-License-Identifier: Apache-2.0
/* The contents of OpenEXR and TIFF images, and of the stack that an image is one of. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "io/volumes/exr_stack.h"
#include "io/volumes/volume_file.h"
#include "job/inspect/contents.h"
#include "job/inspect/dense_inspection.h"
#include "files/root.h"

/* Maximum number of slices of a spec, and of channels of a stack whose values are read. */
enum { MOST_SLICES = 65536, MOST_CHANNELS = 4 };

/* Images whose names differ in a number. */
typedef struct stack {
    char *pattern; /* with #### in place of the number */
    int first, last;
    size_t count;
    char **paths;
    int *numbers;
} stack;

static void free_stack(stack *s)
{
    mem_free_texts(s->paths, s->count);
    free(s->numbers);
    free(s->pattern);
}

static bool is_there(const contents_input *in, const char *path)
{
    int fd = store_open_input(in->options->roots, path, NULL);
    if (fd >= 0) close(fd);
    return fd >= 0;
}

/* Finds the images with consecutive numbers around this one; the number is the last one in the name. */
static stack find_stack(const contents_input *in)
{
    const char *slash = strrchr(in->path, '/'), *name = slash ? slash + 1 : in->path,
               *end = strrchr(name, '.');
    stack s = {0};
    while (end && end > name && !isdigit((unsigned char)end[-1])) end--;
    const char *begin = end;
    while (begin && begin > name && isdigit((unsigned char)begin[-1])) begin--;
    int digits = (int)(end - begin), head = (int)(begin - in->path);
    if (!end || digits < 1 || digits > 9) return s;
    int number = atoi(begin);
    s.first = s.last = number;
    for (int step = -1; step <= 1; step += 2)
        for (int k = number + step; k >= 0 && s.last - s.first + 1 < MOST_SLICES; k += step) {
            char *path = mem_printf("%.*s%0*d%s", head, in->path, digits, k, end);
            bool there = is_there(in, path);
            free(path);
            if (!there) break;
            if (step < 0)
                s.first = k;
            else
                s.last = k;
        }
    s.count = (size_t)(s.last - s.first + 1);
    s.paths = mem_alloc(s.count * sizeof *s.paths);
    s.numbers = mem_alloc(s.count * sizeof *s.numbers);
    for (size_t k = 0; k < s.count; k++) {
        s.numbers[k] = s.first + (int)k;
        s.paths[k] = mem_printf("%.*s%0*d%s", head, in->path, digits, s.numbers[k], end);
    }
    s.pattern = mem_printf("%.*s%.*s%s", head, in->path, digits, "#########", end);
    return s;
}

/* Describes one channel of a stack: its values, and suggested surfaces. */
static bool describe_channel(const contents_input *in, const stack *of, const char *part, const char *channel,
                             json *inspection, error *e)
{
    const slices_files files = {dense_inspection_open_beside, (void *)in};
    const exr_stack_params params = {.count = of->count,
                                     .paths = (const char *const *)of->paths,
                                     .numbers = of->numbers,
                                     .part = *part ? part : NULL,
                                     .channel = channel,
                                     .voxel_size = {1, 1, 1},
                                     .memory_limit = run_options_memory(in->options, 0),
                                     .files = &files};
    slices *s = exr_stack_open(&params, e);
    if (!s) return false;
    json *exr = json_new_object();
    char *range = mem_printf("%d-%d", of->first, of->last);
    json_put_string(exr, "path", of->pattern);
    json_put_string(exr, "slices", range);
    if (*part) json_put_string(exr, "part", part);
    json_put_string(exr, "channel", channel);
    json *size = json_put_array(exr, "voxel_size");
    for (int k = 0; k < 3; k++) json_append_number(size, 1);
    free(range);
    json *volume = json_append_object(json_find(inspection, "/stacks"));
    json_put_string(volume, "part", part);
    json_put_string(volume, "channel", channel);
    bool ok = dense_inspection_describe(in, s, "exr", exr, volume, json_find(inspection, "/suggestions"), e);
    json_free(exr);
    s->ops->close(s);
    return ok;
}

/* Describes a TIFF image of one page, with the images numbered consecutively. */
static bool describe_pages(const contents_input *in, const stack *of, json *inspection, error *e)
{
    const slices_files files = {dense_inspection_open_beside, (void *)in};
    const exr_stack_params params = {.count = of->count,
                                     .paths = (const char *const *)of->paths,
                                     .numbers = of->numbers,
                                     .voxel_size = {1, 1, 1},
                                     .memory_limit = run_options_memory(in->options, 0),
                                     .files = &files};
    slices *s = volume_file_open_stack(&params, e);
    if (!s) return false;
    json *file = json_new_object();
    char *range = mem_printf("%d-%d", of->first, of->last);
    json_put_string(file, "path", of->pattern);
    json_put_string(file, "slices", range);
    free(range);
    json_put_integer(inspection, "images", (int64_t)of->count);
    const bool ok = dense_inspection_describe_volume(in, s, file, inspection, e);
    json_free(file);
    s->ops->close(s);
    return ok;
}

bool contents_read_tiff(const contents_input *in, json *inspection, error *e)
{
    const slices_files files = {dense_inspection_open_beside, (void *)in};
    error fault = {0};
    slices *s = dense_inspection_open(in, &files, &fault);
    if (s) {
        s->ops->close(s);
        return contents_read_dense(in, inspection, e);
    }
    stack beside = fault.code == ERROR_NO_SURFACE ? find_stack(in) : (stack){0};
    bool ok = beside.count >= 2 && describe_pages(in, &beside, inspection, e);
    if (beside.count < 2) {
        if (e) *e = fault;
        ok = error_prefix(e, "%s", in->path);
    }
    free_stack(&beside);
    return ok;
}

static void describe_line(char *line, json *channels, const char **part, const char **channel)
{
    const char *word[8] = {""};
    for (int k = 0; k < 8; k++) word[k] = line ? strsep(&line, "\t") : "";
    json *o = json_append_object(channels);
    json_put_string(o, "part", word[0]);
    json_put_string(o, "storage", word[1]);
    json *window = json_put_array(o, "data_window");
    for (int k = 2; k < 6; k++) json_append_number(window, atoi(word[k]));
    json_put_string(o, "channel", word[6]);
    json_put_string(o, "type", word[7]);
    *part = word[0];
    *channel = word[6];
}

bool contents_read_exr(const contents_input *in, json *inspection, error *e)
{
    const slices_files files = {dense_inspection_open_beside, (void *)in};
    const exr_stack_params params = {.count = 1,
                                     .paths = &in->path,
                                     .numbers = &(int){0},
                                     .memory_limit = run_options_memory(in->options, 0),
                                     .files = &files};
    char *text = exr_stack_list(&params, e), *rest = text;
    if (!text) return false;
    stack s = find_stack(in);
    json *channels = json_put_array(inspection, "channels");
    json_put_array(inspection, "stacks");
    json_put_integer(inspection, "images", (int64_t)(s.count > 0 ? s.count : 1));
    bool ok = true;
    for (size_t k = 0; ok && *rest; k++) {
        const char *part, *channel;
        error fault = {0};
        describe_line(strsep(&rest, "\n"), channels, &part, &channel);
        if (s.count < 2 || k >= MOST_CHANNELS) continue;
        if (!describe_channel(in, &s, part, channel, inspection,
                              &fault)) /* an image that is not a volume does not prevent the description of
                                        * the others */
            json_put_string(json_append_object(json_find(inspection, "/stacks")), "error", fault.message);
        ok = fault.code != ERROR_CANCELLED && fault.code != ERROR_LIMIT_TIME;
        if (!ok && e) *e = fault;
    }
    free_stack(&s);
    free(text);
    return ok;
}

// SPDX-License-Identifier: Apache-2.0
#include "job/phases/result_arrays.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "io/points/column.h"
#include "io/points/property.h"
#include "job/phases/output_points.h"

static const char what[] = "the result";

static void free_items(result_arrays *r)
{
    for (size_t k = 0; k < r->count; k++) free(r->item[k].data);
    free(r->item);
    r->item = NULL;
    r->count = 0;
}

void result_arrays_free(result_arrays *r)
{
    free_items(r);
    free(r->report);
    *r = (result_arrays){0};
}

/* Adds an array; its elements are zero. Returns them; NULL: limit_memory. */
static void *add(result_arrays *r, const char *name, number_type type, size_t rows, size_t width, error *e)
{
    void *data = mem_array(rows, width * number_bytes(type), what, e);
    if (!data) return NULL;
    r->item = mem_resize(r->item, (r->count + 1) * sizeof *r->item);
    result_array *a = &r->item[r->count++];
    *a = (result_array){.type = type, .rows = rows, .components = width, .data = data};
    snprintf(a->name, sizeof a->name, "%s", name);
    return data;
}

static bool add_property(result_arrays *r, const property *p, size_t rows, error *e)
{
    const size_t width = (size_t)p->components;
    void *data = add(r, p->name, p->whole ? NUMBER_INT64 : NUMBER_DOUBLE, rows, width, e);
    for (size_t k = 0; data && k < rows * width; k++) {
        const double value = property_value(p, k / width, (int)(k % width));
        if (p->whole)
            ((int64_t *)data)[k] = (int64_t)value;
        else
            ((double *)data)[k] = value;
    }
    return data != NULL;
}

static bool add_mesh(result_arrays *r, const points *vertices, error *e)
{
    const size_t n = vertices->triangle_count;
    uint32_t *corner = add(r, "triangle", NUMBER_UINT32, n, 3, e);
    if (!corner) return false;
    if (n > 0) memcpy(corner, vertices->triangle, n * sizeof *vertices->triangle);
    if (!vertices->triangle_labels) return true;
    int64_t *labels = add(r, "triangle_labels", NUMBER_INT64, n, 2, e);
    if (labels && n > 0) memcpy(labels, vertices->triangle_labels, n * sizeof *vertices->triangle_labels);
    return labels != NULL;
}

static bool begin(void *context, error *e)
{
    (void)context, (void)e;
    return true;
}

static bool take_points(void *context, const results_input *in, threads *pool, json *outputs,
                        report_outputs *out, error *e)
{
    result_arrays *r = context;
    output_points final;
    report_outputs facts;
    (void)outputs;
    free_items(r);
    const char *const *wanted = (const char *const *)in->spec->ply_properties;
    const size_t wanted_count = in->spec->ply_property_count;
    columns chosen = {.count = 0};
    bool ok = output_points_make(in, columns_need_color(wanted, wanted_count), pool, &final, &facts, e) &&
              columns_choose(&final.set, wanted, wanted_count, &chosen, e);
    const points *set = &final.set;
    property *list = mem_alloc((PROPERTIES_OWN + set->attribute_count) * sizeof *list);
    const size_t count = ok ? property_list(set, list) : 0;
    for (size_t k = 0; ok && k < count; k++)
        if (columns_have_all(wanted, wanted_count) || columns_have_property(&chosen, &list[k]))
            ok = add_property(r, &list[k], set->count, e);
    if (ok && in->spec->has_mesh) {
        output_mesh made;
        ok = output_mesh_make(in, set, pool, &made, &facts, e) && add_mesh(r, &made.vertices, e);
        output_mesh_free(&made);
    }
    free(list);
    output_points_free(&final);
    if (ok) *out = facts;
    return ok;
}

static bool take_report(void *context, const json *report, error *e)
{
    result_arrays *r = context;
    (void)e;
    free(r->report);
    r->report = json_print(report);
    return true;
}

static void clear(void *context)
{
    (void)context;
}

delivery results_in_memory(result_arrays *to)
{
    return (delivery){to, begin, take_points, take_report, clear};
}

/* ---- transfer: a head; then the message of an error, or the arrays, each after its head, and the report */

static const uint64_t MAGIC = 0x3173796172726168; /* "harrays1" */

typedef struct stream_head {
    uint64_t magic;
    uint32_t code; /* an error_code; ERROR_NONE: arrays follow */
    uint32_t arrays;
    uint64_t text; /* bytes of the message, or of the report */
} stream_head;

typedef struct array_head {
    char name[RESULT_ARRAY_NAME];
    uint64_t type, rows, components;
} array_head;

static bool put(int fd, const void *from, size_t bytes)
{
    const char *p = from;
    while (bytes > 0) {
        const ssize_t n = write(fd, p, bytes);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return false;
        p += n;
        bytes -= (size_t)n;
    }
    return true;
}

/* The other end, as result_arrays_read gets it. */
typedef struct reading {
    int fd;
    result_arrays_wait *wait;
    void *context;
    error error;
} reading;

static bool get(reading *r, void *to, size_t bytes)
{
    char *p = to;
    while (bytes > 0) {
        if (!r->wait(r->context)) return error_set(&r->error, ERROR_CANCELLED, "the job was cancelled");
        const ssize_t n = read(r->fd, p, bytes);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        p += n;
        bytes -= (size_t)n;
    }
    return true;
}

static size_t bytes_of(const result_array *a)
{
    return a->rows * a->components * number_bytes(a->type);
}

static bool put_array(int fd, const result_array *a)
{
    array_head head = {.type = a->type, .rows = a->rows, .components = a->components};
    memcpy(head.name, a->name, sizeof head.name);
    return put(fd, &head, sizeof head) && put(fd, a->data, bytes_of(a));
}

bool result_arrays_write(const result_arrays *r, const error *why, int fd, error *e)
{
    const char *text = why ? why->message : r->report;
    const stream_head head = {MAGIC, why ? (uint32_t)why->code : ERROR_NONE, why ? 0 : (uint32_t)r->count,
                              strlen(text)};
    bool ok = put(fd, &head, sizeof head);
    for (size_t k = 0; ok && k < head.arrays; k++) ok = put_array(fd, &r->item[k]);
    ok = ok && put(fd, text, head.text);
    return ok || error_set(e, ERROR_INTERNAL, "cannot return the arrays: %s", strerror(errno));
}

static bool get_array(reading *r, result_arrays *out)
{
    array_head head;
    if (!get(r, &head, sizeof head) || !memchr(head.name, 0, sizeof head.name) || head.type >= NUMBER_TYPES)
        return false;
    void *data = add(out, head.name, (number_type)head.type, head.rows, head.components, &r->error);
    return data && get(r, data, bytes_of(&out->item[out->count - 1]));
}

bool result_arrays_read(int fd, result_arrays_wait *wait, void *context, result_arrays *out, error *e)
{
    stream_head head;
    reading r = {.fd = fd, .wait = wait, .context = context};
    *out = (result_arrays){0};
    bool ok = get(&r, &head, sizeof head) && head.magic == MAGIC && head.code < ERROR_CODE_COUNT;
    for (uint32_t k = 0; ok && k < head.arrays; k++) ok = get_array(&r, out);
    char *text = ok ? mem_array(1, head.text + 1, what, &r.error) : NULL;
    ok = text && get(&r, text, head.text);
    if (ok && head.code == ERROR_NONE) {
        out->report = text;
        return true;
    }
    if (ok)
        error_set(e, (error_code)head.code, "%s", text);
    else if (r.error.code != ERROR_NONE)
        error_set(e, r.error.code, "%s", r.error.message);
    else
        error_set(e, ERROR_INTERNAL, "the worker ended before it had returned all arrays");
    free(text);
    return false;
}

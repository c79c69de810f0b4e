// SPDX-License-Identifier: Apache-2.0
#include "spec/frame_values.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/frames.h"
#include "base/core/memory.h"

/* Maximum number of frames: the spec of each is checked before the job is accepted. */
enum { MOST_FRAMES = 10000 };

static bool is_path(const char *pointer)
{
    const char *last = strrchr(pointer, '/');
    return last && (strcmp(last, "/path") == 0 || strcmp(last, "/slices") == 0 ||
                    strcmp(pointer, "/output/directory") == 0);
}

/* False for members that the service reads from the spec, since it reads them once for all frames. */
static bool may_change(const char *pointer)
{
    static const char *const groups[] = {"/surface/", "/region/", "/sampling/", "/solver/", "/output/"};
    bool good = false;
    for (size_t i = 0; i < sizeof groups / sizeof *groups; i++)
        good |= strncmp(pointer, groups[i], strlen(groups[i])) == 0;
    return good && strcmp(pointer, "/solver/threads") != 0;
}

/* Whether a value is a number, a word, true, false, or an array of numbers. Objects are refused, since they
 * could contain a path. */
static bool is_value(json_at at)
{
    switch (json_type_of(at)) {
    case JSON_NUMBER:
    case JSON_STRING:
    case JSON_BOOL:
        return true;
    case JSON_ARRAY: {
        json_at element = json_first(&at);
        while (json_type_of(element) == JSON_NUMBER) element = json_next(&element);
        return !element.node;
    }
    default:
        return false;
    }
}

static bool is_ramp(json_at at)
{
    json_at from = json_member(&at, "from"), to = json_member(&at, "to");
    return json_type_of(at) == JSON_OBJECT && json_size(at) == 2 && json_type_of(from) == JSON_NUMBER &&
           json_type_of(to) == JSON_NUMBER;
}

static void read_values(reading *r, const json_at *at)
{
    for (json_at element = json_first(at); element.node; element = json_next(&element))
        if (!is_value(element))
            reading_add_mismatch(r, &element, "must be a number, a word, true, false or an array of numbers");
}

void frame_values_read(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    size_t count = json_size(*at), before = r->total;
    char given[READING_SHOWN_MAX + 8];
    if (json_type_of(*at) != JSON_OBJECT || (double)count < row->low || (double)count > row->high) {
        reading_add_mismatch(r, at, "must be an object with %.0f to %.0f JSON Pointers", row->low, row->high);
        return;
    }
    for (json_at member = json_first(at); member.node; member = json_next(&member)) {
        if (is_path(member.key)) {
            reading_shorten(member.key, given);
            reading_add_fault(
                r, at,
                "the path '%s' is the same for all frames: put the files below an input root and "
                "write #### in the path, or list uploaded files in queue.files",
                given);
            continue;
        }
        if (!may_change(member.key))
            reading_add_fault(r, &member,
                              "must be the JSON Pointer of a member of surface, region, sampling, solver or "
                              "output; not solver.threads");
        if (json_type_of(member) == JSON_ARRAY) {
            read_values(r, &member);
        } else if (!is_ramp(member)) {
            reading_add_mismatch(
                r, &member,
                "must be an array of one value for each frame, or {\"from\": number, \"to\": number}");
        }
    }
    if (r->total > before) return;
    *(bool *)reading_target(r, row->offset) = true;
    json_put(normal, spec_row_key(row), json_copy(at->node));
}

static void find_bounds(frame_values *w)
{
    w->lowest = w->highest = w->frame[0];
    for (size_t i = 1; i < w->frame_count; i++) {
        if (w->frame[i] < w->lowest) w->lowest = w->frame[i];
        if (w->frame[i] > w->highest) w->highest = w->frame[i];
    }
}

bool frame_values_open(const json *document, frame_values *w)
{
    json_at root = json_root(document), queue = json_member(&root, "queue"),
            list = json_member(&queue, "by_frame");
    const char *frames = json_string(json_member(&queue, "frames"), NULL);
    *w = (frame_values){.document = document};
    if (json_type_of(list) != JSON_OBJECT || !frames ||
        (double)json_size(list) > spec_row_find("/queue", "by_frame")->high ||
        !(w->frame = frames_parse(frames, &w->frame_count, NULL)))
        return false;
    find_bounds(w);
    w->member = mem_alloc((json_size(list) + 1) * sizeof *w->member);
    for (json_at at = json_first(&list); at.node; at = json_next(&at)) {
        frame_values_member *m = &w->member[w->count++];
        *m = (frame_values_member){.pointer = at.key,
                                   .from = json_number(json_member(&at, "from"), 0),
                                   .to = json_number(json_member(&at, "to"), 0)};
        bool list_of_values = json_type_of(at) == JSON_ARRAY && json_size(at) > 0;
        if (!may_change(at.key) || !(list_of_values || is_ramp(at))) {
            frame_values_close(w);
            return false;
        }
        if (!list_of_values) continue;
        m->values = mem_alloc(json_size(at) * sizeof *m->values);
        json_elements(at, m->values, json_size(at));
    }
    return true;
}

void frame_values_close(frame_values *w)
{
    for (size_t i = 0; i < w->count; i++) free(w->member[i].values);
    free(w->member);
    free(w->frame);
    *w = (frame_values){0};
}

json *frame_values_at(const frame_values *w, const frame_values_member *m, size_t index)
{
    if (m->values) return json_copy(m->values[index]);
    int frame = w->frame[index];
    double way = (m->to - m->from) * (frame - w->lowest);
    return json_new_number(frame == w->lowest    ? m->from
                           : frame == w->highest ? m->to
                                                 : m->from + way / (w->highest - w->lowest));
}

const char *frame_values_apply(const frame_values *w, size_t index, json *document)
{
    for (size_t i = 0; i < w->count; i++) {
        json *value = frame_values_at(w, &w->member[i], index);
        if (json_set(document, w->member[i].pointer, value)) continue;
        json_free(value);
        return w->member[i].pointer;
    }
    return NULL;
}

void frame_values_check(reading *r, const json_at *at)
{
    json_at list = json_member(at, "by_frame");
    const bool has_frames = json_member(at, "frames").node != NULL;
    const int *frames = *(int **)reading_target(r, offsetof(spec, frame));
    const size_t count = *(size_t *)reading_target(r, offsetof(spec, frame_count));
    if (list.node && !has_frames) reading_add_fault(r, &list, "requires queue.frames");
    if (!list.node || !frames) return;
    if (count > MOST_FRAMES)
        reading_add_fault(r, &list,
                          "a job with by_frame has at most %d frames (given %zu): submit several jobs",
                          MOST_FRAMES, count);
    for (json_at member = json_first(&list); member.node; member = json_next(&member)) {
        const size_t values = json_size(member);
        if (json_type_of(member) == JSON_ARRAY && values != count)
            reading_add_fault(r, &member,
                              "must have one value for each frame (given %zu values for %zu frames)", values,
                              count);
    }
}

void frame_values_check_places(reading *r, const json_at *root)
{
    json_at queue = json_member(root, "queue"), list = json_member(&queue, "by_frame");
    frame_values w;
    if (!frame_values_open(root->node, &w)) return;
    json *copy = json_copy(root->node);
    const char *lost = frame_values_apply(&w, 0, copy);
    json_at member = json_member(&list, lost ? lost : "");
    if (lost)
        reading_add_fault(r, &member,
                          "the spec has no object that could hold this member: correct the JSON Pointer, or "
                          "add the object");
    json_free(copy);
    frame_values_close(&w);
}

json *frame_values_document(const frame_values *w, size_t index, const json *document)
{
    char number[16];
    json *copy = json_copy(document), *queue = json_find(copy, "/queue"), *own = json_new_object();
    snprintf(number, sizeof number, "%d", w->frame[index]);
    for (size_t i = 0; i < w->count; i++)
        json_append(json_put_array(own, w->member[i].pointer), frame_values_at(w, &w->member[i], index));
    json_put_string(queue, "frames", number);
    json_put(queue, "by_frame", own);
    frame_values_apply(w, index, copy);
    return copy;
}

/* Whether a pointer is the first n bytes of another one, or lies below. */
static bool is_within(const char *pointer, const char *other, size_t n)
{
    return strncmp(pointer, other, n) == 0 && (!pointer[n] || pointer[n] == '/');
}

/* The length of the pointer of the highest object that the document lacks above a member, and that its values
 * therefore add; 0: it lacks none. */
static size_t find_added(const frame_values *w, const char *pointer)
{
    for (const char *end = strchr(pointer + 1, '/'); end; end = strchr(end + 1, '/')) {
        char *object = mem_strndup(pointer, (size_t)(end - pointer));
        const bool found = json_find((json *)w->document, object);
        free(object);
        if (!found) return (size_t)(end - pointer);
    }
    return 0;
}

/* The member with values by frame at or above the place of a fault, or that adds an object there (*adds). NULL: there is
 * none. */
static const frame_values_member *member_of(const frame_values *w, const char *pointer, bool *adds)
{
    *adds = false;
    for (size_t i = 0; i < w->count; i++)
        if (is_within(pointer, w->member[i].pointer, strlen(w->member[i].pointer))) return &w->member[i];
    *adds = true;
    for (size_t i = 0; i < w->count; i++) {
        const size_t n = find_added(w, w->member[i].pointer);
        if (n && is_within(pointer, w->member[i].pointer, n)) return &w->member[i];
    }
    return NULL;
}

void frame_values_place_faults(const frame_values *w, size_t index, bool all, spec_faults *faults)
{
    for (size_t i = 0; i < faults->count; i++) {
        spec_fault *fault = &faults->item[i];
        bool adds;
        const frame_values_member *m = member_of(w, fault->pointer, &adds);
        char detail[sizeof fault->detail];
        if (m && adds) {
            snprintf(detail, sizeof detail, "%s: %s", fault->pointer, fault->detail);
            memcpy(fault->detail, detail, sizeof detail);
        }
        if (m) {
            json_at queue = {NULL, &(json_at){0}, "queue", 0}, list = {NULL, &queue, "by_frame", 0},
                    member = {NULL, &list, m->pointer, 0}, value = {NULL, &member, NULL, index};
            json_pointer(m->values && !adds ? &value : &member, fault->pointer, sizeof fault->pointer);
        }
        if (adds && !all) continue;
        snprintf(detail, sizeof detail, "frame %d: %s", w->frame[index], fault->detail);
        memcpy(fault->detail, detail, sizeof detail);
    }
}

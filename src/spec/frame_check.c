// SPDX-License-Identifier: Apache-2.0
#include "spec/frame_check.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "spec/group.h"
#include "spec/reading.h"
#include "spec/relations.h"
#include "spec/rules.h"
#include "spec/spec_table.h"

/* The place where the values of a member are stored. */
typedef struct target {
    const frame_values_member *member;
    char *parts;           /* parts of its pointer, each ended by NUL */
    size_t depth;          /* number of parts before the key of the row */
    const char *group;     /* group of the row */
    const spec_row *row;   /* NULL: no row has this pointer; reading the rest of the spec reports the fault */
    spec_surface *surface; /* surface to which the row belongs; NULL: none */
    bool repeated;         /* an earlier member belongs to the same row of the same surface */
} target;

typedef struct frame_check {
    spec *s; /* spec of the current frame; only its surfaces are valid */
    json *document;
    target *target;
    size_t count;
} frame_check;

static char *split(const char *pointer)
{
    char *parts = mem_strdup(pointer + 1);
    for (char *t = parts; *t; t++)
        if (*t == '/') *t = '\0';
    return parts;
}

/* Finds the row of a pointer and its surface. An element of a list belongs to the row of the list. */
static void find_row(target *t, spec *s)
{
    const char *part = t->parts, *end = part + strlen(t->member->pointer);
    spec_surface *surface = NULL;
    for (t->group = ""; part < end; part += strlen(part) + 1, t->depth++) {
        t->row = spec_row_find(t->group, part);
        if (!t->row) return;
        if (strcmp(t->row->pointer, "/surface") == 0) surface = &s->surface;
        const char *next = part + strlen(part) + 1;
        if (next >= end) break;
        if (t->row->type == SPEC_TYPE_SURFACES) {
            size_t index = strtoul(next, NULL, 10);
            if (!surface || index >= surface->part_count) return;
            surface = surface->parts[index];
            part = next;
            t->depth++;
        } else if (t->row->type == SPEC_TYPE_SURFACE) {
            surface = surface ? surface->parts[0] : s->region_inside;
        } else if (t->row->type != SPEC_TYPE_GROUP) {
            break;
        }
        t->group = t->row->type == SPEC_TYPE_GROUP ? t->row->pointer : "/surface";
    }
    t->surface = surface;
}

/* An element of a list of surfaces, which are short. */
static json_at find_element(const json_at *list, size_t index)
{
    json_at at = json_first(list);
    while (at.node && at.index < index) at = json_next(&at);
    return at;
}

/* The object that contains the member of the row. Its node is NULL if a value of another member has replaced
 * an object on the path. */
static json_at find_place(const target *t, const json *document, json_at place[JSON_MAX_DEPTH])
{
    const char *part = t->parts;
    place[0] = json_root(document);
    for (size_t i = 0; i < t->depth; i++, part += strlen(part) + 1)
        place[i + 1] = json_type_of(place[i]) == JSON_ARRAY ? find_element(&place[i], strtoul(part, NULL, 10))
                                                            : json_member(&place[i], part);
    return place[t->depth];
}

/* Frees the value of the row's member, before it is read again. */
static void empty(reading *r, const spec_row *row)
{
    if (row->type == SPEC_TYPE_INTEGERS) {
        spec_list *list = reading_target(r, row->offset);
        free(list->number);
        *list = (spec_list){0};
    } else if (row->type == SPEC_TYPE_STRING || row->type == SPEC_TYPE_NUMBERS) {
        void **text_or_numbers = reading_target(r, row->offset);
        free(*text_or_numbers);
        *text_or_numbers = NULL;
    }
}

/* Reads a member of a surface again, and checks the relations with the other members of its group. These
 * members depend on the shape. */
static void read_target(reading *r, const target *t, const json *document)
{
    json_at place[JSON_MAX_DEPTH];
    json_at at = find_place(t, document, place);
    size_t before = r->total;
    if (json_type_of(at) != JSON_OBJECT) return;
    json *normal = json_new_object(); /* not used */
    bool is_shape = t->row->offset == offsetof(spec, surface.analytic.shape);
    r->surface = (partial_surface *)t->surface;
    r->shape_known = !is_shape;
    empty(r, t->row);
    if (is_shape) {
        t->surface->analytic = (spec_analytic){0};
        group_read(r, &at, t->group, normal);
    } else {
        group_read_row(r, &at, t->row, normal);
        if (r->total == before) rules_check_group(r, &at, t->group);
    }
    json_free(normal);
}

/* Reads the changed members of surfaces into the spec of the first frame, which is complete. */
static void read_surfaces(const frame_check *c, reading *r)
{
    json_at root = json_root(c->document);
    for (size_t i = 0; i < c->count; i++)
        if (c->target[i].surface && !c->target[i].repeated) read_target(r, &c->target[i], c->document);
    r->surface = (partial_surface *)&c->s->surface;
    r->complete = true;
    relations_check(r, &root);
}

/* Reads the whole spec except surfaces and the queue, which are borrowed from the first frame. */
static void read_rest(const frame_check *c, reading *r)
{
    json_at root = json_root(c->document);
    json *normal = json_new_object();
    spec *s = mem_alloc(sizeof *s);
    reading_open(r, s, c->s);
    group_read(r, &root, "", normal);
    relations_set_defaults(r);
    relations_check(r, &root);
    s->surface = (spec_surface){0};
    s->region_inside = NULL;
    s->frames = NULL;
    spec_free(s);
    reading_close(r);
    json_free(normal);
}

static size_t check_frame(const frame_check *c, const frame_values *w, size_t index, spec_faults *faults)
{
    reading r;
    bool other = false;
    reading_open(&r, c->s, c->s);
    frame_values_apply(w, index, c->document);
    for (size_t i = 0; i < c->count; i++) other |= !c->target[i].surface;
    read_surfaces(c, &r);
    reading_close(&r);
    if (other && r.total == 0) read_rest(c, &r);
    frame_values_place_faults(w, index, true, &r.faults);
    if (r.total > 0) *faults = r.faults;
    return r.total;
}

size_t frame_check_all(spec *first, const json *document, const frame_values *w, spec_faults *faults)
{
    frame_check c = {.s = first, .document = json_copy(document), .count = w->count};
    size_t total = 0;
    /* removed, because its lists are long */
    json_put_null(json_find(c.document, "/queue"), "by_frame");
    c.target = mem_alloc(c.count * sizeof *c.target);
    for (size_t i = 0; i < c.count; i++) {
        c.target[i] = (target){.member = &w->member[i], .parts = split(w->member[i].pointer)};
        find_row(&c.target[i], first);
        for (size_t k = 0; k < i; k++)
            c.target[i].repeated |=
                c.target[k].row == c.target[i].row && c.target[k].surface == c.target[i].surface;
    }
    for (size_t i = 1; total == 0 && i < w->frame_count; i++) total = check_frame(&c, w, i, faults);
    for (size_t i = 0; i < c.count; i++) free(c.target[i].parts);
    free(c.target);
    json_free(c.document);
    return total;
}

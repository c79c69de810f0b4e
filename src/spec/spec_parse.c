// SPDX-License-Identifier: Apache-2.0
/* Reads and checks whole specs, including those of the frames of a sequence. */
#include <assert.h>

#include "base/core/memory.h"
#include "spec/frame_check.h"
#include "spec/frame_values.h"
#include "spec/group.h"
#include "spec/reading.h"
#include "spec/relations.h"
#include "spec/spec.h"

static void sum_up(const spec_faults *faults, size_t total, error *e)
{
    const spec_fault *fault = &faults->item[0];
    const char *where = *fault->pointer ? fault->pointer : "the spec";
    if (total > 1)
        error_set(e, fault->code, "%s: %s (and %zu more)", where, fault->detail, total - 1);
    else
        error_set(e, fault->code, "%s: %s", where, fault->detail);
}

/* Reads a document into which the values of the frame number `index` of `w` were inserted. `w` NULL: it has
 * no values by frame. */
static spec *parse(const json *document, const frame_values *w, size_t index, spec_faults *faults, error *e)
{
    reading r;
    spec *s = mem_alloc(sizeof *s);
    reading_open(&r, s, NULL);
    json_at root = json_root(document);
    s->normalised = json_new_object();
    if (document)
        group_read(&r, &root, "", s->normalised);
    else
        reading_add_fault(&r, &root, "must be an object (nothing is given)");
    relations_set_defaults(&r);
    relations_check(&r, &root);
    reading_close(&r);
    if (w) frame_values_place_faults(w, index, index > 0, &r.faults);
    if (faults) *faults = r.faults;
    if (r.total == 0) return s;
    sum_up(&r.faults, r.total, e);
    spec_free(s);
    return NULL;
}

spec *spec_parse(const json *document, spec_faults *faults, error *e)
{
    frame_values w;
    if (!document || !frame_values_open(document, &w)) return parse(document, NULL, 0, faults, e);
    json *copy = json_copy(document);
    bool placed = !frame_values_apply(&w, 0, copy);
    spec *s = parse(placed ? copy : document, placed ? &w : NULL, 0, faults, e);
    json_free(copy);
    frame_values_close(&w);
    return s;
}

spec *spec_of_frame(const spec *s, size_t index, spec_faults *faults, error *e)
{
    frame_values w;
    bool swept = frame_values_open(s->normalised, &w);
    assert(s->has_frame_values && swept && index < w.frame_count);
    json *document = frame_values_document(&w, index, s->normalised);
    spec *frame = parse(document, &w, index, faults, e);
    json_free(document);
    frame_values_close(&w);
    return frame;
}

bool spec_check_frames(const spec *s, spec_faults *faults, error *e)
{
    frame_values w;
    size_t total = 0;
    spec_faults found = {0};
    if (!s->has_frame_values || !frame_values_open(s->normalised, &w)) return true;
    spec *first = spec_of_frame(s, 0, faults, e);
    if (first) total = frame_check_all(first, s->normalised, &w, &found);
    frame_values_close(&w);
    spec_free(first);
    if (total > 0) sum_up(&found, total, e);
    if (total > 0 && faults) *faults = found;
    return first && total == 0;
}

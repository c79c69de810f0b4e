// SPDX-License-Identifier: Apache-2.0
/* A request's body: json_parse and spec_parse. What is accepted is printed, and must be read as the same
 * again. */
#include <string.h>

#include "fuzz/target.h"
#include "base/json/json.h"
#include "spec/spec.h"

/* The text of what a text says, which must be a fixed point. */
static void reread(const char *text)
{
    error e = {0};
    json *again = json_parse(text, strlen(text), &e);
    expect(again);
    char *printed = json_print(again);
    expect(strcmp(printed, text) == 0);
    free(printed);
    json_free(again);
}

/* All frames are good exactly if each is. */
static void check_frames(const spec *s)
{
    enum { FRAMES_MOST = 8 };
    bool each = true;
    if (!s->has_frame_values || s->frame_count > FRAMES_MOST) return;
    for (size_t i = 0; each && i < s->frame_count; i++) {
        spec *frame = spec_of_frame(s, i, NULL, NULL);
        each = frame != NULL;
        spec_free(frame);
    }
    expect(spec_check_frames(s, NULL, NULL) == each);
}

static void check_spec(const spec *s)
{
    error e = {0};
    spec_faults faults = {0};
    char *text = json_print(s->normalised);
    reread(text);
    spec *again = spec_parse(s->normalised, &faults, &e);
    expect(again);
    char *printed = json_print(again->normalised);
    expect(strcmp(printed, text) == 0);
    spec_input input;
    for (size_t n = 0; spec_input_at(s, n, &input); n++) expect(*input.path && *input.pointer == '/');
    check_frames(s);
    free(printed);
    free(text);
    spec_free(again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    error e = {0};
    spec_faults faults = {0};
    json *document = json_parse((const char *)data, size, &e);
    if (!document) {
        expect(e.code == ERROR_SPEC_INVALID && *e.message);
        return 0;
    }
    char *text = json_print(document);
    reread(text);
    free(text);
    spec *s = spec_parse(document, &faults, &e);
    if (s) {
        check_spec(s);
    } else {
        expect(e.code == ERROR_SPEC_INVALID || e.code == ERROR_NOT_SUPPORTED);
        expect(faults.count > 0 && faults.count <= SPEC_MAX_FAULTS);
        for (size_t n = 0; n < faults.count; n++) expect(*faults.item[n].detail);
    }
    spec_free(s);
    json_free(document);
    return 0;
}

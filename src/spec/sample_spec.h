// SPDX-License-Identifier: Apache-2.0
/* sample_spec: the spec of the commands `sample`, from a surface that an inspection suggests and the options
 * of the command line; and the option --set, which puts a value into any spec. Pure functions except for
 * allocation. */
#ifndef HEXAD_SPEC_SAMPLE_SPEC_H
#define HEXAD_SPEC_SAMPLE_SPEC_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "base/core/file_format.h"
#include "base/json/json.h"

/* The texts of the options; NULL: not given. The values are checked by spec_parse. */
typedef struct sample_options {
    const char *count, *spacing; /* at most one of them */
    const char *grade;           /* curvature, or curvature=RATIO */
    const char *pattern;
    const char *frames, *name;
    const char *const *set; /* assignments, see sample_spec_set */
    size_t set_count;
} sample_options;

/* The file of the spec beside the points. */
#define SAMPLE_SPEC_NAME "spec.json"

/* The suggested count of a surface that was not measured. Such a job takes seconds. */
#define SAMPLE_SPEC_COUNT_MOST 100000

/* The suggestion of an inspection (doc/inspect.md) that can be sampled: the first one whose surface was
 * measured, otherwise the first one with a spec. NULL: none. It is owned by the inspection. */
const json *sample_spec_suggested(const json *inspection);

/* The member of a surface that names files of this format: "mesh", "vdb" or "volume". */
const char *sample_spec_member(file_format format);

/* What an inspection of a large file suggests: its surface was not measured. For use without an inspection; the
 * caller frees it. `member`: see sample_spec_member. */
json *sample_spec_unseen(const char *member, const char *path);

/* The path of the file to inspect: `path`, or that of the first frame if `path` is a pattern and the options name
 * frames. The caller frees it. NULL: spec_invalid, an option is malformed. */
char *sample_spec_inspected(const char *path, const sample_options *options, error *e);

/* Whether the options name a target, so that the suggested count is not used. */
bool sample_spec_has_target(const sample_options *options);

/* Whether the options name a target, and the isovalue of a surface of this member unless it is a mesh. */
bool sample_spec_is_complete(const char *member, const sample_options *options);

/* Whether a surface of this member has to be inspected. A complete mesh or VDB file has not; the inspection of
 * another volume finds its slices as well. */
bool sample_spec_needs_inspection(const char *member, const sample_options *options);

/* The text about an isovalue, or about the index of one of several volumes, that an inspection suggests and no option
 * sets; the caller frees it. NULL: none. */
char *sample_spec_isovalue_note(const json *inspection, const sample_options *options);
char *sample_spec_volume_note(const json *inspection, const sample_options *options);

/* Puts the value of `/POINTER=VALUE` into a spec. VALUE is JSON; any other text is a string. Missing objects
 * on the path are created. Error spec_invalid: the text has another form, or the path leads through a value
 * that has no members. */
bool sample_spec_set(json *document, const char *assignment, error *e);

/* The spec that samples the suggested surface. The suggested count is used if the options name no target. The
 * job has the name of the file without directories and extension, unless the options name it. In the surface, the
 * path of the inspected frame is replaced by the pattern. NULL: spec_invalid (an option is malformed),
 * or the error of the first suggestion if no surface can be sampled. The caller frees the document. */
json *sample_spec_make(const json *inspection, const char *path, const sample_options *options, error *e);

/* Whether the options have the right form, which needs no inspection. Error spec_invalid. */
bool sample_spec_check(const sample_options *options, error *e);

/* Replaces the error of a file that was given as a spec and is none, if its name is that of a mesh or volume:
 * the command `sample` of the program takes such files. */
void sample_spec_advise(const char *program, const char *path, error *e);

/* The name of the file without directories and extension (".nii.gz" is one), and of a pattern the part before the
 * frame number; the caller frees it. It is the name of the job, and the directory of its result by default. */
char *sample_spec_stem(const char *path);

/* The extension of a file that identifies its format, such as ".obj" or ".nii.gz"; "" if the name has none. */
const char *sample_spec_ending(const char *path);

#endif

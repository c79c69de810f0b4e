// SPDX-License-Identifier: Apache-2.0
/* attach_spec: converts the spec of a result to a spec that places its points on other meshes
 * (sampling.attach). Pure functions except for allocation. */
#ifndef HEXAD_SPEC_ATTACH_SPEC_H
#define HEXAD_SPEC_ATTACH_SPEC_H

#include <stddef.h>

#include "base/core/error.h"
#include "base/json/json.h"

/* The end of messages about points without the attribute with their positions on the meshes. */
#define ATTACH_SPEC_SOURCE_ADVICE                                                                                  \
    "sample it again with --set '/attributes=[{\"from\":\"geometry\",\"name\":\"source\"}]' (hexadctl sample and " \
    "submit, hexad-worker sample)"

/* `sampled`: the spec of the result. `points`: the path of its points.ply. `mesh`: one path for each mesh of
 * the surface, in the order of the spec. Members that concern the computation of points are removed, as is
 * the queue. The name gets the ending " attached". NULL: spec_invalid (the surface has another number of meshes) or attribute_missing (the
 * points have no attribute source). The caller frees the document. */
json *attach_spec_make(const json *sampled, const char *points, const char *const *mesh, size_t mesh_count,
                       error *e);

#endif

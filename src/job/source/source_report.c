// SPDX-License-Identifier: Apache-2.0
#include "job/source/source_report.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "job/source/label_source.h"
#include "job/source/mesh_source.h"

static void describe_volume(const volume_info *info, json *members, json *warnings)
{
    json_put_integer(members, "voxels", (int64_t)info->active_voxels);
    if (*info->format) {
        json *dense = json_put_object(members, "volume");
        json *size = json_put_array(dense, "size");
        json_put_string(dense, "format", info->format);
        for (int k = 0; k < 3; k++) json_append_number(size, (double)info->size[k]);
        if (*info->space) json_put_string(dense, "space", info->space);
        json_put_number(members, "isovalue", info->isovalue);
    } else if (info->triangles == 0) {
        json_put_string(members, "grid", info->grid);
        json_put_number(members, "isovalue", info->isovalue);
    } else {
        json *of_mesh = json_put_object(members, "mesh");
        json_put_integer(of_mesh, "triangles", (int64_t)info->triangles);
        json_put_number(of_mesh, "area", info->fidelity.area);
        json_put_number(of_mesh, "rms_distance_vox", info->fidelity.rms_vox);
        json_put_number(of_mesh, "close_fraction", info->fidelity.close);
        json_put_number(of_mesh, "unresolved_fraction", info->fidelity.unresolved);
        json_put_number(of_mesh, "thin_fraction", info->fidelity.thin);
        json_put_number(of_mesh, "hidden_fraction", info->fidelity.hidden);
        json_put_number(of_mesh, "resolution", round(info->resolution.longest / info->resolution.voxel_size));
        json_put_string(of_mesh, "resolution_by", info->resolution.chosen_by);
        json_put_string(of_mesh, "resolution_limited_by", info->resolution.limited_by);
    }
    json_put_number(members, "voxel_size", info->voxel_size);
    json_put_integer(members, "crossing_cells", (int64_t)info->crossing_cells);
    json_put_integer(members, "bricks", (int64_t)info->coefficient_blocks);
    for (size_t k = 0; k < info->warning_count; k++) json_append_string(warnings, info->warning[k]);
}

/* Adds a warning on thin walls if more than a hundredth of the surface is missing, the limit of the
 * outcome. */
static void append_walls(const combination *c, json *warnings)
{
    char warning[256];
    const double share = combination_missing(c, NULL);
    if (!(share > 0.01)) return;
    snprintf(warning, sizeof warning,
             "about %.3g %% of the surface of a combination is in walls or slits thinner than its "
             "smallest cells, %.3g, and may have no points: widen them, or combine fewer or "
             "smaller parts",
             100 * share, combination_field(c)->cell_size);
    json_append_string(warnings, warning);
}

static void append_nothing(const source_part *p, json *warnings)
{
    char warning[sizeof(error) + 64];
    snprintf(warning, sizeof warning, "%s: this part is skipped", p->nothing);
    json_append_string(warnings, warning);
}

/* Lists the volumes of the parts in the order of the spec. */
static void describe_parts(const source_part *p, json *members, json **list, json *warnings)
{
    for (size_t k = 0; k < p->part_count; k++) {
        const source_part *part = &p->parts[k];
        if (part->nothing) append_nothing(part, warnings);
        if (part->combination) append_walls(part->combination, warnings);
        if ((part->volume || part->mesh) && !*list) *list = json_put_array(members, "parts");
        if (part->volume) describe_volume(volume_describe(part->volume), json_append_object(*list), warnings);
        if (part->mesh) mesh_source_describe(part->mesh, &part->notes, json_append_object(*list), warnings);
        describe_parts(part, members, list, warnings);
    }
}

/* Numbers that JSON cannot represent, beyond 53 bits, are stored as text. */
static void put_number(json *o, const char *key, int64_t number)
{
    char text[24];
    snprintf(text, sizeof text, "%" PRId64, number);
    json_put_string(o, key, text);
}

/* Adds the identity by which the daemon detects whether the path still refers to the file that was read. Without it,
 * the result is not used again. */
static void put_identity(json *o, const source_input *input)
{
    const store_identity *id = &input->identity;
    if (input->changed || id->bytes != input->facts.bytes) return;
    put_number(o, "inode", (int64_t)id->inode);
    put_number(o, "mtime_ns", id->mtime_ns);
    put_number(o, "ctime_ns", id->ctime_ns);
}

void source_describe(const source *s, json *report, json *members, json *warnings)
{
    json *inputs = json_put_array(report, "inputs"), *list = NULL;
    if (s->whole.volume) describe_volume(volume_describe(s->whole.volume), members, warnings);
    if (s->whole.combination) append_walls(s->whole.combination, warnings);
    if (s->whole.labels) label_surface_describe(s->whole.labels, members, warnings);
    if (s->whole.mesh) mesh_source_describe(s->whole.mesh, &s->whole.notes, members, warnings);
    describe_parts(&s->whole, members, &list, warnings);
    for (size_t k = 0; k < s->map_notes.count; k++) {
        char *text = mem_printf("/sampling/grid: %s", s->map_notes.text[k]);
        json_append_string(warnings, text);
        free(text);
    }
    for (size_t k = 0; k < s->input_count; k++) {
        json *input = json_append_object(inputs);
        json_put_string(input, "path", s->inputs[k].path);
        json_put_integer(input, "bytes", (int64_t)s->inputs[k].facts.bytes);
        json_put_string(input, "sha256", s->inputs[k].facts.sha256);
        if (!s->lacks_file) put_identity(input, &s->inputs[k]);
    }
}

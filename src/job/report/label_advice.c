// SPDX-License-Identifier: Apache-2.0
#include "job/report/label_advice.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "job/report/advice.h"
#include "spec/spec_table.h"

/* Maximum number of groups in the text of a message; `set` has all of them. */
enum { MOST_TOLD = 10 };

/* The majority filter to try next, in spacings, or relative to the previous filter. The slices of a frog, up
 * to ten voxels apart, converge with 1.5 spacings of 10 000 points. */
static const double WIDER = 1.5;

/* The thin labels of a surface: the number that merge with another label, and the number that are rows of
 * voxels. */
typedef struct thin_labels {
    const label_thin *list;
    size_t count, united, rows, alone; /* alone: rows that do not merge */
} thin_labels;

static thin_labels find_thin(const label_surface *labels)
{
    thin_labels found = {0};
    found.list = label_surface_thin(labels, &found.count);
    for (size_t k = 0; k < found.count; k++) {
        found.united += found.list[k].unites;
        found.rows += found.list[k].row;
        found.alone += found.list[k].row && !found.list[k].unites;
    }
    return found;
}

bool label_advice_is_hopeless(const label_surface *labels)
{
    const thin_labels thin = find_thin(labels);
    return thin.count > 0 && thin.alone == thin.count;
}

/* Appends the label, and those that the spec merges with it. */
static void append_members(json *group, const spec_labels *s, int64_t label)
{
    json_append_number(group, (double)label);
    for (size_t g = 0; g < s->group_count; g++)
        for (size_t k = 1; k < s->groups[g].count; k++)
            if (s->groups[g].number[0] == (double)label) json_append_number(group, s->groups[g].number[k]);
}

/* Appends the group of thin labels that merge into one label, if that has no group yet. */
static void append_group(json *groups, const spec_labels *s, const label_thin *thin, size_t count,
                         int64_t into)
{
    json *group = json_new_array();
    append_members(group, s, into);
    for (size_t k = 0; k < count; k++)
        if (thin[k].unites && thin[k].into == into) append_members(group, s, thin[k].label);
    json_append(groups, group);
}

/* All groups; each thin label is in the group of the label that it merges with. */
static json *make_groups(const spec_labels *s, const label_thin *thin, size_t count)
{
    json *groups = json_new_array();
    for (size_t g = 0; g < s->group_count; g++) { /* unchanged groups */
        bool changed = false;
        for (size_t k = 0; k < count; k++) {
            const double first = s->groups[g].number[0];
            changed |= thin[k].unites && ((double)thin[k].into == first || (double)thin[k].label == first);
        }
        if (!changed) append_group(groups, s, thin, 0, (int64_t)s->groups[g].number[0]);
    }
    for (size_t k = 0; k < count; k++) {
        bool first = thin[k].unites;
        for (size_t i = 0; i < k; i++) first &= !thin[i].unites || thin[i].into != thin[k].into;
        if (first) append_group(groups, s, thin, count, thin[k].into);
    }
    return groups;
}

static void append_union(json *list, const spec_labels *s, const label_thin *thin, size_t count,
                         size_t united)
{
    json *groups = make_groups(s, thin, count);
    char *text = json_print(groups);
    char *message =
        mem_printf("%zu label%s one voxel thin: to give %s voxels to the labels that they touch most, "
                   "set /surface/labels/groups%s%s",
                   united, united == 1 ? " is" : "s are", united == 1 ? "its" : "their",
                   united <= MOST_TOLD ? " to " : "", united <= MOST_TOLD ? text : "");
    json_put(advice_append(list, "thin_labels", message), "/surface/labels/groups", groups);
    free(message);
    free(text);
}

void label_advice_append(json *list, const spec_labels *s, const label_surface *labels)
{
    const thin_labels thin = find_thin(labels);
    if (thin.united > 0 && s->interface_count == 0)
        append_union(list, s, thin.list, thin.count, thin.united);
    else if (thin.rows > 0)
        advice_append(
            list, "thin_labels",
            "the labels consist of single voxels or rows of voxels, on which points do not form a regular "
            "packing: use the points as they are, or label smaller voxels");
}

void label_advice_append_majority(json *list, const spec_labels *s, const label_surface *labels,
                                  double spacing)
{
    const double width = ceil(2 * WIDER * fmax(spacing / label_surface_voxel(labels), s->majority)) / 2;
    if (width > SPEC_MAJORITY_MAX || !label_surface_is_ragged(labels, width)) return;
    char *message =
        mem_printf("set /surface/labels/majority to %.10g: the labels are thin in many places, as "
                   "where slices do not match, and these points do not resolve that. Each voxel then "
                   "gets the label of most voxels around it: labels keep their volume, but thin parts "
                   "and specks may be lost, and wide filters take time.",
                   width);
    json_put_number(advice_append(list, "ragged_labels", message), "/surface/labels/majority", width);
    free(message);
}

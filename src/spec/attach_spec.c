// SPDX-License-Identifier: Apache-2.0
#include "spec/attach_spec.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "spec/spec.h"
#include "spec/spec_table.h"

typedef struct replacement {
    json *root; /* the new document */
    const char *const *mesh;
    size_t given, count; /* number of given meshes, and of meshes found in the surface so far */
} replacement;

/* Changes a text of the new document. The document is not constant, so that the cast is permitted. */
static void set_path(const json_at *path, const char *to)
{
    json_set_string((json *)path->node, to);
}

/* Replaces the path of each attribute that is read from the file of a mesh. */
static void replace_attributes(json *root, const char *from, const char *to)
{
    const json_at at = json_root(root), list = json_member(&at, "attributes");
    for (json_at one = json_first(&list); one.node; one = json_next(&one)) {
        const json_at path = json_member(&one, "from");
        if (strcmp(json_string(path, ""), from) == 0) set_path(&path, to);
    }
}

/* Replaces the paths of all meshes at and below a position in the surface. */
static void replace_meshes(replacement *r, const json_at *at)
{
    for (json_at member = json_first(at); member.node; member = json_next(&member)) {
        const json_at path = json_member(&member, "path");
        if (!member.key || strcmp(member.key, "mesh") != 0 || json_type_of(path) != JSON_STRING) {
            replace_meshes(r, &member);
            continue;
        }
        if (r->count < r->given) {
            char *before = mem_strdup(json_string(path, ""));
            set_path(&path, r->mesh[r->count]);
            replace_attributes(r->root, before, r->mesh[r->count]);
            free(before);
        }
        r->count++;
    }
}

/* Whether the points have the attribute with their positions on the meshes. */
static bool has_source(const json_at *at)
{
    const json_at list = json_member(at, "attributes");
    bool found = false;
    for (json_at one = json_first(&list); one.node && !found; one = json_next(&one))
        found = strcmp(json_string(json_member(&one, "from"), ""), SPEC_FROM_GEOMETRY) == 0 &&
                strcmp(json_string(json_member(&one, "name"), ""), SPEC_GEOMETRY_SOURCE) == 0;
    return found;
}

/* Removes the weights: they are those of the first shape. */
static void remove_weights(json *root)
{
    const json_at at = json_root(root), list = json_member(&at, "attributes");
    json *kept = json_new_array();
    for (json_at one = json_first(&list); one.node; one = json_next(&one))
        if (strcmp(json_string(json_member(&one, "from"), ""), SPEC_FROM_GEOMETRY) != 0 ||
            strcmp(json_string(json_member(&one, "name"), ""), SPEC_GEOMETRY_WEIGHT) != 0)
            json_append(kept, json_copy(one.node));
    json_put(root, "attributes", kept);
}

/* Puts the name of the new job, unless it is longer than a spec permits: a name that several jobs have names none
 * of them on the command line. */
static void put_name(json *document)
{
    static const char ending[] = " attached";
    const json_at root = json_root(document);
    const char *name = json_string(json_member(&root, "name"), "");
    const size_t length = strlen(name), added = sizeof ending - 1;
    if (!length || (length > added && strcmp(name + length - added, ending) == 0)) return;
    char *own = mem_printf("%s%s", name, ending);
    if ((double)strlen(own) <= spec_row_find("", "name")->high) json_put_string(document, "name", own);
    free(own);
}

json *attach_spec_make(const json *sampled, const char *points, const char *const *mesh, size_t mesh_count,
                       error *e)
{
    static const char *const removed[] = {"queue", "outcome"}, *const outputs[] = {"mesh", "mesh_usda",
                                                                                   "label_meshes",
                                                                                   "convergence", "order"};
    json *root = json_copy(sampled);
    replacement r = {root, mesh, mesh_count, 0};
    const json_at at = json_root(root), surface = json_member(&at, "surface");
    if (!has_source(&at)) {
        error_set(
            e, ERROR_ATTRIBUTE_MISSING,
            "the result cannot be attached, because its points have no attribute source: " ATTACH_SPEC_SOURCE_ADVICE);
        json_free(root);
        return NULL;
    }
    replace_meshes(&r, &surface);
    if (r.count != mesh_count) {
        error_set(
            e, ERROR_SPEC_INVALID,
            "the surface of the result has %zu meshes (given %zu): give one mesh for each, in the same order",
            r.count, mesh_count);
        json_free(root);
        return NULL;
    }
    remove_weights(root);
    put_name(root);
    for (size_t k = 0; k < sizeof removed / sizeof *removed; k++) json_remove(root, removed[k]);
    json *output = json_find(root, "/output");
    for (size_t k = 0; output && k < sizeof outputs / sizeof *outputs; k++) json_remove(output, outputs[k]);
    json_put_string(json_put_object(root, "sampling"), "attach", points);
    return root;
}

#include "spec/attach_spec.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "spec/spec.h"

enum { POINTER_SIZE = 1024 };

typedef struct replacement {
    json *root; /* the new document */
    const char *const *mesh;
    size_t given, count; /* meshes; found so far */
} replacement;

/* Sets the path of each attribute that is read from the file of a mesh. */
static void replace_attributes(json *root, const char *from, const char *to)
{
    const json_at at = json_root(root), list = json_member(&at, "attributes");
    for (size_t k = 0; k < json_size(list); k++) {
        const json_at one = json_element(&list, k), path = json_member(&one, "from");
        char pointer[POINTER_SIZE];
        if (strcmp(json_string(path, ""), from) != 0) continue;
        json_set_string(json_find(root, json_pointer(&path, pointer, sizeof pointer)), to);
    }
}

/* Replaces the paths of all meshes at a place of the surface and below. */
static void replace_meshes(replacement *r, const json_at *at)
{
    for (size_t k = 0; k < json_size(*at); k++) {
        const json_at member = json_element(at, k), path = json_member(&member, "path");
        char pointer[POINTER_SIZE];
        if (!member.key || strcmp(member.key, "mesh") != 0 || json_type_of(path) != JSON_STRING) {
            replace_meshes(r, &member);
            continue;
        }
        if (r->count < r->given) {
            char *before = mem_strdup(json_string(path, ""));
            json_set_string(json_find(r->root, json_pointer(&path, pointer, sizeof pointer)),
                            r->mesh[r->count]);
            replace_attributes(r->root, before, r->mesh[r->count]);
            free(before);
        }
        r->count++;
    }
}

/* Whether the points have the attribute of their places on the meshes. */
static bool has_source(const json_at *at)
{
    const json_at list = json_member(at, "attributes");
    bool found = false;
    for (size_t k = 0; !found && k < json_size(list); k++) {
        const json_at one = json_element(&list, k);
        found = strcmp(json_string(json_member(&one, "from"), ""), SPEC_FROM_GEOMETRY) == 0 &&
                strcmp(json_string(json_member(&one, "name"), ""), SPEC_GEOMETRY_SOURCE) == 0;
    }
    return found;
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
    for (size_t k = 0; k < sizeof removed / sizeof *removed; k++) json_remove(root, removed[k]);
    json *output = json_find(root, "/output");
    for (size_t k = 0; output && k < sizeof outputs / sizeof *outputs; k++) json_remove(output, outputs[k]);
    json_put_string(json_put_object(root, "sampling"), "attach", points);
    return root;
}

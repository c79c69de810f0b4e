// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/collada_textures.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/meshes/plain_textures.h"

typedef struct id {
    char text[MESH_MATERIAL_NAME_SIZE];
} id;

/* A reference from an element to another one. */
typedef struct reference {
    id from, to;
    id name;          /* of a material: its name; of a diffuse colour: the word for its coordinates */
    uint32_t wrap[2]; /* of a sampler: a mesh_wrap for each coordinate */
    uint32_t set;     /* of a binding: the set of coordinates */
} reference;

typedef struct references {
    reference *item;
    size_t count, room;
} references;

typedef struct document {
    xml reader;
    plain_mesh *m;
    references materials;                        /* a material and its effect */
    references diffuses;                         /* an effect and the sampler of its diffuse colour */
    references samplers;                         /* an effect and a sampler of it */
    references bindings;                         /* a material and the word for a set of coordinates */
    id material, name, effect, parameter, bound; /* the open elements */
    bool in_diffuse;
    size_t begin;   /* of the text of the innermost element */
    size_t unknown; /* number of modes that are not read */
} document;

static void copy_id(id *to, const char *text)
{
    snprintf(to->text, sizeof to->text, "%.*s", MESH_MATERIAL_NAME_SIZE - 1, text ? text : "");
}

/* Copies the id that a URL such as "#id" names. */
static void copy_url(id *to, const char *url)
{
    copy_id(to, url && *url == '#' ? url + 1 : url);
}

static bool is(const id *a, const id *b)
{
    return strcmp(a->text, b->text) == 0;
}

/* Adds a reference. NULL: memory is out. */
static reference *add(document *d, references *to, const id *from, const id *name)
{
    if (!plain_mesh_make_room(d->m, (void **)&to->item, &to->room, to->count + 1, sizeof *to->item))
        return NULL;
    reference *new = &to->item[to->count++];
    *new = (reference){.from = *from, .wrap = {MESH_WRAP_REPEAT, MESH_WRAP_REPEAT}};
    if (name) new->to = *name;
    return new;
}

static bool add_material(document *d, const char **attributes)
{
    reference *new = add(d, &d->materials, &d->material, NULL);
    if (!new) return false;
    new->name = d->name;
    copy_url(&new->to, xml_attribute(attributes, "url"));
    return true;
}

static bool add_diffuse(document *d, const char **attributes)
{
    reference *new = add(d, &d->diffuses, &d->effect, NULL);
    if (!new) return false;
    copy_id(&new->to, xml_attribute(attributes, "texture"));
    copy_id(&new->name, xml_attribute(attributes, "texcoord"));
    return true;
}

static bool add_binding(document *d, const char **attributes)
{
    const char *set = xml_attribute(attributes, "input_set");
    reference *new = add(d, &d->bindings, &d->bound, NULL);
    if (!new) return false;
    copy_id(&new->to, xml_attribute(attributes, "semantic"));
    new->set = set ? (uint32_t)strtoul(set, NULL, 10) : 0;
    return true;
}

static void open_material(document *d, const char **attributes)
{
    const char *name = xml_attribute(attributes, "name"), *own = xml_attribute(attributes, "id");
    copy_id(&d->material, own);
    copy_id(&d->name, name && *name ? name : own);
}

static bool begin(void *context, const char *name, const char **attributes)
{
    document *d = context;
    name = xml_local_name(name);
    d->begin = xml_tag_end(&d->reader);
    if (strcmp(name, "effect") == 0) copy_id(&d->effect, xml_attribute(attributes, "id"));
    if (strcmp(name, "newparam") == 0) copy_id(&d->parameter, xml_attribute(attributes, "sid"));
    if (strcmp(name, "instance_material") == 0) copy_url(&d->bound, xml_attribute(attributes, "target"));
    if (strcmp(name, "material") == 0) open_material(d, attributes);
    if (strcmp(name, "diffuse") == 0) d->in_diffuse = true;
    if (strcmp(name, "sampler2D") == 0) return add(d, &d->samplers, &d->effect, &d->parameter) != NULL;
    if (strcmp(name, "texture") == 0 && d->in_diffuse) return add_diffuse(d, attributes);
    if (strcmp(name, "instance_effect") == 0) return add_material(d, attributes);
    if (strcmp(name, "bind_vertex_input") == 0) return add_binding(d, attributes);
    return true;
}

/* Reads the text of wrap_s or wrap_t. */
static void read_mode(document *d, uint32_t *out)
{
    static const struct {
        const char *name;
        mesh_wrap wrap;
    } modes[] = {{"WRAP", MESH_WRAP_REPEAT}, {"MIRROR", MESH_WRAP_MIRROR}, {"CLAMP", MESH_WRAP_CLAMP}};
    const char *text = d->reader.data + d->begin;
    text += strspn(text, " \t\r\n");
    for (size_t k = 0; k < sizeof modes / sizeof *modes; k++)
        if (strncmp(text, modes[k].name, strlen(modes[k].name)) == 0 &&
            strchr(" \t\r\n<", text[strlen(modes[k].name)])) {
            *out = modes[k].wrap;
            return;
        }
    d->unknown++;
}

static void end(void *context, const char *name)
{
    document *d = context;
    name = xml_local_name(name);
    if (strcmp(name, "diffuse") == 0) d->in_diffuse = false;
    if (d->samplers.count > 0 && (strcmp(name, "wrap_s") == 0 || strcmp(name, "wrap_t") == 0))
        read_mode(d, &d->samplers.item[d->samplers.count - 1].wrap[name[strlen("wrap_")] == 't']);
}

/* The reference from an element to `to`, or to any element. NULL: there is none. */
static const reference *find(const references *all, const id *from, const id *to)
{
    for (size_t k = 0; k < all->count; k++)
        if (is(&all->item[k].from, from) && (!to || is(&all->item[k].to, to))) return &all->item[k];
    return NULL;
}

static const reference *find_named(const references *all, const char *name)
{
    for (size_t k = 0; k < all->count; k++)
        if (strncmp(all->item[k].name.text, name, sizeof all->item[k].name.text - 1) == 0)
            return &all->item[k];
    return NULL;
}

/* Sets the wrap modes and the set of coordinates of a material that has an image. */
static void apply(const document *d, mesh_material *m, uint32_t *set)
{
    const reference *material = find_named(&d->materials, m->name),
                    *diffuse = material ? find(&d->diffuses, &material->to, NULL) : NULL,
                    *sampler = diffuse ? find(&d->samplers, &material->to, &diffuse->to) : NULL,
                    *binding = diffuse ? find(&d->bindings, &material->from, &diffuse->name) : NULL;
    if (sampler) memcpy(m->wrap, sampler->wrap, sizeof m->wrap);
    *set = binding ? binding->set : 0;
}

bool collada_textures_read(const char *data, size_t size, plain_mesh *m, uint32_t *set)
{
    document d = {.m = m};
    d.reader =
        (xml){.data = data, .size = size, .context = &d, .begin = begin, .end = end, .allows_doctype = true};
    const bool ok = plain_mesh_read_xml(m, &d.reader, "the COLLADA file");
    for (size_t k = 0; ok && k < m->textures->all.materials; k++)
        apply(&d, &m->textures->all.material[k], &set[k]);
    if (ok && d.unknown > 0)
        plain_textures_warn(m, "%zu wrap modes are not WRAP, MIRROR or CLAMP: these images are repeated",
                            d.unknown);
    free(d.materials.item);
    free(d.diffuses.item);
    free(d.samplers.item);
    free(d.bindings.item);
    return ok;
}

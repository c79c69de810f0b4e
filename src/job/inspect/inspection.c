#include "job/inspect/inspection.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "job/inspect/contents.h"
#include "files/root.h"

/* What the first bytes of a file, or its name, say of it. */
typedef struct kind {
    const char *format, *magic;
    size_t magic_length;
    const char *endings; /* each between blanks; NULL: the first bytes determine the format */
    contents_reader *read;
} kind;

/* A file that is none of the others is a mesh, whose reader knows the formats by their endings. */
static const kind kinds[] = {
    {"OpenVDB", " BDV\0\0\0\0", 8, " .vdb ", contents_read_vdb},
    {"OpenEXR", "v/1\1", 4, " .exr ", contents_read_exr},
    {"TIFF", "II*\0", 4, " .tif .tiff .btf ", contents_read_tiff},
    {"TIFF", "MM\0*", 4, "", contents_read_tiff},
    {"TIFF", "II+\0", 4, "", contents_read_tiff},
    {"TIFF", "MM\0+", 4, "", contents_read_tiff},
    {"NRRD", "NRRD", 4, " .nrrd .nhdr ", contents_read_dense},
    {"NIfTI", "", 0, " .nii .nii.gz .hdr .img .img.gz ", contents_read_dense},
    /* of these the reader says what they are */
    {"MetaImage", "", 0, " .mha .mhd ", contents_read_dense},
    {"volume", "", 0, " .vti .slc .vol .mgz .mgh .raw .dcm ", contents_read_dense},
    {"mesh", "", 0, NULL, contents_read_mesh},
};

static bool ends_with_one_of(const char *path, const char *endings)
{
    size_t length = strlen(path);
    for (const char *at = endings; at && (at = strchr(at, '.')); at += strcspn(at, " ")) {
        size_t n = strcspn(at, " ");
        if (length > n && strncasecmp(path + length - n, at, n) == 0) return true;
    }
    return false;
}

static const kind *recognise(int fd, const char *path)
{
    char head[8] = "";
    const kind *k = kinds;
    ssize_t got = pread(fd, head, sizeof head, 0);
    for (; k->endings; k++)
        if (k->magic_length > 0 && got >= (ssize_t)k->magic_length &&
            memcmp(head, k->magic, k->magic_length) == 0)
            return k;
    for (k = kinds; k->endings && !ends_with_one_of(path, k->endings);) k++;
    return k;
}

json *inspection_make(const char *path, const run_options *options, error *e)
{
    static const kind of_directories = {"OME-Zarr", "", 0, NULL, contents_read_zarr};
    bool is_directory = false;
    int fd = store_open_place(options->roots, path, &is_directory, e);
    if (fd < 0) return NULL;
    const kind *k = is_directory ? &of_directories : recognise(fd, path);
    json *o = json_new_object();
    json_put_string(o, "schema", "hexad.inspection");
    json_put_integer(o, "version", 1);
    json_put_string(o, "path", path);
    json_put_integer(o, "bytes", is_directory ? 0 : (int64_t)lseek(fd, 0, SEEK_END));
    json_put_string(o, "format", k->format);
    const contents_input in = {fd, path, options};
    json_put_array(o, "suggestions");
    if (!k->read(&in, o, e)) {
        json_free(o);
        o = NULL;
    }
    close(fd);
    return o;
}

const json *inspection_spec(const json *inspection)
{
    const json *found = NULL;
    json_at root = json_root(inspection), list = json_member(&root, "suggestions");
    for (json_at item = json_first(&list); item.node; item = json_next(&item)) {
        json_at spec = json_member(&item, "spec");
        if (!spec.node) continue;
        if (json_bool(json_member(&item, "measured"), false)) return spec.node;
        if (!found) found = spec.node;
    }
    return found;
}

// SPDX-License-Identifier: Apache-2.0
#include "job/inspect/inspection.h"

#include <unistd.h>

#include "base/core/file_format.h"
#include "base/core/memory.h"
#include "job/inspect/contents.h"
#include "files/root.h"

/* Readers by format. Formats without a row are dense volumes, whose reader names the format in its message,
 * and meshes. */
static contents_reader *const readers[FILE_FORMATS] = {[FILE_FORMAT_VDB] = contents_read_vdb,
                                                       [FILE_FORMAT_EXR] = contents_read_exr,
                                                       [FILE_FORMAT_TIFF] = contents_read_tiff,
                                                       [FILE_FORMAT_OME_ZARR] = contents_read_zarr};

static contents_reader *reader_of(file_format format)
{
    if (readers[format]) return readers[format];
    return file_formats[format].kind == FILE_FORMAT_VOLUMES ? contents_read_dense : contents_read_mesh;
}

const char *inspection_member(const char *path, const run_options *options)
{
    bool is_directory = false;
    int fd = store_open_place(options->roots, path, &is_directory, NULL);
    if (fd < 0) return NULL;
    const file_format format = is_directory ? FILE_FORMAT_OME_ZARR : file_format_of_file(fd, path);
    close(fd);
    return reader_of(format) == contents_read_mesh ? "mesh" : format == FILE_FORMAT_VDB ? "vdb" : NULL;
}

json *inspection_make(const char *path, const run_options *options, error *e)
{
    bool is_directory = false;
    int fd = store_open_place(options->roots, path, &is_directory, e);
    if (fd < 0) return NULL;
    const file_format format = is_directory ? FILE_FORMAT_OME_ZARR : file_format_of_file(fd, path);
    contents_reader *const read = reader_of(format);
    json *o = json_new_object();
    json_put_string(o, "schema", "hexad.inspection");
    json_put_integer(o, "version", 1);
    json_put_string(o, "path", path);
    json_put_integer(o, "bytes", is_directory ? 0 : (int64_t)lseek(fd, 0, SEEK_END));
    json_put_string(o, "format", read == contents_read_mesh ? "mesh" : file_formats[format].name);
    const contents_input in = {fd, path, options};
    json_put_array(o, "suggestions");
    if (!read(&in, o, e)) {
        json_free(o);
        o = NULL;
    }
    close(fd);
    return o;
}

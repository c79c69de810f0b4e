// SPDX-License-Identifier: Apache-2.0
/* file_format: the registry of file formats, constant data: what a format is called, how its files are
 * recognised, what they hold, and what to do with a file that is not read.
 *
 * Functions of formats are in tables by file_format: readers in io/meshes/plain_mesh and
 * io/volumes/volume_file, writers in io/points/writers. Tests compare the tables and doc/formats.md with the
 * registry. Any thread.
 */
#ifndef HEXAD_BASE_CORE_FILE_FORMAT_H
#define HEXAD_BASE_CORE_FILE_FORMAT_H

#include <stdbool.h>
#include <stddef.h>

typedef enum file_format {
    FILE_FORMAT_UNKNOWN, /* none of the others; it may be a mesh that the library assimp reads */
    FILE_FORMAT_PLY,
    FILE_FORMAT_OBJ,
    FILE_FORMAT_STL,
    FILE_FORMAT_OFF,
    FILE_FORMAT_3MF,
    FILE_FORMAT_VTK, /* legacy files */
    FILE_FORMAT_VTP, /* XML files */
    FILE_FORMAT_GIFTI,
    FILE_FORMAT_FBX,
    FILE_FORMAT_COLLADA,
    FILE_FORMAT_X3D,
    FILE_FORMAT_NPZ,
    FILE_FORMAT_GLTF,
    FILE_FORMAT_USD,
    FILE_FORMAT_AMF,
    FILE_FORMAT_DXF,
    FILE_FORMAT_STEP,
    FILE_FORMAT_IGES,
    FILE_FORMAT_ALEMBIC,
    FILE_FORMAT_HOUDINI,
    FILE_FORMAT_FREESURFER,
    FILE_FORMAT_HDF5,
    FILE_FORMAT_VDB,
    FILE_FORMAT_NRRD,
    FILE_FORMAT_NIFTI,
    FILE_FORMAT_META_IMAGE,
    FILE_FORMAT_TIFF,
    FILE_FORMAT_OME_ZARR, /* a directory */
    FILE_FORMAT_ZARR_PART,
    FILE_FORMAT_VTI,
    FILE_FORMAT_SLC,
    FILE_FORMAT_VOL,
    FILE_FORMAT_DICOM,
    FILE_FORMAT_MGH,
    FILE_FORMAT_NETCDF,
    FILE_FORMAT_MRC,
    FILE_FORMAT_ANALYZE,
    FILE_FORMAT_RAW,
    FILE_FORMAT_ZIP,
    FILE_FORMAT_EXR,
    FILE_FORMAT_PNG,
    FILE_FORMAT_JPEG,
    FILE_FORMAT_DPX,
    FILE_FORMAT_JSON,
    FILE_FORMATS
} file_format;

typedef enum file_format_kind {
    FILE_FORMAT_MESHES,
    FILE_FORMAT_POINTS,
    FILE_FORMAT_GRIDS,   /* sparse: OpenVDB */
    FILE_FORMAT_VOLUMES, /* dense */
    FILE_FORMAT_IMAGES,
    FILE_FORMAT_DOCUMENTS
} file_format_kind;

typedef enum file_format_reading {
    FILE_FORMAT_NOT_READ,
    FILE_FORMAT_READ,           /* by a reader of hexad */
    FILE_FORMAT_READ_BY_LIBRARY /* by assimp */
} file_format_reading;

enum { FILE_FORMAT_ENDINGS = 5, FILE_FORMAT_BEGINNINGS = 4 };

/* Bytes at a place of each file. length 0: any. */
typedef struct file_format_bytes {
    size_t at, length;
    const char *bytes;
} file_format_bytes;

typedef struct file_format_row {
    const char *name;
    /* of names of files, in lower case, from the dot on; files that are written have the first */
    const char *ending[FILE_FORMAT_ENDINGS];
    file_format_bytes beginning[FILE_FORMAT_BEGINNINGS]; /* any of these identifies the format */
    const char *within;                        /* a text in the head of a file identifies it; or NULL */
    bool (*is)(const char *data, size_t size); /* a test of the bytes identifies it; or NULL */
    file_format_kind kind;
    file_format_reading reading;
    bool is_written;
    bool has_points;          /* points can be given in such files */
    bool positions_only;      /* of the vertices of its meshes only positions are read */
    bool has_floats;          /* positions are written as floats, relative to an origin */
    bool is_misread;          /* assimp takes files that end so, and reads them wrongly */
    bool z_up;                /* the axis z points up; otherwise y */
    bool up_varies;           /* files exist with either axis */
    const char *content_type; /* of HTTP, of files that are written; NULL: bytes */
    /* What to do with a file of the format: the sentences of the message if it is given as a mesh and not
     * read as one; the words behind "the file is " if it is given as a dense volume; the sentence if it is an
     * image of a stack of OpenEXR. NULL: there is no advice. For a format that is read, as_mesh is for a
     * file with a foreign ending. */
    const char *as_mesh, *as_volume, *as_image;
} file_format_row;

extern const file_format_row file_formats[FILE_FORMATS];

/* Bytes that are the head of a file. */
enum { FILE_FORMAT_HEAD = 1024 };

/* By a name, a path or an ending without its dot, in any case. If two formats have the ending, the one that
 * has it nearer to the front of its row. */
file_format file_format_of_name(const char *name);

/* Whether files of the format may have this name, path or ending. */
bool file_format_has_ending(file_format format, const char *name);

/* By the bytes of a file: its head, or all. data[size] is 0. */
file_format file_format_of_bytes(const char *data, size_t size);

/* By the head of an open file and its name. The bytes decide for formats of grids, volumes and images that
 * are read; then the name, because many meshes are text without a mark; then the bytes. */
file_format file_format_of_file(int fd, const char *name);

#endif

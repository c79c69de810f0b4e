// SPDX-License-Identifier: Apache-2.0
/* file_format: the registry of file formats, constant data: the name of each format, how its files are
 * recognised, their contents, and advice about files that are not read.
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
    FILE_FORMAT_UNKNOWN,
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
    FILE_FORMAT_NPZ,
    FILE_FORMAT_GLTF,
    FILE_FORMAT_X3D,
    FILE_FORMAT_3DS,
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
    FILE_FORMAT_WEBP,
    FILE_FORMAT_KTX,
    FILE_FORMAT_DDS,
    FILE_FORMAT_GIF,
    FILE_FORMAT_BMP,
    FILE_FORMAT_AVIF,
    FILE_FORMAT_HEIC,
    FILE_FORMAT_JPEG_2000,
    FILE_FORMAT_BASIS,
    FILE_FORMAT_PHOTOSHOP,
    FILE_FORMAT_RADIANCE,
    FILE_FORMAT_TGA,
    FILE_FORMAT_JSON,
    FILE_FORMAT_CSV,
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

/* Bytes at a given offset of each file of the format. length 0: any bytes. */
typedef struct file_format_bytes {
    size_t at, length;
    const char *bytes;
} file_format_bytes;

typedef struct file_format_row {
    const char *name;
    /* endings of file names, in lower case, with the dot; written files have the first one */
    const char *ending[FILE_FORMAT_ENDINGS];
    /* any of these at the beginning of a file identifies the format */
    file_format_bytes beginning[FILE_FORMAT_BEGINNINGS];
    const char *within;                        /* this text in the head of a file identifies the format; or
                                                * NULL */
    bool (*is)(const char *data, size_t size); /* tests the bytes of a file; or NULL */
    file_format_kind kind;
    file_format_reading reading;
    bool is_written;
    bool has_points;          /* such files can be used as given points */
    bool has_floats;          /* positions are written as floats, relative to an origin */
    bool z_up;                /* z points up in such files; otherwise y */
    bool up_varies;           /* in some files y points up, in others z */
    const char *content_type; /* HTTP content type of written files; NULL: application/octet-stream */
    /* Advice about a file of the format. as_mesh: complete sentences, if it is given as a mesh and is not
     * read. as_volume: the text after "the file is ", if it is given as a dense volume. as_image: a
     * sentence, if it is an image of an OpenEXR stack. NULL: no advice. */
    const char *as_mesh, *as_volume, *as_image;
} file_format_row;

extern const file_format_row file_formats[FILE_FORMATS];

/* Number of bytes at the beginning of a file that are examined. */
enum { FILE_FORMAT_HEAD = 1024 };

/* The format by a name, a path or an ending without its dot, in any case. If several formats have the
 * ending, the one that lists it earlier in its row. */
file_format file_format_of_name(const char *name);

/* The format of a mesh whose file has neither a signature nor a known name: OFF, OBJ or STL by the first words and the size, or
 * FILE_FORMAT_UNKNOWN. data[size] is 0. */
file_format file_format_of_words(const char *data, size_t size);

/* Whether files of the format may have this name, path or ending. */
bool file_format_has_ending(file_format format, const char *name);

/* The format by the bytes of a file: its head, or all. data[size] is 0. */
file_format file_format_of_bytes(const char *data, size_t size);

/* Advice about a file that is given as a mesh and cannot be read as one, by its bytes, or by its name if that of a
 * format that is not read; NULL: none. data[size] is 0. */
const char *file_format_as_mesh(const char *name, const char *data, size_t size);

/* The format by the head and the name of an open file. The bytes decide for formats of grids, volumes and
 * images that are read. Otherwise the name decides, because many meshes are text without a signature; then
 * the bytes. */
file_format file_format_of_file(int fd, const char *name);

#endif

// SPDX-License-Identifier: Apache-2.0
#include "base/core/file_format.h"

#include <ctype.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/core/number.h"

/* ---- formats that a few bytes do not identify */

/* The exchange format of STEP with a schema other than IFC. */
static bool is_step(const char *data, size_t size)
{
    static const char begin[] = "ISO-10303-21;";
    if (size < sizeof begin || memcmp(data, begin, sizeof begin - 1) != 0) return false;
    const char *schema = strstr(data, "FILE_SCHEMA"), *end = schema ? strchr(schema, ';') : NULL,
               *ifc = schema ? strstr(schema, "IFC") : NULL;
    return !ifc || !end || ifc > end;
}

/* IGES has lines of 80 characters; in the first section column 73 is S, followed by the line number. */
static bool is_iges(const char *data, size_t size)
{
    enum { SECTION = 72, NUMBER = 7 };
    if (size < SECTION + NUMBER + 1 || data[SECTION] != 'S' || memchr(data, '\n', SECTION)) return false;
    const size_t blanks = strspn(data + SECTION + 1, " 0");
    return blanks == NUMBER - 1 && data[SECTION + NUMBER] == '1';
}

/* DXF as text: a group code of 0, and the name SECTION in the next line; comments, of the code 999, may precede them. */
static bool is_dxf(const char *data, size_t size)
{
    static const char blanks[] = " \t\r\n", binary[] = "AutoCAD Binary DXF";
    if (size >= sizeof binary && memcmp(data, binary, sizeof binary - 1) == 0) return true;
    const char *code = data + strspn(data, blanks);
    while (strncmp(code, "999", 3) == 0 && code[3] && strchr(blanks, code[3])) {
        code += strcspn(code, "\n");
        code += *code == '\n';
        code += strcspn(code, "\n");
        code += strspn(code, blanks);
    }
    return *code == '0' && code[1] && strchr(blanks, code[1]) &&
           strncmp(code + 1 + strspn(code + 1, blanks), "SECTION", 7) == 0;
}

/* 3DS: the main chunk begins with the chunk of the version, of 10 bytes. */
static bool is_3ds(const char *data, size_t size)
{
    return size >= 16 && memcmp(data, "MM", 2) == 0 && memcmp(data + 6, "\2\0\12\0\0\0", 6) == 0;
}

/* NIfTI-1 and -2: the size of the header in either byte order, and the mark. */
static bool is_nifti(const char *data, size_t size)
{
    static const struct {
        const char *size, *marks[2];
        size_t at;
    } versions[] = {{"\x5c\1\0\0\0\0\1\x5c", {"n+1", "ni1"}, 344},
                    {"\x1c\2\0\0\0\0\2\x1c", {"n+2", "ni2"}, 4}};
    for (size_t k = 0; k < sizeof versions / sizeof *versions; k++)
        for (int n = 0; n < 2 && size >= versions[k].at + 4; n++)
            if ((memcmp(data, versions[k].size, 4) == 0 || memcmp(data, versions[k].size + 4, 4) == 0) &&
                memcmp(data + versions[k].at, versions[k].marks[n], 4) == 0)
                return true;
    return false;
}

/* MetaImage: begins with "KEY =", and has the number of dimensions. */
static bool is_meta_image(const char *data, size_t size)
{
    static const char *const first[] = {"ObjectType", "NDims", "Comment"};
    (void)size;
    for (size_t k = 0; k < sizeof first / sizeof *first; k++) {
        const size_t n = strlen(first[k]);
        if (strncmp(data, first[k], n) == 0 && data[n + strspn(data + n, " \t")] == '=')
            return strstr(data, "NDims") != NULL;
    }
    return isalpha((unsigned char)*data) && data[strcspn(data, "=\n")] == '=' && strstr(data, "NDims") &&
           strstr(data, "ElementDataFile");
}

/* ---- the registry */

#define NOT_READ(what) "the file is " what ", which is not read. Convert it with "
#define REMOVED(what) "the file is " what ", which is no longer read. Convert it with "
#define BLENDER "Blender: import it, and export PLY or OBJ."
#define NO_SURFACE(what) \
    "the file is a " what ", which is neither a mesh nor a volume. Name the file of the surface."
#define IMAGE(what)                                                                 \
    .name = what, .kind = FILE_FORMAT_IMAGES, .as_mesh = NO_SURFACE(what " image"), \
    .as_image = "the file is a " what " image: `oiiotool IMAGE -o IMAGE.exr` converts it"

// clang-format off
const file_format_row file_formats[FILE_FORMATS] = {
    [FILE_FORMAT_UNKNOWN] = {.name = "unknown"},
    /* meshes that are read */
    [FILE_FORMAT_PLY] = {.name = "PLY", .ending = {".ply"}, .beginning = {{0, 3, "ply"}},
        .reading = FILE_FORMAT_READ, .is_written = true, .has_points = true, .up_varies = true,
        .content_type = "model/ply"},
    [FILE_FORMAT_OBJ] = {.name = "OBJ", .ending = {".obj"}, .reading = FILE_FORMAT_READ, .up_varies = true},
    [FILE_FORMAT_STL] = {.name = "STL", .ending = {".stl"}, .reading = FILE_FORMAT_READ, .z_up = true,
        .up_varies = true},
    [FILE_FORMAT_OFF] = {.name = "OFF", .ending = {".off"}, .reading = FILE_FORMAT_READ, .up_varies = true},
    [FILE_FORMAT_3MF] = {.name = "3MF", .ending = {".3mf"}, .reading = FILE_FORMAT_READ, .z_up = true},
    [FILE_FORMAT_VTK] = {.name = "VTK", .ending = {".vtk", ".vtp"}, .beginning = {{0, 14, "# vtk DataFile"}},
        .reading = FILE_FORMAT_READ, .z_up = true,
        .as_volume = "a VTK file (3D Slicer saves a volume as NRRD; name a mesh as /surface/mesh/path)"},
    [FILE_FORMAT_VTP] = {.name = "VTK (XML)", .ending = {".vtp", ".vtk"}, .within = "<VTKFile",
        .reading = FILE_FORMAT_READ, .is_written = true, .z_up = true,
        .as_volume = "a VTK XML file (ParaView saves a volume as MetaImage, .mhd; name a ""mesh as "
            "/surface/mesh/path)"},
    [FILE_FORMAT_GIFTI] = {.name = "GIfTI", .ending = {".gii"}, .within = "<GIFTI",
        .reading = FILE_FORMAT_READ, .z_up = true,
        .as_volume = "a GIfTI file, which holds a mesh (name it as /surface/mesh/path)"},
    [FILE_FORMAT_FBX] = {.name = "FBX", .ending = {".fbx"}, .beginning = {{0, 7, "Kaydara"}, {0, 5, "; FBX"}},
        .reading = FILE_FORMAT_READ_BY_LIBRARY},
    [FILE_FORMAT_COLLADA] = {.name = "COLLADA", .ending = {".dae"}, .within = "<COLLADA",
        .reading = FILE_FORMAT_READ_BY_LIBRARY},
    [FILE_FORMAT_NPZ] = {.name = "NumPy archive", .ending = {".npz"}, .kind = FILE_FORMAT_POINTS,
        .reading = FILE_FORMAT_READ, .is_written = true, .has_points = true,
        .content_type = "application/zip"},
    [FILE_FORMAT_GLTF] = {.name = "glTF", .ending = {".glb", ".gltf"}, .beginning = {{0, 4, "glTF"}},
        .reading = FILE_FORMAT_READ, .is_written = true, .has_floats = true,
        .content_type = "model/gltf-binary"},
    /* meshes that are not read */
    [FILE_FORMAT_X3D] = {.name = "X3D", .ending = {".x3d"}, .within = "<X3D",
        .as_mesh = REMOVED("an X3D file") "assimp (assimp export a.x3d a.ply)."},
    [FILE_FORMAT_3DS] = {.name = "3DS", .ending = {".3ds"}, .is = is_3ds,
        .as_mesh = REMOVED("a 3DS file") "assimp (assimp export a.3ds a.ply)."},
    [FILE_FORMAT_USD] = {.name = "USD", .ending = {".usda", ".usd", ".usdc", ".usdz"},
        .beginning = {{0, 5, "#usda"}, {0, 8, "PXR-USDC"}}, .is_written = true, .has_floats = true,
        .content_type = "model/vnd.usda", .as_mesh = NOT_READ("a USD file") BLENDER},
    [FILE_FORMAT_AMF] = {.name = "AMF", .ending = {".amf"}, .within = "<amf",
        .as_mesh = NOT_READ("an AMF file") "PrusaSlicer (prusa-slicer --export-stl part.amf)."},
    [FILE_FORMAT_DXF] = {.name = "DXF", .ending = {".dxf"}, .is = is_dxf,
        .as_mesh = NOT_READ("a DXF file") "Blender: import it (add-on AutoCAD DXF), and ""export PLY or "
            "OBJ."},
    [FILE_FORMAT_STEP] = {.name = "STEP", .ending = {".step", ".stp"}, .is = is_step,
        .as_mesh = NOT_READ("a STEP file") "Gmsh (gmsh part.step -2 -o part.stl) or FreeCAD."},
    [FILE_FORMAT_IGES] = {.name = "IGES", .ending = {".igs", ".iges"}, .is = is_iges,
        .as_mesh = NOT_READ("an IGES file") "Gmsh (gmsh part.igs -2 -o part.stl) or FreeCAD."},
    [FILE_FORMAT_ALEMBIC] = {.name = "Alembic", .ending = {".abc"}, .beginning = {{0, 5, "Ogawa"}},
        .as_mesh = NOT_READ("an Alembic file") BLENDER},
    [FILE_FORMAT_HOUDINI] = {.name = "Houdini geometry", .ending = {".bgeo", ".geo", ".bgeo.sc"},
        .beginning = {{0, 4, "Bgeo"}, {0, 5, "\x7FNSJb"}, {0, 4, "scf1"}, {0, 9, "PGEOMETRY"}},
        .within = "\"fileversion\"",
        .as_mesh = NOT_READ("a geometry file of Houdini") "gconvert of Houdini (gconvert a.bgeo a.obj)."},
    [FILE_FORMAT_FREESURFER] = {.name = "FreeSurfer surface", .beginning = {{0, 3, "\xFF\xFF\xFE"}},
        .as_mesh = NOT_READ("a surface of FreeSurfer") "mris_convert (mris_convert lh.pial lh.stl)."},
    [FILE_FORMAT_HDF5] = {.name = "HDF5", .ending = {".h5", ".hdf5"},
        .beginning = {{0, 8, "\x89HDF\r\n\x1a\n"}},
        .as_mesh = "the file is an HDF5 file, as Alembic files may be, which is not read. ""Convert it "
            "with Blender (Alembic) or ParaView: export PLY or OBJ.",
        .as_volume = "an HDF5 file (`h5dump -d DATASET -b LE -o FILE` writes its raw ""numbers, which need "
            "an NRRD header)"},
    /* grids and volumes that are read */
    [FILE_FORMAT_VDB] = {.name = "OpenVDB", .ending = {".vdb"}, .beginning = {{0, 8, " BDV\0\0\0\0"}},
        .kind = FILE_FORMAT_GRIDS, .reading = FILE_FORMAT_READ, .is_written = true,
        .as_mesh = "the file is a volume of OpenVDB and not a mesh. In the spec, name it as "
            """/surface/vdb/path.",
        .as_volume = "an OpenVDB file (use surface.vdb)"},
    [FILE_FORMAT_NRRD] = {.name = "NRRD", .ending = {".nrrd", ".nhdr"}, .beginning = {{0, 4, "NRRD"}},
        .kind = FILE_FORMAT_VOLUMES, .reading = FILE_FORMAT_READ, .z_up = true,
        .as_mesh = "the file is an NRRD volume and not a mesh. In the spec, name it as "
            """/surface/volume/path."},
    [FILE_FORMAT_NIFTI] = {.name = "NIfTI", .ending = {".nii", ".nii.gz", ".hdr", ".img", ".img.gz"}, .is = is_nifti,
        .kind = FILE_FORMAT_VOLUMES, .reading = FILE_FORMAT_READ, .z_up = true},
    [FILE_FORMAT_META_IMAGE] = {.name = "MetaImage", .ending = {".mha", ".mhd"}, .is = is_meta_image,
        .kind = FILE_FORMAT_VOLUMES, .reading = FILE_FORMAT_READ, .z_up = true},
    [FILE_FORMAT_TIFF] = {.name = "TIFF", .ending = {".tif", ".tiff", ".btf"},
        .beginning = {{0, 4, "II*\0"}, {0, 4, "MM\0*"}, {0, 4, "II+\0"}, {0, 4, "MM\0+"}},
        .kind = FILE_FORMAT_VOLUMES, .reading = FILE_FORMAT_READ, .z_up = true,
        .as_image = "the file is a TIFF image: name the stack as /surface/volume/path with slices"},
    [FILE_FORMAT_OME_ZARR] = {.name = "OME-Zarr", .kind = FILE_FORMAT_VOLUMES, .reading = FILE_FORMAT_READ,
        .z_up = true},
    /* volumes that are not read */
    [FILE_FORMAT_ZARR_PART] = {.name = "part of a Zarr volume", .within = "zarr_format",
        .kind = FILE_FORMAT_VOLUMES, .as_volume = "a part of a Zarr volume (name its directory as the path)"},
    [FILE_FORMAT_VTI] = {.name = "VTK image data", .ending = {".vti"}, .kind = FILE_FORMAT_VOLUMES,
        .as_volume = "a VTK image data file (ParaView saves it as MetaImage, .mhd)"},
    [FILE_FORMAT_SLC] = {.name = "VolVis SLC", .ending = {".slc"}, .beginning = {{0, 6, "11111\n"}},
        .kind = FILE_FORMAT_VOLUMES,
        .as_volume = "an SLC volume of VolVis (ParaView saves it as VTK, and 3D Slicer that as NRRD)"},
    [FILE_FORMAT_VOL] = {.name = "Mitsuba VOL", .ending = {".vol"}, .beginning = {{0, 4, "VOL\003"}},
        .kind = FILE_FORMAT_VOLUMES,
        .as_volume = "a VOL volume of Mitsuba (48 bytes and raw floats: write an NRRD ""header with `byte "
            "skip: 48`)"},
    [FILE_FORMAT_DICOM] = {.name = "DICOM", .ending = {".dcm"}, .beginning = {{128, 4, "DICM"}},
        .kind = FILE_FORMAT_VOLUMES,
        .as_volume = "a DICOM file (`dcm2niix FOLDER` converts a series to NIfTI)"},
    [FILE_FORMAT_MGH] = {.name = "FreeSurfer volume", .ending = {".mgz", ".mgh"},
        .beginning = {{0, 4, "\0\0\0\1"}}, .kind = FILE_FORMAT_VOLUMES,
        .as_volume = "a volume of FreeSurfer (`mri_convert FILE.mgz FILE.nii` converts it)"},
    [FILE_FORMAT_NETCDF] = {.name = "netCDF or MINC", .ending = {".nc", ".mnc"}, .beginning = {{0, 3, "CDF"}},
        .kind = FILE_FORMAT_VOLUMES, .as_volume = "a netCDF or MINC file (`mnc2nii` converts MINC to NIfTI)"},
    [FILE_FORMAT_MRC] = {.name = "MRC or CCP4", .ending = {".mrc", ".ccp4"}, .beginning = {{208, 4, "MAP "}},
        .kind = FILE_FORMAT_VOLUMES,
        .as_volume = "an MRC or CCP4 map (1024 bytes and raw numbers: write an NRRD header with `byte "
            "skip: 1024`)"},
    [FILE_FORMAT_ANALYZE] = {.name = "ANALYZE 7.5", .beginning = {{0, 4, "\x5c\1\0\0"}, {0, 4, "\0\0\1\x5c"}},
        .kind = FILE_FORMAT_VOLUMES,
        .as_volume = "an ANALYZE 7.5 header (`fslchfiletype NIFTI FILE` converts it)"},
    [FILE_FORMAT_RAW] = {.name = "raw numbers", .ending = {".raw"}, .kind = FILE_FORMAT_VOLUMES,
        .as_mesh = "the file has raw numbers, which are not read as a mesh. Name a volume as "
            "/surface/volume/path, with an NRRD header, and save a mesh as PLY or OBJ.",
        .as_volume = "not a volume in a known format (raw numbers need an NRRD header: `unu ""make -h -t "
            "TYPE -s X Y Z -i FILE`)"},
    [FILE_FORMAT_ZIP] = {.name = "ZIP", .ending = {".zip"}, .beginning = {{0, 4, "PK\3\4"}},
        .kind = FILE_FORMAT_DOCUMENTS,
        .as_volume = "a ZIP archive (unpack it; name the directory of an OME-Zarr image as the path)"},
    /* images and documents */
    [FILE_FORMAT_EXR] = {.name = "OpenEXR", .ending = {".exr"}, .beginning = {{0, 4, "v/1\1"}},
        .kind = FILE_FORMAT_IMAGES, .reading = FILE_FORMAT_READ, .is_written = true, .z_up = true,
        .content_type = "image/x-exr", .as_volume = "an EXR image (use surface.exr)"},
    [FILE_FORMAT_PNG] = {IMAGE("PNG"), .ending = {".png"}, .beginning = {{0, 4, "\x89PNG"}}, .is_written = true,
        .content_type = "image/png"},
    [FILE_FORMAT_JPEG] = {IMAGE("JPEG"), .ending = {".jpg", ".jpeg"}, .beginning = {{0, 3, "\xff\xd8\xff"}}},
    [FILE_FORMAT_DPX] = {IMAGE("DPX"), .ending = {".dpx"}, .beginning = {{0, 4, "SDPX"}, {0, 4, "XPDS"}}},
    [FILE_FORMAT_WEBP] = {IMAGE("WebP"), .ending = {".webp"}, .beginning = {{8, 4, "WEBP"}}},
    [FILE_FORMAT_KTX] = {IMAGE("KTX"), .ending = {".ktx", ".ktx2"}, .beginning = {{0, 5, "\xABKTX "}}},
    [FILE_FORMAT_DDS] = {IMAGE("DDS"), .ending = {".dds"}, .beginning = {{0, 4, "DDS "}}},
    [FILE_FORMAT_GIF] = {IMAGE("GIF"), .ending = {".gif"}, .beginning = {{0, 4, "GIF8"}}},
    [FILE_FORMAT_BMP] = {IMAGE("BMP"), .ending = {".bmp"}, .beginning = {{0, 2, "BM"}}},
    [FILE_FORMAT_AVIF] = {IMAGE("AVIF"), .ending = {".avif"}, .beginning = {{4, 7, "ftypavi"}}},
    [FILE_FORMAT_HEIC] = {IMAGE("HEIC"), .ending = {".heic"}, .beginning = {{4, 7, "ftyphei"}}},
    [FILE_FORMAT_JPEG_2000] = {IMAGE("JPEG 2000"), .ending = {".jp2"}, .beginning = {{4, 4, "jP  "}}},
    [FILE_FORMAT_BASIS] = {IMAGE("Basis"), .ending = {".basis"}, .beginning = {{0, 2, "sB"}}},
    [FILE_FORMAT_PHOTOSHOP] = {IMAGE("Photoshop"), .ending = {".psd"}, .beginning = {{0, 4, "8BPS"}}},
    [FILE_FORMAT_RADIANCE] = {IMAGE("Radiance"), .beginning = {{0, 5, "#?RAD"}}},
    [FILE_FORMAT_TGA] = {IMAGE("TGA"), .ending = {".tga"}},
    [FILE_FORMAT_JSON] = {.name = "JSON", .ending = {".json"}, .kind = FILE_FORMAT_DOCUMENTS,
        .is_written = true, .content_type = "application/json", .as_mesh = NO_SURFACE("JSON document")},
    [FILE_FORMAT_CSV] = {.name = "CSV", .ending = {".csv"}, .kind = FILE_FORMAT_DOCUMENTS,
        .is_written = true, .content_type = "text/csv", .as_mesh = NO_SURFACE("CSV table")},
};
// clang-format on

/* ---- recognition */

/* Whether the name ends with the ending, or equals it without its dot. */
static bool ends_with(const char *name, const char *ending)
{
    const size_t length = strlen(name), n = strlen(ending + 1);
    return length >= n && strcasecmp(name + length - n, ending + 1) == 0 &&
           (length == n || name[length - n - 1] == '.');
}

file_format file_format_of_name(const char *name)
{
    for (int place = 0; place < FILE_FORMAT_ENDINGS; place++)
        for (int k = 0; k < FILE_FORMATS; k++) {
            const char *ending = file_formats[k].ending[place];
            if (ending && ends_with(name, ending)) return (file_format)k;
        }
    return FILE_FORMAT_UNKNOWN;
}

bool file_format_has_ending(file_format format, const char *name)
{
    for (int place = 0; place < FILE_FORMAT_ENDINGS; place++) {
        const char *ending = file_formats[format].ending[place];
        if (ending && ends_with(name, ending)) return true;
    }
    return false;
}

static bool begins_as(const file_format_row *row, const char *data, size_t size)
{
    for (const file_format_bytes *b = row->beginning; b < row->beginning + FILE_FORMAT_BEGINNINGS; b++)
        if (b->length > 0 && size >= b->at + b->length && memcmp(data + b->at, b->bytes, b->length) == 0)
            return true;
    return false;
}

file_format file_format_of_bytes(const char *data, size_t size)
{
    char head[FILE_FORMAT_HEAD + 1];
    const size_t length = size < FILE_FORMAT_HEAD ? size : FILE_FORMAT_HEAD;
    memcpy(head, data, length);
    head[length] = 0;
    for (int k = 0; k < FILE_FORMATS; k++) {
        const file_format_row *row = &file_formats[k];
        if (begins_as(row, data, size) || (row->within && strstr(head, row->within)) ||
            (row->is && row->is(data, size)))
            return (file_format)k;
    }
    return FILE_FORMAT_UNKNOWN;
}

/* The first word that is not in a comment; *length: of it. */
static const char *first_word(const char *data, size_t *length)
{
    static const char blanks[] = " \t\r\n";
    if (strncmp(data, "\xef\xbb\xbf", 3) == 0) data += 3;
    data += strspn(data, blanks);
    while (*data == '#') {
        data += strcspn(data, "\n");
        data += strspn(data, blanks);
    }
    *length = strcspn(data, blanks);
    return data;
}

/* OFF with prefixes for further numbers of vertices: COFF, STNOFF, 4OFF, nOFF, ... */
static bool is_off_word(const char *word, size_t length)
{
    static const char suffix[] = "OFF";
    const size_t prefix = length - strlen(suffix);
    return length >= strlen(suffix) && strncmp(word + prefix, suffix, strlen(suffix)) == 0 &&
           strspn(word, "STCN4n") == prefix;
}

static bool is_obj_word(const char *word, size_t length)
{
    static const char *const words[] = {"v", "vn", "vt", "o", "g", "s", "mtllib", "usemtl"};
    for (size_t k = 0; k < sizeof words / sizeof *words; k++)
        if (strlen(words[k]) == length && strncmp(word, words[k], length) == 0) return true;
    return false;
}

/* A header of 80 bytes, the number of triangles, and 50 bytes for each. */
static bool is_binary_stl(const char *data, size_t size)
{
    enum { HEADER = 84, TRIANGLE = 50 };
    return size >= HEADER &&
           (uint64_t)size == HEADER + TRIANGLE * number_bits(data + 80, 4, NUMBER_LITTLE_SWAPPED);
}

file_format file_format_of_words(const char *data, size_t size)
{
    size_t length;
    const char *word = first_word(data, &length);
    if (is_off_word(word, length)) return FILE_FORMAT_OFF;
    if (is_binary_stl(data, size) ||
        (strncmp(word, "solid", length) == 0 && length == 5 && strstr(word, "facet")))
        return FILE_FORMAT_STL;
    return is_obj_word(word, length) && (strncmp(word, "v ", 2) == 0 || strstr(word, "\nv "))
               ? FILE_FORMAT_OBJ
               : FILE_FORMAT_UNKNOWN;
}

const char *file_format_as_mesh(const char *name, const char *data, size_t size)
{
    const file_format_row *found = &file_formats[file_format_of_bytes(data, size)],
                          *named = &file_formats[file_format_of_name(name)];
    return found->as_mesh || named->reading != FILE_FORMAT_NOT_READ ? found->as_mesh : named->as_mesh;
}

file_format file_format_of_file(int fd, const char *name)
{
    char head[FILE_FORMAT_HEAD + 1];
    const ssize_t got = pread(fd, head, FILE_FORMAT_HEAD, 0);
    const size_t length = got > 0 ? (size_t)got : 0;
    head[length] = 0;
    const file_format found = file_format_of_bytes(head, length), named = file_format_of_name(name);
    const file_format_row *row = &file_formats[found];
    const bool is_sure = row->kind != FILE_FORMAT_MESHES && row->reading != FILE_FORMAT_NOT_READ;
    return is_sure || named == FILE_FORMAT_UNKNOWN ? found : named;
}

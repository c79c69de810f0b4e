#include "io/meshes/foreign_format.h"

#include <stdbool.h>
#include <string.h>
#include <strings.h>

static bool begins_with(const char *data, size_t size, const char *bytes, size_t count)
{
    return size >= count && memcmp(data, bytes, count) == 0;
}

#define BEGINS(bytes) begins_with(data, size, bytes, sizeof(bytes) - 1)

/* The text is within the first bytes, where the head of an XML document is. */
static bool has_in_head(const char *data, size_t size, const char *text)
{
    enum { HEAD = 1024 };
    char head[HEAD + 1];
    const size_t length = size < HEAD ? size : HEAD;
    memcpy(head, data, length);
    head[length] = 0;
    return strstr(head, text) != NULL;
}

/* The exchange format of STEP, whose schema is not IFC, which assimp reads. */
static bool is_step(const char *data, size_t size)
{
    if (!BEGINS("ISO-10303-21;")) return false;
    const char *schema = strstr(data, "FILE_SCHEMA"), *end = schema ? strchr(schema, ';') : NULL,
               *ifc = schema ? strstr(schema, "IFC") : NULL;
    return !ifc || !end || ifc > end;
}

/* Lines of 80 characters: the 73rd of the first section is S, and its number follows. */
static bool is_iges(const char *data, size_t size)
{
    enum { SECTION = 72, NUMBER = 7 };
    if (size < SECTION + NUMBER + 1 || data[SECTION] != 'S' || memchr(data, '\n', SECTION)) return false;
    const size_t blanks = strspn(data + SECTION + 1, " 0");
    return blanks == NUMBER - 1 && data[SECTION + NUMBER] == '1';
}

/* DXF as text: a group code of 0, and the name SECTION in the next line. */
static bool is_dxf(const char *data, size_t size)
{
    static const char blanks[] = " \t\r\n";
    if (BEGINS("AutoCAD Binary DXF")) return true;
    const char *code = data + strspn(data, blanks);
    return *code == '0' && code[1] && strchr(blanks, code[1]) &&
           strncmp(code + 1 + strspn(code + 1, blanks), "SECTION", 7) == 0;
}

const char *foreign_format(const char *ending, const char *data, size_t size)
{
    if (BEGINS(" BDV\0\0\0\0"))
        return "the file is a volume of OpenVDB and not a mesh. In the spec, name it as /surface/vdb/path.";
    if (BEGINS("NRRD"))
        return "the file is an NRRD volume and not a mesh. In the spec, name it as /surface/volume/path.";
    if (is_step(data, size))
        return "the file is a STEP file, which is not read. Convert it with Gmsh (gmsh part.step -2 -o part.stl) or FreeCAD.";
    if (is_iges(data, size))
        return "the file is an IGES file, which is not read. Convert it with Gmsh (gmsh part.igs -2 -o part.stl) or FreeCAD.";
    if (BEGINS("Ogawa"))
        return "the file is an Alembic file, which is not read. Convert it with Blender: import it, and export PLY or OBJ.";
    if (BEGINS("\x89HDF\r\n"))
        return "the file is an HDF5 file, as Alembic files may be, which is not read. Convert it with Blender (Alembic) or "
               "ParaView: export PLY or OBJ.";
    if (BEGINS("Bgeo") || BEGINS("\x7FNSJb") || BEGINS("scf1") || BEGINS("PGEOMETRY") ||
        has_in_head(data, size, "\"fileversion\""))
        return "the file is a geometry file of Houdini, which is not read. Convert it with gconvert of Houdini (gconvert "
               "a.bgeo a.obj).";
    if (BEGINS("# vtk DataFile") || has_in_head(data, size, "<VTKFile"))
        return strcasecmp(ending, "vtk") == 0 || strcasecmp(ending, "vtp") == 0
                   ? NULL
                   : "the file is a VTK file, which the ending of its name does not say. Name it .vtk or .vtp.";
    if (has_in_head(data, size, "<GIFTI"))
        return strcasecmp(ending, "gii") == 0
                   ? NULL
                   : "the file is a GIfTI file, which the ending of its name does not say. Name it .gii.";
    if (BEGINS("\xFF\xFF\xFE"))
        return "the file is a surface of FreeSurfer, which is not read. Convert it with mris_convert (mris_convert lh.pial "
               "lh.stl).";
    if (BEGINS("#usda") || BEGINS("PXR-USDC"))
        return "the file is a USD file, which is not read. Convert it with Blender: import it, and export PLY or OBJ.";
    if (strcasecmp(ending, "amf") == 0 || has_in_head(data, size, "<amf"))
        return "the file is an AMF file, which is not read. Convert it with PrusaSlicer (prusa-slicer --export-stl part.amf).";
    if (strcasecmp(ending, "dxf") == 0 || is_dxf(data, size))
        return "the file is a DXF file, which is not read. Convert it with Blender: import it (add-on AutoCAD DXF), and export PLY "
               "or OBJ.";
    return NULL;
}

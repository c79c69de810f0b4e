// SPDX-License-Identifier: Apache-2.0
/* vdb_write: small volumes that the project makes itself, for its example and its tests. */
#include "io/vdb/archive.h"

#include <sstream>

#include <openvdb/openvdb.h>
#include <openvdb/io/Compression.h>

namespace vdb = openvdb;
using shim::fault;

namespace {

vdb::GridClass class_for(vdb_class c)
{
    switch (c) {
    case VDB_LEVEL_SET:
        return vdb::GRID_LEVEL_SET;
    case VDB_FOG:
        return vdb::GRID_FOG_VOLUME;
    case VDB_STAGGERED:
        return vdb::GRID_STAGGERED;
    default:
        return vdb::GRID_UNKNOWN;
    }
}

/* Tree levels, from the leaves: 0 voxels, 1 cubes of 8, 2 of 128, 3 of 4096. */
vdb::Index level_of(int32_t side)
{
    switch (side) {
    case 8:
        return 1;
    case 128:
        return 2;
    case 4096:
        return 3;
    default:
        throw fault(ERROR_INPUT_UNSUPPORTED, "a tile has a side of 8, 128 or 4096 voxels");
    }
}

/* The library creates the empty grid: constructing it here would instantiate its templates, which takes
 * minutes to compile. */
template <typename Grid> vdb::GridBase::Ptr build(const vdb_draft &draft)
{
    typedef typename Grid::ValueType value;
    vdb::GridBase::Ptr grid = vdb::GridBase::createGrid(Grid::gridType());
    auto &tree = vdb::StaticPtrCast<Grid>(grid)->tree();
    tree.root().setBackground(value(draft.background), /*update child nodes*/ false);
    for (size_t i = 0; i < draft.voxel_count; i++) {
        vdb::Coord at(draft.voxels[i][0], draft.voxels[i][1], draft.voxels[i][2]);
        if (!draft.active || draft.active[i])
            tree.setValueOn(at, value(draft.values[i]));
        else
            tree.setValueOff(at, value(draft.values[i]));
    }
    for (size_t i = 0; i < draft.tile_count; i++) {
        const vdb_tile &tile = draft.tiles[i];
        tree.addTile(level_of(tile.side), vdb::Coord(tile.origin[0], tile.origin[1], tile.origin[2]),
                     value(tile.value), tile.active);
    }
    return grid;
}

vdb::math::Transform::Ptr transform_for(const double *index_to_world)
{
    if (!index_to_world) {
        const vdb::BBoxd box(vdb::Vec3d(0, 0, 0), vdb::Vec3d(100, 100, 100));
        return vdb::math::Transform::createFrustumTransform(box, /*taper*/ 0.5, /*depth*/ 100, /*voxel*/ 1);
    }
    vdb::math::Mat4d m;
    for (int row = 0; row < 4; row++)
        for (int column = 0; column < 4; column++) m(column, row) = index_to_world[4 * row + column];
    return vdb::math::Transform::createLinearTransform(m);
}

vdb::GridBase::Ptr build_any(const vdb_draft &draft)
{
    std::string type = draft.type;
    vdb::GridBase::Ptr grid;
    if (type == "float")
        grid = build<vdb::FloatGrid>(draft);
    else if (type == "double")
        grid = build<vdb::DoubleGrid>(draft);
    else if (type == "int32")
        grid = build<vdb::Int32Grid>(draft);
    else if (type == "int64")
        grid = build<vdb::Int64Grid>(draft);
    else if (type == "vec3d")
        grid = build<vdb::Vec3DGrid>(draft);
    else if (type == "vec3i")
        grid = build<vdb::Vec3IGrid>(draft);
    else if (type == "bool")
        grid = build<vdb::BoolGrid>(draft);
    else if (type == "vec3s")
        grid = build<vdb::Vec3SGrid>(draft);
    else
        throw fault(ERROR_INPUT_UNSUPPORTED, "grids of type " + type + " are not written");
    grid->setTransform(transform_for(draft.index_to_world));
    grid->setName(draft.name);
    grid->setGridClass(class_for(draft.grid_class));
    grid->setSaveFloatAsHalf(draft.half);
    return grid;
}

} // namespace

extern "C" bool vdb_write_grids(int fd, const vdb_draft *drafts, size_t count, vdb_layout layout,
                                bool compressed, error *e)
{
    return shim::guard(e, ERROR_INTERNAL, "a volume to write", [&] {
        vdb::initialize();
        vdb::GridCPtrVec grids;
        for (size_t i = 0; i < count; i++) grids.push_back(build_any(drafts[i]));
        shim::archive archive;
        archive.setCompression(compressed ? vdb::io::COMPRESS_ZIP | vdb::io::COMPRESS_ACTIVE_MASK
                                          : vdb::io::COMPRESS_NONE);
        shim::write_bytes(fd, archive.file_of(grids, layout == VDB_SEEKABLE));
    });
}

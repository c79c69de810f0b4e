// SPDX-License-Identifier: Apache-2.0
/* vdb_points: writes points grids of OpenVDB files. The library creates the empty grid, and leaves are
 * filled one by one. Constructing a grid or converting a whole grid here would instantiate these templates,
 * which takes minutes to compile. */
#include "io/vdb/archive.h"

#include <algorithm>
#include <cstdio>
#include <sstream>
#include <tuple>
#include <vector>

#include <openvdb/openvdb.h>
#include <openvdb/points/PointDataGrid.h>

namespace vdb = openvdb;
using shim::fault;

namespace {

typedef vdb::points::PointDataGrid grid;
typedef grid::TreeType::LeafNodeType leaf_node;
typedef vdb::points::AttributeSet::Descriptor descriptor;
typedef vdb::points::AttributeWriteHandle<vdb::Vec3f> vector_writer;
typedef vdb::math::Quat<float> quaternion;

const char grid_name[] = "points";

vdb::Vec3d vector_at(const double *values, size_t i)
{
    return vdb::Vec3d(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
}

vdb::math::Transform::Ptr transform_for(const vdb_points &p)
{
    vdb::Vec3d low(p.position[0], p.position[1], p.position[2]);
    for (size_t i = 0; i < p.count; i++)
        for (int k = 0; k < 3; k++) low[k] = std::min(low[k], p.position[3 * i + size_t(k)]);
    vdb::math::Transform::Ptr transform = vdb::math::Transform::createLinearTransform(p.voxel_size);
    transform->postTranslate(low);
    return transform;
}

/* The position of a point in the grid. */
struct place {
    vdb::Coord leaf;    /* its origin */
    vdb::Index voxel;   /* in the leaf */
    vdb::Index32 point; /* in the arrays */
    bool operator<(const place &other) const
    {
        return std::tie(leaf, voxel, point) < std::tie(other.leaf, other.voxel, other.point);
    }
};

std::vector<place> places_of(const vdb_points &p, const vdb::math::Transform &transform)
{
    std::vector<place> places(p.count);
    for (size_t i = 0; i < p.count; i++) {
        const vdb::Coord at = transform.worldToIndexCellCentered(vector_at(p.position, i));
        places[i] = {at & ~int(leaf_node::DIM - 1), leaf_node::coordToOffset(at), vdb::Index32(i)};
    }
    std::sort(places.begin(), places.end());
    return places;
}

const char *scalar_type(const vdb_point_values &v)
{
    return v.whole ? "int64" : v.is_double ? "double" : "float";
}

/* A vector of two components and a zero, or of the first three components. */
vdb::Vec3f vector_of(const vdb_point_values &v, size_t i)
{
    const double *at = v.values + size_t(v.components) * i;
    return vdb::Vec3f(float(at[0]), float(at[1]), v.components > 2 ? float(at[2]) : 0);
}

bool is_double(const vdb_point_values &v)
{
    return v.is_double && v.components == 3;
}

/* The type of an attribute. */
vdb::NamePair type_of(const vdb_point_values &v)
{
    const char *vector = is_double(v) ? "vec3d" : "vec3s";
    return vdb::NamePair(v.components > 1 ? vector : scalar_type(v), "null");
}

quaternion quaternion_at(const double *values, size_t i)
{
    const double *at = values + 4 * i;
    return quaternion(float(at[0]), float(at[1]), float(at[2]), float(at[3]));
}

/* The attributes of a leaf as they are added: each entry has one more than the entry before it. */
std::vector<descriptor::Ptr> attributes_of(const vdb_points &p)
{
    const vdb::NamePair vector("vec3s", "null");
    std::vector<descriptor::Ptr> made{descriptor::create(vector)};
    const auto append = [&](const char *name, const vdb::NamePair &type) {
        made.push_back(made.back()->duplicateAppend(name, type));
    };
    append("N", vector);
    append("pscale", vdb::NamePair("float", "null"));
    append("id", vdb::NamePair("int64", "null"));
    if (p.velocity) append("v", vector);
    if (p.orient) append("orient", vdb::NamePair(vdb::typeNameAsString<quaternion>(), "null"));
    for (size_t k = 0; k < p.value_count; k++) append(p.values[k].name, type_of(p.values[k]));
    return made;
}

/* Sets the values of a leaf. A value that all points of the leaf share is stored once. */
template <typename Writer, typename Value>
void fill(leaf_node &leaf, const char *name, const place *first, size_t count, const Value &value_of)
{
    Writer writer(leaf.attributeArray(name));
    for (size_t n = 0; n < count; n++) writer.set(vdb::Index(n), value_of(first[n]));
    writer.compact();
}

void fill_leaf(leaf_node &leaf, std::vector<descriptor::Ptr> &attributes, const vdb_points &p,
               const vdb::math::Transform &transform, const place *first, size_t count)
{
    leaf.initializeAttributes(attributes[0], vdb::Index(count));
    for (size_t n = 1; n < attributes.size(); n++) leaf.appendAttribute(*attributes[n - 1], attributes[n], n);
    /* per voxel: the index of its last point plus 1 */
    std::vector<leaf_node::ValueType> ends(leaf_node::SIZE, 0);
    for (size_t n = 0; n < count; n++) ends[first[n].voxel] = vdb::Index32(n + 1);
    for (size_t v = 1; v < ends.size(); v++) ends[v] = std::max(ends[v], ends[v - 1]);
    leaf.setOffsets(ends);
    fill<vector_writer>(leaf, "P", first, count, [&](const place &at) {
        const vdb::Coord voxel = leaf.offsetToGlobalCoord(at.voxel);
        return vdb::Vec3f(transform.worldToIndex(vector_at(p.position, at.point)) - voxel.asVec3d());
    });
    const auto vectors = [&](const char *name, const double *values) {
        fill<vector_writer>(leaf, name, first, count,
                            [&](const place &at) { return vdb::Vec3f(vector_at(values, at.point)); });
    };
    vectors("N", p.normal);
    if (p.velocity) vectors("v", p.velocity);
    if (p.orient)
        fill<vdb::points::AttributeWriteHandle<quaternion>>(
            leaf, "orient", first, count, [&](const place &at) { return quaternion_at(p.orient, at.point); });
    fill<vdb::points::AttributeWriteHandle<float>>(
        leaf, "pscale", first, count, [&](const place &at) { return float(0.5 * p.spacing[at.point]); });
    fill<vdb::points::AttributeWriteHandle<int64_t>>(
        leaf, "id", first, count, [&](const place &at) { return int64_t(p.id ? p.id[at.point] : at.point); });
    for (size_t k = 0; k < p.value_count; k++) {
        const vdb_point_values &v = p.values[k];
        if (is_double(v))
            fill<vdb::points::AttributeWriteHandle<vdb::Vec3d>>(
                leaf, v.name, first, count, [&](const place &at) { return vector_at(v.values, at.point); });
        else if (v.components > 1)
            fill<vector_writer>(leaf, v.name, first, count,
                                [&](const place &at) { return vector_of(v, at.point); });
        else if (v.whole)
            fill<vdb::points::AttributeWriteHandle<int64_t>>(
                leaf, v.name, first, count, [&](const place &at) { return int64_t(v.values[at.point]); });
        else if (v.is_double)
            fill<vdb::points::AttributeWriteHandle<double>>(
                leaf, v.name, first, count, [&](const place &at) { return v.values[at.point]; });
        else
            fill<vdb::points::AttributeWriteHandle<float>>(
                leaf, v.name, first, count, [&](const place &at) { return float(v.values[at.point]); });
    }
}

vdb::GridBase::Ptr build(const vdb_points &p)
{
    const vdb::math::Transform::Ptr transform = transform_for(p);
    const std::vector<place> places = places_of(p, *transform);
    std::vector<descriptor::Ptr> attributes = attributes_of(p);
    vdb::GridBase::Ptr made = vdb::GridBase::createGrid(grid::gridType());
    auto &tree = vdb::StaticPtrCast<grid>(made)->tree();
    for (size_t first = 0, end; first < places.size(); first = end) {
        for (end = first; end < places.size() && places[end].leaf == places[first].leaf; end++) {
        }
        fill_leaf(*tree.touchLeaf(places[first].leaf), attributes, p, *transform, &places[first],
                  end - first);
    }
    made->setTransform(transform);
    made->setName(grid_name);
    return made;
}

} // namespace

extern "C" bool vdb_write_points(FILE *file, const vdb_points *points, error *e)
{
    return shim::guard(e, ERROR_INTERNAL, "a points grid to write", [&] {
        vdb::initialize();
        shim::archive archive;
        archive.setCompression(vdb::io::COMPRESS_ZIP | vdb::io::COMPRESS_ACTIVE_MASK);
        const std::string bytes = archive.file_of({build(*points)}, true);
        if (std::fwrite(bytes.data(), 1, bytes.size(), file) != bytes.size() || std::fflush(file) != 0)
            throw fault(error_code_of_errno(errno),
                        std::string("cannot be written: ") + std::strerror(errno));
    });
}

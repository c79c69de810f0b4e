// SPDX-License-Identifier: Apache-2.0
/* vdb_points_reader: reads a points grid with OpenVDB and compares it with the points. It uses the library's
 * reader and shares no code with the writer (io/vdb/vdb_points.cc). */
#include "vdb_points_reader.h"

#include <algorithm>
#include <cstring>
#include <sstream>
#include <unordered_map>
#include <vector>

#include <sys/stat.h>
#include <unistd.h>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointDataGrid.h>

#include "io/vdb/shim.h"

namespace vdb = openvdb;
using shim::fault;

namespace {

typedef vdb::points::PointDataGrid grid;
typedef grid::TreeType::LeafNodeType leaf_node;
typedef vdb::math::Quat<float> quaternion;

/* In voxels: a float's rounding at half a voxel is a thirtieth of it. */
const double place_tolerance = 1e-6;

vdb::Vec3d vector_at(const double *values, size_t i)
{
    return vdb::Vec3d(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
}

/* A vector of two components and a zero, or of three components. */
vdb::Vec3f vector_of(const vdb_point_values &v, size_t i)
{
    const double *at = v.values + size_t(v.components) * i;
    return vdb::Vec3f(float(at[0]), float(at[1]), v.components > 2 ? float(at[2]) : 0);
}

bool is_double(const vdb_point_values &v)
{
    return v.is_double && v.components == 3;
}

quaternion quaternion_at(const double *values, size_t i)
{
    const double *at = values + 4 * i;
    return quaternion(float(at[0]), float(at[1]), float(at[2]), float(at[3]));
}

std::string read_all(int fd)
{
    struct stat info;
    if (::fstat(fd, &info) != 0) throw fault(ERROR_INTERNAL, "the file cannot be read");
    std::string bytes(size_t(info.st_size), '\0');
    for (size_t done = 0; done < bytes.size();) {
        ssize_t n = ::pread(fd, &bytes[done], bytes.size() - done, off_t(done));
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0)
            throw fault(error_code_of_errno(n < 0 ? errno : 0),
                        std::string("the file cannot be read: ") + std::strerror(errno));
        done += size_t(n);
    }
    return bytes;
}

fault differs(const char *what, size_t i)
{
    return fault(ERROR_INTERNAL, std::string("the ") + what + " of point " + std::to_string(i) +
                                     " differs from the written data");
}

/* Which point has an id; the number of all: none. */
class finder {
public:
    explicit finder(const vdb_points &p) : count(p.count), given(p.id)
    {
        for (size_t i = 0; given && i < count; i++) of_id[given[i]] = i;
    }
    size_t find(int64_t id) const
    {
        if (!given) return id >= 0 && size_t(id) < count ? size_t(id) : count;
        const auto found = of_id.find(id);
        return found == of_id.end() ? count : found->second;
    }

private:
    size_t count;
    const uint32_t *given;
    std::unordered_map<int64_t, size_t> of_id;
};

/* One attribute of a leaf's points, which have been found. */
void verify_values(const leaf_node &leaf, const vdb_point_values &v, const finder &where)
{
    const auto &array = leaf.constAttributeArray(v.name);
    vdb::points::AttributeHandle<int64_t> id(leaf.constAttributeArray("id"));
    vdb::points::AttributeHandle<vdb::Vec3f>::Ptr vector;
    vdb::points::AttributeHandle<vdb::Vec3d>::Ptr exact;
    vdb::points::AttributeHandle<int64_t>::Ptr whole;
    vdb::points::AttributeHandle<float>::Ptr real;
    if (is_double(v))
        exact = vdb::points::AttributeHandle<vdb::Vec3d>::create(array);
    else if (v.components > 1)
        vector = vdb::points::AttributeHandle<vdb::Vec3f>::create(array);
    else if (v.whole)
        whole = vdb::points::AttributeHandle<int64_t>::create(array);
    else
        real = vdb::points::AttributeHandle<float>::create(array);
    for (auto point = leaf.beginIndexOn(); point; ++point) {
        const size_t i = where.find(id.get(*point));
        const bool same = exact    ? exact->get(*point) == vector_at(v.values, i)
                          : vector ? vector->get(*point) == vector_of(v, i)
                          : whole  ? whole->get(*point) == int64_t(v.values[i])
                                   : real->get(*point) == float(v.values[i]);
        if (!same) throw differs(v.name, i);
    }
}

/* Compares a leaf's points, and marks them as seen. */
void verify_leaf(const leaf_node &leaf, const vdb::math::Transform &transform, const vdb_points &p,
                 const finder &where, std::vector<bool> &seen)
{
    vdb::points::AttributeHandle<vdb::Vec3f> offset(leaf.constAttributeArray("P"));
    vdb::points::AttributeHandle<vdb::Vec3f> normal(leaf.constAttributeArray("N"));
    vdb::points::AttributeHandle<float> scale(leaf.constAttributeArray("pscale"));
    vdb::points::AttributeHandle<int64_t> id(leaf.constAttributeArray("id"));
    vdb::points::AttributeHandle<vdb::Vec3f>::Ptr velocity;
    if (p.velocity)
        velocity = vdb::points::AttributeHandle<vdb::Vec3f>::create(leaf.constAttributeArray("v"));
    vdb::points::AttributeHandle<quaternion>::Ptr orient;
    if (p.orient)
        orient = vdb::points::AttributeHandle<quaternion>::create(leaf.constAttributeArray("orient"));
    for (auto point = leaf.beginIndexOn(); point; ++point) {
        const size_t i = where.find(id.get(*point));
        if (i == p.count || seen[i]) throw fault(ERROR_INTERNAL, "an id is repeated, or was not written");
        seen[i] = true;
        const vdb::Vec3d world =
            transform.indexToWorld(vdb::Vec3d(offset.get(*point)) + point.getCoord().asVec3d());
        for (int k = 0; k < 3; k++) {
            const size_t at = 3 * i + size_t(k);
            const double slack = place_tolerance * p.voxel_size + 1e-15 * std::abs(p.position[at]);
            if (!(std::abs(world[k] - p.position[at]) <= slack)) throw differs("position", i);
            if (normal.get(*point)[k] != float(p.normal[at])) throw differs("normal", i);
            if (velocity && velocity->get(*point)[k] != float(p.velocity[at])) throw differs("velocity", i);
        }
        if (orient && !(orient->get(*point) == quaternion_at(p.orient, i))) throw differs("orient", i);
        if (scale.get(*point) != float(0.5 * p.spacing[i])) throw differs("pscale", i);
    }
    for (size_t k = 0; k < p.value_count; k++) verify_values(leaf, p.values[k], where);
}

} // namespace

extern "C" bool vdb_points_compare(int fd, const vdb_points *points, error *e)
{
    return shim::guard(e, ERROR_INTERNAL, "the points grid", [&] {
        vdb::initialize();
        std::istringstream in(read_all(fd), std::ios_base::binary);
        in.exceptions(std::ios_base::failbit | std::ios_base::badbit | std::ios_base::eofbit);
        const vdb::GridPtrVecPtr grids = vdb::io::Stream(in, false).getGrids();
        if (grids->size() != 1 || !(*grids)[0]->isType<grid>() || (*grids)[0]->getName() != "points")
            throw fault(ERROR_INTERNAL, "the file does not contain exactly one points grid");
        const grid::Ptr found = vdb::gridPtrCast<grid>((*grids)[0]);
        std::vector<bool> seen(points->count, false);
        const finder where(*points);
        for (auto leaf = found->tree().cbeginLeaf(); leaf; ++leaf)
            verify_leaf(*leaf, found->transform(), *points, where, seen);
        if (std::find(seen.begin(), seen.end(), false) != seen.end())
            throw fault(ERROR_INTERNAL, "the points grid does not contain all points");
    });
}

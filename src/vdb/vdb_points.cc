/* Points grids. A unit of its own: the library's points take long to compile. */
#include "vdb/archive.h"

#include <cstdio>
#include <sstream>
#include <unordered_map>
#include <vector>

#include <sys/stat.h>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointAttribute.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>

namespace vdb = openvdb;
using shim::fault;

namespace {

typedef vdb::points::PointDataGrid grid;
typedef vdb::points::TypedAttributeArray<vdb::Vec3f> normal_array;
typedef vdb::points::TypedAttributeArray<vdb::Vec3f> velocity_array;
typedef vdb::points::TypedAttributeArray<float> scale_array;
typedef vdb::points::TypedAttributeArray<int64_t> id_array;

const char grid_name[] = "points";

/* Places farther from where they should be than this, in voxels, are not those that were written: a float's
 * rounding at half a voxel is a thirtieth of it. */
const double place_tolerance = 1e-6;

/* What the library's conversion reads points from. */
template <typename Value> class source {
public:
    typedef Value value_type;
    typedef Value PosType;
    typedef Value ValueType;
    source(const double *values, size_t count, double factor) : values(values), count(count), factor(factor)
    {
    }
    size_t size() const { return count; }
    void getPos(size_t i, Value &out) const { get(out, i); }
    template <typename Type> void get(Type &out, size_t i, vdb::Index = 0) const { take(out, i); }

private:
    template <typename T> void take(vdb::math::Vec3<T> &out, size_t i) const
    {
        for (int k = 0; k < 3; k++) out[k] = T(factor * values[3 * i + size_t(k)]);
    }
    void take(float &out, size_t i) const { out = float(factor * values[i]); }
    const double *values;
    size_t count;
    double factor;
};

/* The ids that are given, or the places 0, 1, 2, ... */
class ids {
public:
    typedef int64_t value_type;
    typedef int64_t ValueType;
    explicit ids(const vdb_points &p) : count(p.count), given(p.id) {}
    size_t size() const { return count; }
    void get(int64_t &out, size_t i, vdb::Index = 0) const { out = given ? given[i] : int64_t(i); }

private:
    size_t count;
    const uint32_t *given;
};

vdb::math::Transform::Ptr transform_for(const vdb_points &p)
{
    vdb::Vec3d low(p.position[0], p.position[1], p.position[2]);
    for (size_t i = 0; i < p.count; i++)
        for (int k = 0; k < 3; k++) low[k] = std::min(low[k], p.position[3 * i + size_t(k)]);
    vdb::math::Transform::Ptr transform = vdb::math::Transform::createLinearTransform(p.voxel_size);
    transform->postTranslate(low);
    return transform;
}

grid::Ptr build(const vdb_points &p)
{
    const source<vdb::Vec3d> positions(p.position, p.count, 1);
    const vdb::math::Transform::Ptr transform = transform_for(p);
    auto index = vdb::tools::createPointIndexGrid<vdb::tools::PointIndexGrid>(positions, *transform);
    grid::Ptr made =
        vdb::points::createPointDataGrid<vdb::points::NullCodec, grid>(*index, positions, *transform);
    auto &tree = made->tree();
    const auto &order = index->tree();
    vdb::points::appendAttribute(tree, "N", normal_array::attributeType());
    vdb::points::appendAttribute(tree, "pscale", scale_array::attributeType());
    vdb::points::appendAttribute(tree, "id", id_array::attributeType());
    vdb::points::populateAttribute(tree, order, "N", source<vdb::Vec3f>(p.normal, p.count, 1));
    vdb::points::populateAttribute(tree, order, "pscale", source<float>(p.spacing, p.count, 0.5));
    vdb::points::populateAttribute(tree, order, "id", ids(p));
    if (p.velocity) {
        vdb::points::appendAttribute(tree, "v", velocity_array::attributeType());
        vdb::points::populateAttribute(tree, order, "v", source<vdb::Vec3f>(p.velocity, p.count, 1));
    }
    made->setName(grid_name);
    return made;
}

/* Fowler, Noll and Vo's hash (FNV-1a, 64 bits). */
uint64_t hash_of(const std::string &bytes, uint64_t state)
{
    for (unsigned char byte : bytes) state = (state ^ byte) * 1099511628211u;
    return state;
}

/* Puts a hash of the rest in the place of the format's identifier. */
void identify(std::string &bytes, const std::string &random)
{
    const size_t at = bytes.find(random);
    if (at == std::string::npos) throw fault(ERROR_INTERNAL, "the file has no identifier");
    bytes.replace(at, random.size(), random.size(), '0');
    const uint64_t a = hash_of(bytes, 14695981039346656037u), b = hash_of(bytes, a);
    char text[37];
    std::snprintf(text, sizeof text, "%08x-%04x-%04x-%04x-%012llx", unsigned(a >> 32),
                  unsigned(a >> 16 & 0xffff), unsigned(a & 0xffff), unsigned(b >> 48),
                  static_cast<unsigned long long>(b & 0xffffffffffff));
    if (random.size() == sizeof text - 1) bytes.replace(at, random.size(), text);
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
    return fault(ERROR_INTERNAL,
                 std::string("the ") + what + " of point " + std::to_string(i) + " is not what was written");
}

/* Which point has an id; the number of all: none. */
class places {
public:
    explicit places(const vdb_points &p) : count(p.count), given(p.id)
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

/* Of a leaf's points; notes those that are seen. */
void verify_leaf(const grid::TreeType::LeafNodeType &leaf, const vdb::math::Transform &transform,
                 const vdb_points &p, const places &where, std::vector<bool> &seen)
{
    vdb::points::AttributeHandle<vdb::Vec3f> offset(leaf.constAttributeArray("P"));
    vdb::points::AttributeHandle<vdb::Vec3f> normal(leaf.constAttributeArray("N"));
    vdb::points::AttributeHandle<float> scale(leaf.constAttributeArray("pscale"));
    vdb::points::AttributeHandle<int64_t> id(leaf.constAttributeArray("id"));
    vdb::points::AttributeHandle<vdb::Vec3f>::Ptr velocity;
    if (p.velocity)
        velocity = vdb::points::AttributeHandle<vdb::Vec3f>::create(leaf.constAttributeArray("v"));
    for (auto point = leaf.beginIndexOn(); point; ++point) {
        const size_t i = where.find(id.get(*point));
        if (i == p.count || seen[i])
            throw fault(ERROR_INTERNAL, "an id stands twice, or is none that was written");
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
        if (scale.get(*point) != float(0.5 * p.spacing[i])) throw differs("pscale", i);
    }
}

} // namespace

extern "C" bool vdb_write_points(int fd, const vdb_points *points, error *e)
{
    return shim::guard(e, ERROR_INTERNAL, "a points grid to write", [&] {
        vdb::initialize();
        shim::archive archive;
        archive.setCompression(vdb::io::COMPRESS_ZIP | vdb::io::COMPRESS_ACTIVE_MASK);
        std::ostringstream out(std::ios_base::binary);
        archive.write_all(out, {build(*points)}, true);
        std::string bytes = out.str();
        identify(bytes, archive.getUniqueTag());
        shim::write_bytes(fd, bytes);
    });
}

extern "C" bool vdb_verify_points(int fd, const vdb_points *points, error *e)
{
    return shim::guard(e, ERROR_INTERNAL, "the points grid", [&] {
        vdb::initialize();
        std::istringstream in(read_all(fd), std::ios_base::binary);
        in.exceptions(std::ios_base::failbit | std::ios_base::badbit | std::ios_base::eofbit);
        const vdb::GridPtrVecPtr grids = vdb::io::Stream(in, false).getGrids();
        if (grids->size() != 1 || !(*grids)[0]->isType<grid>() || (*grids)[0]->getName() != grid_name)
            throw fault(ERROR_INTERNAL, "the file does not hold one points grid");
        const grid::Ptr found = vdb::gridPtrCast<grid>((*grids)[0]);
        std::vector<bool> seen(points->count, false);
        const places where(*points);
        if (vdb::points::pointCount(found->tree()) != points->count)
            throw fault(ERROR_INTERNAL, "the points grid does not hold all points");
        for (auto leaf = found->tree().cbeginLeaf(); leaf; ++leaf)
            verify_leaf(*leaf, found->transform(), *points, where, seen);
    });
}

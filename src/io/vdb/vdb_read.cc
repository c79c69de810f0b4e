// SPDX-License-Identifier: Apache-2.0
/* vdb_read: reading of grids and their metadata from OpenVDB files, with the messages about files that cannot
 * be read. The order of the parts of a file is that of openvdb::io::Stream and io::File, which this unit
 * walks itself (through the base class of both) for three reasons: a grid that is not requested is skipped if
 * the file has offsets, lengths are checked before they are believed, and the tree's topology can be
 * compared with the memory limit before its values are read. */
#include "io/vdb/shim.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <istream>
#include <sstream>
#include <streambuf>
#include <vector>

#include <dlfcn.h>
#include <sys/stat.h>
#include <unistd.h>

#include <openvdb/openvdb.h>
#include <openvdb/io/Archive.h>
#include <openvdb/io/Compression.h>
#include <openvdb/io/DelayedLoadMetadata.h>
#include <openvdb/io/io.h>
#include <openvdb/tools/SignedFloodFill.h>

namespace vdb = openvdb;
using shim::fault;

namespace {

const char *const half_suffix = "_HalfFloat";
const char name_separator = 0x1e; /* OpenVDB writes equal names as NAME 0x1e NUMBER */

/* Maximum difference of a format version from the newest supported one: versions differ in features that few
 * files use. A larger difference means damage. */
const uint32_t newer_versions = 16;
/* Maximum length of a string. A grid has a few short strings (names, types). */
const uint32_t longest_string = 1u << 16;
/* Minimum size of a grid in a file. The count of grids is checked against it. */
const int64_t smallest_grid = 40;
/* Largest accepted condition number: beyond it the inverse of the transform loses more than half of the
 * digits of a double. */
const double largest_condition = 1e8;

std::string format(const char *text, unsigned long long a, unsigned long long b)
{
    char line[256];
    std::snprintf(line, sizeof line, text, a, b);
    return line;
}

/* The bytes of a descriptor. It never moves the descriptor's own offset. */
class fd_buffer : public std::streambuf {
public:
    fd_buffer(int fd, int64_t size) : fd_(fd), size_(size), next_(0), block_(1 << 16) {}

    /* Checks the length before the values of a node: positive for packed bytes, minus the number of bytes
     * for values that are not packed. */
    void check_packed(size_t bytes)
    {
        int64_t length, here = next_ - (egptr() - gptr());
        if (egptr() - gptr() >= ssize_t(sizeof length))
            std::memcpy(&length, gptr(), sizeof length);
        else if (pread(fd_, &length, sizeof length, off_t(here)) != ssize_t(sizeof length))
            return; /* the library reports this error */
        if (length > 0 ? length > size_ - here : uint64_t(0) - uint64_t(length) != bytes)
            throw fault(ERROR_INPUT_DAMAGED,
                        "the file has values whose number differs from that of their node: it is damaged. "
                        "Save it again.");
    }

protected:
    int_type underflow() override
    {
        if (gptr() < egptr()) return traits_type::to_int_type(*gptr());
        size_t got = fetch(block_.data(), block_.size());
        if (got == 0) return traits_type::eof();
        setg(block_.data(), block_.data(), block_.data() + got);
        return traits_type::to_int_type(*gptr());
    }
    std::streamsize xsgetn(char *to, std::streamsize count) override
    {
        std::streamsize done = 0;
        while (done < count) {
            std::streamsize held = egptr() - gptr(), wanted = count - done;
            if (held > 0) {
                std::streamsize part = held < wanted ? held : wanted;
                std::memcpy(to + done, gptr(), size_t(part));
                gbump(int(part));
                done += part;
            } else if (wanted >= std::streamsize(block_.size())) {
                size_t got = fetch(to + done, size_t(wanted));
                if (got == 0) break;
                done += std::streamsize(got);
            } else if (underflow() == traits_type::eof()) {
                break;
            }
        }
        return done;
    }
    pos_type seekoff(off_type off, std::ios_base::seekdir way, std::ios_base::openmode) override
    {
        int64_t here = next_ - (egptr() - gptr());
        int64_t base = way == std::ios_base::beg ? 0 : way == std::ios_base::cur ? here : size_, to;
        if (__builtin_add_overflow(base, int64_t(off), &to) || to < 0 || to > size_)
            return pos_type(off_type(-1));
        if (to == here) return pos_type(to);
        setg(nullptr, nullptr, nullptr);
        next_ = to;
        return pos_type(to);
    }
    pos_type seekpos(pos_type to, std::ios_base::openmode mode) override
    {
        return seekoff(off_type(to), std::ios_base::beg, mode);
    }

private:
    size_t fetch(char *to, size_t count)
    {
        ssize_t got;
        do got = pread(fd_, to, count, off_t(next_));
        while (got < 0 && errno == EINTR);
        if (got < 0)
            throw fault(ERROR_INPUT_DAMAGED, std::string("the file cannot be read: ") + std::strerror(errno));
        next_ += got;
        return size_t(got);
    }
    int fd_;
    int64_t size_, next_;
    std::vector<char> block_;
};

/* The head of a grid. */
struct descriptor {
    std::string unique_name, name, type, parent;
    bool half = false;
    int64_t end = 0; /* offset of the next grid; 0 in files without offsets */
};

class reader : public vdb::io::Archive {
public:
    explicit reader(int fd) : size_(size_of(fd)), buffer_(fd, size_), in_(&buffer_)
    {
        check_magic(fd);
        in_.exceptions(std::ios_base::badbit | std::ios_base::failbit | std::ios_base::eofbit);
        readHeader(in_);
        metadata_.reset(new vdb::io::StreamMetadata);
        vdb::io::setStreamMetadataPtr(in_, metadata_, /*transfer=*/false);
        vdb::io::setVersion(in_, libraryVersion(), fileVersion());
        vdb::io::setDataCompression(in_, compression());
        vdb::MetaMap ignored;
        read_entries(ignored);
        count_ = readGridCount(in_);
        if (count_ < 0 || count_ > size_ / smallest_grid)
            throw fault(ERROR_INPUT_DAMAGED,
                        format("states %llu grids in %llu bytes: it is damaged. Save it again.",
                               (unsigned long long)count_, (unsigned long long)size_));
    }
    int32_t count() const { return count_; }

    descriptor read_descriptor()
    {
        descriptor d;
        d.unique_name = read_string();
        d.name = d.unique_name.substr(0, d.unique_name.find(name_separator));
        if (d.name.size() >= VDB_NAME_SIZE || d.name.find('\0') != std::string::npos)
            throw fault(
                ERROR_INPUT_DAMAGED,
                "the file has a grid name that is too long or not text: it is damaged. Save it again.");
        d.type = read_string();
        size_t stem = d.type.size() - std::min(d.type.size(), std::strlen(half_suffix));
        if (d.type.compare(stem, std::string::npos, half_suffix) == 0) {
            d.half = true;
            d.type.resize(stem);
        }
        d.parent = read_string();
        int64_t offsets[3];
        in_.read(reinterpret_cast<char *>(offsets), sizeof offsets);
        if (inputHasGridOffsets()) {
            d.end = offsets[2];
            if (d.end < int64_t(in_.tellg()) || d.end > size_)
                throw fault(
                    ERROR_INPUT_DAMAGED,
                    "grid \"" + d.name + "\": " +
                        format("a grid ends at byte %llu, but the file has %llu bytes: it is truncated or "
                               "damaged. Copy or save it again.",
                               (unsigned long long)d.end, (unsigned long long)size_));
        }
        return d;
    }

    vdb::GridBase::Ptr create(const descriptor &d)
    {
        if (!vdb::GridBase::isRegistered(d.type)) return vdb::GridBase::Ptr();
        vdb::GridBase::Ptr grid = vdb::GridBase::createGrid(d.type);
        grid->setSaveFloatAsHalf(d.half);
        return grid;
    }

    /* Reads the part of a grid that does not depend on its type, up to its transform. */
    void read_metadata(vdb::GridBase &grid)
    {
        current_.reset(new vdb::io::StreamMetadata(*metadata_));
        current_->setHalfFloat(grid.saveFloatAsHalf());
        vdb::io::setStreamMetadataPtr(in_, current_, /*transfer=*/false);
        vdb::io::setGridClass(in_, vdb::GRID_UNKNOWN);
        vdb::io::setGridBackgroundValuePtr(in_, nullptr);
        readGridCompression(in_);
        grid.clearMetadata();
        read_entries(grid);
        current_->gridMetadata() = static_cast<vdb::MetaMap &>(grid);
        vdb::io::setGridClass(in_, grid.getGridClass());
    }

    void read_transform(vdb::GridBase &grid)
    {
        check_transform();
        try {
            grid.readTransform(in_);
        } catch (const vdb::ArithmeticError &x) {
            throw fault(ERROR_INPUT_UNSUPPORTED,
                        std::string("its transform cannot be inverted (") + x.what() + ")");
        }
    }

    void skip(const descriptor &d, vdb::GridBase::Ptr grid)
    {
        if (inputHasGridOffsets()) {
            in_.seekg(d.end);
            return;
        }
        read_transform(*grid);
        if (d.parent.empty()) {
            grid->readTopology(in_);
            grid->readBuffers(in_);
        }
    }

    bool is_newer() const { return fileVersion() > vdb::OPENVDB_FILE_VERSION; }
    bool has_offsets() const { return inputHasGridOffsets(); }
    std::istream &stream() { return in_; }

private:
    static int64_t size_of(int fd)
    {
        struct stat st;
        if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode))
            throw fault(ERROR_INPUT_DAMAGED, "the file is not a regular file");
        return st.st_size;
    }

    void check_magic(int fd)
    {
        char head[64] = {0};
        ssize_t got = pread(fd, head, sizeof head - 1, 0);
        if (got < 0)
            throw fault(ERROR_INPUT_DAMAGED, std::string("the file cannot be read: ") + std::strerror(errno));
        if (got == 0) throw fault(ERROR_INPUT_DAMAGED, "the file is empty (0 bytes): copy or save it again");
        if (std::strncmp(head, "version https://git-lfs", 23) == 0)
            throw fault(ERROR_INPUT_DAMAGED,
                        "the file is a Git LFS pointer instead of the volume: run `git lfs pull` in its "
                        "repository");
        if (std::strncmp(head, "NanoVDB", 7) == 0)
            throw fault(ERROR_INPUT_UNSUPPORTED,
                        "the file is a NanoVDB file: convert it (`nanovdb_convert FILE.nvdb FILE.vdb`)");
        int64_t magic;
        uint32_t version;
        std::memcpy(&magic, head, sizeof magic);
        std::memcpy(&version, head + sizeof magic, sizeof version);
        if (got < ssize_t(sizeof magic) || magic != vdb::OPENVDB_MAGIC)
            throw fault(ERROR_INPUT_DAMAGED,
                        "the file is not an OpenVDB file (by its first bytes): use surface.volume for NRRD, "
                        "NIfTI and MetaImage files, and surface.mesh for meshes");
        if (got < ssize_t(sizeof magic + sizeof version))
            throw fault(ERROR_INPUT_DAMAGED,
                        "the file is truncated after its first bytes: copy or save it again");
        /* newer versions are read as far as they agree, as the library does */
        if (version < vdb::OPENVDB_FILE_VERSION_GRID_INSTANCING)
            throw fault(
                ERROR_INPUT_UNSUPPORTED,
                format("the file has format version %llu, older than the first supported version %llu: save "
                       "it again with a current OpenVDB",
                       version, uint32_t(vdb::OPENVDB_FILE_VERSION_GRID_INSTANCING)));
        if (version > vdb::OPENVDB_FILE_VERSION + newer_versions)
            throw fault(
                ERROR_INPUT_UNSUPPORTED,
                format("the file has format version %llu, far newer than version %llu of the installed "
                       "OpenVDB: it is damaged, or requires a hexad built with a newer OpenVDB",
                       version, vdb::OPENVDB_FILE_VERSION));
    }

    /* Reads a block of metadata, value by value. The library would allocate memory according to the lengths
     * in the file, but read each value by the length of its type, and would then be at a wrong offset.
     * Entries for delayed loading are omitted. */
    void read_entries(vdb::MetaMap &to)
    {
        int32_t entries = read_int<int32_t>();
        if (entries < 0)
            throw fault(ERROR_INPUT_DAMAGED, "the file has a negative count of metadata: it is damaged");
        for (int32_t i = 0; i < entries; i++) {
            std::string name = read_string(), type = read_string();
            uint32_t bytes = read_int<uint32_t>();
            int64_t here = in_.tellg();
            if (bytes > size_ - here)
                throw fault(
                    ERROR_INPUT_DAMAGED,
                    format(
                        "the file has metadata of %llu bytes, but only %llu bytes are left: it is truncated "
                        "or damaged. Copy or save it again.",
                        bytes, (unsigned long long)(size_ - here)));
            if (!vdb::Metadata::isRegisteredType(type) ||
                type == vdb::io::DelayedLoadMetadata::staticTypeName()) {
                in_.seekg(here + bytes);
                continue;
            }
            std::string text(reinterpret_cast<const char *>(&bytes), sizeof bytes);
            text.resize(sizeof bytes + bytes);
            in_.read(&text[sizeof bytes], std::streamsize(bytes));
            std::istringstream alone(text);
            alone.exceptions(in_.exceptions());
            vdb::Metadata::Ptr value = vdb::Metadata::createMetadata(type);
            value->read(alone);
            to.insertMeta(name, *value);
        }
    }

    /* Checks the kind of the transform, and that of the map within a frustum: the library would follow
     * nested frustums to any depth. Restores the position of the stream. */
    void check_transform()
    {
        const std::string frustum = vdb::math::NonlinearFrustumMap::mapType();
        std::streampos start = in_.tellg();
        if (read_string() == frustum) {
            bool old = fileVersion() < vdb::OPENVDB_FILE_VERSION_FLOAT_FRUSTUM_BBOX;
            size_t box = 6 * (old ? sizeof(int32_t) : sizeof(double));
            /* and skip taper and depth */
            in_.seekg(std::streamoff(box + 2 * sizeof(double)), std::ios_base::cur);
            if (read_string() == frustum)
                throw fault(ERROR_INPUT_DAMAGED,
                            "the file has a frustum within a frustum for a transform: it is damaged");
        }
        in_.seekg(start);
    }

    template <typename T> T read_int()
    {
        T value;
        in_.read(reinterpret_cast<char *>(&value), sizeof value);
        return value;
    }

    std::string read_string()
    {
        uint32_t length = read_int<uint32_t>();
        if (length > longest_string)
            throw fault(ERROR_INPUT_DAMAGED,
                        format("the file has a name of %llu bytes (more than %llu): it is damaged", length,
                               longest_string));
        std::string text(length, '\0');
        if (length) in_.read(&text[0], std::streamsize(length));
        return text;
    }

    int64_t size_;
    fd_buffer buffer_;
    /* The stream keeps the addresses of these two pointers: they live as long as it does. */
    vdb::io::StreamMetadata::Ptr metadata_, current_;
    std::istream in_;
    int32_t count_ = 0;
};

vdb_class class_of(const vdb::GridBase &grid)
{
    switch (grid.getGridClass()) {
    case vdb::GRID_LEVEL_SET:
        return VDB_LEVEL_SET;
    case vdb::GRID_FOG_VOLUME:
        return VDB_FOG;
    case vdb::GRID_STAGGERED:
        return VDB_STAGGERED;
    default:
        return VDB_UNKNOWN;
    }
}

/* "Tree_float_5_4_3" becomes "float"; a type of another form is returned unchanged. */
std::string value_type(const std::string &type)
{
    if (type.compare(0, 5, "Tree_") != 0) return type;
    size_t end = type.find('_', 5);
    return type.substr(5, end == std::string::npos ? end : end - 5);
}

bool is_scalar(const std::string &type)
{
    return type == vdb::FloatGrid::gridType() || type == vdb::DoubleGrid::gridType();
}

template <size_t N> void copy_text(char (&to)[N], const std::string &from)
{
    size_t n = std::min(from.size(), N - 1);
    std::memcpy(to, from.data(), n);
    to[n] = '\0';
}

template <typename T> T *array(size_t count)
{
    void *p = std::calloc(count ? count : 1, sizeof(T));
    if (!p) throw std::bad_alloc();
    return static_cast<T *>(p);
}

/* Returns the grid at `index`, or the parent with this name. The stream is then at its transform. */
vdb::GridBase::Ptr find(reader &file, size_t index, const std::string *parent, descriptor *d)
{
    for (int32_t i = 0; i < file.count(); i++) {
        *d = file.read_descriptor();
        bool wanted = parent ? d->unique_name == *parent : size_t(i) == index;
        vdb::GridBase::Ptr grid = file.create(*d);
        if (grid) file.read_metadata(*grid);
        if (wanted) return grid;
        if (!grid && !file.has_offsets())
            throw fault(ERROR_INPUT_UNSUPPORTED,
                        "grid \"" + d->name + "\" has the type " + value_type(d->type) +
                            ", which cannot be stepped over in a file without offsets");
        file.skip(*d, grid);
    }
    throw fault(ERROR_INPUT_DAMAGED, "refers to a grid that is missing: it is damaged. Save it again.");
}

void copy_transform(const vdb::GridBase &grid, double to[16])
{
    const vdb::math::Transform &transform = grid.transform();
    if (!transform.isLinear())
        throw fault(ERROR_INPUT_UNSUPPORTED,
                    "its transform is a " + transform.mapType() +
                        " (a frustum); only affine transforms are supported: resample it to one");
    vdb::math::Mat4d m;
    try {
        m = transform.baseMap()->getAffineMap()->getMat4();
    } catch (const vdb::ArithmeticError &x) {
        throw fault(ERROR_INPUT_UNSUPPORTED,
                    std::string("its transform cannot be inverted (") + x.what() + ")");
    }
    double size = 0;
    for (int row = 0; row < 4; row++)
        for (int column = 0; column < 4; column++) {
            double value = m(column, row); /* the library multiplies row vectors */
            if (!std::isfinite(value))
                throw fault(ERROR_INPUT_UNSUPPORTED, "its transform has values that are not finite");
            to[4 * row + column] = value;
            if (row < 3 && column < 3) size = std::max(size, std::fabs(value));
        }
    double det = m.getMat3().det();
    if (!(std::fabs(det) * largest_condition > size * size * size))
        throw fault(ERROR_INPUT_UNSUPPORTED, "its transform cannot be inverted: it is singular or nearly so");
}

/* Checks the position of a child of the root, which the library does not check. The positions of nodes below
 * are determined by their parents. */
void check_corner(const vdb::Coord &corner, int32_t side)
{
    for (int axis = 0; axis < 3; axis++)
        if (corner[axis] % side != 0)
            throw fault(ERROR_INPUT_DAMAGED,
                        "a node of its tree has an impossible position: it is damaged. Save it again.");
}

/* Checks the tree after its topology is read, before its values. */
template <typename Tree> void check_topology(const Tree &tree, size_t limit)
{
    const int32_t side = Tree::RootNodeType::ChildNodeType::DIM;
    for (auto child = tree.root().cbeginChildOn(); child; ++child) check_corner(child.getCoord(), side);
    for (auto tile = tree.root().cbeginValueAll(); tile; ++tile) check_corner(tile.getCoord(), side);
    typedef typename Tree::ValueType value;
    unsigned long long leaves = tree.leafCount();
    unsigned long long each = VDB_LEAF_VOXELS * (sizeof(value) + sizeof(float)) + 256;
    if (leaves > limit / each)
        throw fault(ERROR_LIMIT_MEMORY,
                    format("its %llu leaves require %llu MB", leaves, (leaves * each) >> 20) +
                        format(", above the limit of %llu MB: raise limits.memory_mb",
                               (unsigned long long)limit >> 20, 0));
}

template <typename Tree> void copy_leaves(const Tree &tree, vdb_grid *out)
{
    out->leaf_count = tree.leafCount();
    out->leaf_origin = reinterpret_cast<int32_t(*)[3]>(array<int32_t>(out->leaf_count * 3));
    out->leaf_values = array<float>(out->leaf_count * VDB_LEAF_VOXELS);
    out->leaf_active = array<uint64_t>(out->leaf_count * 8);
    size_t n = 0;
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf, ++n) {
        for (int axis = 0; axis < 3; axis++) out->leaf_origin[n][axis] = leaf->origin()[axis];
        const auto *values = leaf->buffer().data();
        if (!values) throw fault(ERROR_INPUT_DAMAGED, "a leaf of it has no values: it is damaged");
        float *to = out->leaf_values + n * VDB_LEAF_VOXELS;
        for (int i = 0; i < VDB_LEAF_VOXELS; i++) to[i] = float(double(values[i]) - out->zero);
        for (int word = 0; word < 8; word++)
            out->leaf_active[8 * n + size_t(word)] =
                leaf->valueMask().template getWord<uint64_t>(vdb::Index(word));
    }
}

template <typename Tree> void copy_tiles(const Tree &tree, size_t limit, vdb_grid *out)
{
    std::vector<vdb_tile> tiles;
    auto it = tree.cbeginValueAll();
    it.setMaxDepth(Tree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; it; ++it) {
        float value = float(double(*it) - out->zero);
        if (value == out->background) continue;
        vdb::CoordBBox box;
        it.getBoundingBox(box);
        vdb_tile tile = {{box.min()[0], box.min()[1], box.min()[2]},
                         box.max()[0] - box.min()[0] + 1,
                         value,
                         it.isValueOn()};
        tiles.push_back(tile);
        if (tiles.size() > limit / (4 * sizeof tile))
            throw fault(
                ERROR_LIMIT_MEMORY,
                format("its tiles, more than %llu, exceed the limit of %llu MB: raise limits.memory_mb",
                       tiles.size(), (unsigned long long)limit >> 20));
    }
    out->tile_count = tiles.size();
    out->tiles = array<vdb_tile>(tiles.size());
    if (!tiles.empty()) std::memcpy(out->tiles, tiles.data(), tiles.size() * sizeof tiles[0]);
}

/* Reads the file from the transform. */
template <typename Grid>
typename Grid::Ptr read_tree(reader &file, size_t index, descriptor d, vdb::GridBase::Ptr base, int fd,
                             size_t limit)
{
    typename Grid::Ptr grid = vdb::gridPtrCast<Grid>(base);
    file.read_transform(*grid);
    if (d.parent.empty()) {
        grid->readTopology(file.stream());
        check_topology(grid->tree(), limit);
        grid->readBuffers(file.stream());
    } else { /* the grid shares the tree of another grid of the file */
        reader again(fd);
        descriptor owner;
        vdb::GridBase::Ptr parent = find(again, index, &d.parent, &owner);
        if (owner.type != d.type || !owner.parent.empty())
            throw fault(ERROR_INPUT_DAMAGED,
                        "shares the tree of a grid of another type: the file is damaged");
        again.read_transform(*parent);
        parent->readTopology(again.stream());
        check_topology(vdb::gridPtrCast<Grid>(parent)->tree(), limit);
        parent->readBuffers(again.stream());
        grid->setTree(parent->baseTreePtr());
    }
    return grid;
}

template <typename Grid> void load(typename Grid::Ptr grid, vdb_loading how, size_t limit, vdb_grid *out)
{
    out->grid_class = class_of(*grid);
    out->is_local = !grid->isInWorldSpace();
    for (auto item = grid->beginMeta(); item != grid->endMeta(); ++item)
        if (vdb_is_unit(item->first.c_str()) && item->second->typeName() == "string")
            std::snprintf(out->unit, sizeof out->unit, "%s", item->second->str().c_str());
    const bool level_set = out->grid_class == VDB_LEVEL_SET;
    out->zero = level_set || std::is_same<typename Grid::ValueType, float>::value ? 0 : how.zero;
    if (how.flood && level_set) vdb::tools::signedFloodFill(grid->tree(), false);
    copy_transform(*grid, out->index_to_world);
    out->background = float(double(grid->background()) - out->zero);
    out->active_voxels = grid->activeVoxelCount();
    copy_leaves(grid->tree(), out);
    copy_tiles(grid->tree(), limit, out);
}

template <typename T> void copy_value(const T &from, double to[3])
{
    to[0] = double(from);
}

template <typename T> void copy_value(const vdb::math::Vec3<T> &from, double to[3])
{
    for (int k = 0; k < 3; k++) to[k] = double(from[k]);
}

template <typename Grid> bool read_voxel(const vdb_voxels *v, const int32_t at[3], double value[3])
{
    typename Grid::ValueType found;
    const auto *access = static_cast<const typename Grid::ConstAccessor *>(v->tree);
    bool active = access->probeValue(vdb::Coord(at[0], at[1], at[2]), found);
    copy_value(found, value);
    return active;
}

template <typename T> int64_t copy_whole(const T &from)
{
    return int64_t(from);
}

template <typename T> int64_t copy_whole(const vdb::math::Vec3<T> &from)
{
    return int64_t(from[0]);
}

template <typename Grid> int64_t read_whole(const vdb_voxels *v, const int32_t at[3])
{
    return copy_whole(static_cast<const typename Grid::ConstAccessor *>(v->tree)->getValue(
        vdb::Coord(at[0], at[1], at[2])));
}

/* A visit: the index of the grid, and the visitor. */
struct visit {
    reader &file;
    size_t index;
    const descriptor &d;
    vdb::GridBase::Ptr base;
    int fd;
    size_t limit;
    vdb_visitor *visitor;
    void *context;
    error *e;
    bool done, answer;

    template <typename Grid> void try_as(int components, bool whole)
    {
        if (done || d.type != Grid::gridType()) return;
        typename Grid::Ptr grid = read_tree<Grid>(file, index, d, base, fd, limit);
        typename Grid::ConstAccessor access = grid->getConstAccessor();
        vdb_voxels v = {components, whole,   class_of(*grid),  {1, 1, 1},       {0, 0, 0},
                        {0},        &access, read_voxel<Grid>, read_whole<Grid>};
        if (whole) {
            const vdb::CoordBBox box = grid->evalActiveVoxelBoundingBox();
            for (int k = 0; k < 3; k++) {
                v.low[k] = box.min()[k];
                v.high[k] = box.max()[k];
            }
        }
        copy_transform(*grid, v.index_to_world);
        answer = visitor(context, &v, e);
        done = true;
    }
};

bool is_numeric(const std::string &type)
{
    for (const auto &known :
         {vdb::FloatGrid::gridType(), vdb::DoubleGrid::gridType(), vdb::Int32Grid::gridType(),
          vdb::Int64Grid::gridType(), vdb::BoolGrid::gridType(), vdb::Vec3SGrid::gridType(),
          vdb::Vec3DGrid::gridType(), vdb::Vec3IGrid::gridType()})
        if (type == known) return true;
    return false;
}

} // namespace

/* OpenVDB 10.0 reads values that are not packed with the length given in the file, beyond the end of the
 * node's buffer, and checks afterwards. For packed values it allocates that length. These two functions
 * therefore replace the library's: all callers, also those in the library, are linked to them. They check
 * the length, then call the library's functions. */
typedef void unpacker(std::istream &, char *, size_t);

static unpacker *find_library(unpacker *ours)
{
    Dl_info info;
    bool named = dladdr(reinterpret_cast<void *>(ours), &info) && info.dli_sname;
    return named ? reinterpret_cast<unpacker *>(dlsym(RTLD_NEXT, info.dli_sname)) : nullptr;
}

static void unpack(unpacker *library, std::istream &in, char *data, size_t bytes)
{
    if (!library)
        throw fault(ERROR_INTERNAL,
                    "the file cannot be decompressed: the function of OpenVDB for it is missing. Install "
                    "hexad again.");
    fd_buffer *buffer = dynamic_cast<fd_buffer *>(in.rdbuf());
    if (buffer && data) buffer->check_packed(bytes);
    library(in, data, bytes);
}

namespace openvdb {
OPENVDB_USE_VERSION_NAMESPACE
namespace OPENVDB_VERSION_NAME {
namespace io {

void unzipFromStream(std::istream &in, char *data, size_t bytes)
{
    static unpacker *const library = find_library(&unzipFromStream);
    unpack(library, in, data, bytes);
}

void bloscFromStream(std::istream &in, char *data, size_t bytes)
{
    static unpacker *const library = find_library(&bloscFromStream);
    unpack(library, in, data, bytes);
}

} // namespace io
} // namespace OPENVDB_VERSION_NAME
} // namespace openvdb

extern "C" bool vdb_list_grids(int fd, vdb_listing *out, error *e)
{
    vdb_listing list = {nullptr, 0};
    bool ok = shim::guard(e, ERROR_INPUT_DAMAGED, "the list of grids", [&] {
        vdb::initialize();
        reader file(fd);
        list.entries = array<vdb_entry>(size_t(file.count()));
        for (int32_t i = 0; i < file.count(); i++) {
            descriptor d = file.read_descriptor();
            vdb_entry *entry = &list.entries[i];
            copy_text(entry->name, d.name);
            copy_text(entry->type, value_type(d.type));
            entry->scalar = is_scalar(d.type);
            entry->numeric = is_numeric(d.type);
            vdb::GridBase::Ptr grid = file.create(d);
            if (grid) {
                file.read_metadata(*grid);
                entry->grid_class = class_of(*grid);
            } else if (!file.has_offsets()) {
                throw fault(ERROR_INPUT_UNSUPPORTED, "grid \"" + d.name + "\" has the type " +
                                                         value_type(d.type) +
                                                         ", which is not known, in a file without offsets");
            }
            file.skip(d, grid);
            list.count++;
        }
    });
    if (ok)
        *out = list;
    else
        vdb_listing_free(&list);
    return ok;
}

extern "C" vdb_grid *vdb_load_grid(int fd, size_t index, vdb_loading how, size_t memory_limit, error *e)
{
    vdb_grid *out = nullptr;
    bool ok = shim::guard(e, ERROR_INPUT_DAMAGED, "the voxels of the grid", [&] {
        vdb::initialize();
        out = array<vdb_grid>(1);
        reader file(fd);
        out->from_newer = file.is_newer();
        descriptor d;
        vdb::GridBase::Ptr grid = find(file, index, nullptr, &d);
        if (!is_scalar(d.type))
            throw fault(ERROR_INPUT_UNSUPPORTED, "its values are of type " + value_type(d.type) +
                                                     "; only float and double can be sampled");
        if (d.type == vdb::FloatGrid::gridType())
            load<vdb::FloatGrid>(read_tree<vdb::FloatGrid>(file, index, d, grid, fd, memory_limit), how,
                                 memory_limit, out);
        else
            load<vdb::DoubleGrid>(read_tree<vdb::DoubleGrid>(file, index, d, grid, fd, memory_limit), how,
                                  memory_limit, out);
    });
    if (ok) return out;
    vdb_grid_free(out);
    return nullptr;
}

extern "C" bool vdb_visit_grid(int fd, size_t index, size_t memory_limit, vdb_visitor *visitor, void *context,
                               error *e)
{
    bool answer = false;
    bool ok = shim::guard(e, ERROR_INPUT_DAMAGED, "the voxels of the grid", [&] {
        vdb::initialize();
        reader file(fd);
        descriptor d;
        vdb::GridBase::Ptr grid = find(file, index, nullptr, &d);
        visit v = {file, index, d, grid, fd, memory_limit, visitor, context, e, false, false};
        v.try_as<vdb::FloatGrid>(1, false);
        v.try_as<vdb::DoubleGrid>(1, false);
        v.try_as<vdb::Int32Grid>(1, true);
        v.try_as<vdb::Int64Grid>(1, true);
        v.try_as<vdb::BoolGrid>(1, true);
        v.try_as<vdb::Vec3SGrid>(3, false);
        v.try_as<vdb::Vec3DGrid>(3, false);
        v.try_as<vdb::Vec3IGrid>(3, true);
        if (!v.done)
            throw fault(ERROR_INPUT_UNSUPPORTED,
                        "its values are of type " + value_type(d.type) + ", which are not numbers");
        answer = v.answer;
    });
    return ok && answer;
}

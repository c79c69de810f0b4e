// SPDX-License-Identifier: Apache-2.0
/* archive: whole files of grids, for C++ units. Not for C. */
#ifndef HEXAD_IO_VDB_ARCHIVE_H
#define HEXAD_IO_VDB_ARCHIVE_H

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <sstream>
#include <string>

#include <unistd.h>

#include <openvdb/io/Archive.h>

#include "base/core/hash.h"
#include "io/vdb/shim.h"

namespace shim {

inline uint64_t hash_of(const std::string &bytes, uint64_t state)
{
    for (unsigned char byte : bytes) state = hash_add(state, byte);
    return state;
}

/* Replaces the random identifier of the format by a hash of the contents. */
inline void identify(std::string &bytes, const std::string &random)
{
    const size_t at = bytes.find(random);
    if (at == std::string::npos) throw fault(ERROR_INTERNAL, "the file has no identifier");
    bytes.replace(at, random.size(), random.size(), '0');
    const uint64_t a = hash_of(bytes, HASH_NONE), b = hash_of(bytes, a);
    char text[37];
    std::snprintf(text, sizeof text, "%08x-%04x-%04x-%04x-%012llx", unsigned(a >> 32),
                  unsigned(a >> 16 & 0xffff), unsigned(a & 0xffff), unsigned(b >> 48),
                  static_cast<unsigned long long>(b & 0xffffffffffff));
    if (random.size() == sizeof text - 1) bytes.replace(at, random.size(), text);
}

/* Archive's own write is protected. Its two public subclasses, io::File and io::Stream, cannot write a
 * seekable file to a stream in memory. */
class archive : public openvdb::io::Archive {
public:
    /* The bytes of a whole file. The same grids give the same bytes. */
    std::string file_of(const openvdb::GridCPtrVec &grids, bool seekable) const
    {
        std::ostringstream out(std::ios_base::binary);
        Archive::write(out, grids, seekable);
        std::string bytes = out.str();
        identify(bytes, getUniqueTag());
        return bytes;
    }
};

inline void write_bytes(int fd, const std::string &bytes)
{
    size_t done = 0;
    while (done < bytes.size()) {
        ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0)
            throw fault(error_code_of_errno(errno),
                        std::string("cannot be written: ") + std::strerror(errno));
        done += size_t(n);
    }
}

} // namespace shim

#endif

// SPDX-License-Identifier: Apache-2.0
/* archive: writes whole files to a descriptor, for C++ units. Not for C. */
#ifndef HEXAD_IO_VDB_ARCHIVE_H
#define HEXAD_IO_VDB_ARCHIVE_H

#include <cerrno>
#include <cstring>
#include <ostream>
#include <string>

#include <unistd.h>

#include <openvdb/io/Archive.h>

#include "io/vdb/shim.h"

namespace shim {

/* Archive's own write is protected. Its two public subclasses, io::File and io::Stream, cannot write a
 * seekable file to a stream in memory. */
class archive : public openvdb::io::Archive {
public:
    void write_all(std::ostream &out, const openvdb::GridCPtrVec &grids, bool seekable) const
    {
        Archive::write(out, grids, seekable);
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

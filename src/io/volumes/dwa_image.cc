// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/dwa_image.h"

#include <exception>
#include <unistd.h>

#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>

namespace {

/* Reads the file with pread; the offset of its descriptor does not change. */
class stream : public Imf::IStream {
public:
    explicit stream(int descriptor) : IStream("slice"), fd(descriptor) {}

    bool read(char to[], int count) override
    {
        for (int done = 0; done < count;) {
            const ssize_t got = pread(fd, to + done, (size_t)(count - done), (off_t)at);
            if (got <= 0) throw std::runtime_error("it is truncated");
            done += (int)got;
            at += (uint64_t)got;
        }
        return true;
    }

    uint64_t tellg() override { return at; }
    void seekg(uint64_t to) override { at = to; }

private:
    int fd;
    uint64_t at = 0;
};

} // namespace

bool dwa_image_read(int fd, int part, const char *channel, bool whole, const int32_t low[2],
                    const int32_t high[2], uint32_t *values, error *e)
{
    try {
        const Imath::Box2i window(Imath::V2i(low[0], low[1]), Imath::V2i(high[0], high[1]));
        const size_t pixel = sizeof *values, row = pixel * ((size_t)(high[0] - (int64_t)low[0]) + 1);
        stream from(fd);
        Imf::MultiPartInputFile file(from, 0);
        Imf::InputPart image(file, part);
        Imf::FrameBuffer into;
        into.insert(channel, Imf::Slice::Make(whole ? Imf::UINT : Imf::FLOAT, values, window, pixel, row));
        image.setFrameBuffer(into);
        image.readPixels(low[1], high[1]);
        return true;
    } catch (const std::exception &fault) {
        return error_set(e, ERROR_INPUT_DAMAGED, "its pixels are missing or damaged: %s", fault.what());
    }
}

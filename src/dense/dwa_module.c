/* dwa_image.h for a program that loads the library only where an image needs it. */
#include "base/module.h"
#include "dense/dwa_image.h"

typedef bool read_function(int, int, const char *, const int32_t *, const int32_t *, float *, error *);

bool dwa_image_read(int fd, int part, const char *channel, const int32_t low[2], const int32_t high[2],
                    float *values, error *e)
{
    read_function *read = (read_function *)module_symbol(DWA_IMAGE_MODULE, "dwa_image_read", e);
    return read && read(fd, part, channel, low, high, values, e);
}

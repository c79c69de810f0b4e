// SPDX-License-Identifier: Apache-2.0
/* A PNG or JPEG image, as the process that reads them does. The limits are far below a job's, so that what a file makes
 * up is seen. */
#include "io/images/image_decode.h"
#include "fuzz/target.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const image_limits limits = {.pixels = 1 << 18, .scans = 20, .memory = 1 << 22};
    image_facts facts;
    error e = {0};
    unsigned char *pixels = image_decode(data, size, "image", &limits, &facts, &e);
    expect(pixels || *facts.unread || (e.code != ERROR_NONE && *e.message));
    if (!pixels) return 0;
    const size_t bytes = (size_t)4 * (facts.bits / 8) * facts.width * facts.height;
    expect(facts.width > 0 && facts.height > 0 && bytes <= limits.memory);
    unsigned sum = 0; /* every number is there */
    for (size_t k = 0; k < bytes; k++) sum += pixels[k];
    (void)sum;
    free(pixels);
    return 0;
}

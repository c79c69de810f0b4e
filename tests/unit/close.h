// SPDX-License-Identifier: Apache-2.0
/* close: comparison in double precision (cmocka's assert_float_equal compares floats). Include after
 * cmocka. */
#ifndef HEXAD_TESTS_CLOSE_H
#define HEXAD_TESTS_CLOSE_H

#include <math.h>

#define assert_close(a, b, tolerance)                                                   \
    do {                                                                                \
        double close_a = (a), close_b = (b), close_t = (tolerance);                     \
        if (!(fabs(close_a - close_b) <= close_t))                                      \
            fail_msg("%s = %.17g, not %.17g within %g", #a, close_a, close_b, close_t); \
    } while (0)

#endif

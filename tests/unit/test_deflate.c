/* deflate: what zlib makes of it, and that no damage goes unnoticed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <zlib.h>

#include <cmocka.h>

#include "base/memory.h"
#include "base/rng.h"
#include "formats/deflate.h"

/* Noise, runs, and patterns of two bytes, all of them of many lengths. */
static unsigned char *make_bytes(size_t count, int kind, rng *r)
{
    unsigned char *bytes = mem_alloc(count + 1);
    for (size_t at = 0; at < count;) {
        size_t span = 1 + (size_t)(rng_uniform(r) * (kind == 1 ? 1200 : 20));
        bool noise = kind == 0 || (kind == 2 && rng_uniform(r) < 0.5);
        unsigned char pair[2] = {(unsigned char)(rng_uniform(r) * 256),
                                 (unsigned char)(rng_uniform(r) * 256)};
        for (size_t k = 0; k < span && at < count; k++, at++)
            bytes[at] = noise ? (unsigned char)(rng_uniform(r) * 256) : pair[k & 1];
    }
    return bytes;
}

static void check(const unsigned char *bytes, size_t count)
{
    unsigned char *stream = mem_alloc(deflate_bound(count)), *back = mem_alloc(count + 1);
    size_t length = deflate_pack(bytes, count, stream);
    uLongf got = count + 1;
    assert_true(length <= deflate_bound(count));
    assert_int_equal(uncompress(back, &got, stream, length), Z_OK);
    assert_int_equal(got, count);
    assert_memory_equal(back, bytes, count);
    assert_true(deflate_holds(stream, length, bytes, count));
    free(stream);
    free(back);
}

static void test_zlib_reads_it(void **state)
{
    (void)state;
    rng r = rng_seed(1, 1);
    for (int kind = 0; kind < 3; kind++)
        for (size_t count = 0; count < 100000; count = count < 40 ? count + 1 : count * 3 / 2 + 1) {
            unsigned char *bytes = make_bytes(count, kind, &r);
            check(bytes, count);
            free(bytes);
        }
}

/* Every length of a match, alone between what does not match. */
static void test_every_length(void **state)
{
    (void)state;
    unsigned char bytes[600];
    for (size_t run = 0; run <= 530; run++) {
        memset(bytes, 7, sizeof bytes);
        for (size_t k = 0; k < 16; k++) bytes[k] = (unsigned char)(17 * k * k);
        bytes[16 + run] = 200;
        bytes[17 + run] = 100;
        check(bytes, 18 + run);
    }
}

static void test_damage_is_seen(void **state)
{
    (void)state;
    rng r = rng_seed(2, 1);
    size_t count = 700;
    unsigned char *bytes = make_bytes(count, 2, &r), *stream = mem_alloc(deflate_bound(count));
    size_t length = deflate_pack(bytes, count, stream);
    size_t unused = 0; /* bits between the end of the block and the checksum mean nothing */
    for (size_t bit = 0; bit < 8 * length; bit++) {
        stream[bit / 8] ^= (unsigned char)(1u << bit % 8);
        unused += deflate_holds(stream, length, bytes, count);
        stream[bit / 8] ^= (unsigned char)(1u << bit % 8);
    }
    assert_true(unused < 8);
    for (size_t n = 0; n < length; n++) assert_false(deflate_holds(stream, n, bytes, count));
    for (size_t k = 0; k < count; k++) {
        bytes[k] ^= 1;
        assert_false(deflate_holds(stream, length, bytes, count));
        bytes[k] ^= 1;
    }
    assert_false(deflate_holds(stream, length, bytes, count - 1));
    assert_true(deflate_holds(stream, length, bytes, count));
    free(bytes);
    free(stream);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_zlib_reads_it),
        cmocka_unit_test(test_every_length),
        cmocka_unit_test(test_damage_is_seen),
    };
    return cmocka_run_group_tests_name("deflate", tests, NULL, NULL);
}

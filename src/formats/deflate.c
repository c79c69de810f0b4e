#include "formats/deflate.h"

#include <endian.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

enum { MATCH_LEAST = 3, MATCH_MOST = 258, DISTANCE = 2, END_OF_BLOCK = 256, FIRST_LENGTH = 257 };

/* The longest code of a literal is 9 bits; header, end and checksum take less than the rest. */
size_t deflate_bound(size_t count)
{
    return count + count / 8 + 32;
}

/* A code, first bit lowest. */
typedef struct bits {
    uint32_t value;
    uint32_t count;
} bits;

typedef struct codes {
    bits literal[256];
    bits match[MATCH_MOST + 1]; /* by length, with the distance */
} codes;

typedef struct writer {
    unsigned char *out;
    uint64_t pending;
    unsigned count; /* of bits that are pending, less than 8 after flush */
} writer;

static uint32_t reversed(uint32_t value, uint32_t count)
{
    uint32_t r = 0;
    for (uint32_t k = 0; k < count; k++) r |= (value >> k & 1) << (count - 1 - k);
    return r;
}

/* RFC 1951, 3.2.6. */
static bits fixed_code(uint32_t symbol)
{
    if (symbol < 144) return (bits){reversed(0x30 + symbol, 8), 8};
    if (symbol < 256) return (bits){reversed(0x190 + symbol - 144, 9), 9};
    if (symbol < 280) return (bits){reversed(symbol - 256, 7), 7};
    return (bits){reversed(0xC0 + symbol - 280, 8), 8};
}

static bits joined(bits low, bits high)
{
    return (bits){low.value | high.value << low.count, low.count + high.count};
}

/* RFC 1951, 3.2.5: lengths from 11 on come in groups of four symbols with an extra bit more each. */
static bits match_code(uint32_t length)
{
    static const bits distance = {0x10, 5}; /* symbol DISTANCE - 1 of five bits, reversed */
    uint32_t above = length - MATCH_LEAST, extra = 0;
    while (above >> extra >= 8) extra++;
    uint32_t symbol = FIRST_LENGTH + 4 * extra + (above >> extra);
    bits code = fixed_code(length == MATCH_MOST ? 285 : symbol);
    if (length < MATCH_MOST) code = joined(code, (bits){above & ((1u << extra) - 1), extra});
    return joined(code, distance);
}

static void make_codes(codes *c)
{
    for (uint32_t k = 0; k < 256; k++) c->literal[k] = fixed_code(k);
    for (uint32_t k = MATCH_LEAST; k <= MATCH_MOST; k++) c->match[k] = match_code(k);
}

static inline void put(writer *w, bits code)
{
    w->pending |= (uint64_t)code.value << w->count;
    w->count += code.count;
}

static inline void flush(writer *w)
{
    uint64_t little = htole64(w->pending);
    memcpy(w->out, &little, sizeof little);
    w->out += w->count >> 3;
    w->pending >>= w->count & ~7u;
    w->count &= 7;
}

static inline uint64_t differences(const unsigned char *at)
{
    uint64_t here, before;
    memcpy(&here, at, sizeof here);
    memcpy(&before, at - DISTANCE, sizeof before);
    return le64toh(here ^ before);
}

static size_t match_length(const unsigned char *at, size_t left)
{
    size_t most = left < MATCH_MOST ? left : MATCH_MOST, length = 0;
    while (length + 8 <= most) {
        uint64_t d = differences(at + length);
        if (d) return length + (size_t)__builtin_ctzll(d) / 8;
        length += 8;
    }
    while (length < most && at[length] == at[length - DISTANCE]) length++;
    return length;
}

/* Eight bytes of which none is what stands two before it. */
static inline bool all_differ(uint64_t d)
{
    return ((d - 0x0101010101010101u) & ~d & 0x8080808080808080u) == 0;
}

static inline void put_eight(writer *w, const codes *c, const unsigned char *at)
{
    for (int k = 0; k < 4; k++) put(w, c->literal[at[k]]);
    flush(w);
    for (int k = 4; k < 8; k++) put(w, c->literal[at[k]]);
    flush(w);
}

static void put_bytes(writer *w, const codes *c, const unsigned char *in, size_t count)
{
    size_t at = 0;
    for (; at < count && at < DISTANCE; at++) put(w, c->literal[in[at]]);
    flush(w);
    while (at < count) {
        if (count - at >= 8 && all_differ(differences(in + at))) {
            put_eight(w, c, in + at);
            at += 8;
            continue;
        }
        size_t length = match_length(in + at, count - at);
        if (length >= MATCH_LEAST) {
            put(w, c->match[length]);
            at += length;
        } else
            put(w, c->literal[in[at++]]);
        flush(w);
    }
}

enum { LANES = 64, GROUPS = 80 }; /* of so many bytes together the sums stay far below 2^32 */

/* Lane by lane the sum of the bytes, and the sum of these sums before each group. */
__attribute__((target_clones("default", "avx2", "avx512f"))) static void
sum_groups(const unsigned char *in, size_t groups, uint32_t *restrict sum, uint32_t *restrict before)
{
    for (size_t g = 0; g < groups; g++)
        for (int k = 0; k < LANES; k++) {
            before[k] += sum[k];
            sum[k] += in[g * LANES + (size_t)k];
        }
}

/* RFC 1950. */
static uint32_t adler32_of(const unsigned char *in, size_t count)
{
    static const uint64_t modulus = 65521;
    uint64_t a = 1, b = 0;
    for (size_t at = 0; at < count;) {
        size_t groups = (count - at) / LANES < GROUPS ? (count - at) / LANES : GROUPS;
        uint32_t sum[LANES] = {0}, before[LANES] = {0};
        sum_groups(in + at, groups, sum, before);
        b += groups * LANES * a;
        for (uint32_t k = 0; k < LANES; k++) {
            b += (uint64_t)LANES * before[k] + (uint64_t)(LANES - k) * sum[k];
            a += sum[k];
        }
        at += groups * LANES;
        for (size_t end = groups < GROUPS ? count : at; at < end; at++) b += a += in[at];
        a %= modulus;
        b %= modulus;
    }
    return (uint32_t)(b << 16 | a);
}

size_t deflate_pack(const unsigned char *in, size_t count, unsigned char *out)
{
    static const unsigned char head[2] = {0x78, 0x01}; /* deflate, a window of 32 kB, the quickest level */
    static const bits last_block_of_fixed_codes = {3, 3}, end = {0, 7};
    codes c;
    make_codes(&c);
    memcpy(out, head, sizeof head);
    writer w = {.out = out + sizeof head};
    put(&w, last_block_of_fixed_codes);
    put_bytes(&w, &c, in, count);
    put(&w, end);
    w.count = (w.count + 7) & ~7u;
    flush(&w);
    uint32_t sum = htobe32(adler32_of(in, count));
    memcpy(w.out, &sum, sizeof sum);
    return (size_t)(w.out - out) + sizeof sum;
}

/* ---- reading */

enum { CODE_MOST = 9, TABLE = 1 << CODE_MOST, LAST_SYMBOL = 285 };

/* By the next bits, first bit lowest: 16 times the symbol, and how many of the bits are its code. */
typedef struct table {
    uint16_t entry[TABLE];
} table;

static void make_table(table *t)
{
    for (uint32_t symbol = 0; symbol <= LAST_SYMBOL; symbol++) {
        bits code = fixed_code(symbol);
        for (uint32_t rest = code.value; rest < TABLE; rest += 1u << code.count)
            t->entry[rest] = (uint16_t)(symbol << 4 | code.count);
    }
}

/* What is beyond the end reads as zeros, and shows in `spent`. */
typedef struct reader {
    const unsigned char *at, *end;
    uint64_t pending;
    unsigned count;
    size_t spent; /* bytes beyond the end */
} reader;

static inline void refill(reader *r)
{
    if (r->end - r->at >= 8) {
        uint64_t next;
        memcpy(&next, r->at, sizeof next);
        r->pending |= le64toh(next) << r->count;
        r->at += (63 - r->count) >> 3;
        r->count |= 56;
        return;
    }
    for (; r->count <= 56; r->count += 8) {
        if (r->at < r->end)
            r->pending |= (uint64_t)*r->at++ << r->count;
        else
            r->spent++;
    }
}

static inline uint32_t take(reader *r, uint32_t count)
{
    uint32_t value = (uint32_t)r->pending & ((1u << count) - 1);
    r->pending >>= count;
    r->count -= count;
    return value;
}

/* RFC 1951, 3.2.5. */
static inline uint32_t length_of(reader *r, uint32_t symbol)
{
    uint32_t above = symbol - FIRST_LENGTH, extra = above < 8 ? 0 : above / 4 - 1;
    if (symbol == LAST_SYMBOL) return MATCH_MOST;
    uint32_t base = above < 8 ? above : (4 + above % 4) << extra;
    return MATCH_LEAST + base + take(r, extra);
}

/* As many bits as a match takes with all that belongs to it. */
enum { SYMBOL_MOST = CODE_MOST + 5 + 5 };

/* The symbols up to the end of the block. */
static bool same_bytes(reader *whole, const unsigned char *bytes, size_t count)
{
    table t;
    reader r = *whole; /* a copy that nothing else points to stays in registers */
    size_t at = 0;
    make_table(&t);
    for (;;) {
        if (r.count < SYMBOL_MOST) refill(&r);
        uint32_t entry = t.entry[r.pending & (TABLE - 1)], symbol = entry >> 4;
        take(&r, entry & 15);
        if (symbol < END_OF_BLOCK) {
            if (at == count || bytes[at++] != symbol) return false;
            continue;
        }
        if (symbol == END_OF_BLOCK) break;
        uint32_t length = length_of(&r, symbol);
        if (take(&r, 5) != 0x10 || at < DISTANCE || count - at < length) return false;
        if (memcmp(bytes + at, bytes + at - DISTANCE, length) != 0) return false;
        at += length;
    }
    *whole = r;
    return at == count;
}

bool deflate_holds(const unsigned char *stream, size_t length, const unsigned char *bytes, size_t count)
{
    uint32_t sum;
    if (length < 2 + sizeof sum || stream[0] != 0x78 || stream[1] != 0x01) return false;
    reader r = {.at = stream + 2, .end = stream + length - sizeof sum};
    refill(&r);
    if (take(&r, 3) != 3 || !same_bytes(&r, bytes, count)) return false;
    memcpy(&sum, stream + length - sizeof sum, sizeof sum);
    /* what was taken but not used is less than a byte, and of the stream's own */
    size_t unused = (size_t)(r.end - r.at) + r.count / 8;
    return unused == r.spent && be32toh(sum) == adler32_of(bytes, count);
}

/* deflate: bytes into a zlib stream (RFC 1950 and 1951), quickly.
 *
 * For planes of pixels after EXR's reordering and differences. What repeats there repeats after two bytes:
 * spans of one value give zeros, or a pattern of two where the bytes of a float alternate; all else is the
 * noise of positions, which no search can shrink. So that is the one distance that is looked for, and the
 * codes are the fixed ones: about the size that zlib's quickest level gives, at a tenth of its time.
 */
#ifndef HEXAD_FORMATS_DEFLATE_H
#define HEXAD_FORMATS_DEFLATE_H

#include <stdbool.h>
#include <stddef.h>

/* No stream of so many bytes is longer. */
size_t deflate_bound(size_t count);

/* Packs `count` bytes into `out`, of deflate_bound(count) bytes; returns the stream's length. */
size_t deflate_pack(const unsigned char *in, size_t count, unsigned char *out);

/* Whether a stream is whole and holds these bytes. It is read code by code, as the RFCs say, so that this
 * does not rely on deflate_pack; streams of other codes or distances than that uses are not understood. */
bool deflate_holds(const unsigned char *stream, size_t length, const unsigned char *bytes, size_t count);

#endif

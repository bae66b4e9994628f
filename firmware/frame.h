/* Frames on a serial line: CRC-32, and consistent overhead byte stuffing (COBS), so that a zero byte ends each frame.
 *
 * Sources: CRC-32 of IEEE 802.3; S. Cheshire and M. Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on
 * Networking 7 (1999). Byte tables: docs/reference/firmware.md.
 */
#ifndef TL_FRAME_H
#define TL_FRAME_H

#include <stddef.h>
#include <stdint.h>

/* Largest content of a frame [bytes], without CRC; far below the 254 bytes up to which COBS adds one byte. */
#define TL_CONTENT_MAX 96u
/* Largest frame on the line [bytes]: content, CRC, COBS's byte, and the ending zero. */
#define TL_FRAME_MAX (TL_CONTENT_MAX + 6u)

/* Return the CRC-32 of bytes; 0xCBF43926 for the nine digits "123456789". */
uint32_t tl_crc32(const uint8_t *bytes, size_t length);

/* Write content, CRC and the ending zero as one frame; return its length. Content has at most TL_CONTENT_MAX bytes. */
size_t tl_frame_encode(const uint8_t *content, size_t length, uint8_t frame[TL_FRAME_MAX]);

/* Read a frame without its ending zero into content; return the length of the content, 0 if the frame is broken. */
size_t tl_frame_decode(const uint8_t *frame, size_t length, uint8_t content[TL_FRAME_MAX]);

#endif

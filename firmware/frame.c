/* CRC-32 and COBS. See frame.h. */
#include "frame.h"

#define CRC_BYTES 4u
#define CRC_POLYNOMIAL 0xEDB88320u /* IEEE 802.3, bits reversed */

uint32_t tl_crc32(const uint8_t *bytes, size_t length) {
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < length; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (CRC_POLYNOMIAL & (0u - (crc & 1u)));
        }
    }
    return ~crc;
}

static uint8_t byte_of(uint32_t value, size_t place) { return (uint8_t)((value >> (8u * place)) & 0xFFu); }

size_t tl_frame_encode(const uint8_t *content, size_t length, uint8_t frame[TL_FRAME_MAX]) {
    const uint32_t crc = tl_crc32(content, length);
    size_t code = 0; /* place of the byte that counts the bytes up to the next zero */
    size_t end = 1;
    for (size_t i = 0; i < length + CRC_BYTES; i++) {
        const uint8_t byte = i < length ? content[i] : byte_of(crc, i - length);
        if (byte == 0u) {
            frame[code] = (uint8_t)(end - code);
            code = end;
        } else {
            frame[end] = byte;
        }
        end++;
    }
    frame[code] = (uint8_t)(end - code);
    frame[end] = 0u;
    return end + 1u;
}

/* Undo the byte stuffing; return the number of bytes, 0 if a count points beyond the frame. */
static size_t unstuff(const uint8_t *frame, size_t length, uint8_t bytes[TL_FRAME_MAX]) {
    size_t end = 0;
    size_t next = 0; /* place of the next count */
    for (size_t i = 0; i < length; i++) {
        if (i < next) {
            bytes[end] = frame[i];
            end++;
        } else {
            if (i > 0u) {
                bytes[end] = 0u;
                end++;
            }
            next = i + frame[i];
        }
    }
    return next == length ? end : 0u;
}

size_t tl_frame_decode(const uint8_t *frame, size_t length, uint8_t content[TL_FRAME_MAX]) {
    const size_t end = length < TL_FRAME_MAX ? unstuff(frame, length, content) : 0u;
    if (end <= CRC_BYTES) {
        return 0u;
    }
    const uint32_t crc = tl_crc32(content, end - CRC_BYTES);
    for (size_t i = 0; i < CRC_BYTES; i++) {
        if (content[end - CRC_BYTES + i] != byte_of(crc, i)) {
            return 0u;
        }
    }
    return end - CRC_BYTES;
}

/* Messages as bytes. See messages.h. */
#include "messages.h"

static uint8_t low(uint32_t value) { return (uint8_t)(value & 0xFFu); }

static uint32_t get(const uint8_t *bytes, size_t count) {
    uint32_t value = 0;
    for (size_t i = count; i > 0u; i--) {
        value = (value << 8) | bytes[i - 1u];
    }
    return value;
}

static int16_t get_signed(const uint8_t *bytes) {
    const int32_t value = (int32_t)get(bytes, 2);
    return (int16_t)(value >= 0x8000 ? value - 0x10000 : value);
}

/* Write a number and return the place behind it. */
static uint8_t *put(uint8_t *place, uint32_t value, size_t count) {
    for (size_t i = 0; i < count; i++) {
        place[i] = low(value >> (8u * i));
    }
    return &place[count];
}

static uint8_t *put_all(uint8_t *place, const int16_t *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        (void)put(&place[2u * i], (uint32_t)values[i], 2);
    }
    return &place[2u * count];
}

tl_reply tl_message_decode(const uint8_t *content, size_t length, tl_message *message) {
    if (length > 0u && content[0] != TL_MESSAGES_VERSION) {
        return TL_VERSION;
    }
    if (length != TL_HOST_BYTES || content[2] != TL_HOST_BYTES || content[1] < (uint8_t)TL_DRIVE ||
        content[1] > (uint8_t)TL_SET_LIMITS) {
        return TL_BROKEN;
    }
    message->kind = (tl_kind)content[1];
    message->sender = (uint16_t)get(&content[3], 2);
    message->sequence = (uint16_t)get(&content[5], 2);
    message->stamp_ms = get(&content[7], 4);
    message->latch = (uint16_t)get(&content[11], 2);
    for (size_t i = 0; i < TL_VALUES; i++) {
        message->values[i] = get_signed(&content[13u + 2u * i]);
    }
    return TL_ACCEPTED;
}

static uint32_t flag(bool is_set, int bit) { return is_set ? (uint32_t)bit : 0u; }

static uint32_t flags_of(const tl_rules *rules, const tl_outputs *outputs, const tl_readings *readings) {
    const uint32_t words = (uint32_t)TL_FLIGHT_ENDS | (uint32_t)TL_GO_BACK;
    return flag(outputs->brake, TL_BRAKE) | flag(rules->inputs.dead_man, TL_DEAD_MAN_HELD) |
           flag(rules->inputs.stop, TL_STOP_PRESSED) | flag(rules->inputs.rearm, TL_REARM_PRESSED) | flag(rules->is_open, TL_OPEN) |
           (readings->buttons & words);
}

size_t tl_state_encode(const tl_rules *rules, const tl_outputs *outputs, const tl_readings *readings, uint8_t content[TL_STATE_BYTES]) {
    uint8_t *place = put(content, TL_MESSAGES_VERSION, 1);
    place = put(place, TL_STATE_KIND, 1);
    place = put(place, TL_STATE_BYTES, 1);
    place = put(place, rules->now_ms, 4);
    place = put(place, rules->latch, 2);
    place = put(place, (uint32_t)rules->cause, 1);
    place = put(place, flags_of(rules, outputs, readings), 1);
    place = put(place, readings->present | flag(rules->inputs.handset, TL_HAS_HANDSET), 1);
    place = put(place, (uint32_t)rules->reply, 1);
    place = put(place, rules->rejections, 2);
    place = put(place, rules->sender, 2);
    place = put(place, rules->heard_ms, 4);
    place = put(place, rules->inputs.drive_error, 2);
    place = put_all(place, rules->limits, TL_VALUES);
    place = put(place, (uint32_t)outputs->belts_um_s[TL_LEFT], 4);
    place = put(place, (uint32_t)outputs->belts_um_s[TL_RIGHT], 4);
    place = put_all(place, rules->inputs.belts, 2);
    place = put(place, readings->voltage_mv, 2);
    place = put_all(place, readings->orientation, 4);
    place = put_all(place, readings->rates, 3);
    place = put_all(place, readings->accelerations, 3);
    place = put_all(place, &readings->seat_pitch, 1);
    place = put_all(place, &readings->seat_stroke, 1);
    place = put_all(place, &readings->flipper_angle, 1);
    place = put_all(place, &readings->flipper_torque, 1);
    const ptrdiff_t length = place - content;
    return (size_t)length;
}

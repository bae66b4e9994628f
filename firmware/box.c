/* Bytes to rules and back. See box.h. */
#include "box.h"

size_t tl_box_bytes(void) { return sizeof(tl_box); }

void tl_box_start(tl_box *box, uint32_t now_ms) {
    const tl_outputs standing = {.belts_um_s = {0, 0}, .seat = 0, .flipper = 0, .brake = true, .contactor = true};
    tl_rules_start(&box->rules, now_ms);
    box->outputs = standing;
    box->length = 0;
}

/* Judge the bytes between two zeros. */
static void take(tl_box *box) {
    uint8_t content[TL_FRAME_MAX] = {0};
    tl_message message = {.kind = TL_STOP};
    const size_t length = tl_frame_decode(box->frame, box->length, content);
    const tl_reply reply = length == 0u ? TL_BROKEN : tl_message_decode(content, length, &message);
    if (reply == TL_ACCEPTED) {
        (void)tl_rules_receive(&box->rules, &message);
    } else {
        (void)tl_rules_reject(&box->rules, reply);
    }
}

void tl_box_receive(tl_box *box, const uint8_t *bytes, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (bytes[i] != 0u) {
            if (box->length < TL_FRAME_MAX) {
                box->frame[box->length] = bytes[i];
                box->length++;
            }
        } else if (box->length > 0u) {
            take(box);
            box->length = 0;
        } else {
            /* a second zero ends no frame */
        }
    }
}

tl_outputs tl_box_tick(tl_box *box, uint32_t now_ms, const tl_inputs *inputs) {
    box->outputs = tl_rules_tick(&box->rules, now_ms, inputs);
    return box->outputs;
}

size_t tl_box_state(const tl_box *box, const tl_readings *readings, uint8_t frame[TL_FRAME_MAX]) {
    uint8_t content[TL_STATE_BYTES];
    return tl_frame_encode(content, tl_state_encode(&box->rules, &box->outputs, readings, content), frame);
}

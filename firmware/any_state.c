/* Entry of the analysis (make prove): any call, with any bytes, messages, inputs and times, on a box in any sound state. */
#include "box.h"

#include <__fc_builtin.h>

static bool any_bool(void) { return Frama_C_interval(0, 1) == 1; }

/* Every memory of the rules whose numbers are within the ranges of a sound box (is_sound of rules.h). */
static tl_rules any_rules(void) {
    tl_rules rules;
    Frama_C_make_unknown((char *)&rules, sizeof rules);
    rules.cause = (tl_cause)Frama_C_interval(TL_ARMED, TL_RUNAWAY);
    rules.reply = (tl_reply)Frama_C_interval(TL_ACCEPTED, TL_BEYOND);
    rules.held_ms = (uint16_t)Frama_C_interval(0, TL_AGE_MAX);
    rules.released_ms = (uint16_t)Frama_C_interval(0, TL_AGE_MAX);
    rules.pressed_ms = (uint16_t)Frama_C_interval(0, TL_AGE_MAX);
    rules.rearmed_ms = (uint16_t)Frama_C_interval(0, TL_AGE_MAX);
    rules.turned_ms = (uint16_t)Frama_C_interval(0, TL_AGE_MAX);
    rules.turns = any_bool();
    rules.is_open = any_bool();
    rules.drives = any_bool();
    for (int i = 0; i < TL_VALUES; i++) {
        rules.limits[i] = (int16_t)Frama_C_interval(0, INT16_MAX);
    }
    rules.limits[TL_LIMIT_WATCHDOG] = (int16_t)Frama_C_interval(0, TL_WATCHDOG_MAX_MS);
    for (int i = 0; i < 2; i++) {
        rules.belts_um_s[i] = Frama_C_interval(-100 * INT16_MAX, 100 * INT16_MAX);
    }
    return rules;
}

static tl_inputs any_inputs(void) {
    tl_inputs inputs;
    Frama_C_make_unknown((char *)&inputs, sizeof inputs);
    inputs.dead_man = any_bool();
    inputs.stop = any_bool();
    inputs.handset = any_bool();
    inputs.rearm = any_bool();
    return inputs;
}

int main(void) {
    uint8_t bytes[300];
    uint8_t frame[TL_FRAME_MAX];
    tl_readings readings;
    tl_message message;
    tl_box box;
    tl_box new_box;
    Frama_C_make_unknown((char *)bytes, sizeof bytes);
    Frama_C_make_unknown((char *)&readings, sizeof readings);
    Frama_C_make_unknown((char *)&message, sizeof message);
    Frama_C_make_unknown((char *)&box, sizeof box);
    message.kind = (tl_kind)Frama_C_interval(TL_DRIVE, TL_SET_LIMITS);
    box.rules = any_rules();
    box.rules.inputs = any_inputs();
    box.outputs.brake = any_bool();
    box.outputs.contactor = any_bool();
    box.length = (size_t)Frama_C_interval(0, TL_FRAME_MAX);
    const uint32_t now_ms = Frama_C_unsigned_int_interval(0, UINT32_MAX);
    const tl_inputs inputs = any_inputs();
    switch (Frama_C_interval(0, 4)) {
    case 0:
        tl_box_receive(&box, bytes, (size_t)Frama_C_interval(0, sizeof bytes));
        break;
    case 1:
        (void)tl_rules_receive(&box.rules, &message);
        break;
    case 2:
        (void)tl_box_tick(&box, now_ms, &inputs);
        break;
    case 3:
        (void)tl_box_state(&box, &readings, frame);
        break;
    default: /* of memory that nobody has written */
        tl_box_start(&new_box, now_ms);
        tl_box_receive(&new_box, bytes, 1);
        (void)tl_box_tick(&new_box, now_ms, &inputs);
        (void)tl_box_state(&new_box, &readings, frame);
        break;
    }
    return (int)tl_box_bytes() & 1;
}

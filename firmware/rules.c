/* Limits, slew, watchdog, latched stop, hold and re-arm. See rules.h. */
#include "rules.h"

#define UM_S_PER_UNIT 100 /* a belt's unit of 0.1 mm/s */

static const int16_t NO_LIMITS[TL_VALUES] = {0, 0, 0, 0, 0, 0};

static void set_limits(tl_rules *rules, const int16_t values[TL_VALUES]) {
    for (int i = 0; i < TL_VALUES; i++) {
        rules->limits[i] = values[i];
    }
}

static void set_targets(tl_rules *rules, const int16_t values[TL_VALUES], bool drives) {
    for (int i = TL_LEFT; i <= TL_FLIPPER; i++) {
        rules->targets[i] = values[i];
    }
    rules->drives = drives;
}

/* Stand until a re-arm, from now on and not from the next tick; the first cause stays. */
static void stop(tl_rules *rules, tl_cause cause) {
    if (rules->cause == TL_ARMED) {
        rules->cause = (uint8_t)cause;
        rules->latch++;
        rules->belts_um_s[TL_LEFT] = rules->belts_um_s[TL_RIGHT] = 0;
    }
}

void tl_rules_start(tl_rules *rules, uint32_t now_ms) {
    const tl_rules started = {.now_ms = now_ms, .heard_ms = now_ms, .latch = 1u, .cause = TL_START};
    *rules = started;
}

tl_reply tl_rules_reject(tl_rules *rules, tl_reply reply) {
    rules->reply = (uint8_t)reply;
    rules->rejections++;
    return reply;
}

static bool is_within(int16_t value, int16_t limit) { return value <= limit && value >= -limit; }

/* The limits of a host must be positive, the watchdog short, and a hold no harder than the acceleration. */
static bool are_limits(const int16_t values[TL_VALUES]) {
    return values[TL_LIMIT_SPEED] > 0 && values[TL_LIMIT_HOLD] > 0 && values[TL_LIMIT_ACCELERATION] >= values[TL_LIMIT_HOLD] &&
           values[TL_LIMIT_WATCHDOG] > 0 && values[TL_LIMIT_WATCHDOG] <= TL_WATCHDOG_MAX_MS && values[TL_LIMIT_SEAT] >= 0 &&
           values[TL_LIMIT_FLIPPER] >= 0;
}

static uint32_t watchdog_ms(const tl_rules *rules) {
    return rules->limits[TL_LIMIT_WATCHDOG] == 0 ? (uint32_t)TL_WATCHDOG_MAX_MS : (uint32_t)rules->limits[TL_LIMIT_WATCHDOG];
}

/* Differences of times and sequence numbers are those of counters that run over. */
static bool is_fresh(const tl_rules *rules, uint32_t stamp_ms) {
    return (uint32_t)(rules->now_ms - stamp_ms) < watchdog_ms(rules);
}

static bool is_next(const tl_rules *rules, uint16_t sequence) {
    const uint16_t ahead = (uint16_t)(sequence - rules->sequence);
    return ahead != 0u && ahead < 0x8000u;
}

/* Limits and re-arm: for a box that stands. */
static tl_reply settle(tl_rules *rules, const tl_message *message) {
    if (message->kind == TL_SET_LIMITS) {
        const bool are_valid = are_limits(message->values);
        set_limits(rules, are_valid ? message->values : NO_LIMITS);
        return are_valid ? TL_ACCEPTED : TL_BEYOND;
    }
    if (message->kind != TL_REARM) {
        return TL_NOT_NOW;
    }
    if (message->latch != rules->latch) {
        return TL_OLD_LATCH;
    }
    if (rules->limits[TL_LIMIT_SPEED] == 0) {
        return TL_NO_LIMITS;
    }
    if (!rules->inputs.dead_man || rules->inputs.stop || rules->inputs.drive_error != 0u) {
        return TL_BLOCKED;
    }
    rules->cause = TL_ARMED;
    rules->sender = message->sender;
    set_targets(rules, NO_LIMITS, false);
    return TL_ACCEPTED;
}

/* Motion and hold: for a box that is armed. */
static tl_reply drive(tl_rules *rules, const tl_message *message) {
    const int16_t *limits = rules->limits;
    const int16_t *values = message->values;
    if (message->kind != TL_DRIVE && message->kind != TL_HOLD) {
        return TL_NOT_NOW;
    }
    if (!is_within(values[TL_LEFT], limits[TL_LIMIT_SPEED]) || !is_within(values[TL_RIGHT], limits[TL_LIMIT_SPEED]) ||
        !is_within(values[TL_SEAT], limits[TL_LIMIT_SEAT]) || !is_within(values[TL_FLIPPER], limits[TL_LIMIT_FLIPPER])) {
        return TL_BEYOND;
    }
    set_targets(rules, values, message->kind == TL_DRIVE);
    return TL_ACCEPTED;
}

tl_reply tl_rules_receive(tl_rules *rules, const tl_message *message) {
    const bool is_armed = rules->cause == TL_ARMED;
    if (message->kind == TL_STOP) {
        stop(rules, TL_STOPPED); /* from whomever, however old */
        return TL_ACCEPTED;
    }
    if (is_armed && message->sender != rules->sender) {
        stop(rules, TL_TWO_HOSTS);
        return tl_rules_reject(rules, TL_FOREIGN);
    }
    if (!is_fresh(rules, message->stamp_ms)) {
        return tl_rules_reject(rules, TL_STALE);
    }
    if (is_armed && !is_next(rules, message->sequence)) {
        return tl_rules_reject(rules, TL_OUT_OF_ORDER);
    }
    const tl_reply reply = is_armed ? drive(rules, message) : settle(rules, message);
    if (reply != TL_ACCEPTED) {
        return tl_rules_reject(rules, reply);
    }
    rules->heard_ms = message->stamp_ms;
    rules->sequence = message->sequence;
    return TL_ACCEPTED;
}

/* Inputs and silence of an armed box, the most telling cause first. A clock that is set back counts as a long time. */
static void watch(tl_rules *rules, uint32_t elapsed_ms) {
    if (rules->inputs.drive_error != 0u) {
        stop(rules, TL_DRIVE_ERROR);
    } else if (rules->inputs.stop) {
        stop(rules, TL_BUTTON);
    } else if (!rules->inputs.dead_man) {
        stop(rules, TL_DEAD_MAN);
    } else if (elapsed_ms >= watchdog_ms(rules) || !is_fresh(rules, rules->heard_ms)) {
        stop(rules, TL_WATCHDOG);
    }
}

/* A set point one step nearer to its target. */
static int32_t approach(int32_t value, int32_t target, int32_t step) {
    if (target > value) {
        return target - value > step ? value + step : target;
    }
    return value - target > step ? value - step : target;
}

tl_outputs tl_rules_tick(tl_rules *rules, uint32_t now_ms, const tl_inputs *inputs) {
    const uint32_t elapsed_ms = now_ms - rules->now_ms;
    tl_outputs outputs = {.belts_um_s = {0, 0}, .seat = 0, .flipper = 0, .brake = true};
    rules->now_ms = now_ms;
    rules->inputs = *inputs;
    watch(rules, elapsed_ms);
    const bool is_armed = rules->cause == TL_ARMED;
    /* 1 mm/s2 in 1 ms is 1 um/s. The watchdog keeps the time of an armed box below 100 ms, and the product within 32 bits. */
    const int32_t step = is_armed ? rules->limits[rules->drives ? TL_LIMIT_ACCELERATION : TL_LIMIT_HOLD] * (int32_t)elapsed_ms : 0;
    for (int i = TL_LEFT; i <= TL_RIGHT; i++) {
        const int32_t target = rules->drives ? rules->targets[i] * UM_S_PER_UNIT : 0;
        rules->belts_um_s[i] = is_armed ? approach(rules->belts_um_s[i], target, step) : 0;
        outputs.belts_um_s[i] = rules->belts_um_s[i];
    }
    if (is_armed) {
        outputs.seat = rules->targets[TL_SEAT];
        outputs.flipper = rules->targets[TL_FLIPPER];
        outputs.brake = !rules->drives && outputs.belts_um_s[TL_LEFT] == 0 && outputs.belts_um_s[TL_RIGHT] == 0;
    }
    return outputs;
}

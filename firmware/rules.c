/* Limits, slew, watchdog, latched stop, hold and re-arm. See rules.h. */
#include "rules.h"

#define UM_S_PER_UNIT 100 /* a belt's unit of 0.1 mm/s */

/*@ requires \valid(rules) && \valid_read(values + (0 .. TL_VALUES - 1)) && \separated(rules, values + (0 .. TL_VALUES - 1));
    assigns rules->limits[0 .. TL_VALUES - 1];
    ensures \forall integer k; 0 <= k < TL_VALUES ==> rules->limits[k] == values[k]; */
static void set_limits(tl_rules *rules, const int16_t values[TL_VALUES]) {
    /*@ loop invariant 0 <= i <= TL_VALUES && \forall integer k; 0 <= k < i ==> rules->limits[k] == values[k];
        loop assigns i, rules->limits[0 .. TL_VALUES - 1];
        loop variant TL_VALUES - i; */
    for (int i = 0; i < TL_VALUES; i++) {
        rules->limits[i] = values[i];
    }
}

/*@ requires \valid(rules) && \valid_read(values + (0 .. TL_FLIPPER)) && \separated(rules, values + (0 .. TL_FLIPPER));
    assigns rules->targets[0 .. TL_FLIPPER], rules->drives;
    ensures \forall integer k; 0 <= k <= TL_FLIPPER ==> rules->targets[k] == values[k];
    ensures rules->drives == drives; */
static void set_targets(tl_rules *rules, const int16_t values[TL_VALUES], bool drives) {
    /*@ loop invariant 0 <= i <= TL_FLIPPER + 1 && \forall integer k; 0 <= k < i ==> rules->targets[k] == values[k];
        loop assigns i, rules->targets[0 .. TL_FLIPPER];
        loop variant TL_FLIPPER - i; */
    for (int i = TL_LEFT; i <= TL_FLIPPER; i++) {
        rules->targets[i] = values[i];
    }
    rules->drives = drives;
}

/* Stand until a re-arm, from now on and not from the next tick; the first cause stays. */
/*@ requires \valid(rules) && cause != TL_ARMED;
    assigns rules->cause, rules->latch, rules->belts_um_s[TL_LEFT .. TL_RIGHT], rules->held_ms, rules->released_ms;
    ensures \old(rules->cause) != TL_ARMED ==> rules->cause == \old(rules->cause) && rules->held_ms == \old(rules->held_ms) &&
        rules->released_ms == \old(rules->released_ms) && rules->belts_um_s[TL_LEFT] == \old(rules->belts_um_s[TL_LEFT]) &&
        rules->belts_um_s[TL_RIGHT] == \old(rules->belts_um_s[TL_RIGHT]);
    ensures \old(rules->cause) == TL_ARMED ==> rules->cause == cause && rules->held_ms == 0 && rules->released_ms == 0 &&
        rules->belts_um_s[TL_LEFT] == 0 && rules->belts_um_s[TL_RIGHT] == 0; */
static void stop(tl_rules *rules, tl_cause cause) {
    if (rules->cause == TL_ARMED) {
        rules->cause = cause;
        rules->latch++;
        rules->belts_um_s[TL_LEFT] = 0;
        rules->belts_um_s[TL_RIGHT] = 0;
        rules->held_ms = 0;
        rules->released_ms = 0;
    }
}

void tl_rules_start(tl_rules *rules, uint32_t now_ms) {
    const tl_rules started = {
        .now_ms = now_ms,
        .heard_ms = now_ms,
        .latch = 1u,
        .cause = TL_START,
        .pressed_ms = TL_AGE_MAX,
        .rearmed_ms = TL_AGE_MAX,
    };
    *rules = started;
}

tl_reply tl_rules_reject(tl_rules *rules, tl_reply reply) {
    rules->reply = reply;
    rules->rejections++;
    return reply;
}

/*@ assigns \nothing;
    ensures \result <==> -limit <= value <= limit; */
static bool is_within(int16_t value, int16_t limit) { return value <= limit && value >= -limit; }

/* The limits of a host must be positive, the watchdog short, and a hold no harder than the acceleration. */
/*@ requires \valid_read(values + (0 .. TL_VALUES - 1));
    assigns \nothing;
    ensures \result <==> values[TL_LIMIT_SPEED] > 0 && values[TL_LIMIT_HOLD] > 0 &&
        values[TL_LIMIT_ACCELERATION] >= values[TL_LIMIT_HOLD] && 0 < values[TL_LIMIT_WATCHDOG] <= TL_WATCHDOG_MAX_MS &&
        values[TL_LIMIT_SEAT] >= 0 && values[TL_LIMIT_FLIPPER] >= 0; */
static bool are_limits(const int16_t values[TL_VALUES]) {
    return values[TL_LIMIT_SPEED] > 0 && values[TL_LIMIT_HOLD] > 0 && values[TL_LIMIT_ACCELERATION] >= values[TL_LIMIT_HOLD] &&
           values[TL_LIMIT_WATCHDOG] > 0 && values[TL_LIMIT_WATCHDOG] <= (int16_t)TL_WATCHDOG_MAX_MS && values[TL_LIMIT_SEAT] >= 0 &&
           values[TL_LIMIT_FLIPPER] >= 0;
}

/*@ requires \valid_read(rules) && (are_unset(rules) || are_valid(rules));
    assigns \nothing;
    ensures \result == watchdog_of(rules); */
static uint32_t watchdog_ms(const tl_rules *rules) {
    return rules->limits[TL_LIMIT_WATCHDOG] == 0 ? TL_WATCHDOG_MAX_MS : (uint32_t)rules->limits[TL_LIMIT_WATCHDOG];
}

/* Differences of times and sequence numbers are those of counters that run over. */
/*@ requires \valid_read(rules) && (are_unset(rules) || are_valid(rules));
    assigns \nothing;
    ensures \result <==> (uint32_t)(rules->now_ms - stamp_ms) < watchdog_of(rules); */
static bool is_fresh(const tl_rules *rules, uint32_t stamp_ms) {
    return (uint32_t)(rules->now_ms - stamp_ms) < watchdog_ms(rules);
}

/*@ requires \valid_read(rules);
    assigns \nothing; */
static bool is_next(const tl_rules *rules, uint16_t sequence) {
    const uint16_t ahead = (uint16_t)(sequence - rules->sequence);
    return ahead != 0u && ahead < 0x8000u;
}

/* Whether an input, the time or a missing act is against a re-arm. */
/*@ requires \valid_read(rules);
    assigns \nothing;
    ensures !\result && rules->limits[TL_LIMIT_SPEED] > 0 ==> may_rearm(rules); */
static bool is_blocked(const tl_rules *rules) {
    const tl_inputs *inputs = &rules->inputs;
    return !inputs->dead_man || inputs->stop || inputs->drive_error != 0u || rules->turns || rules->held_ms < TL_HELD_MS ||
           rules->rearmed_ms < TL_AGAIN_MS || (inputs->handset && rules->pressed_ms >= TL_PRESS_MS);
}

/* Limits and re-arm: for a box that stands. */
/*@ requires \valid(rules) && \valid_read(message) && \separated(rules, message) && is_sound(rules) && rules->cause != TL_ARMED;
    assigns rules->limits[0 .. TL_VALUES - 1], rules->targets[0 .. TL_FLIPPER], rules->drives, rules->cause, rules->sender,
        rules->pressed_ms, rules->rearmed_ms, rules->is_open;
    ensures is_sound(rules);
    ensures rules->cause == TL_ARMED ==> message->kind == TL_REARM && message->latch == rules->latch && \old(may_rearm(rules));
    ensures \result != TL_ACCEPTED ==> rules->cause != TL_ARMED; */
static tl_reply settle(tl_rules *rules, const tl_message *message) {
    const int16_t none[TL_VALUES] = {0, 0, 0, 0, 0, 0};
    if (message->kind == TL_SET_LIMITS) {
        const bool are_valid = are_limits(message->values);
        set_limits(rules, are_valid ? message->values : none);
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
    if (is_blocked(rules)) {
        return TL_BLOCKED;
    }
    rules->cause = TL_ARMED;
    rules->sender = message->sender;
    rules->pressed_ms = TL_AGE_MAX;
    rules->rearmed_ms = 0;
    rules->is_open = false;
    set_targets(rules, none, false);
    return TL_ACCEPTED;
}

/* Motion and hold: for a box that is armed. */
/*@ requires \valid(rules) && \valid_read(message) && \separated(rules, message) && is_sound(rules) && rules->cause == TL_ARMED;
    assigns rules->targets[0 .. TL_FLIPPER], rules->drives;
    ensures is_sound(rules); */
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

/* An age after a time. */
/*@ requires by_ms <= TL_WATCHDOG_MAX_MS && age_ms <= TL_AGE_MAX;
    assigns \nothing;
    ensures age_ms <= \result <= TL_AGE_MAX; */
static uint16_t older(uint16_t age_ms, uint32_t by_ms) {
    const uint32_t older_ms = age_ms + by_ms;
    return (uint16_t)(older_ms < TL_AGE_MAX ? older_ms : TL_AGE_MAX);
}

/*@ requires \valid(rules) && are_ages(rules) && by_ms <= TL_WATCHDOG_MAX_MS;
    assigns rules->held_ms, rules->released_ms, rules->pressed_ms, rules->rearmed_ms, rules->turned_ms;
    ensures are_ages(rules) && rules->pressed_ms >= \old(rules->pressed_ms); */
static void age(tl_rules *rules, uint32_t by_ms) {
    rules->held_ms = older(rules->held_ms, by_ms);
    rules->released_ms = rules->inputs.dead_man ? 0u : older(rules->released_ms, by_ms);
    rules->pressed_ms = older(rules->pressed_ms, by_ms);
    rules->rearmed_ms = older(rules->rearmed_ms, by_ms);
    rules->turned_ms = rules->turns ? older(rules->turned_ms, by_ms) : 0u;
}

/* A person's act ends a stop, not a key that is held on: the button is pressed anew while the dead-man switch is held, so with another
 * key; or the switch was released before, long enough to be meant. */
/*@ requires \valid(rules) && \valid_read(inputs) && \separated(rules, inputs) && are_ages(rules);
    assigns rules->pressed_ms;
    ensures are_ages(rules);
    ensures rules->pressed_ms == 0 && \old(rules->pressed_ms) > 0 ==>
        inputs->rearm && !rules->inputs.rearm && inputs->dead_man && !inputs->stop && rules->held_ms >= TL_HELD_MS &&
        (rules->inputs.dead_man || rules->released_ms >= TL_RELEASED_MS) && rules->cause != TL_ARMED; */
static void judge_press(tl_rules *rules, const tl_inputs *inputs) {
    const bool is_new = inputs->rearm && !rules->inputs.rearm;
    const bool is_meant = rules->inputs.dead_man || rules->released_ms >= TL_RELEASED_MS;
    const bool is_answer = rules->cause != TL_ARMED && rules->held_ms >= TL_HELD_MS;
    if (!inputs->dead_man || inputs->stop) {
        rules->pressed_ms = TL_AGE_MAX;
    } else if (is_new && is_meant && is_answer) {
        rules->pressed_ms = 0;
    } else {
        /* an earlier press counts for a while */
    }
}

/* Time and inputs of this tick, field by field: so each of the other fields is proved to stay. */
/*@ requires \valid(rules) && \valid_read(inputs) && \separated(rules, inputs);
    assigns rules->now_ms, rules->inputs.dead_man, rules->inputs.stop, rules->inputs.handset, rules->inputs.rearm,
        rules->inputs.drive_error, rules->inputs.belts[TL_LEFT .. TL_RIGHT];
    ensures rules->now_ms == now_ms; */
static void sense(tl_rules *rules, uint32_t now_ms, const tl_inputs *inputs) {
    rules->now_ms = now_ms;
    rules->inputs.dead_man = inputs->dead_man;
    rules->inputs.stop = inputs->stop;
    rules->inputs.handset = inputs->handset;
    rules->inputs.rearm = inputs->rearm;
    rules->inputs.drive_error = inputs->drive_error;
    rules->inputs.belts[TL_LEFT] = inputs->belts[TL_LEFT];
    rules->inputs.belts[TL_RIGHT] = inputs->belts[TL_RIGHT];
}

/* Inputs and silence of an armed box, the most telling cause first. A clock that is set back counts as a long time. */
/*@ requires \valid(rules) && (are_unset(rules) || are_valid(rules));
    assigns rules->cause, rules->latch, rules->belts_um_s[TL_LEFT .. TL_RIGHT], rules->held_ms, rules->released_ms;
    ensures \old(rules->cause) != TL_ARMED || rules->cause == TL_ARMED ==> rules->cause == \old(rules->cause) && rules->held_ms == \old(rules->held_ms) &&
        rules->released_ms == \old(rules->released_ms) && rules->belts_um_s[TL_LEFT] == \old(rules->belts_um_s[TL_LEFT]) &&
        rules->belts_um_s[TL_RIGHT] == \old(rules->belts_um_s[TL_RIGHT]);
    ensures \old(rules->cause) == TL_ARMED && rules->cause != TL_ARMED ==> rules->held_ms == 0 && rules->released_ms == 0 &&
        rules->belts_um_s[TL_LEFT] == 0 && rules->belts_um_s[TL_RIGHT] == 0;
    ensures rules->cause == TL_ARMED ==>
        elapsed_ms < watchdog_of(rules) && (uint32_t)(rules->now_ms - rules->heard_ms) < watchdog_of(rules); */
static void watch(tl_rules *rules, uint32_t elapsed_ms) {
    if (rules->inputs.drive_error != 0u) {
        stop(rules, TL_DRIVE_ERROR);
    } else if (rules->inputs.stop) {
        stop(rules, TL_BUTTON);
    } else if (!rules->inputs.dead_man) {
        stop(rules, TL_DEAD_MAN);
    } else if (elapsed_ms >= watchdog_ms(rules) || !is_fresh(rules, rules->heard_ms)) {
        stop(rules, TL_WATCHDOG);
    } else {
        /* the host speaks, and no input is against motion */
    }
}

/* A set point one step nearer to its target. */
/*@ requires step >= 0;
    assigns \nothing;
    ensures value <= \result <= target || target <= \result <= value; */
static int32_t approach(int32_t value, int32_t target, int32_t step) {
    if (target > value) {
        return target - value > step ? value + step : target;
    }
    return value - target > step ? value - step : target;
}

/* The set point of a belt after a time of TL_WATCHDOG_MAX_MS at most: 1 mm/s2 in 1 ms is 1 um/s, and the product has 32 bits. */
/*@ requires \valid(rules) && TL_LEFT <= belt <= TL_RIGHT && by_ms <= TL_WATCHDOG_MAX_MS;
    requires rules->cause == TL_ARMED ==> are_valid(rules) && are_within(rules);
    assigns rules->belts_um_s[belt];
    ensures rules->cause == TL_ARMED ==> are_within(rules);
    ensures rules->cause != TL_ARMED ==> rules->belts_um_s[belt] == 0; */
static void move(tl_rules *rules, int belt, uint32_t by_ms) {
    const int32_t limit = rules->limits[rules->drives ? TL_LIMIT_ACCELERATION : TL_LIMIT_HOLD];
    const int32_t elapsed_ms = (int32_t)by_ms;
    const int32_t target = rules->drives ? rules->targets[belt] * UM_S_PER_UNIT : 0;
    rules->belts_um_s[belt] = rules->cause == TL_ARMED ? approach(rules->belts_um_s[belt], target, limit * elapsed_ms) : 0;
}

/*@ requires \valid_read(rules);
    assigns \nothing;
    ensures rules->cause != TL_ARMED ==> \result; */
static bool stands(const tl_rules *rules) {
    return rules->cause != TL_ARMED || (!rules->drives && rules->belts_um_s[TL_LEFT] == 0 && rules->belts_um_s[TL_RIGHT] == 0);
}

/*@ assigns \nothing;
    ensures \result <==> belt > TL_TURNS || belt < -TL_TURNS; */
static bool is_fast(int16_t belt) { return belt > TL_TURNS || belt < -TL_TURNS; }

/* A belt that turns although the box stands: neither the drives nor the brake hold it, so the drives lose their power. */
/*@ requires \valid(rules);
    assigns rules->turns, rules->is_open, rules->cause, rules->latch, rules->belts_um_s[TL_LEFT .. TL_RIGHT], rules->held_ms,
        rules->released_ms;
    ensures \old(rules->cause) != TL_ARMED || rules->cause == TL_ARMED ==> rules->cause == \old(rules->cause) && rules->held_ms == \old(rules->held_ms) &&
        rules->released_ms == \old(rules->released_ms) && rules->belts_um_s[TL_LEFT] == \old(rules->belts_um_s[TL_LEFT]) &&
        rules->belts_um_s[TL_RIGHT] == \old(rules->belts_um_s[TL_RIGHT]);
    ensures rules->cause == TL_ARMED ==> rules->is_open == \old(rules->is_open);
    ensures \old(rules->cause) == TL_ARMED && rules->cause != TL_ARMED ==> rules->held_ms == 0 && rules->released_ms == 0 &&
        rules->belts_um_s[TL_LEFT] == 0 && rules->belts_um_s[TL_RIGHT] == 0;
    ensures rules->turns && rules->turned_ms >= TL_TURNS_MS ==> rules->is_open && rules->cause != TL_ARMED; */
static void watch_belts(tl_rules *rules) {
    rules->turns = stands(rules) && (is_fast(rules->inputs.belts[TL_LEFT]) || is_fast(rules->inputs.belts[TL_RIGHT]));
    if (rules->turns && rules->turned_ms >= TL_TURNS_MS) {
        rules->is_open = true;
        stop(rules, TL_RUNAWAY);
    }
}

tl_outputs tl_rules_tick(tl_rules *rules, uint32_t now_ms, const tl_inputs *inputs) {
    const uint32_t elapsed_ms = now_ms - rules->now_ms;
    /* A longer time stops an armed box, and makes nothing older that stands. */
    const uint32_t counted_ms = elapsed_ms < TL_WATCHDOG_MAX_MS ? elapsed_ms : TL_WATCHDOG_MAX_MS;
    age(rules, counted_ms);
    judge_press(rules, inputs);
    sense(rules, now_ms, inputs);
    watch(rules, elapsed_ms);
    move(rules, TL_LEFT, counted_ms);
    move(rules, TL_RIGHT, counted_ms);
    /*@ assert are_unset(rules) || are_valid(rules); */
    watch_belts(rules);
    /*@ assert are_unset(rules) || are_valid(rules); */
    const bool is_armed = rules->cause == TL_ARMED;
    const tl_outputs outputs = {
        .belts_um_s = {rules->belts_um_s[TL_LEFT], rules->belts_um_s[TL_RIGHT]},
        .seat = is_armed ? rules->targets[TL_SEAT] : (int16_t)0,
        .flipper = is_armed ? rules->targets[TL_FLIPPER] : (int16_t)0,
        .brake = stands(rules),
        .contactor = !rules->is_open,
    };
    return outputs;
}

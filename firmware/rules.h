/* Rules of the box at the drives: what may move, how fast, and when it stops.
 *
 * Whole numbers without floating point: no set point can be infinite or not a number. The box stands, latched, from its start
 * until a host sends limits and a re-arm. While it drives, a command counts from its stamp: the box's own time in the newest state
 * that the host had received. A command that is built on a state older than the watchdog time therefore never drives, however it was
 * delayed, and the box needs no clock but its own.
 */
#ifndef TL_RULES_H
#define TL_RULES_H

#include <stdbool.h>
#include <stdint.h>

/* Longest watchdog time that a host may set [ms]: a third of the guard's 0.3 s, so that the box stops before the guard must. */
#define TL_WATCHDOG_MAX_MS 100u

/* Times of a re-arm [ms], those of the guard: age of a stop from which a press of the button answers it, release of the dead-man
 * switch after which pressing both again is meant, time between two re-arms, and time for which a press waits for the host. */
#define TL_HELD_MS 500u
#define TL_RELEASED_MS 750u
#define TL_AGAIN_MS 1000u
#define TL_PRESS_MS 300u
/* Largest age that the box counts [ms]. */
#define TL_AGE_MAX TL_AGAIN_MS

/* Speed of a belt that turns although the box stands [0.1 mm/s], and the time after which the contactor opens [ms]. */
#define TL_TURNS 500
#define TL_TURNS_MS 200u

/* Places in the values of a command. */
enum { TL_LEFT, TL_RIGHT, TL_SEAT, TL_FLIPPER, TL_VALUES = 6 };
/* Places in the values of a message with limits. */
enum { TL_LIMIT_SPEED, TL_LIMIT_ACCELERATION, TL_LIMIT_HOLD, TL_LIMIT_WATCHDOG, TL_LIMIT_SEAT, TL_LIMIT_FLIPPER };

/* Messages of a host. */
typedef enum { TL_DRIVE = 1, TL_HOLD, TL_STOP, TL_REARM, TL_SET_LIMITS } tl_kind;

/* Causes of a latched stop. */
typedef enum { TL_ARMED, TL_START, TL_STOPPED, TL_WATCHDOG, TL_TWO_HOSTS, TL_DEAD_MAN, TL_BUTTON, TL_DRIVE_ERROR, TL_RUNAWAY } tl_cause;

/* Reasons for which a message was rejected. */
typedef enum {
    TL_ACCEPTED,
    TL_BROKEN,       /* byte stuffing, CRC, length or kind */
    TL_VERSION,      /* another version of the messages */
    TL_FOREIGN,      /* from a second host */
    TL_STALE,        /* stamped too long ago, or in the future */
    TL_OUT_OF_ORDER, /* overtaken, or received twice */
    TL_NOT_NOW,      /* limits or a re-arm while armed; motion while latched */
    TL_OLD_LATCH,    /* re-arm of another stop than the present one */
    TL_NO_LIMITS,    /* re-arm before the limits were set */
    TL_BLOCKED,      /* re-arm while an input is against it, too early, or without its act */
    TL_BEYOND        /* a value beyond its limit */
} tl_reply;

/* Message of a host. Unit of speeds: 0.1 mm/s for the belts, 0.01 mm/s for the seat, 1 mrad/s for the flipper. */
typedef struct {
    tl_kind kind;
    uint16_t sender;   /* drawn by the host at random when it connects */
    uint16_t sequence; /* one more for each message */
    uint32_t stamp_ms; /* box time of the newest state that the host received */
    uint16_t latch;    /* number of the latched stop that a re-arm ends */
    /* TL_DRIVE, TL_HOLD: left, right, seat, flipper; TL_SET_LIMITS: largest belt speed, acceleration and deceleration of a hold
     * [mm/s2], watchdog [ms], largest rates of seat and flipper. Others: zero. */
    int16_t values[TL_VALUES];
} tl_message;

/* What the box senses at a tick. */
typedef struct {
    bool dead_man;        /* true where no wired switch is fitted */
    bool stop;            /* wired stop button */
    bool handset;         /* whether a re-arm button is wired; without one, the host's message is the act */
    bool rearm;           /* wired re-arm button */
    uint16_t drive_error; /* error code of the motor drives, 0 without one; also where they measure no speed */
    int16_t belts[2];     /* measured speeds of the belts, left and right [0.1 mm/s] */
} tl_inputs;

/* What the drives do until the next tick. */
typedef struct {
    int32_t belts_um_s[2]; /* set points of the belts, left and right [um/s] */
    int16_t seat;          /* [0.01 mm/s] */
    int16_t flipper;       /* [mrad/s] */
    bool brake;
    bool contactor; /* closed: the drives have power */
} tl_outputs;

/* Memory of the rules; the caller owns it. */
typedef struct {
    uint32_t now_ms;
    uint32_t heard_ms; /* stamp of the newest accepted message */
    uint16_t sender;
    uint16_t sequence;
    uint16_t latch; /* number of latched stops since the start */
    tl_cause cause; /* TL_ARMED, or why the box stands */
    tl_reply reply; /* reason of the newest rejection */
    uint16_t rejections;
    uint16_t held_ms;     /* age of the latched stop; this and the next four end at TL_AGE_MAX */
    uint16_t released_ms; /* time since which the dead-man switch is released during this stop */
    uint16_t pressed_ms;  /* age of the press that may re-arm, TL_AGE_MAX without one */
    uint16_t rearmed_ms;  /* age of the last re-arm */
    uint16_t turned_ms;   /* time since which a belt turns although the box stands */
    bool turns;           /* whether one does */
    bool is_open;         /* the contactor */
    bool drives;          /* TL_DRIVE rather than TL_HOLD */
    int16_t targets[4];
    int16_t limits[TL_VALUES]; /* all zero until they are set */
    int32_t belts_um_s[2];
    tl_inputs inputs;
} tl_rules;

/* What holds of each state that the box reaches; annotations in ACSL, here and below, are proved by make prove. */
/*@ predicate are_unset(tl_rules *r) =
        r->limits[TL_LIMIT_SPEED] == 0 && r->limits[TL_LIMIT_ACCELERATION] == 0 && r->limits[TL_LIMIT_HOLD] == 0 &&
        r->limits[TL_LIMIT_WATCHDOG] == 0 && r->limits[TL_LIMIT_SEAT] == 0 && r->limits[TL_LIMIT_FLIPPER] == 0;

    predicate are_valid(tl_rules *r) =
        r->limits[TL_LIMIT_SPEED] > 0 && r->limits[TL_LIMIT_HOLD] > 0 &&
        r->limits[TL_LIMIT_ACCELERATION] >= r->limits[TL_LIMIT_HOLD] &&
        0 < r->limits[TL_LIMIT_WATCHDOG] <= TL_WATCHDOG_MAX_MS &&
        r->limits[TL_LIMIT_SEAT] >= 0 && r->limits[TL_LIMIT_FLIPPER] >= 0;

    predicate are_within(tl_rules *r) =
        -r->limits[TL_LIMIT_SPEED] <= r->targets[TL_LEFT] <= r->limits[TL_LIMIT_SPEED] &&
        -r->limits[TL_LIMIT_SPEED] <= r->targets[TL_RIGHT] <= r->limits[TL_LIMIT_SPEED] &&
        -r->limits[TL_LIMIT_SEAT] <= r->targets[TL_SEAT] <= r->limits[TL_LIMIT_SEAT] &&
        -r->limits[TL_LIMIT_FLIPPER] <= r->targets[TL_FLIPPER] <= r->limits[TL_LIMIT_FLIPPER] &&
        -100 * r->limits[TL_LIMIT_SPEED] <= r->belts_um_s[TL_LEFT] <= 100 * r->limits[TL_LIMIT_SPEED] &&
        -100 * r->limits[TL_LIMIT_SPEED] <= r->belts_um_s[TL_RIGHT] <= 100 * r->limits[TL_LIMIT_SPEED];

    predicate are_ages(tl_rules *r) =
        r->held_ms <= TL_AGE_MAX && r->released_ms <= TL_AGE_MAX && r->pressed_ms <= TL_AGE_MAX &&
        r->rearmed_ms <= TL_AGE_MAX && r->turned_ms <= TL_AGE_MAX;

    predicate is_sound(tl_rules *r) =
        (are_unset(r) || are_valid(r)) && are_ages(r) &&
        (r->cause == TL_ARMED ==> are_valid(r) && are_within(r) && !r->is_open) &&
        (r->cause != TL_ARMED ==> r->belts_um_s[TL_LEFT] == 0 && r->belts_um_s[TL_RIGHT] == 0);

    logic integer watchdog_of(tl_rules *r) =
        r->limits[TL_LIMIT_WATCHDOG] == 0 ? TL_WATCHDOG_MAX_MS : r->limits[TL_LIMIT_WATCHDOG];

    predicate may_rearm(tl_rules *r) =
        r->limits[TL_LIMIT_SPEED] > 0 && r->inputs.dead_man && !r->inputs.stop && r->inputs.drive_error == 0 && !r->turns &&
        r->held_ms >= TL_HELD_MS && r->rearmed_ms >= TL_AGAIN_MS && (r->inputs.handset ==> r->pressed_ms < TL_PRESS_MS);
*/

/* Latched stop of a box that has just started. */
/*@ requires \valid(rules);
    assigns *rules; */
void tl_rules_start(tl_rules *rules, uint32_t now_ms);

/* Judge a message at the time of the last tick. */
/*@ requires \valid(rules) && \valid_read(message) && \separated(rules, message) && is_sound(rules);
    assigns *rules;
    ensures sound: is_sound(rules);
    ensures no_rearm_without_its_act:
        \old(rules->cause) != TL_ARMED && rules->cause == TL_ARMED ==>
        message->kind == TL_REARM && message->latch == \old(rules->latch) && \old(may_rearm(rules)) &&
        (uint32_t)(\old(rules->now_ms) - message->stamp_ms) < TL_WATCHDOG_MAX_MS;
    ensures a_stop_is_obeyed: message->kind == TL_STOP ==> rules->cause != TL_ARMED; */
tl_reply tl_rules_receive(tl_rules *rules, const tl_message *message);

/* Count a rejected message. */
/*@ requires \valid(rules);
    assigns rules->reply, rules->rejections;
    ensures \result == reply; */
tl_reply tl_rules_reject(tl_rules *rules, tl_reply reply);

/* Advance to a time and return what the drives do; called at least every 10 ms. */
/*@ requires \valid(rules) && \valid_read(inputs) && \separated(rules, inputs) && is_sound(rules);
    assigns *rules;
    ensures sound: is_sound(rules);
    ensures a_latched_box_stands:
        rules->cause != TL_ARMED ==> \result.brake && \result.belts_um_s[TL_LEFT] == 0 && \result.belts_um_s[TL_RIGHT] == 0 &&
        \result.seat == 0 && \result.flipper == 0;
    ensures no_set_point_beyond_its_limit:
        -100 * rules->limits[TL_LIMIT_SPEED] <= \result.belts_um_s[TL_LEFT] <= 100 * rules->limits[TL_LIMIT_SPEED] &&
        -100 * rules->limits[TL_LIMIT_SPEED] <= \result.belts_um_s[TL_RIGHT] <= 100 * rules->limits[TL_LIMIT_SPEED] &&
        -rules->limits[TL_LIMIT_SEAT] <= \result.seat <= rules->limits[TL_LIMIT_SEAT] &&
        -rules->limits[TL_LIMIT_FLIPPER] <= \result.flipper <= rules->limits[TL_LIMIT_FLIPPER];
    ensures the_watchdog_acts_in_time:
        (uint32_t)(now_ms - \old(rules->heard_ms)) >= watchdog_of(rules) ||
        (uint32_t)(now_ms - \old(rules->now_ms)) >= watchdog_of(rules) ==> rules->cause != TL_ARMED;
    ensures no_tick_ends_a_stop: \old(rules->cause) != TL_ARMED ==> rules->cause == \old(rules->cause);
    ensures a_press_is_an_act:
        rules->pressed_ms == 0 && \old(rules->pressed_ms) > 0 ==>
        inputs->rearm && !\old(rules->inputs.rearm) && inputs->dead_man && !inputs->stop && rules->held_ms >= TL_HELD_MS &&
        (\old(rules->inputs.dead_man) || rules->released_ms >= TL_RELEASED_MS) && rules->cause != TL_ARMED;
    ensures a_belt_that_turns_opens_the_contactor:
        rules->turns && rules->turned_ms >= TL_TURNS_MS ==> !\result.contactor && rules->cause != TL_ARMED; */
tl_outputs tl_rules_tick(tl_rules *rules, uint32_t now_ms, const tl_inputs *inputs);

#endif

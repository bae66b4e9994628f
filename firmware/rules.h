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

/* Latched stop of a box that has just started. */
void tl_rules_start(tl_rules *rules, uint32_t now_ms);

/* Judge a message at the time of the last tick. */
tl_reply tl_rules_receive(tl_rules *rules, const tl_message *message);

/* Count a rejected message. */
tl_reply tl_rules_reject(tl_rules *rules, tl_reply reply);

/* Advance to a time and return what the drives do; called at least every 10 ms. */
tl_outputs tl_rules_tick(tl_rules *rules, uint32_t now_ms, const tl_inputs *inputs);

#endif

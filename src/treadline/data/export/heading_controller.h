/* The heading controller of a tracked chair on a stair: the heading in, belt speeds out, once per period.
 *
 * Written by `treadline export`. It is treadline's HeadingController line by line: an observer that carries the constant
 * difference between the belts, an LQR gain, and belt speeds within limits that do not let the chair slide.
 *
 * C99. It allocates nothing, keeps nothing but the state that the caller owns, and needs no library.
 * Signs: heading is anticlockwise seen from above, zero square to the stair; positive speed drives up the stair.
 */
#ifndef HEADING_CONTROLLER_H
#define HEADING_CONTROLLER_H

#include <stdbool.h>

#include "heading_numbers.h"

/* All that is remembered from one call to the next. */
typedef struct {
    double state[HEADING_STATES];
    double disturbance_m_s; /* right belt faster than the left by so much, as learned */
    double given_m_s[2];    /* left, right: asked of the belts last time */
    double seen[2];         /* heading from where to steer [rad], rate [rad/s]: last time */
    bool is_running;
    bool was_limited;
} heading_state;

/* What is known now, and what is wanted. */
typedef struct {
    bool has_estimate; /* false: there is no heading; the chair stands */
    bool steers;       /* false: something else turns the chair, or it is let alone; what was learned of its belts is void */
    double heading_rad;
    double heading_rate_rad_s;
    double speed_m_s;          /* of both belts, negative backs down */
    double target_heading_rad; /* to steer to */
    double min_inner_speed_ratio;      /* of the speed, kept by the slower belt where the chair climbs; HEADING_SLOWEST_CLIMBING by default */
} heading_input;

typedef struct {
    double left_m_s;
    double right_m_s;
    bool brake;
} heading_command;

/* Forget everything, what the belts' difference is as well. */
void heading_reset(heading_state *memory);

/* Answer one estimate; call it every HEADING_PERIOD_S. Without a usable estimate, and where something else steers: zero speed
 * and brake. */
heading_command heading_step(heading_state *memory, const heading_input *input);

#endif

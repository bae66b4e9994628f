/* Heading controller of a tracked chair on a stair: heading in, belt speeds out, once per period.
 *
 * Written by `treadline export`, a line-by-line port of treadline's HeadingController: an observer that estimates a
 * constant belt mismatch, an LQR gain, and belt speeds within limits that keep the chair from sliding.
 *
 * C99 without memory allocation, global state or libraries; the caller owns the state.
 * Signs: heading is anticlockwise seen from above, zero square to the stair; positive speed drives up the stair.
 */
#ifndef HEADING_CONTROLLER_H
#define HEADING_CONTROLLER_H

#include <stdbool.h>

#include "heading_numbers.h"

/* State between calls. */
typedef struct {
    double state[HEADING_STATES];
    double disturbance_m_s; /* estimated belt mismatch, right minus left */
    double yaw_gain_ratio; /* measured yaw gain over the model's, at least 1 */
    double sent_m_s[HEADING_DEAD_TIME + 1][2]; /* commands under way, the last first: left, right, less the planned speed */
    bool limited[HEADING_DEAD_TIME + 1];       /* whether they asked for more than was given */
    double seen[2];         /* previous heading error [rad] and rate [rad/s] */
    bool is_running;
} heading_state;

/* Estimate and plan. */
typedef struct {
    bool has_estimate; /* false: no heading estimate; the chair stops */
    bool steers;       /* false: another controller steers, or steering is suspended; the estimated mismatch is reset */
    double heading_rad;
    double heading_rate_rad_s;
    double speed_m_s;          /* speed of both belts, negative when backing down */
    double target_heading_rad; /* target heading */
    double min_inner_speed_ratio;      /* inner belt speed over the climb speed; HEADING_SLOWEST_CLIMBING by default */
} heading_input;

typedef struct {
    double left_m_s;
    double right_m_s;
    bool brake;
} heading_command;

/* Reset the state, including the estimated mismatch. */
void heading_reset(heading_state *memory);

/* Return the command for one estimate; call every HEADING_PERIOD_S. Without a usable estimate, or while another controller steers:
 * zero speed and brake. */
heading_command heading_step(heading_state *memory, const heading_input *input);

#endif

/* The box at the drives: bytes of the serial line in, set points for the drives and states for the host out.
 *
 * The integrator's main loop, once per tick of 10 ms or less: pass the bytes that have arrived to tl_box_receive, call
 * tl_box_tick, hand its outputs to the motor drives and the brake, and at 100 Hz send what tl_box_state writes. An interrupt or a
 * hardware watchdog of the microcontroller must brake where this loop stops.
 */
#ifndef TL_BOX_H
#define TL_BOX_H

#include "messages.h"

/* Memory of a box; the caller owns it. */
typedef struct {
    tl_rules rules;
    tl_outputs outputs;
    uint8_t frame[TL_FRAME_MAX]; /* bytes since the last zero */
    size_t length;               /* their number, TL_FRAME_MAX if there were too many */
} tl_box;

/* Return the size of a box's memory [bytes], for programs in other languages. */
size_t tl_box_bytes(void);

/* Start a box: latched, without limits. */
void tl_box_start(tl_box *box, uint32_t now_ms);

/* Accept bytes from the host, in whatever portions they arrive. */
void tl_box_receive(tl_box *box, const uint8_t *bytes, size_t count);

/* Advance the box's clock [ms]; return what the drives do. */
tl_outputs tl_box_tick(tl_box *box, uint32_t now_ms, const tl_inputs *inputs);

/* Write the state as a frame for the host; return its length. */
size_t tl_box_state(const tl_box *box, const tl_readings *readings, uint8_t frame[TL_FRAME_MAX]);

#endif

/* Messages between host and box as bytes, least significant first. Byte tables: docs/reference/firmware.md. */
#ifndef TL_MESSAGES_H
#define TL_MESSAGES_H

#include "frame.h"
#include "rules.h"

/* Version of the messages; box and host must have the same one. */
#define TL_MESSAGES_VERSION 2u
#define TL_HOST_BYTES 25u
#define TL_STATE_BYTES 77u
/* Kind of the box's state; those of a host are tl_kind. */
#define TL_STATE_KIND 0x80u

/* Bits of tl_state.flags. */
enum { TL_BRAKE = 1, TL_DEAD_MAN_HELD = 2, TL_STOP_PRESSED = 4, TL_REARM_PRESSED = 8, TL_FLIGHT_ENDS = 16, TL_GO_BACK = 32, TL_OPEN = 64 };
/* Bits of what the box measures, those of tl_readings.present and TL_HAS_HANDSET. */
enum { TL_HAS_IMU = 1, TL_HAS_SEAT = 2, TL_HAS_FLIPPER = 4, TL_HAS_HANDSET = 8, TL_HAS_VOLTAGE = 16 };

/* What the box measured for the host, beside the inputs of its rules; units of 0.1 mrad, 0.1 mrad/s, mm/s2, 0.01 mm, 0.1 N m, mV; quaternion times 16384. */
typedef struct {
    uint8_t present;
    uint8_t buttons; /* bits TL_FLIGHT_ENDS, TL_GO_BACK of the handset */
    uint16_t voltage_mv;
    int16_t orientation[4];
    int16_t rates[3];
    int16_t accelerations[3];
    int16_t seat_pitch;
    int16_t seat_stroke;
    int16_t flipper_angle;
    int16_t flipper_torque;
} tl_readings;

/* Read a host's message; TL_ACCEPTED, TL_BROKEN or TL_VERSION. */
tl_reply tl_message_decode(const uint8_t *content, size_t length, tl_message *message);

/* Write the box's state; return its length. */
size_t tl_state_encode(const tl_rules *rules, const tl_outputs *outputs, const tl_readings *readings, uint8_t content[TL_STATE_BYTES]);

#endif

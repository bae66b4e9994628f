/* Self-test of the box's firmware: each rule at its limit, each way in which bytes can be broken. Returns 0 if all is well.
 *
 * Runs on a computer (make test) and on the target, where `failures` is to be read with a debugger.
 */
#include "box.h"

static const tl_inputs IDLE = {.dead_man = true};
static const int16_t LIMITS[TL_VALUES] = {10000, 4000, 1500, 100, 600, 500};
static const int16_t NONE[TL_VALUES] = {0, 0, 0, 0, 0, 0};
static int failures;
static tl_box box;
static uint16_t sequence;

static void expect(bool is_so) { failures += is_so ? 0 : 1; }

static tl_reply tell(tl_kind kind, const int16_t values[TL_VALUES]) {
    tl_message message = {.kind = (uint8_t)kind, .sender = 7, .sequence = ++sequence, .stamp_ms = box.rules.now_ms};
    message.latch = box.rules.latch;
    for (int i = 0; i < TL_VALUES; i++) {
        message.values[i] = values[i];
    }
    return tl_rules_receive(&box.rules, &message);
}

static tl_reply drive_at(int left, int right, int seat, int flipper) {
    const int16_t values[TL_VALUES] = {(int16_t)left, (int16_t)right, (int16_t)seat, (int16_t)flipper, 0, 0};
    return tell(TL_DRIVE, values);
}

static tl_outputs tick(uint32_t ms) { return tl_box_tick(&box, box.rules.now_ms + ms, &IDLE); }

/* A second in which nobody is heard: every stop is old enough for a re-arm, and every re-arm for the next. */
static void wait(void) {
    for (int i = 0; i < 10; i++) {
        (void)tick(100);
    }
}

/* A box that drives straight at 0.2 m/s, shortly before its clock runs over. */
static void set_off(void) {
    tl_box_start(&box, 0xFFFFFC08u); /* wait() ends at -16 */
    wait();
    expect(tell(TL_SET_LIMITS, LIMITS) == TL_ACCEPTED);
    expect(tell(TL_REARM, NONE) == TL_ACCEPTED);
    expect(drive_at(2000, 2000, 0, 0) == TL_ACCEPTED);
    expect(tick(50).belts_um_s[TL_LEFT] == 200000);
}

static void test_frames(void) {
    uint8_t frame[TL_FRAME_MAX], content[TL_FRAME_MAX];
    const uint8_t bytes[5] = {0, 17, 0, 0, 255};
    const size_t length = tl_frame_encode(bytes, 5, frame);
    expect(tl_crc32((const uint8_t *)"123456789", 9) == 0xCBF43926u);
    expect(length == 11u && frame[10] == 0u);
    expect(tl_frame_decode(frame, length - 1u, content) == 5u && content[1] == 17u && content[4] == 255u);
    expect(tl_frame_decode(frame, length - 2u, content) == 0u); /* cut */
    expect(tl_frame_decode(frame, TL_FRAME_MAX, content) == 0u);
    frame[2] ^= 4u; /* a flipped bit */
    expect(tl_frame_decode(frame, length - 1u, content) == 0u);
}

static void test_bytes(void) {
    uint8_t content[TL_HOST_BYTES] = {TL_MESSAGES_VERSION, TL_STOP, TL_HOST_BYTES};
    uint8_t frame[TL_FRAME_MAX + 8u];
    tl_message message;
    const tl_inputs turning = {.dead_man = true, .handset = true, .rearm = true, .belts = {-1, 1}};
    const tl_readings readings = {.present = TL_HAS_IMU};
    expect(tl_message_decode(content, TL_HOST_BYTES, &message) == TL_ACCEPTED);
    content[13] = 0xFE;
    content[14] = 0xFF;
    expect(tl_message_decode(content, TL_HOST_BYTES, &message) == TL_ACCEPTED && message.values[TL_LEFT] == -2);
    expect(tl_message_decode(content, 0, &message) == TL_BROKEN);
    expect(tl_message_decode(content, TL_HOST_BYTES - 1u, &message) == TL_BROKEN);
    expect(tl_box_bytes() == sizeof box);
    set_off();
    tl_box_receive(&box, frame, tl_frame_encode(content, TL_HOST_BYTES, frame));
    expect(box.rules.cause == TL_STOPPED && tick(10).belts_um_s[TL_LEFT] == 0);
    content[1] = TL_SET_LIMITS + 1;
    tl_box_receive(&box, frame, tl_frame_encode(content, TL_HOST_BYTES, frame));
    expect(box.rules.reply == TL_BROKEN);
    content[1] = 0;
    expect(tl_message_decode(content, TL_HOST_BYTES, &message) == TL_BROKEN);
    content[2] = 0;
    expect(tl_message_decode(content, TL_HOST_BYTES, &message) == TL_BROKEN);
    content[0] = TL_MESSAGES_VERSION + 1;
    tl_box_receive(&box, frame, tl_frame_encode(content, TL_HOST_BYTES, frame));
    expect(box.rules.reply == TL_VERSION && box.rules.rejections == 2u);
    for (size_t i = 0; i < sizeof frame; i++) {
        frame[i] = (uint8_t)(i + 1u < sizeof frame); /* ones without an end, a zero, and a zero more */
    }
    tl_box_receive(&box, frame, sizeof frame);
    tl_box_receive(&box, frame + sizeof frame - 1u, 1);
    expect(box.rules.reply == TL_BROKEN && box.rules.rejections == 3u);
    (void)tl_box_tick(&box, box.rules.now_ms, &turning);
    const size_t length = tl_box_state(&box, &readings, frame);
    expect(length == TL_STATE_BYTES + 6u && tl_frame_decode(frame, length - 1u, frame) == TL_STATE_BYTES);
    expect(frame[9] == TL_STOPPED && frame[10] == (TL_BRAKE | TL_DEAD_MAN_HELD | TL_REARM_PRESSED));
    expect(frame[11] == (TL_HAS_IMU | TL_HAS_HANDSET) && frame[43] == 0xFFu && frame[45] == 1u);
}

static void test_limits(void) {
    for (int i = 0; i < TL_VALUES; i++) {
        int16_t values[TL_VALUES];
        for (int j = 0; j < TL_VALUES; j++) {
            values[j] = i == j ? -1 : LIMITS[j];
        }
        tl_box_start(&box, 0);
        expect(tell(TL_SET_LIMITS, LIMITS) == TL_ACCEPTED && tell(TL_SET_LIMITS, values) == TL_BEYOND);
        expect(tell(TL_REARM, NONE) == TL_NO_LIMITS);
    }
    const int16_t slow[TL_VALUES] = {10000, 4000, 1500, (int16_t)TL_WATCHDOG_MAX_MS + 1, 600, 500};
    expect(tell(TL_SET_LIMITS, slow) == TL_BEYOND);
    set_off();
    expect(drive_at(10001, 0, 0, 0) == TL_BEYOND && drive_at(-10001, 0, 0, 0) == TL_BEYOND && drive_at(0, 10001, 0, 0) == TL_BEYOND);
    expect(drive_at(0, 0, -601, 0) == TL_BEYOND && drive_at(0, 0, 0, 501) == TL_BEYOND);
    expect(drive_at(10000, -10000, 600, -500) == TL_ACCEPTED);
    const tl_outputs outputs = tick(10); /* 4 m/s2 in 10 ms */
    expect(outputs.belts_um_s[TL_LEFT] == 240000 && outputs.belts_um_s[TL_RIGHT] == 160000);
    expect(outputs.seat == 600 && outputs.flipper == -500 && !outputs.brake);
}

static void test_stops(void) {
    set_off();
    expect(tick(49).belts_um_s[TL_LEFT] == 200000 && tick(1).belts_um_s[TL_LEFT] == 0); /* 100 ms after the command's stamp */
    expect(box.rules.cause == TL_WATCHDOG && box.rules.latch == 2u && tick(0).brake);
    expect(drive_at(0, 0, 0, 0) == TL_NOT_NOW && tell(TL_STOP, NONE) == TL_ACCEPTED && box.rules.cause == TL_WATCHDOG);
    tl_message message = {.kind = TL_REARM, .sender = 7, .stamp_ms = box.rules.now_ms, .latch = 1};
    expect(tl_rules_receive(&box.rules, &message) == TL_OLD_LATCH);
    expect(tell(TL_REARM, NONE) == TL_BLOCKED); /* the stop is too young */
    wait();
    expect(tell(TL_REARM, NONE) == TL_ACCEPTED && tick(10).brake && box.rules.cause == TL_ARMED);
    expect(tell(TL_REARM, NONE) == TL_NOT_NOW && tell(TL_SET_LIMITS, LIMITS) == TL_NOT_NOW);

    set_off();
    expect(tell(TL_HOLD, NONE) == TL_ACCEPTED && tick(10).belts_um_s[TL_LEFT] == 185000 && !tick(0).brake);
    expect(drive_at(0, 2000, 0, 0) == TL_ACCEPTED && tick(10).belts_um_s[TL_LEFT] == 145000);
    expect(drive_at(1450, 0, 0, 0) == TL_ACCEPTED && tick(40).belts_um_s[TL_RIGHT] == 40000 && tell(TL_HOLD, NONE) == TL_ACCEPTED);
    expect(!tick(40).brake && box.rules.belts_um_s[TL_RIGHT] == 0 && tell(TL_HOLD, NONE) == TL_ACCEPTED);
    expect(tick(80).brake && box.rules.cause == TL_ARMED);
    expect(drive_at(0, 2000, 0, 0) == TL_ACCEPTED && tick(20).belts_um_s[TL_LEFT] == 0 && tell(TL_HOLD, NONE) == TL_ACCEPTED);
    expect(!tick(10).brake);

    set_off(); /* a clock that is set back, or a loop that stood still */
    expect(tl_box_tick(&box, box.rules.now_ms - 30u, &IDLE).brake && box.rules.cause == TL_WATCHDOG);

    set_off(); /* stopped, and the re-arm before is too young */
    expect(tell(TL_STOP, NONE) == TL_ACCEPTED && tell(TL_SET_LIMITS, LIMITS) == TL_ACCEPTED && tell(TL_REARM, NONE) == TL_BLOCKED);
    for (int i = 0; i < 10; i++) {
        expect(tick(95).belts_um_s[TL_LEFT] == 0 && tell(TL_REARM, NONE) == (i < 9 ? TL_BLOCKED : TL_ACCEPTED));
    }

    set_off();
    sequence--; /* the same message again */
    expect(drive_at(0, 0, 0, 0) == TL_OUT_OF_ORDER);
    sequence -= 9;
    expect(drive_at(0, 0, 0, 0) == TL_OUT_OF_ORDER);
    message.kind = TL_DRIVE;
    message.stamp_ms = box.rules.now_ms - 100u;
    expect(tl_rules_receive(&box.rules, &message) == TL_STALE && box.rules.cause == TL_ARMED);
    message.sender = 8;
    expect(tl_rules_receive(&box.rules, &message) == TL_FOREIGN && box.rules.cause == TL_TWO_HOSTS);
}

static void test_inputs(void) {
    const tl_inputs blocks[3] = {{.dead_man = false}, {.dead_man = true, .stop = true}, {.dead_man = true, .drive_error = 0x11}};
    const uint8_t causes[3] = {TL_DEAD_MAN, TL_BUTTON, TL_DRIVE_ERROR};
    const tl_readings readings = {.buttons = 0xFF}; /* of which two are reported */
    for (int i = 0; i < 3; i++) {
        uint8_t content[TL_STATE_BYTES];
        set_off();
        (void)tl_state_encode(&box.rules, &box.outputs, &readings, content);
        expect((content[10] & TL_BRAKE) == 0);
        const tl_outputs outputs = tl_box_tick(&box, box.rules.now_ms, &blocks[i]);
        expect(outputs.brake && outputs.belts_um_s[TL_RIGHT] == 0 && box.rules.cause == causes[i]);
        wait();
        (void)tl_box_tick(&box, box.rules.now_ms, &blocks[i]);
        expect(tell(TL_REARM, NONE) == TL_BLOCKED);
        expect(tl_state_encode(&box.rules, &outputs, &readings, content) == TL_STATE_BYTES);
        expect((content[10] & TL_STOP_PRESSED) == (blocks[i].stop ? TL_STOP_PRESSED : 0));
        expect((content[10] & (TL_REARM_PRESSED | TL_FLIGHT_ENDS | TL_GO_BACK)) == (TL_FLIGHT_ENDS | TL_GO_BACK));
        expect(tick(10).brake && tell(TL_REARM, NONE) == TL_ACCEPTED);
    }
}

/* Hold switches of a handset for a time. */
static void hand(uint32_t ms, bool dead_man, bool rearm, bool stop) {
    const tl_inputs inputs = {.dead_man = dead_man, .stop = stop, .handset = true, .rearm = rearm};
    (void)tl_box_tick(&box, box.rules.now_ms, &inputs);
    for (uint32_t passed = 0; passed < ms; passed += 50u) {
        (void)tl_box_tick(&box, box.rules.now_ms + 50u, &inputs);
    }
}

/* A drive for a second, and a stop. */
static void stop_again(void) {
    set_off();
    (void)tell(TL_STOP, NONE);
    hand(0, true, false, false);
}

static void test_acts(void) {
    stop_again(); /* another key, pressed late enough and not long ago, and once */
    hand(1000, true, false, false);
    expect(tell(TL_REARM, NONE) == TL_BLOCKED);
    hand(250, true, true, false);
    expect(tell(TL_REARM, NONE) == TL_ACCEPTED);
    hand(50, true, true, false);
    (void)tell(TL_STOP, NONE);
    hand(1000, true, true, false);
    expect(tell(TL_REARM, NONE) == TL_BLOCKED);
    hand(0, true, false, false);
    hand(300, true, true, false);
    expect(tell(TL_REARM, NONE) == TL_BLOCKED);

    stop_again(); /* too early, and held on */
    hand(400, true, false, false);
    hand(700, true, true, false);
    expect(tell(TL_REARM, NONE) == TL_BLOCKED);

    stop_again(); /* one key that is both, released for too short and for long enough */
    hand(600, true, true, false);
    hand(700, false, false, false);
    hand(50, true, true, false);
    expect(tell(TL_REARM, NONE) == TL_BLOCKED);
    hand(750, false, false, false);
    hand(50, true, true, false);
    hand(50, true, true, true);
    hand(0, true, true, false);
    expect(tell(TL_REARM, NONE) == TL_BLOCKED); /* with the stop button */
    hand(750, false, false, false);
    hand(50, true, true, false);
    expect(tell(TL_REARM, NONE) == TL_ACCEPTED);
    hand(10, true, false, false); /* a press of an armed box is none of its next stop */
    hand(10, true, true, false);
    expect(box.rules.pressed_ms == TL_AGE_MAX);
}

/* Measured speeds of the belts for a time; returns whether the contactor is closed then. */
static bool turn(uint32_t ms, int left, int right) {
    const tl_inputs inputs = {.dead_man = true, .belts = {(int16_t)left, (int16_t)right}};
    bool is_closed = tl_box_tick(&box, box.rules.now_ms, &inputs).contactor;
    for (uint32_t passed = 0; passed < ms; passed += 10u) {
        (void)tell(TL_HOLD, NONE);
        is_closed = tl_box_tick(&box, box.rules.now_ms + 10u, &inputs).contactor;
    }
    return is_closed;
}

static void test_belts(void) {
    const int fast[4][2] = {{501, 0}, {-501, 0}, {0, 501}, {0, -501}};
    for (int i = 0; i < 4; i++) {
        set_off();
        expect(turn(300, 2000, 2000) && turn(1000, 500, -500)); /* the set points are zero after 0.14 s */
        expect(turn(190, fast[i][0], fast[i][1]) && turn(10, 0, 0) && turn(190, fast[i][0], fast[i][1]));
        expect(!turn(10, fast[i][0], fast[i][1]) && box.rules.cause == TL_RUNAWAY);
        expect(!turn(1000, fast[i][0], 501) && tell(TL_REARM, NONE) == TL_BLOCKED);
        expect(!turn(0, 0, 0) && tell(TL_REARM, NONE) == TL_ACCEPTED && turn(10, 0, 0) && box.rules.cause == TL_ARMED);
    }
    set_off();
    (void)tell(TL_STOP, NONE);
    expect(turn(190, 2000, 0) && !turn(10, 2000, 0) && box.rules.cause == TL_STOPPED); /* the first cause stays */
}

int main(void) {
    test_frames();
    test_bytes();
    test_limits();
    test_stops();
    test_inputs();
    test_acts();
    test_belts();
    return failures == 0 ? 0 : 1;
}

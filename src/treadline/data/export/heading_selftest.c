/* Replay a log through the controller and compare the commands with treadline's.
 *
 *     cc -std=c99 -O2 heading_controller.c heading_selftest.c -o heading_selftest && ./heading_selftest
 */
#include <math.h> /* for NAN only */
#include <stdio.h>

#include "heading_controller.h"
#include "heading_log.h"

static double gap(double a, double b) { return a < b ? b - a : a - b; }

int main(void) {
    heading_state memory;
    double largest = 0.0;
    heading_reset(&memory);
    for (int k = 0; k < HEADING_LOG_LENGTH; k++) {
        const heading_command got = heading_step(&memory, &HEADING_LOG[k].input);
        const heading_command wanted = HEADING_LOG[k].answer;
        const double left = gap(got.left_m_s, wanted.left_m_s), right = gap(got.right_m_s, wanted.right_m_s);
        if (got.brake != wanted.brake || !(left <= HEADING_TOLERANCE_M_S) || !(right <= HEADING_TOLERANCE_M_S)) {
            printf("step %d: %.9f %.9f, brake %d; wanted %.9f %.9f, brake %d\n", k, got.left_m_s, got.right_m_s, got.brake,
                   wanted.left_m_s, wanted.right_m_s, wanted.brake);
            return 1;
        }
        largest = left > largest ? left : largest;
        largest = right > largest ? right : largest;
    }
    printf("%d steps agree; largest gap %.1e m/s\n", HEADING_LOG_LENGTH, largest);
    return 0;
}

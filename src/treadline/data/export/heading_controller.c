/* State feedback u = speed - K x - disturbance on both belts, within their limits. See heading_controller.h. */
#include "heading_controller.h"

#define N HEADING_STATES

static const double PI = 3.14159265358979323846;
static const double BELT_DIFFERENCE[2] = {-0.5, 0.5}; /* direction of the disturbance: right belt faster */

static double magnitude(double value) { return value < 0.0 ? -value : value; }

static double within(double value, double limit) { return value < -limit ? -limit : value > limit ? limit : value; }

/* NaN fails every comparison and is therefore rejected. */
static bool is_usable(const heading_input *input) {
    return input->has_estimate && magnitude(input->heading_rad) <= PI &&
           magnitude(input->heading_rate_rad_s) <= HEADING_FASTEST_TURN_RAD_S && magnitude(input->target_heading_rad) <= PI &&
           magnitude(input->speed_m_s) <= HEADING_MAX_SPEED_M_S && magnitude(input->min_inner_speed_ratio) <= 1.0;
}

#if HEADING_STATIC
/* Static reconstruction x = (C - DK)^-1 y, without memory (Eq. 11b of the paper). */
static void find_state(heading_state *memory, const double y[2], double speed_m_s, double x[N]) {
    static const double INVERSE[N][2] = HEADING_INVERSE;
    static const double OUTPUT_OFFSET[2] = HEADING_OUTPUT_OFFSET;
    (void)speed_m_s;
    memory->disturbance_m_s = 0.0;
    for (int i = 0; i < N; i++) {
        x[i] = INVERSE[i][0] * (y[0] - OUTPUT_OFFSET[0]) + INVERSE[i][1] * (y[1] - OUTPUT_OFFSET[1]);
    }
}
#else
static const double C[2][N] = HEADING_C;
static const double OUTPUT_OFFSET[2] = HEADING_OUTPUT_OFFSET;

static void output_of(const double x[N], double y[2]) {
    for (int p = 0; p < 2; p++) {
        y[p] = OUTPUT_OFFSET[p];
        for (int j = 0; j < N; j++) {
            y[p] += C[p][j] * x[j];
        }
    }
}

/* Advance one period with the saturated belt speeds, so that limits cause no windup. */
static void go_on(heading_state *memory, double speed_m_s) {
    static const double A[N][N] = HEADING_A;
    static const double B[N][2] = HEADING_B;
    static const double D[2][2] = HEADING_D;
    static const double GAIN[N][2] = HEADING_OBSERVER_GAIN;
    double acting[2], innovation[2], next[N];
    for (int m = 0; m < 2; m++) {
        acting[m] = memory->given_m_s[m] - speed_m_s + memory->disturbance_m_s * BELT_DIFFERENCE[m];
    }
    output_of(memory->state, innovation);
    for (int p = 0; p < 2; p++) {
        innovation[p] = memory->seen[p] - innovation[p] - D[p][0] * acting[0] - D[p][1] * acting[1];
    }
    for (int i = 0; i < N; i++) {
        next[i] = B[i][0] * acting[0] + B[i][1] * acting[1] + GAIN[i][0] * innovation[0] + GAIN[i][1] * innovation[1];
        for (int j = 0; j < N; j++) {
            next[i] += A[i][j] * memory->state[j];
        }
    }
    for (int i = 0; i < N; i++) {
        memory->state[i] = next[i];
    }
#if HEADING_LEARNS
    const double predicted = memory->seen[1] - innovation[1];
    const bool sticks = magnitude(predicted) > 3.0 * HEADING_YAW_RATE_SIGMA_RAD_S &&
                        magnitude(memory->seen[1]) < HEADING_YAW_RATE_SIGMA_RAD_S; /* dead zone: the inner belt sticks */
    if (!memory->was_limited && !sticks) {
        static const double LEARNING[2] = HEADING_DISTURBANCE_GAIN;
        memory->disturbance_m_s = within(
            memory->disturbance_m_s + LEARNING[0] * innovation[0] + LEARNING[1] * innovation[1], HEADING_DISTURBANCE_LIMIT_M_S);
    }
#endif
}

/* State of the observer, corrected by the current measurement. */
static void find_state(heading_state *memory, const double y[2], double speed_m_s, double x[N]) {
    static const double START[N][2] = HEADING_START;
    static const double CORRECTION[N][2] = HEADING_CORRECTION;
    double unexplained[2];
    if (memory->is_running) {
        go_on(memory, speed_m_s);
    } else {
        for (int i = 0; i < N; i++) {
            memory->state[i] = START[i][0] * (y[0] - OUTPUT_OFFSET[0]) + START[i][1] * (y[1] - OUTPUT_OFFSET[1]);
        }
    }
    output_of(memory->state, unexplained);
    if (memory->is_running && memory->was_limited) {
        /* Yaw gain after a period at the largest belt speed difference. */
        const bool is_turning = magnitude(unexplained[1]) > 3.0 * HEADING_YAW_RATE_SIGMA_RAD_S;
        const double ratio = is_turning ? y[1] / unexplained[1] : 1.0;
        memory->yaw_gain_ratio = ratio > 1.0 ? ratio : 1.0;
    }
    for (int p = 0; p < 2; p++) {
        unexplained[p] = y[p] - unexplained[p];
    }
    for (int i = 0; i < N; i++) {
        x[i] = memory->state[i] + CORRECTION[i][0] * unexplained[0] + CORRECTION[i][1] * unexplained[1];
    }
}
#endif

#if HEADING_CLIMB_SAFE
/* Demanded steering within the limits; the inner belt keeps its ratio of the climb speed. */
static void allocate(const double asked[2], double speed_m_s, double share, double yaw_gain_ratio, double given[2]) {
    const double slowest = share * speed_m_s;
    const double by_belt = 0.5 * (HEADING_MAX_SPEED_M_S - slowest);
    const double by_mean = HEADING_MAX_MEAN_M_S - slowest;
    const double most = (by_belt < by_mean ? by_belt : by_mean) / yaw_gain_ratio;
    const double half = within(0.5 * (asked[1] - asked[0]), most);
    const double least = magnitude(half) + slowest;
    const double common = speed_m_s > least ? speed_m_s : least;
    given[0] = common - half;
    given[1] = common + half;
}
#else
static void allocate(const double asked[2], double speed_m_s, double share, double yaw_gain_ratio, double given[2]) {
    (void)speed_m_s;
    (void)share;
    (void)yaw_gain_ratio;
    given[0] = within(asked[0], HEADING_MAX_SPEED_M_S);
    given[1] = within(asked[1], HEADING_MAX_SPEED_M_S);
}
#endif

/* Backing down: no belt may run uphill, and no belt may run down faster than 1.5 times the commanded speed. */
static void allocate_down(const double asked[2], double speed_m_s, double given[2]) {
    const double half = within(0.5 * (asked[1] - asked[0]), (1.0 - HEADING_SLOWEST_BACKING) * magnitude(speed_m_s));
    given[0] = speed_m_s - half;
    given[1] = speed_m_s + half;
}

void heading_reset(heading_state *memory) {
    const heading_state nothing = {{0.0}, 0.0, 1.0, {0.0, 0.0}, {0.0, 0.0}, false, false};
    *memory = nothing;
}

heading_command heading_step(heading_state *memory, const heading_input *input) {
    static const double K[2][N] = HEADING_K;
    const heading_command stop = {0.0, 0.0, true};
    heading_command command = {0.0, 0.0, false};
    double x[N], y[2], asked[2], given[2];
    if (!input->steers) {
        heading_reset(memory);
        return stop;
    }
    if (!is_usable(input)) {
        /* The state is observed again within one period; the belt mismatch took many, so it is kept. */
        memory->is_running = false;
        return stop;
    }
    y[0] = input->heading_rad - input->target_heading_rad;
    y[1] = input->heading_rate_rad_s;
    find_state(memory, y, input->speed_m_s, x);
    for (int m = 0; m < 2; m++) {
        asked[m] = input->speed_m_s - memory->disturbance_m_s * BELT_DIFFERENCE[m];
        for (int j = 0; j < N; j++) {
            asked[m] -= K[m][j] * x[j];
        }
    }
    if (input->speed_m_s < 0.0) {
        allocate_down(asked, input->speed_m_s, given);
    } else {
        allocate(asked, input->speed_m_s, input->min_inner_speed_ratio, memory->yaw_gain_ratio, given);
    }
    for (int m = 0; m < 2; m++) {
        memory->given_m_s[m] = given[m];
        memory->seen[m] = y[m];
    }
    memory->was_limited = magnitude((given[1] - given[0]) - (asked[1] - asked[0])) > 1e-9;
    memory->is_running = true;
    command.left_m_s = given[0];
    command.right_m_s = given[1];
    return command;
}

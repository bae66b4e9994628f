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

/* Put a command into the queue of those under way. */
static void send(heading_state *memory, double left_m_s, double right_m_s, bool limited) {
    for (int k = HEADING_DEAD_TIME; k > 0; k--) {
        memory->sent_m_s[k][0] = memory->sent_m_s[k - 1][0];
        memory->sent_m_s[k][1] = memory->sent_m_s[k - 1][1];
        memory->limited[k] = memory->limited[k - 1];
    }
    memory->sent_m_s[0][0] = left_m_s;
    memory->sent_m_s[0][1] = right_m_s;
    memory->limited[0] = limited;
}

static double law(const double x[N], int m) {
    static const double K[2][N] = HEADING_K;
    double answer = 0.0;
    for (int j = 0; j < N; j++) {
        answer -= K[m][j] * x[j];
    }
    return answer;
}

#if HEADING_STATIC
/* Static reconstruction x = (C - DK)^-1 y, without memory (Eq. 11b of the paper). */
static void find_state(heading_state *memory, const double y[2], double x[N]) {
    static const double INVERSE[N][2] = HEADING_INVERSE;
    static const double OUTPUT_OFFSET[2] = HEADING_OUTPUT_OFFSET;
    memory->disturbance_m_s = 0.0;
    for (int i = 0; i < N; i++) {
        x[i] = INVERSE[i][0] * (y[0] - OUTPUT_OFFSET[0]) + INVERSE[i][1] * (y[1] - OUTPUT_OFFSET[1]);
    }
}
#else
static const double A[N][N] = HEADING_A;
static const double B[N][2] = HEADING_B;
static const double OUTPUT_OFFSET[2] = HEADING_OUTPUT_OFFSET;
static const int INPUT_DELAY[2] = HEADING_INPUT_DELAY;

/* Command sent some periods ago, with the disturbance that it meets. */
static double acting_of(const heading_state *memory, int m, int ago) {
    return memory->sent_m_s[ago][m] + memory->disturbance_m_s * BELT_DIFFERENCE[m];
}

static void output_of(const double x[N], const double acting[2], double y[2]) {
    static const double C[2][N] = HEADING_C;
    static const double D[2][2] = HEADING_D;
    for (int p = 0; p < 2; p++) {
        y[p] = OUTPUT_OFFSET[p] + D[p][0] * acting[0] + D[p][1] * acting[1];
        for (int j = 0; j < N; j++) {
            y[p] += C[p][j] * x[j];
        }
    }
}

static void advance(double x[N], const double acting[2]) {
    double next[N];
    for (int i = 0; i < N; i++) {
        next[i] = B[i][0] * acting[0] + B[i][1] * acting[1];
        for (int j = 0; j < N; j++) {
            next[i] += A[i][j] * x[j];
        }
    }
    for (int i = 0; i < N; i++) {
        x[i] = next[i];
    }
}

static bool was_limited(const heading_state *memory) { return memory->limited[INPUT_DELAY[0]] || memory->limited[INPUT_DELAY[1]]; }

/* Advance one period with the saturated belt speeds, so that limits cause no windup. */
static void go_on(heading_state *memory) {
    static const double GAIN[N][2] = HEADING_OBSERVER_GAIN;
    const double acting[2] = {acting_of(memory, 0, INPUT_DELAY[0]), acting_of(memory, 1, INPUT_DELAY[1])};
    double innovation[2];
    output_of(memory->state, acting, innovation);
    for (int p = 0; p < 2; p++) {
        innovation[p] = memory->seen[p] - innovation[p];
    }
    advance(memory->state, acting);
    for (int i = 0; i < N; i++) {
        memory->state[i] += GAIN[i][0] * innovation[0] + GAIN[i][1] * innovation[1];
    }
#if HEADING_LEARNS
    const double predicted = memory->seen[1] - innovation[1];
    const bool sticks = magnitude(predicted) > 3.0 * HEADING_YAW_RATE_SIGMA_RAD_S &&
                        magnitude(memory->seen[1]) < HEADING_YAW_RATE_SIGMA_RAD_S; /* dead zone: the inner belt sticks */
    if (!was_limited(memory) && !sticks) {
        static const double LEARNING[2] = HEADING_DISTURBANCE_GAIN;
        memory->disturbance_m_s = within(
            memory->disturbance_m_s + LEARNING[0] * innovation[0] + LEARNING[1] * innovation[1], HEADING_DISTURBANCE_LIMIT_M_S);
    }
#endif
}

/* State of the observer, corrected by the current measurement. */
static void find_state(heading_state *memory, const double y[2], double x[N]) {
    static const double START[N][2] = HEADING_START;
    static const double CORRECTION[N][2] = HEADING_CORRECTION;
    double unexplained[2], known[2];
    if (memory->is_running) {
        go_on(memory);
    } else {
        for (int i = 0; i < N; i++) {
            memory->state[i] = START[i][0] * (y[0] - OUTPUT_OFFSET[0]) + START[i][1] * (y[1] - OUTPUT_OFFSET[1]);
        }
    }
    for (int m = 0; m < 2; m++) {
        /* Without dead time the command of this period is still to be chosen. */
        known[m] = INPUT_DELAY[m] > 0 ? acting_of(memory, m, INPUT_DELAY[m] - 1) : 0.0;
    }
    output_of(memory->state, known, unexplained);
    if (memory->is_running && was_limited(memory)) {
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

#if HEADING_DEAD_TIME
/* Answer of the law to the state when each command will act, from the commands under way. */
static void answer_ahead(const heading_state *memory, double x[N], double answer[2]) {
    for (int ahead = 0; ahead < HEADING_DEAD_TIME; ahead++) {
        double acting[2];
        for (int m = 0; m < 2; m++) {
            acting[m] = INPUT_DELAY[m] > ahead ? acting_of(memory, m, INPUT_DELAY[m] - 1 - ahead) : law(x, m);
        }
        advance(x, acting);
        for (int m = 0; m < 2; m++) {
            answer[m] = INPUT_DELAY[m] > ahead ? law(x, m) : answer[m];
        }
    }
}
#endif
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
    const heading_state nothing = {{0.0}, 0.0, 1.0, {{0.0, 0.0}}, {false}, {0.0, 0.0}, false};
    *memory = nothing;
}

heading_command heading_step(heading_state *memory, const heading_input *input) {
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
        send(memory, 0.0, 0.0, false);
        return stop;
    }
    y[0] = input->heading_rad - input->target_heading_rad;
    y[1] = input->heading_rate_rad_s;
    find_state(memory, y, x);
    asked[0] = law(x, 0);
    asked[1] = law(x, 1);
#if HEADING_DEAD_TIME
    answer_ahead(memory, x, asked);
#endif
    for (int m = 0; m < 2; m++) {
        asked[m] += input->speed_m_s - memory->disturbance_m_s * BELT_DIFFERENCE[m];
        memory->seen[m] = y[m];
    }
    if (input->speed_m_s < 0.0) {
        allocate_down(asked, input->speed_m_s, given);
    } else {
        allocate(asked, input->speed_m_s, input->min_inner_speed_ratio, memory->yaw_gain_ratio, given);
    }
    send(memory, given[0] - input->speed_m_s, given[1] - input->speed_m_s,
         magnitude((given[1] - given[0]) - (asked[1] - asked[0])) > 1e-9);
    memory->is_running = true;
    command.left_m_s = given[0];
    command.right_m_s = given[1];
    return command;
}

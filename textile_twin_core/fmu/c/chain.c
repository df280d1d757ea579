/* An elastic main shaft between events, at events, and over a communication step.
   SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>
#include "textile_twin.h"

#define TURN 6.283185307179586
#define BESIDE 1e-10       /* angle [rad] past an event at which it counts in model exchange */
#define REVERSED 1e-9      /* speed against the direction [rad/s] that counts as a standstill passed */
#define TOLERANCE 1e-13    /* error of a step: of angles [rad], and of speeds over 1 rad/s and the speed */
#define ROUNDING 1e-14
#define CLOSE 1e-17        /* time [s] to which an event is located */
#define LARGEST_ANGLE 0.05 /* of a step [rad], so that no step of a load is passed over */
#define MOST_STEPS 100000000L
#define N TT_STATIONS
#define H TT_HANGERS

static double square(double x) { return x * x; }

/* Tables of the hangers. */

static int place(int profile, double angle, double *u) {
    int begin = tt_node_begin[profile], nodes = tt_node_begin[profile + 1] - begin, node;
    double turns = angle / TURN, x = (turns - floor(turns)) * nodes;
    node = (int)x < nodes - 1 ? (int)x : nodes - 1;
    *u = x - node;
    return begin + node;
}

static double function(int row, int number, double u) {
    const double *t = tt_table[row][number];
    return t[0] + u * t[1] + u * u * (t[2] + u * t[3]);
}

/* Rounding of an angle, towards the way that it turns [rad]. */
static double nearly(double angle, int sense) {
    double near = 1e-13 + 1e-15 * fabs(angle);
    return sense >= 0 ? near : -near;
}

/* Entry of the coefficients that holds at a crank angle, turning forward (1) or backward (-1). */
static int stretch_at(int profile, double angle, int sense) {
    int direction = sense >= 0 ? 0 : 1, first = tt_start_begin[direction][profile];
    int last = tt_start_begin[direction][profile + 1], j = first;
    double at = angle - TURN * floor(angle / TURN) + nearly(angle, sense);
    while (j < last && tt_starts[j] <= at) ++j;
    return j > first ? j - 1 : last - 1;
}

static void find_stretch(tt_state *s, int k, double angle, int sense) {
    int direction = sense >= 0 ? 0 : 1, first = tt_start_begin[direction][tt_profile[k]];
    int last = tt_start_begin[direction][tt_profile[k] + 1], row = stretch_at(tt_profile[k], angle, sense);
    double low, after;
    s->row[k] = row;
    s->low[k] = -HUGE_VAL;
    s->high[k] = HUGE_VAL;
    if (last - first < 2) return;
    low = tt_starts[row];
    low += TURN * floor((angle - low) / TURN + 0.5 * nearly(angle, sense));
    after = row + 1 < last ? tt_starts[row + 1] : tt_starts[first] + TURN;
    s->low[k] = low;
    s->high[k] = low + after - tt_starts[row];
}

static void step_stretch(tt_state *s, int k, int forward) {
    int row = s->row[k], direction = row < tt_start_begin[1][0] ? 0 : 1, first = tt_start_begin[direction][tt_profile[k]];
    int last = tt_start_begin[direction][tt_profile[k] + 1], after, before;
    double gap;
    if (forward) {
        row = row + 1 < last ? row + 1 : first;
        after = row + 1 < last ? row + 1 : first;
        s->low[k] = s->high[k];
        gap = tt_starts[after] - tt_starts[row];
        s->high[k] += gap > 0.0 ? gap : gap + TURN;
    } else {
        before = row > first ? row - 1 : last - 1;
        gap = tt_starts[row] - tt_starts[before];
        row = before;
        s->high[k] = s->low[k];
        s->low[k] -= gap > 0.0 ? gap : gap + TURN;
    }
    s->row[k] = row;
}

static double load_torque(int k, int held, int row, double u, double omega) {
    double torque = 0.0;
    int j;
    for (j = 0; j < TT_LOADS; ++j) {
        double c = tt_coefficients[held][j];
        int power = tt_powers[tt_profile[k]][j];
        if (c != 0.0) torque += c * function(row, 3 + j, u) * (power == 0 ? 1.0 : power == 1 ? omega : omega * omega);
    }
    return torque;
}

/* Inertia of a station, and the torque on it from what hangs there. */
static double hung(const tt_state *s, int i, double angle, double omega, double *torque) {
    double mass = s->inertia[i];
    int k;
    *torque = 0.0;
    for (k = tt_first[i]; k < tt_first[i + 1]; ++k) {
        double u;
        int row = place(tt_profile[k], angle + tt_phase[k], &u);
        mass += function(row, 0, u);
        *torque -= function(row, 1, u) * omega * omega + function(row, 2, u);
        *torque += load_torque(k, s->row[k], row, u, omega);
    }
    return mass;
}

/* How much more the loads of a station that stands would push it forward if it turned backward [N m]. */
static double friction(int i, double angle) {
    double more = 0.0;
    int k, j;
    for (k = tt_first[i]; k < tt_first[i + 1]; ++k) {
        double u, at = angle + tt_phase[k];
        int row = place(tt_profile[k], at, &u);
        int forward = stretch_at(tt_profile[k], at, 1), backward = stretch_at(tt_profile[k], at, -1);
        for (j = 0; j < TT_LOADS; ++j)
            if (tt_powers[tt_profile[k]][j] == 0)
                more += (tt_coefficients[backward][j] - tt_coefficients[forward][j]) * function(row, 3 + j, u);
    }
    return more;
}

/* The equation of motion. y: angle of the first station, twists, speeds. */

static void full_state(const tt_state *s, double later, const double *x, double *y) {
#if TT_TORQUE_INPUT
    (void)s; (void)later;
    memcpy(y, x, 2 * N * sizeof(double));
#else
    int i;
    double omega = s->omega + later * s->alpha;
    y[0] = s->theta + later * (s->omega + 0.5 * later * s->alpha);
    for (i = 0; i < TT_PIECES; ++i) {
        y[1 + i] = x[i];
        if (i < TT_FIXED) y[0] += x[i];
    }
    for (i = 0; i < N; ++i) y[N + i] = omega + (i == TT_FIXED ? 0.0 : x[TT_PIECES + i - (i > TT_FIXED)]);
#endif
}

static double piece_torque(const tt_state *s, int i, const double *y) {
    if (!s->side[i]) return 0.0;
    return s->stiffness[i] * (y[1 + i] - s->side[i] * s->half_play[i]) + s->damping[i] * (y[N + i] - y[N + i + 1]);
}

static void slopes(tt_state *s, const double *y, double *slope) {
    double angle = y[0], before = 0.0;
    int i;
    slope[0] = y[N];
    for (i = 0; i < N; ++i) {
        double net, after = i < TT_PIECES ? piece_torque(s, i, y) : 0.0;
        s->mass[i] = hung(s, i, angle, y[N + i], &net);
        net += before - after - s->viscous[i] * y[N + i];
        if (TT_TORQUE_INPUT && i == TT_DRIVE) net += s->torque * tt_ratio[i];
        s->net[i] = net;
        slope[N + i] = i == TT_FIXED ? s->alpha : s->turning[i] ? net / s->mass[i] : 0.0;
        if (i < TT_PIECES) {
            slope[1 + i] = y[N + i] - y[N + i + 1];
            angle -= y[1 + i];
        }
        before = after;
    }
}

static void rates(tt_state *s, double later, const double *x, double *rate) {
    double y[2 * N], slope[2 * N];
    full_state(s, later, x, y);
    slopes(s, y, slope);
#if TT_TORQUE_INPUT
    memcpy(rate, slope, sizeof slope);
#else
    int i;
    for (i = 0; i < TT_PIECES; ++i) rate[i] = slope[1 + i];
    for (i = 0; i < N; ++i)
        if (i != TT_FIXED) rate[TT_PIECES + i - (i > TT_FIXED)] = slope[N + i] - s->alpha;
#endif
}

/* Events. */

static double station_angle(const double *y, int i) {
    double angle = y[0];
    int j;
    for (j = 0; j < i; ++j) angle -= y[1 + j];
    return angle;
}

/* Let a station turn in a direction, or be held (0). */
static void start_station(tt_state *s, const double *y, int i, int turning) {
    int k;
    s->turning[i] = turning;
    for (k = tt_first[i]; k < tt_first[i + 1]; ++k) find_stretch(s, k, station_angle(y, i) + tt_phase[k], turning);
}

/* Let a station that stands, and whose net torque was just computed forward, start or be held by dry friction. */
static void release(tt_state *s, const double *y, int i, int surely) {
    double ahead = s->net[i], behind = -(s->net[i] + friction(i, station_angle(y, i)));
    if (ahead > 0.0 || (surely && ahead >= behind)) s->turning[i] = 1;
    else if (behind > 0.0 || surely) start_station(s, y, i, -1);
    else s->turning[i] = 0;
}

static void first_modes(tt_state *s) {
    double y[2 * N], slope[2 * N];
    int i;
    full_state(s, 0.0, s->x, y);
    for (i = 0; i < TT_PIECES; ++i) {
        double play = s->half_play[i];
        s->side[i] = play == 0.0 || y[1 + i] > play ? 1 : y[1 + i] < -play ? -1 : 0;
    }
    for (i = 0; i < N; ++i) start_station(s, y, i, (y[N + i] > 0.0) - (y[N + i] < 0.0));
    slopes(s, y, slope);
    for (i = 0; i < N; ++i)
        if (y[N + i] == 0.0 && i != TT_FIXED) release(s, y, i, 0);
}

/* What stays positive until something changes at once: per station its speed in its direction, or the reserve of dry
   friction; per hanger its distances from the ends of its stretch; per piece those from the ends of its side. */
static void monitors(tt_state *s, double later, const double *x, double *out) {
    double y[2 * N], slope[2 * N], angle;
    int i, k, standing = 0;
    full_state(s, later, x, y);
    for (i = 0; i < N; ++i) standing |= !s->turning[i] && i != TT_FIXED;
    if (standing) slopes(s, y, slope);
    angle = y[0];
    for (i = 0; i < N; ++i) {
        if (s->turning[i]) out[i] = s->turning[i] * y[N + i];
        else if (i == TT_FIXED) out[i] = 1.0;
        else {
            double ahead = s->net[i], other = ahead + friction(i, angle);
            out[i] = -ahead < other ? -ahead : other;
        }
        for (k = tt_first[i]; k < tt_first[i + 1]; ++k) {
            double at = angle + tt_phase[k];
            out[N + 2 * k] = s->low[k] > -HUGE_VAL ? at - s->low[k] : 1.0;
            out[N + 2 * k + 1] = s->high[k] < HUGE_VAL ? s->high[k] - at : 1.0;
        }
        if (i < TT_PIECES) {
            double twist = y[1 + i], play = s->half_play[i], *own = out + N + 2 * H + 2 * i;
            own[0] = own[1] = 1.0;
            if (play > 0.0 && !s->side[i]) own[0] = twist + play, own[1] = play - twist;
            else if (play > 0.0) own[0] = s->side[i] * twist - play;
            angle -= twist;
        }
    }
}

/* Let the change of one monitor happen. Returns 1 where it changes a continuous state. */
static int change(tt_state *s, int which) {
    double y[2 * N], slope[2 * N];
    if (which < N) {
        int held = s->turning[which] == 0, moved = 0;
        if (which == TT_FIXED) {
            full_state(s, 0.0, s->x, y);
            start_station(s, y, which, s->omega > 0.0 ? 1 : s->omega < 0.0 ? -1 : -s->turning[which]);
            return 0;
        }
#if TT_TORQUE_INPUT
        moved = s->x[N + which] != 0.0;
        s->x[N + which] = 0.0;
#else
        moved = 1;
        s->x[TT_PIECES + which - (which > TT_FIXED)] = -s->omega;
#endif
        full_state(s, 0.0, s->x, y);
        y[N + which] = 0.0;
        start_station(s, y, which, 0);
        slopes(s, y, slope);
        release(s, y, which, held);
        return moved;
    }
    if (which < N + 2 * H) step_stretch(s, (which - N) / 2, (which - N) % 2);
    else {
        int i = (which - N - 2 * H) / 2, upper = (which - N - 2 * H) % 2;
        s->side[i] = s->side[i] ? 0 : upper ? 1 : -1;
    }
    return 0;
}

/* After new inputs: the direction of the driven station, and the stretches of hangers that were moved elsewhere. */
static void follow_inputs(tt_state *s) {
#if !TT_TORQUE_INPUT
    double y[2 * N];
    int i, k, sense = s->omega != 0.0 ? (s->omega > 0.0) - (s->omega < 0.0) : (s->alpha > 0.0) - (s->alpha < 0.0);
    full_state(s, 0.0, s->x, y);
    if (sense != s->turning[TT_FIXED]) start_station(s, y, TT_FIXED, sense);
    for (i = 0; i < N; ++i)
        for (k = tt_first[i]; k < tt_first[i + 1]; ++k) {
            double at = station_angle(y, i) + tt_phase[k];
            if (at < s->low[k] - BESIDE || at > s->high[k] + BESIDE) find_stretch(s, k, at, s->turning[i]);
        }
#else
    (void)s;
#endif
}

/* Start. */

/* Twist at which all stations follow one of them: no vibration at the beginning. psi: angles beyond it. */
static void twist_statically(tt_state *s, double theta, double omega, double alpha, int fixed, double *psi) {
    double right[N], held, play;
    int round, i, k;
    memset(psi, 0, N * sizeof *psi);
    for (round = 0; round < 8; ++round) {
        double torque[N];
        for (i = 0; i < N; ++i) {
            double angle = theta + psi[i], mass = s->inertia[i], resisting = s->viscous[i] * omega;
            for (k = tt_first[i]; k < tt_first[i + 1]; ++k) {
                double u, at = angle + tt_phase[k];
                int row = place(tt_profile[k], at, &u), p = tt_profile[k];
                mass += function(row, 0, u);
                resisting += function(row, 1, u) * omega * omega + function(row, 2, u);
                if (omega >= 0.0) resisting -= (omega ? 1.0 : 0.5) * load_torque(k, stretch_at(p, at, 1), row, u, omega);
                if (omega <= 0.0) resisting -= (omega ? 1.0 : 0.5) * load_torque(k, stretch_at(p, at, -1), row, u, omega);
            }
            right[i] = mass * alpha + resisting;
        }
        for (held = 0.0, i = N - 1; i > fixed; --i) torque[i - 1] = held += right[i];
        for (held = 0.0, i = 0; i < fixed; ++i) torque[i] = held -= right[i];
        psi[fixed] = 0.0;
        for (i = fixed; i < TT_PIECES; ++i) {
            play = torque[i] > 0.0 ? s->half_play[i] : torque[i] < 0.0 ? -s->half_play[i] : 0.0;
            psi[i + 1] = psi[i] - torque[i] / s->stiffness[i] - play;
        }
        for (i = fixed - 1; i >= 0; --i) {
            play = torque[i] > 0.0 ? s->half_play[i] : torque[i] < 0.0 ? -s->half_play[i] : 0.0;
            psi[i] = psi[i + 1] + torque[i] / s->stiffness[i] + play;
        }
    }
}

static void begin(tt_state *s) {
    double psi[N];
    int i;
#if TT_TORQUE_INPUT
    for (i = 0; i < N; ++i) s->x[i] = 0.0, s->x[N + i] = s->omega;
    s->x[0] = s->theta;
    if (s->omega != 0.0) {
        double slope[2 * N], mass = 0.0, net = 0.0;
        first_modes(s);
        slopes(s, s->x, slope);
        for (i = 0; i < N; ++i) mass += s->mass[i], net += s->net[i];
        twist_statically(s, s->theta, s->omega, net / mass, TT_DRIVE, psi);
        s->x[0] += psi[0];
        for (i = 0; i < TT_PIECES; ++i) s->x[1 + i] = psi[i] - psi[i + 1];
    }
#else
    double before[N], after[N], moment = 1e-4 / (fabs(s->omega) > 1.0 ? fabs(s->omega) : 1.0), h = moment;
    twist_statically(s, s->theta - h * (s->omega - 0.5 * h * s->alpha), s->omega - h * s->alpha, s->alpha, TT_FIXED, before);
    twist_statically(s, s->theta + h * (s->omega + 0.5 * h * s->alpha), s->omega + h * s->alpha, s->alpha, TT_FIXED, after);
    twist_statically(s, s->theta, s->omega, s->alpha, TT_FIXED, psi);
    for (i = 0; i < N; ++i) {
        double rate = (after[i] - before[i]) / (2.0 * h);
        if (i < TT_PIECES) s->x[i] = psi[i] - psi[i + 1];
        if (fabs(before[i] + after[i] - 2.0 * psi[i]) > 0.1 * fabs(after[i] - before[i])) rate = 0.0;
        if (i != TT_FIXED) s->x[TT_PIECES + i - (i > TT_FIXED)] = rate;
    }
#endif
    first_modes(s);
    follow_inputs(s);
}

/* Interface. */

static void refresh(tt_state *s) {
    if (s->parameters_changed) {
        tt_shaft(s->parameter, s);
        s->parameters_changed = 0;
        s->outputs_old = 1;
    }
    if (!s->initialized) begin(s);
}

TT_LOCAL void tt_initialize(tt_state *s) {
    s->initialized = 0;
    refresh(s);
    s->initialized = 1;
    s->outputs_old = 1;
    s->step = 0.0;
}

TT_LOCAL void tt_bring_up_to_date(tt_state *s) {
    double y[2 * N], slope[2 * N], theta[N], piece[TT_PIECES];
    int i;
    refresh(s);
    if (!s->outputs_old) return;
    full_state(s, 0.0, s->x, y);
    slopes(s, y, slope);
    for (i = 0; i < N; ++i) theta[i] = i ? theta[i - 1] - y[i] : y[0];
    for (i = 0; i < TT_PIECES; ++i) piece[i] = piece_torque(s, i, y) / tt_ratio[i + 1];
#if TT_TORQUE_INPUT
    if (s->initialized) {
        s->theta = theta[TT_DRIVE];
        s->omega = y[N + TT_DRIVE];
    }
    s->alpha = slope[N + TT_DRIVE];
#endif
    tt_outputs(theta, y + N, slope + N, piece, s->output);
    s->outputs_old = 0;
}

TT_LOCAL void tt_get_states(const tt_state *s, double *x) { memcpy(x, s->x, sizeof s->x); }

TT_LOCAL void tt_set_states(tt_state *s, const double *x) {
    memcpy(s->x, x, sizeof s->x);
    s->outputs_old = 1;
}

TT_LOCAL void tt_derivatives(tt_state *s, double *derivative) {
    refresh(s);
    rates(s, 0.0, s->x, derivative);
}

TT_LOCAL void tt_indicators(tt_state *s, double *indicator) {
    double all[TT_MONITORS];
    int k;
    refresh(s);
    monitors(s, 0.0, s->x, all);
    for (k = 0; k < TT_INDICATORS; ++k)
        indicator[k] = all[k] + (k >= N ? BESIDE : s->turning[k] ? REVERSED : 0.0);
}

TT_LOCAL int tt_event(tt_state *s) {
    double indicator[TT_SIZE(TT_INDICATORS)];
    int changed = 0, round, k, any = 1;
    refresh(s);
    follow_inputs(s);
    for (round = 0; any && round < 8; ++round) {
        tt_indicators(s, indicator);
        for (any = k = 0; k < TT_INDICATORS; ++k)
            if (indicator[k] < 0.0) {
                changed |= change(s, k);
                any = 1;
            }
    }
    s->outputs_old = 1;
    return changed;
}

/* One step of Dormand and Prince's method of order 5 between events, from the rates at its beginning, with those at its
   end; returns its error over the tolerance (Dormand, J. R., Prince, P. J. (1980). A family of embedded Runge-Kutta
   formulae. J. Comput. Appl. Math. 6, 19-26). */
static double step(tt_state *s, double later, double h, const double *first, double *x, double *last) {
    static const double a[6][6] = {
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {44.0 / 45, -56.0 / 15, 32.0 / 9},
        {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
        {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
        {35.0 / 384, 0.0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
    static const double c[6] = {1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1.0, 1.0};
    static const double e[7] = {71.0 / 57600, 0.0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
    double rate[7][TT_STATES], error = 0.0, size = 1.0 + fabs(TT_TORQUE_INPUT ? s->x[N + TT_DRIVE] : s->omega);
    int i, j, k;
    memcpy(rate[0], first, sizeof rate[0]);
    for (i = 0; i < 6; ++i) {
        for (k = 0; k < TT_STATES; ++k) {
            double sum = 0.0;
            for (j = 0; j <= i; ++j) sum += a[i][j] * rate[j][k];
            x[k] = s->x[k] + h * sum;
        }
        rates(s, later + c[i] * h, x, rate[i + 1]);
    }
    for (k = 0; k < TT_STATES; ++k) {
        double sum = 0.0;
        for (i = 0; i < 7; ++i) sum += e[i] * rate[i][k];
        sum = fabs(h * sum) / (TOLERANCE * (k < TT_STATES - (TT_TORQUE_INPUT ? N : TT_PIECES) ? 1.0 : size));
        if (!(sum <= error)) error = sum;
    }
    memcpy(last, rate[6], sizeof rate[6]);
    return error;
}

/* First monitor that has passed zero, with the values of all; -1 where none has. */
static int passed(tt_state *s, double later, const double *x, const double *began, double *now) {
    int k;
    monitors(s, later, x, now);
    for (k = 0; k < TT_MONITORS; ++k)
        if (now[k] < 0.0 && now[k] < began[k] - ROUNDING) return k;
    return -1;
}

/* Go exactly onto the first change within a step of h, by the Illinois method on its monitor; returns its time
   (Dowell, M., Jarratt, P. (1971). A modified regula falsi method. BIT 11, 168-174). */
static double land(tt_state *s, double later, double h, const double *first, double *x, double *end,
                   const double *began, double *now, int *which) {
    double low = 0.0, high = h, at_low[TT_MONITORS], before = began[*which], after = now[*which];
    int moved = 0, k;
    memcpy(at_low, began, sizeof at_low);
    while (high - low > 2.0 * CLOSE) {
        double middle = before > 0.0 ? low + (high - low) * before / (before - after) : 0.5 * (low + high);
        middle = fmin(fmax(middle, low + CLOSE), high - CLOSE);
        step(s, later, middle, first, x, end);
        k = passed(s, later + middle, x, began, now);
        if (k >= 0) {
            high = middle;
            after = now[k];
            if (k != *which) before = at_low[k];
            else if (moved > 0) before *= 0.5;
            *which = k;
            moved = 1;
        } else {
            low = middle;
            before = now[*which];
            memcpy(at_low, now, sizeof at_low);
            if (moved < 0) after *= 0.5;
            moved = -1;
        }
    }
    step(s, later, high, first, x, end);
    return high;
}

TT_LOCAL int tt_advance(tt_state *s, double span) {
    const double theta = s->theta, omega = s->omega, alpha = s->alpha;
    double x[TT_STATES], first[TT_STATES], end[TT_STATES], began[TT_MONITORS], now[TT_MONITORS], later = 0.0;
    long steps;
    int k;
    refresh(s);
    tt_event(s);
    monitors(s, 0.0, s->x, began);
    rates(s, 0.0, s->x, first);
    for (steps = 0; steps < MOST_STEPS && later < span; ++steps) {
        double left = span - later, h = s->step > 0.0 ? s->step : 1e-6, error, fastest;
        int last = 0, which;
        for (;;) {
            fastest = fabs(TT_TORQUE_INPUT ? s->x[N + TT_DRIVE] : s->omega + later * s->alpha) + 1e-300;
            if (h * fastest > LARGEST_ANGLE) h = LARGEST_ANGLE / fastest;
            last = h >= left;
            if (last) h = left;
            error = step(s, later, h, first, x, end);
            if (error <= 1.0 || (isfinite(error) && h < 1e-12)) break;
            if (h < 1e-14) {
                s->time += later;
                return 0;
            }
            h *= isfinite(error) ? fmax(0.2, 0.9 * pow(error, -0.2)) : 0.2;
        }
        if (!last || error > 1e-4) s->step = h * fmin(5.0, 0.9 * pow(error + 1e-12, -0.2));
        which = passed(s, later + h, x, began, now);
        if (which >= 0) {
            h = land(s, later, h, first, x, end, began, now, &which);
            last = 0;
        }
        memcpy(s->x, x, sizeof x);
        memcpy(first, end, sizeof end);
        later = last ? span : later + h;
        if (which >= 0) {
            /* the change happens where the given motion is by now */
            s->theta = theta + later * (omega + 0.5 * later * alpha);
            s->omega = omega + later * alpha;
            change(s, which);
            s->theta = theta;
            s->omega = omega;
            rates(s, later, s->x, first);
            monitors(s, later, s->x, began);
        } else memcpy(began, now, sizeof now);
    }
    s->time += later;
    if (!TT_TORQUE_INPUT) {
        s->theta = theta + span * (omega + 0.5 * span * alpha);
        s->omega = omega + span * alpha;
    }
    s->outputs_old = 1;
    for (k = 0; k < TT_STATES; ++k)
        if (!isfinite(s->x[k])) return 0;
    return later >= span;
}

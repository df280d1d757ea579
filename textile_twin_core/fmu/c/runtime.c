/* The machine between events, at events, and over a communication step.
   SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>
#include "textile_twin.h"

/* An event is decided so far [rad] beyond the angle where the shaft stands, on the side that it turns to. */
#define BESIDE 1e-10
#define REVERSED 1e-9      /* speed against the direction [rad/s] that counts as a standstill passed */
#define TOLERANCE 1e-13    /* error of a step: of the angle [rad], and of the speed over 1 rad/s and the speed */
#define LARGEST_ANGLE 0.05 /* of a step [rad], so that no step of a load is passed over */
#define MOST_STEPS 100000000L

static void refresh(tt_state *s) {
    if (s->parameters_changed) {
        tt_constants(s->parameter, s->constant);
        s->parameters_changed = 0;
        s->outputs_old = 1;
    }
}

static double beside(const tt_state *s, int direction) {
    double size = fabs(s->theta);
    return s->theta + direction * BESIDE * (size > 1.0 ? size : 1.0);
}

#if TT_TORQUE_INPUT
static void leaps_for(const tt_state *s, double theta, int direction, double *value) {
    double level[TT_SIZE(TT_LEAPS)];
    tt_leaps(s->constant, theta, (double)direction, 0.0, value, level);
}

/* Acceleration from standstill in a direction, positive where the torques push that way. */
static double push(const tt_state *s, int direction) {
    double leap[TT_SIZE(TT_LEAPS)];
    leaps_for(s, beside(s, direction), direction, leap);
    return direction * tt_acceleration(s->constant, s->theta, 0.0, s->torque, leap);
}

static void leave_standstill(tt_state *s) {
    s->direction = push(s, 1) > 0.0 ? 1 : push(s, -1) > 0.0 ? -1 : 0;
}

static double acceleration(const tt_state *s) {
    return s->direction ? tt_acceleration(s->constant, s->theta, s->omega, s->torque, s->leap) : 0.0;
}
#endif

TT_LOCAL void tt_initialize(tt_state *s) {
    refresh(s);
    s->initialized = 1;
    s->outputs_old = 1;
    s->step = 0.0;
#if TT_TORQUE_INPUT
    s->direction = (s->omega > 0.0) - (s->omega < 0.0);
    if (!s->direction) leave_standstill(s);
    if (s->direction) leaps_for(s, beside(s, s->direction), s->direction, s->leap);
#endif
}

TT_LOCAL void tt_bring_up_to_date(tt_state *s) {
    refresh(s);
    if (!s->outputs_old) return;
#if TT_TORQUE_INPUT
    if (!s->initialized) tt_initialize(s), s->initialized = 0;
    s->alpha = acceleration(s);
    if (!s->direction) {
        double value[TT_SIZE(TT_LEAPS)], level[TT_SIZE(TT_LEAPS)];
        tt_leaps(s->constant, s->theta, 0.0, 0.0, value, level);
        tt_outputs(s->constant, s->theta, 0.0, 0.0, value, s->output);
    } else
#endif
    tt_outputs(s->constant, s->theta, s->omega, s->alpha, s->leap, s->output);
    s->outputs_old = 0;
}

TT_LOCAL void tt_get_states(const tt_state *s, double *x) {
    x[0] = s->theta;
    x[1] = s->omega;
}

TT_LOCAL void tt_set_states(tt_state *s, const double *x) {
    s->theta = x[0];
    s->omega = x[1];
    s->outputs_old = 1;
}

TT_LOCAL void tt_derivatives(tt_state *s, double *derivative) {
#if TT_TORQUE_INPUT
    refresh(s);
    derivative[0] = s->omega;
    derivative[1] = acceleration(s);
#else
    (void)s;
    (void)derivative;
#endif
}

TT_LOCAL void tt_indicators(tt_state *s, double *indicator) {
    double value[TT_SIZE(TT_LEAPS)];
    refresh(s);
#if TT_TORQUE_INPUT
    int direction = s->direction ? s->direction : 1;
    tt_leaps(s->constant, s->theta, (double)direction, 0.0, value, indicator);
    if (s->direction) {
        indicator[TT_LEAPS] = s->direction * s->omega + REVERSED;
    } else {
        double forward = push(s, 1), backward = push(s, -1);
        indicator[TT_LEAPS] = forward > backward ? forward : backward;
    }
#else
    tt_leaps(s->constant, s->theta, s->omega, s->alpha, value, indicator);
#endif
}

TT_LOCAL int tt_event(tt_state *s) {
    int changed = 0;
    refresh(s);
#if TT_TORQUE_INPUT
    if (s->direction && s->direction * s->omega <= 0.0) {
        int before = s->direction;
        if (s->omega != 0.0) {
            s->omega = 0.0;
            changed = 1;
        }
        s->direction = 0;
        /* A shaft that was started by an event stands still for this instant alone. */
        if (push(s, before) > 0.0) s->direction = before;
    }
    if (!s->direction) leave_standstill(s);
    if (s->direction) leaps_for(s, beside(s, s->direction), s->direction, s->leap);
    s->outputs_old = 1;
#endif
    return changed;
}

#if TT_TORQUE_INPUT
/* One step of Dormand and Prince's method of order 5 with held steps of the loads; returns its error over the tolerance
   (Dormand, J. R., Prince, P. J. (1980). A family of embedded Runge-Kutta formulae. J. Comput. Appl. Math. 6, 19-26). */
static double step(const tt_state *s, double h, double *theta, double *omega) {
    static const double a[6][6] = {
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {44.0 / 45, -56.0 / 15, 32.0 / 9},
        {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
        {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
        {35.0 / 384, 0.0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
    static const double e[7] = {71.0 / 57600, 0.0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
    double speed[7], alpha[7], error_theta = 0.0, error_omega = 0.0;
    int i, j;
    speed[0] = s->omega;
    alpha[0] = tt_acceleration(s->constant, s->theta, s->omega, s->torque, s->leap);
    for (i = 0; i < 6; ++i) {
        double x = 0.0, v = 0.0;
        for (j = 0; j <= i; ++j) {
            x += a[i][j] * speed[j];
            v += a[i][j] * alpha[j];
        }
        *theta = s->theta + h * x;
        *omega = s->omega + h * v;
        speed[i + 1] = *omega;
        alpha[i + 1] = tt_acceleration(s->constant, *theta, *omega, s->torque, s->leap);
    }
    for (i = 0; i < 7; ++i) {
        error_theta += e[i] * speed[i];
        error_omega += e[i] * alpha[i];
    }
    error_theta = fabs(h * error_theta) / TOLERANCE;
    error_omega = fabs(h * error_omega) / (TOLERANCE * (1.0 + fabs(s->omega)));
    return error_theta > error_omega ? error_theta : error_omega;
}

/* Whether the shaft has come to a standstill or to a step of a load. */
static int met(const tt_state *s, double theta, double omega) {
    double value[TT_SIZE(TT_LEAPS)];
    if (s->direction * omega < 0.0) return 1;
    leaps_for(s, theta, s->direction, value);
    return memcmp(value, s->leap, TT_LEAPS * sizeof(double)) != 0;
}

/* Go exactly onto the first event within a step of h, to the rounding of the time; returns its time from the beginning. */
static double land(tt_state *s, double h) {
    double low = 0.0, high = h, theta, omega;
    for (;;) {
        double middle = 0.5 * (low + high);
        if (!(low < middle && middle < high)) break;
        step(s, middle, &theta, &omega);
        if (met(s, theta, omega)) high = middle; else low = middle;
        if (high - low < 1e-17) break;
    }
    step(s, high, &theta, &omega);
    s->theta = theta;
    s->omega = omega;
    if (s->direction * omega < 0.0) s->omega = 0.0;
    return high;
}
#endif

TT_LOCAL int tt_advance(tt_state *s, double span) {
    refresh(s);
#if TT_TORQUE_INPUT
    double done = 0.0;
    long steps;
    tt_event(s);
    for (steps = 0; steps < MOST_STEPS && done < span; ++steps) {
        double left = span - done, h = s->step > 0.0 ? s->step : 1e-4, theta, omega, error, fastest;
        int last = 0;
        if (!s->direction) {
            done = span;
            break;
        }
        for (;;) {
            fastest = fabs(s->omega) + 1e-300;
            if (h * fastest > LARGEST_ANGLE) h = LARGEST_ANGLE / fastest;
            last = h >= left;
            if (last) h = left;
            error = step(s, h, &theta, &omega);
            if (error <= 1.0 || (error == error && h < 1e-12)) break;
            if (h < 1e-14) {
                s->time += done;
                return 0;
            }
            h *= error == error ? fmax(0.2, 0.9 * pow(error, -0.2)) : 0.2;
        }
        if (!last || error > 1e-4) s->step = h * fmin(5.0, 0.9 * pow(error + 1e-12, -0.2));
        if (met(s, theta, omega) || met(s, 0.5 * (s->theta + theta), omega)) {
            done += land(s, h);
            tt_event(s);
            continue;
        }
        s->theta = theta;
        s->omega = omega;
        done = last ? span : done + h;
    }
    s->time += done;
    s->outputs_old = 1;
    s->alpha = acceleration(s);
    return done >= span && isfinite(s->omega) && isfinite(s->alpha);
#else
    s->time += span;
    return 1;
#endif
}

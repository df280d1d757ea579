/* A contact machine over a communication step, from event to event.

   Events are downward crossings of polynomials: gaps, forces of closed stops, compressions and forces of pads.
   SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>
#include "textile_twin.h"

#define TURN_TAIL 2.4492935982947064e-16 /* 2 pi less TT_TURN */
#define SAME_ANGLE 1e-13  /* angle [rad] that moves the driven element by less than rounding does */
#define MOST_EVENTS 100000L

enum { CLOSES, RELEASES, TURNS_OFF, TURNS_PUSHING, TURNS_SLACK };

static void distance(const double *ends, double sign, double shift, const tt_motion *m, double *c) {
    int e, k;
    for (k = 0; k < TT_TERMS; ++k) c[k] = 0.0;
    for (e = 0; e < TT_ELEMENTS; ++e)
        for (k = 0; ends[e] != 0.0 && k < TT_TERMS; ++k) c[k] += sign * ends[e] * m->x[e][k];
    c[0] += shift;
}

/* The pull that a slack pad would exert, positive while it stays slack. */
static void withheld(const tt_pad *pad, const double *depth, double h, double *c) {
    int power, k, j;
    for (k = 0; k < TT_ORDER; ++k) c[k] = 0.0;
    for (power = TT_PAD_POWERS - 1; power >= 0; --power) {
        c[0] += pad->stiffness[power];
        for (k = TT_ORDER - 1; k >= 0; --k) {
            double sum = 0.0;
            for (j = 0; j <= k; ++j) sum += depth[j] * c[k - j];
            c[k] = sum;
        }
    }
    for (k = 0; k < TT_ORDER; ++k) c[k] = -c[k] - pad->damping * (k + 1) * depth[k + 1] / h;
}

/* Place u of the first event within a step; infinite without one. */
static double first_event(const tt_state *s, const tt_motion *m, int *kind, int *which) {
    double length = tt_noise(s) + 4.0 * TT_EPSILON * s->clock * s->fastest;
    double force = 1e-13 * (s->force + s->resistance * s->fastest), slack = force;
    double best = HUGE_VAL, found, c[TT_TERMS], pressure[TT_TERMS];
    int i, k;
#define AT(place, event)                                                                                               \
    if ((found = (place)) < best) best = found, *kind = (event), *which = i
    for (i = 0; i < TT_STOPS; ++i)
        if (!s->closed[i]) {
            distance(tt_stop_ends[i], 1.0, s->stop[i].limit, m, c);
            AT(tt_first_crossing(c, TT_TERMS, length), CLOSES);
        }
    for (i = 0; i < TT_PADS; ++i) {
        double tangent = 0.0, own;
        if (s->pressed[i] == TT_OFF) {
            distance(tt_pad_ends[i], -1.0, s->pad[i].position, m, c);
            AT(tt_first_crossing(c, TT_TERMS, length), TURNS_PUSHING);
            continue;
        }
        distance(tt_pad_ends[i], 1.0, -s->pad[i].position, m, c);
        AT(tt_first_crossing(c, TT_TERMS, length), TURNS_OFF);
        if (s->pressed[i] == TT_PUSHING) memcpy(pressure, m->pad[i], sizeof pressure);
        else withheld(&s->pad[i], c, m->h, pressure);
        for (k = TT_PAD_POWERS - 1; k >= 0; --k) tangent = tangent * fmax(c[0], 0.0) + (k + 1) * s->pad[i].stiffness[k];
        own = tangent * length + 1e-14 * tt_largest(pressure, TT_ORDER);
        slack += own;
        if (!tt_pad_pulls[i])
            AT(tt_first_crossing(pressure, TT_ORDER, force + own),
               s->pressed[i] == TT_PUSHING ? TURNS_SLACK : TURNS_PUSHING);
    }
    for (i = 0; i < TT_STOPS; ++i)
        if (s->closed[i]) {
            const double *push = m->stop[i];
            AT(tt_first_crossing(push, TT_ORDER - 1, slack + 1e-12 * tt_largest(push, TT_ORDER - 1)), RELEASES);
        }
    return best;
}

/* Apply an event; returns the stop that it meets. */
static int happen(tt_state *s, int kind, int which) {
    if (kind == CLOSES) {
        s->released[which] = 0; /* if its force vanished only within rounding, it has not opened yet */
        return which;
    }
    if (kind == RELEASES) {
        s->closed[which] = 0;
        s->released[which] = 1;
        return TT_NONE;
    }
    memset(s->released, 0, sizeof s->released);
    s->pressed[which] = kind == TURNS_OFF ? TT_OFF : kind == TURNS_SLACK ? TT_SLACK : TT_PUSHING;
    return TT_NONE;
}

static double driven_acceleration(const tt_state *s) {
    double x[3];
    tt_drive_series(&s->drive, s->clock, 1.0, 2, x);
    return 2.0 * x[2];
}

/* Advance to the end of the section of the law, from event to event. Returns 0 where this is impossible. */
static int advance(tt_state *s) {
    double x[2], longest;
    int hit = TT_NONE, kind = CLOSES, which = TT_NONE, stalled = 0, unsettled = s->unsettled, i;
    long events = 0;
    tt_motion m;
    tt_drive_series(&s->drive, s->clock, 1.0, 1, x);
    unsettled |= fabs(x[1] - s->v[TT_DRIVEN]) > 1e-12 * fmax(s->fastest, fabs(x[1]));
    s->x[TT_DRIVEN] = x[0];
    s->v[TT_DRIVEN] = x[1];
    s->fastest = fmax(s->fastest, fabs(x[1]));
    s->unsettled = 0;
    for (;;) {
        double place;
        if (unsettled && !tt_settle(s, driven_acceleration(s), hit)) return 0;
        if (unsettled && (stalled > 20 + 10 * TT_STOPS || events > MOST_EVENTS)) return 0;
        longest = s->drive.end - s->clock;
        if (longest <= 0.0) return 1;
        tt_step(s, longest, &m);
        place = first_event(s, &m, &kind, &which);
        unsettled = place < HUGE_VAL;
        if (unsettled && place > 0.0) tt_shorten(&m, place);
        if (place > 0.0) {
            double end = fmin(s->clock + m.h, s->drive.end);
            int still = end <= s->clock && !unsettled;
            tt_arrive(s, &m);
            s->clock = m.h >= longest ? s->drive.end : end;
            memset(s->released, 0, sizeof s->released);
            stalled = 0;
            if (still || !isfinite(tt_largest(s->v, TT_ELEMENTS))) return 0;
            for (i = 0; i < TT_STOPS; ++i) /* closed stops tie the driven element to the frame */
                if (s->closed[i] && fabs(tt_gap(s, i)) > 1e-6 * s->length) return 0;
        }
        if (unsettled) {
            ++stalled;
            ++events;
            hit = happen(s, kind, which);
        }
    }
}

/* Follow the shaft, whose angle is a polynomial of time, over a span from section to section of the law. */
static int follow(tt_state *s, const double *theta, double span) {
    int stalled = 0, to;
    double time = 0.0;
    memcpy(s->drive.theta, theta, sizeof s->drive.theta);
    tt_enter_section(&s->drive, theta[0]);
    s->clock = 0.0;
    while (time < span) {
        double end = tt_leaves(&s->drive, time, span, &to);
        if (stalled >= 3) end = span, to = 0;
        if (end > time) {
            s->drive.end = end;
            if (!advance(s)) return 0;
            stalled = 0;
        } else ++stalled;
        time = end;
        if (to && time < span) {
            int next = (s->drive.section + to + TT_SECTIONS) % TT_SECTIONS;
            if (to > 0) s->drive.base += tt_law_start[s->drive.section + 1] - tt_law_start[s->drive.section];
            else s->drive.base -= tt_law_start[next + 1] - tt_law_start[next];
            s->drive.section = next;
        }
    }
    return 1;
}

/* Polynomial over h seconds with value, velocity and acceleration at both ends. */
static void quintic(double h, const double *start, const double *end, double *c) {
    double x = end[0] - start[0] - h * (start[1] + 0.5 * h * start[2]), v = h * (end[1] - start[1] - h * start[2]);
    double a = h * h * (end[2] - start[2]);
    c[0] = start[0];
    c[1] = start[1];
    c[2] = 0.5 * start[2];
    c[3] = (10.0 * x - 4.0 * v + 0.5 * a) / (h * h * h);
    c[4] = (-15.0 * x + 7.0 * v - a) / (h * h * h * h);
    c[5] = (6.0 * x - 3.0 * v + 0.5 * a) / (h * h * h * h * h);
}

/* Angle within a turn, exact to the angle's own rounding. */
static double phase(double angle) {
    double wrapped = fmod(angle, TT_TURN), turns = rint((angle - wrapped) / TT_TURN);
    return (wrapped < 0.0 ? wrapped + TT_TURN : wrapped) - turns * TURN_TAIL;
}

/* Start. */

static void set_plant(tt_state *s) {
    double stiffness = 0.0, damping = 0.0, constant[TT_ELEMENTS], largest = 0.0;
    int e, k, of;
    tt_plant(s->parameter, s);
    s->length = s->rate = 0.0;
    for (k = 0; k < TT_STOPS; ++k) s->length = fmax(s->length, fabs(s->stop[k].limit));
    for (k = 0; k < TT_PADS; ++k) s->length = fmax(s->length, fabs(s->pad[k].position));
    for (e = 0; e < TT_ELEMENTS; ++e) constant[e] = e < TT_BODIES ? s->weight[e] : 0.0;
    for (k = 0; k < TT_SPRINGS; ++k) {
        s->length = fmax(s->length, fabs(s->spring[k].free_length));
        for (e = 0; e < TT_ELEMENTS; ++e)
            constant[e] += tt_spring_ends[k][e] * s->spring[k].stiffness * s->spring[k].free_length;
    }
    if (s->length == 0.0) s->length = 1.0;
    for (e = 0; e < TT_ELEMENTS; ++e) {
        double hardest = 0.0, slowest = 0.0;
        for (k = 0; k < TT_SPRINGS; ++k) {
            double ends = 0.0;
            for (of = 0; of < TT_ELEMENTS; ++of) ends += fabs(tt_spring_ends[k][of]);
            if (tt_spring_ends[k][e] == 0.0) continue;
            hardest += ends * s->spring[k].stiffness;
            slowest += ends * s->spring[k].damping;
        }
        stiffness = fmax(stiffness, hardest);
        damping = fmax(damping, slowest);
        largest = fmax(largest, fabs(constant[e]));
        if (e < TT_BODIES) s->rate = fmax(s->rate, fmax(slowest / s->mass[e], sqrt(hardest / s->mass[e])));
    }
    s->rate = fmax(s->rate, 1.0);
    s->force = stiffness * s->length + largest;
    s->resistance = damping;
}

/* Bring the machine from its declared start to the first sample, along a smooth motion of the shaft. */
static int begin(tt_state *s) {
    static const double rest[3] = {0.0, 0.0, 0.0};
    double theta[6] = {0.0}, to[3], angle = phase(s->theta), span;
    int e, k;
    if (s->omega < 0.0 && angle > 0.0) angle -= TT_TURN;
    span = 1.5 * fabs(angle) / fmax(fabs(s->omega), TT_NOMINAL_SPEED);
    memcpy(s->x, s->start, TT_BODIES * sizeof(double));
    memset(s->v, 0, sizeof s->v);
    memset(s->closed, 0, sizeof s->closed);
    memset(s->released, 0, sizeof s->released);
    s->fastest = 1e-6 * s->length * s->rate;
    s->clock = s->drive.end = 0.0;
    memcpy(s->drive.theta, theta, sizeof theta);
    tt_enter_section(&s->drive, 0.0);
    s->x[TT_DRIVEN] = tt_law[0][0] + tt_wave[0][0] * sin(tt_wave[0][2]);
    for (k = 0; k < TT_STOPS; ++k)
        if (tt_gap(s, k) < -1e3 * tt_noise(s)) return 0;
    for (k = 0; k < TT_PADS; ++k) {
        double depth = -s->pad[k].position;
        for (e = 0; e < TT_ELEMENTS; ++e) depth += tt_pad_ends[k][e] * s->x[e];
        s->pressed[k] = depth <= 0.0 ? TT_OFF : TT_PUSHING;
        if (s->pressed[k] && !tt_pad_pulls[k] && tt_value(s->pad[k].stiffness, TT_PAD_POWERS, depth) < 0.0)
            s->pressed[k] = TT_SLACK;
    }
    if (!tt_settle(s, 0.0, TT_NONE)) return 0;
    s->unsettled = 0;
    if (span > 0.0) {
        to[0] = angle;
        to[1] = s->omega;
        to[2] = 0.0;
        quintic(span, rest, to, theta);
        if (!follow(s, theta, span)) return 0;
    }
    theta[0] = angle;
    theta[1] = s->omega;
    theta[2] = 0.5 * s->alpha;
    theta[3] = theta[4] = theta[5] = 0.0;
    memcpy(s->drive.theta, theta, sizeof theta);
    tt_enter_section(&s->drive, angle);
    s->clock = s->drive.end = 0.0;
    s->unsettled = 1;
    return advance(s);
}

/* Interface. */

static void refresh(tt_state *s) {
    if (s->parameters_changed) {
        set_plant(s);
        s->parameters_changed = 0;
        s->outputs_old = s->unsettled = 1;
    }
    if (!s->begun && s->outputs_old) s->failed = !begin(s);
}

TT_LOCAL void tt_initialize(tt_state *s) { s->initialized = 1; }

/* Positions, velocities and accelerations of the elements, then what the drive must give. */
TT_LOCAL void tt_bring_up_to_date(tt_state *s) {
    double all[3 * TT_ELEMENTS + 8], slope, force = 0.0, own, kinetic = 0.0, potential = 0.0;
    tt_motion m;
    int e, k;
    refresh(s);
    if (!s->outputs_old) return;
    tt_expand(s, 1.0, 2, &m);
    for (e = 0; e < TT_ELEMENTS; ++e) {
        all[e] = s->x[e];
        all[TT_ELEMENTS + e] = s->v[e];
        all[2 * TT_ELEMENTS + e] = 2.0 * m.x[e][2];
        kinetic += 0.5 * (e < TT_BODIES ? s->mass[e] : s->driven_mass) * s->v[e] * s->v[e];
        if (e < TT_BODIES) potential -= s->weight[e] * s->x[e];
    }
    for (k = 0; k < TT_SPRINGS; ++k) {
        double length = -s->spring[k].free_length, rate = 0.0;
        for (e = 0; e < TT_ELEMENTS; ++e) {
            length += tt_spring_ends[k][e] * s->x[e];
            rate += tt_spring_ends[k][e] * s->v[e];
        }
        potential += 0.5 * s->spring[k].stiffness * length * length;
        force -= tt_spring_ends[k][TT_DRIVEN] * (s->spring[k].stiffness * length + s->spring[k].damping * rate);
    }
    for (k = 0; k < TT_PADS; ++k) {
        double depth = -s->pad[k].position, energy = 0.0;
        int power;
        for (e = 0; e < TT_ELEMENTS; ++e) depth += tt_pad_ends[k][e] * s->x[e];
        depth = fmax(depth, 0.0);
        for (power = TT_PAD_POWERS; power > 0; --power)
            energy = (energy + s->pad[k].stiffness[power - 1] / (power + 1)) * depth;
        potential += energy * depth;
        force -= tt_pad_ends[k][TT_DRIVEN] * m.pad[k][0];
    }
    for (k = 0; k < TT_STOPS; ++k) force += tt_stop_ends[k][TT_DRIVEN] * m.stop[k][0];
    own = s->driven_mass * all[2 * TT_ELEMENTS + TT_DRIVEN];
    slope = tt_law_slope(&s->drive, s->clock);
    all[3 * TT_ELEMENTS] = own - force;
    all[3 * TT_ELEMENTS + 1] = (own - force) * slope;
    all[3 * TT_ELEMENTS + 2] = own * slope;
    all[3 * TT_ELEMENTS + 3] = 0.0;
    all[3 * TT_ELEMENTS + 4] = -force * slope;
    all[3 * TT_ELEMENTS + 5] = s->driven_mass * slope * slope;
    all[3 * TT_ELEMENTS + 6] = kinetic;
    all[3 * TT_ELEMENTS + 7] = potential;
    for (k = 0; k < TT_OUTPUTS; ++k) s->output[k] = all[tt_output[k]];
    s->outputs_old = 0;
}

/* Go on for a communication step: the inputs with their acceleration, less what the shaft was off them. */
TT_LOCAL int tt_advance(tt_state *s, double span) {
    double theta[6] = {0.0}, reached[3], c[6], off[3] = {0.0}, end[3] = {0.0};
    int k;
    refresh(s);
    s->begun = 1;
    if (s->failed) return 0;
    if (span <= 0.0) return 1;
    memcpy(c, s->drive.theta, sizeof c);
    tt_move(c, 6, s->clock);
    reached[0] = c[0] - TT_TURN * floor(c[0] / TT_TURN);
    reached[1] = c[1];
    off[0] = remainder(reached[0] - phase(s->theta), TT_TURN);
    off[1] = reached[1] - s->omega;
    if (fabs(off[0]) <= SAME_ANGLE && fabs(off[1]) * span <= SAME_ANGLE) off[0] = off[1] = 0.0;
    else quintic(span, off, end, theta);
    theta[0] = reached[0];
    theta[1] += s->omega;
    theta[2] += 0.5 * s->alpha;
    s->failed = !follow(s, theta, span);
    s->time += span;
    s->outputs_old = 1;
    for (k = 0; k < TT_ELEMENTS; ++k) s->failed |= !isfinite(s->x[k]);
    return !s->failed;
}

/* Model exchange is not offered: a closed stop binds positions to the driven element, which no derivative can. */
TT_LOCAL void tt_get_states(const tt_state *s, double *x) { (void)s; (void)x; }
TT_LOCAL void tt_set_states(tt_state *s, const double *x) { (void)s; (void)x; }
TT_LOCAL void tt_derivatives(tt_state *s, double *derivative) { (void)s; (void)derivative; }
TT_LOCAL void tt_indicators(tt_state *s, double *indicator) { (void)s; (void)indicator; }
TT_LOCAL int tt_event(tt_state *s) { (void)s; return 0; }

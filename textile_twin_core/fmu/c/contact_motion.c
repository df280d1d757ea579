/* Motion of a contact machine between events: power series of the driven element and of the bodies.

   The coefficients follow from each other through the balance of forces (Jorba, A., Zou, M. (2005). A software package
   for the numerical integration of ODEs by means of high-order Taylor methods. Experimental Mathematics 14, 99-117).
   SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>
#include "textile_twin.h"

#define TOLERANCE 1e-15 /* truncated part of a series, over the distance moved at the largest speed so far */
#define STOPS TT_SIZE(TT_STOPS)
#define PADS TT_SIZE(TT_PADS)

/* The driven element. */

/* Positions over h seconds from a time: section(angle), with the angle a polynomial in time. */
TT_LOCAL void tt_drive_series(const tt_drive *d, double time, double h, int order, double *x) {
    const double *law = tt_law[d->section], *wave = tt_wave[d->section];
    double angle[6], factor = 1.0;
    int n = 6, known = 1, k, j;
    memcpy(angle, d->theta, sizeof angle);
    tt_move(angle, 6, time);
    angle[0] -= d->base;
    for (k = 0; k < 6; ++k) {
        angle[k] *= factor;
        factor *= h;
    }
    while (n > 1 && angle[n - 1] == 0.0) --n;
    memset(x, 0, (order + 1) * sizeof *x);
    x[0] = law[TT_LAW_POWERS - 1];
    for (k = TT_LAW_POWERS - 2; k >= 0; --k) { /* Horner's rule on series */
        int longer = known + n - 1 <= order ? known + n - 1 : order + 1, i;
        for (i = longer - 1; i >= 0; --i) {
            double sum = 0.0;
            for (j = 0; j < n && j <= i; ++j)
                if (i - j < known) sum += angle[j] * x[i - j];
            x[i] = sum;
        }
        known = longer;
        x[0] += law[k];
    }
    if (wave[0] != 0.0) {
        double sine[TT_TERMS], cosine[TT_TERMS];
        sine[0] = sin(wave[1] * angle[0] + wave[2]);
        cosine[0] = cos(wave[1] * angle[0] + wave[2]);
        for (k = 0; k < order; ++k) {
            double s = 0.0, c = 0.0;
            for (j = 1; j < n && j <= k + 1; ++j) {
                double slope = wave[1] * j * angle[j];
                s += slope * cosine[k + 1 - j];
                c -= slope * sine[k + 1 - j];
            }
            sine[k + 1] = s / (k + 1);
            cosine[k + 1] = c / (k + 1);
        }
        for (k = 0; k <= order; ++k) x[k] += wave[0] * sine[k];
    }
}

/* Slope of the law of motion [m/rad] at the shaft angle of a time. */
TT_LOCAL double tt_law_slope(const tt_drive *d, double time) {
    const double *law = tt_law[d->section], *wave = tt_wave[d->section];
    double past = tt_value(d->theta, 6, time) - d->base, slope = 0.0;
    int k;
    for (k = TT_LAW_POWERS - 1; k > 0; --k) slope = slope * past + k * law[k];
    return slope + wave[0] * wave[1] * cos(wave[1] * past + wave[2]);
}

/* Time at which the shaft leaves its section of the law, and into the next (1) or the last one (-1); 0: it stays. */
TT_LOCAL double tt_leaves(const tt_drive *d, double time, double span, int *to) {
    double below[6], above[6], factor = 1.0, remaining = span - time, noise, first, second;
    double width = tt_law_start[d->section + 1] - tt_law_start[d->section];
    int k;
    memcpy(below, d->theta, sizeof below);
    tt_move(below, 6, time);
    below[0] -= d->base;
    noise = 1e-14 + 2.0 * TT_EPSILON * (fabs(d->base) + time * fabs(below[1]));
    for (k = 0; k < 6; ++k) {
        below[k] *= factor;
        above[k] = -below[k];
        factor *= remaining;
    }
    above[0] += width;
    first = tt_first_crossing(below, 6, noise);
    second = tt_first_crossing(above, 6, noise);
    *to = first <= 1.0 && first <= second ? -1 : second <= 1.0 ? 1 : 0;
    return *to ? fmin(time + fmin(first, second) * remaining, span) : span;
}

TT_LOCAL void tt_enter_section(tt_drive *d, double angle) {
    d->base = TT_TURN * floor(angle / TT_TURN);
    for (d->section = TT_SECTIONS - 1; d->section > 0 && tt_law_start[d->section] > angle - d->base; --d->section) {}
    d->base += tt_law_start[d->section];
}

/* Motion between events. */

/* Set the closed stops on their gaps, the bodies giving way by their masses. */
static void correct(const tt_state *s, double inverse[STOPS][STOPS], double driven, double driven_speed, double *x,
                    double *v) {
    double gap[STOPS], speed[STOPS];
    int stops[STOPS], n = 0, i, j, e;
    memcpy(x, s->x, sizeof s->x);
    memcpy(v, s->v, sizeof s->v);
    x[TT_DRIVEN] = driven;
    v[TT_DRIVEN] = driven_speed;
    for (i = 0; i < TT_STOPS; ++i) {
        if (!s->closed[i]) continue;
        gap[n] = s->stop[i].limit;
        speed[n] = 0.0;
        for (e = 0; e < TT_ELEMENTS; ++e) {
            gap[n] += tt_stop_ends[i][e] * x[e];
            speed[n] += tt_stop_ends[i][e] * v[e];
        }
        stops[n++] = i;
    }
    for (i = 0; i < n; ++i)
        for (j = 0; j < n; ++j)
            for (e = 0; e < TT_BODIES; ++e) {
                double share = tt_stop_ends[stops[i]][e] / s->mass[e] * inverse[i][j];
                x[e] -= share * gap[j];
                v[e] -= share * speed[j];
            }
}

/* Power series of the motion over h seconds from here, up to an order. */
TT_LOCAL void tt_expand(const tt_state *s, double h, int order, tt_motion *m) {
    double inverse[STOPS][STOPS], powers[PADS][TT_PAD_POWERS][TT_TERMS], x[TT_ELEMENTS], v[TT_ELEMENTS];
    int stops[STOPS], n = 0, k, e, i, j;
    for (i = 0; i < TT_STOPS; ++i)
        if (s->closed[i]) stops[n++] = i;
    m->h = h;
    memset(m->pad, 0, sizeof m->pad);
    memset(m->stop, 0, sizeof m->stop);
    tt_drive_series(&s->drive, s->clock, h, order, m->x[TT_DRIVEN]);
    tt_constrain(s, inverse);
    correct(s, inverse, m->x[TT_DRIVEN][0], m->x[TT_DRIVEN][1] / h, x, v);
    for (e = 0; e < TT_BODIES; ++e) {
        m->x[e][0] = x[e];
        m->x[e][1] = v[e] * h;
    }
    for (k = 0; k < order; ++k) {
        double f[TT_ELEMENTS], unit = (k + 1) * (k + 2) / (h * h), opening[STOPS];
        for (e = 0; e < TT_ELEMENTS; ++e) f[e] = k || e == TT_DRIVEN ? 0.0 : s->weight[e];
        for (i = 0; i < TT_SPRINGS; ++i) {
            const tt_spring *spring = &s->spring[i];
            double length = k ? 0.0 : -spring->free_length, rate = 0.0, pull;
            for (e = 0; e < TT_ELEMENTS; ++e) {
                length += tt_spring_ends[i][e] * m->x[e][k];
                rate += tt_spring_ends[i][e] * m->x[e][k + 1];
            }
            pull = spring->stiffness * length + spring->damping * (k + 1) / h * rate;
            for (e = 0; e < TT_ELEMENTS; ++e) f[e] -= tt_spring_ends[i][e] * pull;
        }
        for (i = 0; i < TT_PADS; ++i) {
            const tt_pad *pad = &s->pad[i];
            double depth = k ? 0.0 : -pad->position, rate = 0.0;
            if (s->pressed[i] != TT_PUSHING) continue;
            for (e = 0; e < TT_ELEMENTS; ++e) {
                depth += tt_pad_ends[i][e] * m->x[e][k];
                rate += tt_pad_ends[i][e] * m->x[e][k + 1];
            }
            powers[i][0][k] = depth;
            m->pad[i][k] = pad->stiffness[0] * depth + pad->damping * (k + 1) / h * rate;
            for (j = 1; j < TT_PAD_POWERS; ++j) {
                double term = 0.0;
                for (e = 0; e <= k; ++e) term += powers[i][j - 1][e] * powers[i][0][k - e];
                powers[i][j][k] = term;
                m->pad[i][k] += pad->stiffness[j] * term;
            }
            for (e = 0; e < TT_ELEMENTS; ++e) f[e] -= tt_pad_ends[i][e] * m->pad[i][k];
        }
        if (k == order - 1) break;
        for (i = 0; i < n; ++i) { /* without forces in the closed stops, which then keep their gaps */
            opening[i] = tt_stop_ends[stops[i]][TT_DRIVEN] * unit * m->x[TT_DRIVEN][k + 2];
            for (e = 0; e < TT_BODIES; ++e) opening[i] += tt_stop_ends[stops[i]][e] * f[e] / s->mass[e];
        }
        for (i = 0; i < n; ++i) {
            double *force = &m->stop[stops[i]][k];
            for (j = 0; j < n; ++j) *force -= inverse[i][j] * opening[j];
            for (e = 0; e < TT_ELEMENTS; ++e) f[e] += tt_stop_ends[stops[i]][e] * *force;
        }
        for (e = 0; e < TT_BODIES; ++e) m->x[e][k + 2] = f[e] / s->mass[e] / unit;
    }
}

/* Factor on the step at which the truncated terms reach the tolerance, over a scale. The radius of convergence comes
   from the last six coefficients, since some may vanish by symmetry. */
static double holds(const double *c, int n, double scale) {
    double radius = HUGE_VAL;
    int k;
    for (k = n - 6; k < n; ++k)
        if (c[k] != 0.0) radius = fmin(radius, pow(scale / fabs(c[k]), 1.0 / k));
    return 0.9 * radius * pow(TOLERANCE, 1.0 / (TT_ORDER - 2));
}

static void stretch(double *c, int n, double factor) {
    double power = 1.0;
    int k;
    for (k = 0; k < n; ++k) {
        c[k] *= power;
        power *= factor;
    }
}

TT_LOCAL void tt_shorten(tt_motion *m, double factor) {
    int i;
    m->h *= factor;
    for (i = 0; i < TT_ELEMENTS; ++i) stretch(m->x[i], TT_TERMS, factor);
    for (i = 0; i < TT_PADS; ++i) stretch(m->pad[i], TT_ORDER, factor);
    for (i = 0; i < TT_STOPS; ++i) stretch(m->stop[i], TT_ORDER - 1, factor);
}

/* The longest step, up to `longest`, over which the series is exact to rounding. */
TT_LOCAL void tt_step(const tt_state *s, double longest, tt_motion *m) {
    double h = fmin(1.0 / s->rate, longest), factor = longest / h, force = 1e-300;
    int i;
    tt_expand(s, h, TT_ORDER, m);
    for (i = 0; i < TT_ELEMENTS; ++i) factor = fmin(factor, holds(m->x[i], TT_TERMS, fmax(s->fastest * h, 1e-300)));
    for (i = 0; i < TT_PADS; ++i) force = fmax(force, tt_largest(m->pad[i], TT_ORDER));
    for (i = 0; i < TT_PADS; ++i) factor = fmin(factor, holds(m->pad[i], TT_ORDER, force));
    tt_shorten(m, factor);
    if (factor * h >= longest) m->h = longest;
}

TT_LOCAL void tt_arrive(tt_state *s, const tt_motion *m) {
    int e, k;
    for (e = 0; e < TT_ELEMENTS; ++e) {
        double x = 0.0, v = 0.0;
        for (k = TT_ORDER; k >= 0; --k) {
            x += m->x[e][k];
            v += k * m->x[e][k];
        }
        s->x[e] = x;
        s->v[e] = v / m->h;
        s->fastest = fmax(s->fastest, fabs(s->v[e]));
    }
}

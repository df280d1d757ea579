/* Polynomials on [0, 1], power coefficients from the lowest: value, expansion elsewhere, first downward crossing.
   SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>
#include "textile_twin.h"

#define MOST_COEFFICIENTS 32
#define DEEPEST 96 /* intervals that wait at most: two for each halving down to NARROWEST */
#define NARROWEST 1.4210854715202004e-14

TT_LOCAL double tt_value(const double *c, int n, double u) {
    double sum = 0.0;
    while (n-- > 0) sum = sum * u + c[n];
    return sum;
}

TT_LOCAL double tt_largest(const double *c, int n) {
    double most = 0.0;
    int k;
    for (k = 0; k < n; ++k)
        if (!(fabs(c[k]) <= most)) most = fabs(c[k]);
    return most;
}

/* Expand in powers of t at an offset, in place: p(offset + t). */
TT_LOCAL void tt_move(double *c, int n, double offset) {
    int start, k;
    for (start = 0; start < n - 1; ++start)
        for (k = n - 2; k >= start; --k) c[k] += offset * c[k + 1];
}

/* A polynomial lies between its smallest and its largest Bernstein coefficient. */
static void bernstein(const double *c, int degree, double *b) {
    double choices = 1.0;
    int k, done;
    for (k = 0; k <= degree; ++k) {
        b[k] = c[k] / choices;
        choices = choices * (degree - k) / (k + 1);
    }
    for (done = 0; done < degree; ++done)
        for (k = degree; k > done; --k) b[k] += b[k - 1];
}

/* The only downward root in [low, high], by Newton's method with bisection. */
static double only_root(const double *c, int n, double low, double high) {
    double u = 0.5 * (low + high);
    int round, k;
    for (round = 0; round < 100; ++round) {
        double f = 0.0, slope = 0.0, next;
        for (k = n - 1; k >= 0; --k) {
            slope = slope * u + f;
            f = f * u + c[k];
        }
        if (f > 0.0) low = u;
        else if (f < 0.0) high = u;
        else return u;
        next = slope != 0.0 ? u - f / slope : low;
        if (!(low < next && next < high)) next = 0.5 * (low + high);
        if (fabs(next - u) <= 1e-17 + 2e-16 * fabs(u) || high - low <= 1e-17) return next;
        u = next;
    }
    return u;
}

/* Depth below zero of u^order times the polynomial after a downward root, by slope and curvature. */
static double dip(const double *c, int n, double root, int order) {
    double f = 0.0, slope = 0.0, bend = 0.0;
    int k;
    for (k = n - 1; k >= 0; --k) {
        bend = bend * root + slope;
        slope = slope * root + f;
        f = f * root + c[k];
    }
    if (bend <= 0.0) return HUGE_VAL;
    return 0.25 * slope * slope / bend * pow(fmin(root - 0.5 * slope / bend, 1.0), order);
}

/* Smallest u in [0, 1] from which the polynomial is negative; infinite if there is none. Leading coefficients below
   `noise` count as zero: a gap that has just opened crosses nothing, one that closes from zero crosses at 0. Roots are
   isolated by the changes of sign of Bernstein coefficients (Descartes' rule), so that no pair of them is missed. */
TT_LOCAL double tt_first_crossing(const double *c, int n, double noise) {
    double lows[DEEPEST], highs[DEEPEST], waiting[DEEPEST][MOST_COEFFICIENTS];
    int order = 0, count = 1, degree, k, done;
    while (order < n && !(fabs(c[order]) > noise)) ++order;
    if (order == n) return HUGE_VAL;
    if (c[order] < 0.0) return 0.0;
    c += order;
    degree = n - order - 1;
    {
        double swing = 0.0;
        for (k = 1; k <= degree; ++k) swing += fabs(c[k]);
        if (swing < c[0]) return HUGE_VAL;
    }
    lows[0] = 0.0;
    highs[0] = 1.0;
    bernstein(c, degree, waiting[0]);
    while (count > 0) {
        double low, high, middle, smallest, *local, *lower;
        int changes = 0;
        --count;
        low = lows[count];
        high = highs[count];
        local = waiting[count];
        for (smallest = local[0], k = 1; k <= degree; ++k) smallest = fmin(smallest, local[k]);
        if (smallest * pow(high, order) >= -noise) continue;
        for (k = 0; k < degree; ++k) changes += (local[k] < 0.0) != (local[k + 1] < 0.0);
        if (changes == 0) {
            if (local[0] < 0.0) return low;
            continue;
        }
        if (changes == 1 && local[0] >= 0.0) {
            double root = only_root(c, degree + 1, low, high);
            if (dip(c, degree + 1, root, order) >= noise) return root;
            continue;
        }
        if (high - low < NARROWEST) return low;
        /* de Casteljau: the right half stays in its row, the left half goes on top and is next */
        middle = 0.5 * (low + high);
        lower = waiting[count + 1];
        for (done = 0; done <= degree; ++done) {
            lower[done] = local[0];
            for (k = 0; k < degree - done; ++k) local[k] = 0.5 * (local[k] + local[k + 1]);
        }
        lows[count] = middle;
        highs[count] = high;
        lows[count + 1] = low;
        highs[count + 1] = middle;
        count += 2;
    }
    return HUGE_VAL;
}

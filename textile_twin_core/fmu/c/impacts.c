/* One instant of a contact machine: impulses until no touching stop approaches, then the stops that stay closed.

   Newton's restitution with Moreau's complementarity: an approaching stop opens with restitution times its speed, a stop
   at standstill transmits impulses, and none pulls. Stops that share bodies in one instant use the smallest of their
   restitutions, so that an impact never creates energy.
   SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>
#include "textile_twin.h"

#define NOISE 1.4210854715202004e-14 /* rounding of a gap, over the lengths whose difference it is */
#define DEPENDENT 1e-9               /* own part of a stop's effect that counts as none */
#define IMPACT_ROUNDS 500            /* in one instant, before stops close without restitution */
#define UNCHANGED 1e-6               /* time of dying bounces, over that in which accelerations change */
#define STOPS TT_SIZE(TT_STOPS)

typedef double square[STOPS][STOPS];

TT_LOCAL double tt_noise(const tt_state *s) { return NOISE * s->length; }

TT_LOCAL double tt_gap(const tt_state *s, int stop) {
    double sum = s->stop[stop].limit;
    int e;
    for (e = 0; e < TT_ELEMENTS; ++e) sum += tt_stop_ends[stop][e] * s->x[e];
    return sum;
}

static double opening_speed(const tt_state *s, int stop) {
    double sum = 0.0;
    int e;
    for (e = 0; e < TT_ELEMENTS; ++e) sum += tt_stop_ends[stop][e] * s->v[e];
    return sum;
}

/* Speed below which speeds are rounding, of earlier speeds or of lengths in forces. */
static double quiet_speed(const tt_state *s) { return fmax(1e-13 * s->fastest, 0.1 * tt_noise(s) * s->rate); }

/* Opening of one stop for a unit force in another one. */
static double effect(const tt_state *s, int of, int by) {
    double sum = 0.0;
    int e;
    for (e = 0; e < TT_BODIES; ++e) sum += tt_stop_ends[of][e] * tt_stop_ends[by][e] / s->mass[e];
    return sum;
}

static void effects(const tt_state *s, int n, const int *stops, square g) {
    int i, j;
    for (i = 0; i < n; ++i)
        for (j = 0; j < n; ++j) g[i][j] = effect(s, stops[i], stops[j]);
}

static int chosen(const int *flags, int *numbers) {
    int k, n = 0;
    for (k = 0; k < TT_STOPS; ++k)
        if (flags[k]) numbers[n++] = k;
    return n;
}

/* Solve the rows and columns `of` of a Gram matrix by elimination with diagonal pivots; unknowns of linearly dependent
   vectors come out as zero. */
static void solve(int n, const int *of, square g, const double *right, double *x) {
    double a[STOPS][STOPS], b[STOPS];
    int order[STOPS], rank = 0, i, k;
    for (i = 0; i < n; ++i) {
        order[i] = i;
        b[i] = right[i];
        x[i] = 0.0;
        for (k = 0; k < n; ++k) a[i][k] = g[of[i]][of[k]];
    }
    while (rank < n) {
        int best = rank, pivot;
        for (k = rank + 1; k < n; ++k) {
            int row = order[k], leader = order[best];
            if (a[row][row] * g[of[leader]][of[leader]] > a[leader][leader] * g[of[row]][of[row]]) best = k;
        }
        pivot = order[best];
        order[best] = order[rank];
        order[rank] = pivot;
        if (a[pivot][pivot] <= 1e-11 * g[of[pivot]][of[pivot]]) break;
        for (k = ++rank; k < n; ++k) {
            int row = order[k];
            double factor = a[row][pivot] / a[pivot][pivot];
            b[row] -= factor * b[pivot];
            for (i = rank; i < n; ++i) a[row][order[i]] -= factor * a[pivot][order[i]];
        }
    }
    while (rank-- > 0) {
        int row = order[rank];
        double sum = b[row];
        for (i = rank + 1; i < n; ++i) sum -= a[row][order[i]] * x[order[i]];
        x[row] = sum / a[row][row];
    }
}

/* Inverse of the effects of the closed stops on each other: forces that undo a motion of their gaps. */
TT_LOCAL void tt_constrain(const tt_state *s, double inverse[STOPS][STOPS]) {
    double unit[STOPS], column[STOPS];
    square g;
    int stops[STOPS], of[STOPS], n = chosen(s->closed, stops), i, j;
    effects(s, n, stops, g);
    for (i = 0; i < n; ++i) unit[i] = 0.0, of[i] = i;
    for (i = 0; i < n; ++i) {
        unit[i] = 1.0;
        solve(n, of, g, unit, column);
        unit[i] = 0.0;
        for (j = 0; j < n; ++j) inverse[j][i] = column[j];
    }
}

/* Residual of a stop's effect on itself after the others gave way as far as they can, with their relief. */
static double own_part(square g, int n, const int *others, int stop, double *relief) {
    double right[STOPS], own = g[stop][stop];
    int i;
    for (i = 0; i < n; ++i) right[i] = g[others[i]][stop];
    solve(n, others, g, right, relief);
    for (i = 0; i < n; ++i) own -= right[i] * relief[i];
    return own;
}

/* Let one more stop push; those that would then pull no longer push. Returns 0 where it jams a body. */
static int take_in(square g, int n, const double *opening, int *pushing, double *force, int stop) {
    double relief[STOPS], right[STOPS], target[STOPS];
    int active[STOPS], m = 0, i;
    for (i = 0; i < n; ++i)
        if (pushing[i]) active[m++] = i;
    pushing[stop] = 1;
    if (own_part(g, m, active, stop, relief) <= DEPENDENT * g[stop][stop]) {
        /* it takes load from the others without any motion, until one of them is free */
        double load = HUGE_VAL;
        int leaving = TT_NONE;
        for (i = 0; i < m; ++i)
            if (relief[i] > DEPENDENT && force[active[i]] / relief[i] < load) {
                load = force[active[i]] / relief[i];
                leaving = active[i];
            }
        if (leaving < 0) return 0;
        for (i = 0; i < m; ++i) force[active[i]] -= load * relief[i];
        force[stop] = load;
        force[leaving] = 0.0;
        pushing[leaving] = 0;
    }
    for (;;) {
        double share = 1.0;
        int leaving = TT_NONE;
        for (m = 0, i = 0; i < n; ++i)
            if (pushing[i]) right[m] = -opening[i], active[m++] = i;
        solve(m, active, g, right, target);
        for (i = 0; i < m; ++i) {
            double now = force[active[i]];
            if (target[i] <= 0.0 && now / (now - target[i] + 1e-300) <= share) {
                share = now / (now - target[i] + 1e-300);
                leaving = active[i];
            }
        }
        for (i = 0; i < m; ++i) force[active[i]] += share * (target[i] - force[active[i]]);
        if (leaving < 0) return 1;
        force[leaving] = 0.0;
        pushing[leaving] = 0;
    }
}

/* Forces f >= 0 with w = g f + opening >= 0 and f w = 0 (Gauss' principle of least constraint), by active sets
   (Lawson, C. L., Hanson, R. J. (1974). Solving Least Squares Problems, ch. 23). Returns 0 where a body is jammed. */
static int one_sided_forces(square g, int n, const double *opening, double *force, double *w) {
    int pushing[STOPS], round, k, j;
    double size = tt_largest(opening, n);
    for (k = 0; k < n; ++k) force[k] = 0.0, w[k] = opening[k], pushing[k] = 0;
    for (round = 0; round < 20 * (n + 1); ++round) {
        int worst = TT_NONE;
        for (k = 0; k < n; ++k)
            if (!pushing[k] && w[k] < -1e-13 * size && (worst < 0 || w[k] < w[worst])) worst = k;
        if (worst < 0) return 1;
        if (!take_in(g, n, opening, pushing, force, worst)) return 0;
        for (k = 0; k < n; ++k) {
            w[k] = opening[k];
            for (j = 0; j < n; ++j) w[k] += g[k][j] * force[j];
            if (pushing[k]) w[k] = 0.0;
        }
    }
    for (k = 0; k < n; ++k)
        if (!(w[k] >= -1e-9 * size)) return 0; /* more than rounding */
    return 1;
}

/* Forces of springs, dampers, pads and weights on the elements. */
static void forces(const tt_state *s, double *f) {
    int e, k;
    for (e = 0; e < TT_ELEMENTS; ++e) f[e] = e < TT_BODIES ? s->weight[e] : 0.0;
    for (k = 0; k < TT_SPRINGS; ++k) {
        double pull = -s->spring[k].stiffness * s->spring[k].free_length;
        for (e = 0; e < TT_ELEMENTS; ++e)
            pull += tt_spring_ends[k][e] * (s->spring[k].stiffness * s->x[e] + s->spring[k].damping * s->v[e]);
        for (e = 0; e < TT_ELEMENTS; ++e) f[e] -= tt_spring_ends[k][e] * pull;
    }
    for (k = 0; k < TT_PADS; ++k) {
        double depth = -s->pad[k].position, rate = 0.0, push;
        if (s->pressed[k] != TT_PUSHING) continue;
        for (e = 0; e < TT_ELEMENTS; ++e) {
            depth += tt_pad_ends[k][e] * s->x[e];
            rate += tt_pad_ends[k][e] * s->v[e];
        }
        push = depth * tt_value(s->pad[k].stiffness, TT_PAD_POWERS, depth) + s->pad[k].damping * rate;
        for (e = 0; e < TT_ELEMENTS; ++e) f[e] -= tt_pad_ends[k][e] * push;
    }
}

/* Forces in the candidate stops, and the acceleration with which every stop then opens. Returns 0 where they jam. */
static int opening_accelerations(const tt_state *s, double driven, int n, const int *candidates, double *force,
                                 double *opening) {
    double f[TT_ELEMENTS], some[STOPS], w[STOPS];
    square g;
    int k, e, c, possible;
    forces(s, f);
    for (k = 0; k < TT_STOPS; ++k) {
        opening[k] = tt_stop_ends[k][TT_BODIES] * driven;
        for (e = 0; e < TT_BODIES; ++e) opening[k] += tt_stop_ends[k][e] * f[e] / s->mass[e];
    }
    effects(s, n, candidates, g);
    for (c = 0; c < n; ++c) some[c] = opening[candidates[c]];
    possible = one_sided_forces(g, n, some, force, w);
    for (k = 0; k < TT_STOPS; ++k)
        for (c = 0; c < n; ++c) opening[k] += effect(s, k, candidates[c]) * force[c];
    for (c = 0; c < n; ++c) opening[candidates[c]] = w[c];
    return possible;
}

/* Whether the bounces after an impact are too small to be followed, so that the stop closes: restitution e under a
   closing acceleration a bounces for 2 v / (a (1 - e)), during which the acceleration must not change. */
static int dies_out(const tt_state *s, double driven, int n, const int *group, const int *approaching,
                    double restitution, int *possible) {
    double force[STOPS], opening[STOPS], quiet = quiet_speed(s);
    int resting[STOPS], candidates[STOPS], i, dies = 1;
    for (i = 0; i < TT_STOPS; ++i) resting[i] = s->closed[i] && fabs(opening_speed(s, i)) <= quiet;
    for (i = 0; i < n; ++i)
        if (approaching[i]) resting[group[i]] = 0;
    *possible = opening_accelerations(s, driven, chosen(resting, candidates), candidates, force, opening);
    for (i = 0; dies && i < n; ++i) {
        double closing = -opening[group[i]], speed = opening_speed(s, group[i]), flight;
        if (!approaching[i] || speed <= 0.0) continue;
        if (closing <= 0.0) return 0;
        flight = 2.0 * speed / closing;
        dies = restitution < 1.0 && flight / (1.0 - restitution) * s->rate <= UNCHANGED;
        if (restitution > 0.99 && speed * flight / 4.0 <= 1e-9 * s->length) dies = 1;
    }
    return dies;
}

static int push_apart(tt_state *s, int n, const int *group, const double *before, const int *approaching,
                      double restitution) {
    double target[STOPS], impulse[STOPS], w[STOPS];
    square g;
    int i, e, possible;
    for (i = 0; i < n; ++i) target[i] = before[group[i]] * (approaching[i] ? 1.0 + restitution : 1.0);
    effects(s, n, group, g);
    possible = one_sided_forces(g, n, target, impulse, w);
    for (i = 0; i < n; ++i)
        for (e = 0; e < TT_BODIES; ++e) s->v[e] += tt_stop_ends[group[i]][e] * impulse[i] / s->mass[e];
    return possible;
}

/* Impulses of one group of touching stops. Returns 0 where they jam a body. */
static int strike(tt_state *s, double driven, int n, const int *group, const double *before, int dead) {
    double restitution = dead ? 0.0 : 1.0, quiet = quiet_speed(s), v[TT_ELEMENTS];
    int approaching[STOPS], i, possible;
    for (i = 0; i < n; ++i) {
        approaching[i] = before[group[i]] < -quiet;
        if (approaching[i]) restitution = fmin(restitution, s->stop[group[i]].restitution);
    }
    memcpy(v, s->v, sizeof v);
    possible = push_apart(s, n, group, before, approaching, restitution);
    if (possible && restitution > 0.0 && dies_out(s, driven, n, group, approaching, restitution, &possible)) {
        memcpy(s->v, v, sizeof v);
        possible = possible && push_apart(s, n, group, before, approaching, 0.0);
    }
    return possible;
}

/* Label each stop that takes part with the first of those that share bodies with it, directly or through others. */
static void label_groups(const int *taking_part, int *label) {
    int stop, other, member, e;
    for (stop = 0; stop < TT_STOPS; ++stop) {
        label[stop] = taking_part[stop] ? stop : TT_NONE;
        for (other = 0; taking_part[stop] && other < stop; ++other)
            for (e = 0; e < TT_BODIES && label[other] >= 0; ++e)
                if (tt_stop_ends[stop][e] != 0.0 && tt_stop_ends[other][e] != 0.0) {
                    int first = label[stop] < label[other] ? label[stop] : label[other];
                    int second = label[stop] < label[other] ? label[other] : label[stop];
                    for (member = 0; member <= stop; ++member)
                        if (label[member] == second) label[member] = first;
                }
    }
}

/* Impulses in rounds, until no touching stop approaches. */
static int collide(tt_state *s, double driven, const int *touching) {
    double quiet = quiet_speed(s), speed[STOPS];
    int taking_part[STOPS], label[STOPS], group[STOPS], rounds, k, leader;
    for (rounds = IMPACT_ROUNDS; rounds >= 0; --rounds) {
        int struck = 0;
        for (k = 0; k < TT_STOPS; ++k) {
            speed[k] = opening_speed(s, k);
            taking_part[k] = touching[k] && (speed[k] <= quiet || rounds == 0);
        }
        label_groups(taking_part, label);
        for (leader = 0; leader < TT_STOPS; ++leader) {
            int n = 0, approaching = 0;
            for (k = 0; k < TT_STOPS; ++k)
                if (label[k] == leader) {
                    group[n++] = k;
                    approaching |= speed[k] < -quiet;
                }
            if (!approaching) continue;
            struck = 1;
            if (!strike(s, driven, n, group, speed, rounds == 0)) return 0;
        }
        if (!struck) break;
    }
    return 1;
}

/* Close the touching stops that push, and those that neither push nor open. */
static int choose_closed(tt_state *s, double driven, const int *touching, int gentle) {
    double quiet = quiet_speed(s), force[STOPS], opening[STOPS], relief[STOPS], faint;
    square g;
    int resting[STOPS], stops[STOPS], shut[STOPS], others[STOPS], n, c, i, m, possible;
    for (c = 0; c < TT_STOPS; ++c)
        resting[c] = touching[c] && !s->released[c] && (fabs(opening_speed(s, c)) <= quiet || c == gentle);
    n = chosen(resting, stops);
    possible = opening_accelerations(s, driven, n, stops, force, opening);
    faint = 1e-12 * fmax(tt_largest(opening, TT_STOPS), fabs(driven));
    effects(s, n, stops, g);
    for (c = 0; c < n; ++c) shut[c] = force[c] > 0.0;
    for (c = 0; c < n; ++c) {
        if (shut[c] || !(opening[stops[c]] <= faint || stops[c] == gentle)) continue;
        for (m = 0, i = 0; i < n; ++i)
            if (shut[i]) others[m++] = i;
        shut[c] = own_part(g, m, others, c, relief) > DEPENDENT * g[c][c]; /* else the others keep it closed */
    }
    memset(s->closed, 0, sizeof s->closed);
    for (c = 0; c < n; ++c) s->closed[stops[c]] = shut[c];
    return possible;
}

/* Settle an instant: `hit` is the stop whose gap has just closed. Returns 0 where stops jam a body between the driven
   element and the frame. */
TT_LOCAL int tt_settle(tt_state *s, double driven, int hit) {
    int touching[STOPS], k, gentle;
    if (hit != TT_NONE) { /* without the rounding of its gap, which bounces would accumulate */
        double excess = tt_gap(s, hit) / effect(s, hit, hit);
        for (k = 0; k < TT_BODIES; ++k) s->x[k] -= tt_stop_ends[hit][k] / s->mass[k] * excess;
    }
    for (k = 0; k < TT_STOPS; ++k) touching[k] = s->closed[k] || k == hit || tt_gap(s, k) <= 4.0 * tt_noise(s);
    gentle = hit != TT_NONE && opening_speed(s, hit) >= -quiet_speed(s) ? hit : TT_NONE;
    return collide(s, driven, touching) && choose_closed(s, driven, touching, gentle);
}

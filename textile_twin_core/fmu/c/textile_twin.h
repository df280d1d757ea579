/* A machine as a functional mock-up unit: what the generated model.c provides, and what both FMI interfaces use.
   SPDX-License-Identifier: Apache-2.0 */
#ifndef TEXTILE_TWIN_H
#define TEXTILE_TWIN_H

#include <stddef.h>
#include <stdint.h>
#include "model.h" /* TT_CHAIN or TT_CONTACT, TT_TORQUE_INPUT, TT_OUTPUTS, TT_PARAMETERS, TT_TOKEN, sizes of the machine */

#ifndef TT_EXPORT
#if defined _WIN32
#define TT_EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define TT_EXPORT __attribute__((visibility("default")))
#else
#define TT_EXPORT
#endif
#endif

/* all.c makes one translation unit of all files, so that the compiler sees through the calls between them. */
#ifndef TT_LOCAL
#define TT_LOCAL
#endif

#define TT_SIZE(n) ((n) > 0 ? (n) : 1)

/* Value references. */
enum { TT_TIME = 0, TT_DRIVE_TORQUE = 1, TT_THETA = 2, TT_OMEGA = 3, TT_ALPHA = 4, TT_DER_THETA = 5,
       TT_INDICATOR = 100, TT_OUTPUT = 1000, TT_PARAMETER = 100000, TT_STATE = 200000, TT_DER_STATE = 300000 };

/* Of every kind of machine. */
#define TT_COMMON                                                                                                      \
    double time, theta, omega, alpha, torque;                                                                          \
    double parameter[TT_SIZE(TT_PARAMETERS)];                                                                          \
    double output[TT_SIZE(TT_OUTPUTS)];                                                                                \
    int initialized, parameters_changed, outputs_old

#if TT_CHAIN

/* An elastic main shaft: a chain of stations that carry hangers (linkages, and what acts once on the main shaft). */
enum { TT_PIECES = TT_STATIONS - 1,
       TT_INDICATORS = TT_STATIONS + 2 * TT_HANGERS + (TT_PLAY ? 2 * TT_PIECES : 0),
       TT_STATES = TT_TORQUE_INPUT ? 2 * TT_STATIONS : 2 * TT_PIECES,
       TT_MONITORS = TT_STATIONS + 2 * TT_HANGERS + 2 * TT_PIECES };

/* All that an instance is in: copied as a whole to get and set its state. The motion is that of the station whose
   motion is the input; with a torque, the start of the drive's. */
typedef struct {
    TT_COMMON;
    /* With a torque: angle of the first station, twists of the pieces, speeds of the stations. With a motion: twists,
       and the speeds of the other stations beyond the given one. */
    double x[TT_STATES];
    double inertia[TT_STATIONS], viscous[TT_STATIONS];
    double stiffness[TT_PIECES], damping[TT_PIECES], half_play[TT_PIECES];
    double low[TT_SIZE(TT_HANGERS)], high[TT_SIZE(TT_HANGERS)]; /* angles between which the loads of a hanger hold */
    double mass[TT_STATIONS], net[TT_STATIONS];
    double step;                     /* step that the integrator tries next [s] */
    int row[TT_SIZE(TT_HANGERS)];    /* coefficients of the loads that hold */
    int turning[TT_STATIONS];        /* 1 forward, -1 backward, 0 held by dry friction */
    int side[TT_PIECES];             /* 1 and -1 in contact, 0 within the play; 1 without play */
} tt_state;

/* Generated. */
TT_LOCAL void tt_shaft(const double *p, tt_state *s);
TT_LOCAL void tt_outputs(const double *theta, const double *omega, const double *alpha, const double *piece, double *y);

#elif TT_CONTACT

/* Bodies on a line between springs, one-sided stops and pads. The elements are the bodies, then the driven one. */
enum { TT_DRIVEN = TT_BODIES, TT_ELEMENTS = TT_BODIES + 1, TT_INDICATORS = 0, TT_STATES = 0 };
enum { TT_ORDER = 26, TT_TERMS = TT_ORDER + 1 }; /* of power series */
#define TT_TURN 6.283185307179586
#define TT_EPSILON 2.220446049250313e-16

typedef struct { double stiffness, damping, free_length; } tt_spring;
typedef struct { double limit, restitution; } tt_stop;
typedef struct { double position, damping, stiffness[TT_PAD_POWERS]; } tt_pad;

/* Motion of the shaft over a communication step, and the section of the law of motion that the driven element is in. */
typedef struct {
    double theta[6]; /* shaft angle [rad], power series in seconds */
    double base;     /* shaft angle at which the section begins [rad] */
    double end;      /* time at which the shaft leaves the section, or the step ends [s] */
    int section;
} tt_drive;

/* All that an instance is in: copied as a whole to get and set its state. */
typedef struct {
    TT_COMMON;
    double mass[TT_SIZE(TT_BODIES)], weight[TT_SIZE(TT_BODIES)], start[TT_SIZE(TT_BODIES)], driven_mass;
    tt_spring spring[TT_SIZE(TT_SPRINGS)];
    tt_stop stop[TT_SIZE(TT_STOPS)];
    tt_pad pad[TT_SIZE(TT_PADS)];
    double length, rate;                      /* scales of lengths [m] and of the springs' rates [1/s] */
    double force, resistance;                 /* scales of forces of springs [N] and of dampers [N s/m] */
    double x[TT_ELEMENTS], v[TT_ELEMENTS];    /* positions [m], velocities [m/s] */
    double fastest;                           /* largest speed so far [m/s] */
    double clock;                             /* seconds since the beginning of the communication step */
    tt_drive drive;
    int closed[TT_SIZE(TT_STOPS)];
    int released[TT_SIZE(TT_STOPS)];          /* its force has just reached zero */
    int pressed[TT_SIZE(TT_PADS)];            /* TT_OFF, TT_PUSHING, TT_SLACK */
    int begun;                                /* the first step has been done */
    int unsettled;                            /* the stops that stay closed must be chosen */
    int failed;
} tt_state;

/* A stretch of motion: positions of the elements, forces of pads and closed stops, in powers of u, the share of h. */
typedef struct {
    double x[TT_ELEMENTS][TT_TERMS], pad[TT_SIZE(TT_PADS)][TT_TERMS], stop[TT_SIZE(TT_STOPS)][TT_TERMS], h;
} tt_motion;

enum { TT_OFF, TT_PUSHING, TT_SLACK }; /* a slack pad is touched, but its body leaves too fast */
enum { TT_NONE = -1 };

/* Generated. */
TT_LOCAL void tt_plant(const double *p, tt_state *s);

/* polynomials.c */
TT_LOCAL double tt_value(const double *c, int n, double u);
TT_LOCAL double tt_largest(const double *c, int n);
TT_LOCAL void tt_move(double *c, int n, double offset);
TT_LOCAL double tt_first_crossing(const double *c, int n, double noise);

/* impacts.c */
TT_LOCAL double tt_noise(const tt_state *s);
TT_LOCAL double tt_gap(const tt_state *s, int stop);
TT_LOCAL void tt_constrain(const tt_state *s, double inverse[TT_SIZE(TT_STOPS)][TT_SIZE(TT_STOPS)]);
TT_LOCAL int tt_settle(tt_state *s, double acceleration, int hit);

/* contact_motion.c */
TT_LOCAL void tt_drive_series(const tt_drive *d, double time, double h, int order, double *x);
TT_LOCAL double tt_law_slope(const tt_drive *d, double time);
TT_LOCAL double tt_leaves(const tt_drive *d, double time, double span, int *to);
TT_LOCAL void tt_enter_section(tt_drive *d, double angle);
TT_LOCAL void tt_expand(const tt_state *s, double h, int order, tt_motion *m);
TT_LOCAL void tt_step(const tt_state *s, double longest, tt_motion *m);
TT_LOCAL void tt_shorten(tt_motion *m, double factor);
TT_LOCAL void tt_arrive(tt_state *s, const tt_motion *m);

#else

enum { TT_INDICATORS = TT_LEAPS + (TT_TORQUE_INPUT ? 1 : 0), TT_STATES = TT_TORQUE_INPUT ? 2 : 0 };

/* All that an instance is in: copied as a whole to get and set its state. */
typedef struct {
    TT_COMMON;
    double constant[TT_SIZE(TT_CONSTANTS)];
    double leap[TT_SIZE(TT_LEAPS)]; /* values of the steps of the loads, held between events */
    double step;                    /* step that the integrator tries next [s] */
    int direction;                  /* in which the shaft turns: 1, -1; 0 at standstill */
} tt_state;

/* Generated. */
TT_LOCAL void tt_constants(const double *p, double *c);
TT_LOCAL void tt_outputs(const double *c, double theta, double omega, double alpha, const double *leap, double *y);
TT_LOCAL void tt_leaps(const double *c, double theta, double omega, double alpha, double *value, double *level);
TT_LOCAL double tt_acceleration(const double *c, double theta, double omega, double torque, const double *leap);

#endif

TT_LOCAL void tt_start_values(double *p); /* generated */

/* variables.c */
TT_LOCAL void tt_reset(tt_state *s);
TT_LOCAL int tt_get(tt_state *s, uint32_t reference, double *value);
TT_LOCAL int tt_set(tt_state *s, uint32_t reference, double value);

/* Runtime: runtime.c, chain.c or contact.c. */
TT_LOCAL void tt_initialize(tt_state *s);
TT_LOCAL void tt_bring_up_to_date(tt_state *s);
TT_LOCAL void tt_get_states(const tt_state *s, double *x);
TT_LOCAL void tt_set_states(tt_state *s, const double *x);
TT_LOCAL void tt_derivatives(tt_state *s, double *derivative);
TT_LOCAL void tt_indicators(tt_state *s, double *indicator);
TT_LOCAL int tt_event(tt_state *s); /* returns 1 where it changes a continuous state */
/* Advance by a span, which is exact where the time of a start long ago is not; 0 where the motion cannot be followed. */
TT_LOCAL int tt_advance(tt_state *s, double span);

#endif

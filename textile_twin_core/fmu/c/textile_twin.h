/* A machine as a functional mock-up unit: what the generated model.c provides, and what both FMI interfaces use.
   SPDX-License-Identifier: Apache-2.0 */
#ifndef TEXTILE_TWIN_H
#define TEXTILE_TWIN_H

#include <stddef.h>
#include <stdint.h>
#include "model.h" /* TT_CHAIN, TT_TORQUE_INPUT, TT_OUTPUTS, TT_PARAMETERS, TT_TOKEN and the sizes of the machine */

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

#if TT_CHAIN

/* An elastic main shaft: a chain of stations that carry hangers (linkages, and what acts once on the main shaft). */
enum { TT_PIECES = TT_STATIONS - 1,
       TT_INDICATORS = TT_STATIONS + 2 * TT_HANGERS + (TT_PLAY ? 2 * TT_PIECES : 0),
       TT_STATES = TT_TORQUE_INPUT ? 2 * TT_STATIONS : 2 * TT_PIECES,
       TT_MONITORS = TT_STATIONS + 2 * TT_HANGERS + 2 * TT_PIECES };

/* All that an instance is in: copied as a whole to get and set its state. */
typedef struct {
    double time, torque;
    double theta, omega, alpha; /* of the station whose motion is the input; with a torque, the start of the drive's */
    double parameter[TT_SIZE(TT_PARAMETERS)];
    double output[TT_SIZE(TT_OUTPUTS)];
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
    int initialized, parameters_changed, outputs_old;
} tt_state;

/* Generated. */
TT_LOCAL void tt_start_values(double *p);
TT_LOCAL void tt_shaft(const double *p, tt_state *s);
TT_LOCAL void tt_outputs(const double *theta, const double *omega, const double *alpha, const double *piece, double *y);

#else

enum { TT_INDICATORS = TT_LEAPS + (TT_TORQUE_INPUT ? 1 : 0), TT_STATES = TT_TORQUE_INPUT ? 2 : 0 };

/* All that an instance is in: copied as a whole to get and set its state. */
typedef struct {
    double time, theta, omega, alpha, torque;
    double parameter[TT_SIZE(TT_PARAMETERS)];
    double constant[TT_SIZE(TT_CONSTANTS)];
    double output[TT_SIZE(TT_OUTPUTS)];
    double leap[TT_SIZE(TT_LEAPS)]; /* values of the steps of the loads, held between events */
    double step;                    /* step that the integrator tries next [s] */
    int direction;                  /* in which the shaft turns: 1, -1; 0 at standstill */
    int initialized, parameters_changed, outputs_old;
} tt_state;

/* Generated. */
TT_LOCAL void tt_start_values(double *p);
TT_LOCAL void tt_constants(const double *p, double *c);
TT_LOCAL void tt_outputs(const double *c, double theta, double omega, double alpha, double *y);
TT_LOCAL void tt_leaps(const double *c, double theta, double omega, double *value, double *level);
TT_LOCAL double tt_acceleration(const double *c, double theta, double omega, double torque, const double *leap);

#endif

/* Runtime. */
TT_LOCAL void tt_reset(tt_state *s);
TT_LOCAL void tt_initialize(tt_state *s);
TT_LOCAL int tt_get(tt_state *s, uint32_t reference, double *value);
TT_LOCAL int tt_set(tt_state *s, uint32_t reference, double value);
TT_LOCAL void tt_get_states(const tt_state *s, double *x);
TT_LOCAL void tt_set_states(tt_state *s, const double *x);
TT_LOCAL void tt_derivatives(tt_state *s, double *derivative);
TT_LOCAL void tt_indicators(tt_state *s, double *indicator);
TT_LOCAL int tt_event(tt_state *s); /* returns 1 where it changes a continuous state */
TT_LOCAL int tt_advance(tt_state *s, double until); /* returns 0 where the motion cannot be followed */

#endif

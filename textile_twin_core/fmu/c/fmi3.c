/* The interface of FMI 3.0 (https://fmi-standard.org), model exchange and co-simulation.
   SPDX-License-Identifier: Apache-2.0 */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "textile_twin.h"

typedef void *Component;
typedef int Status;
typedef uint32_t Reference;
typedef const char *String;
typedef const uint8_t *Binary;
typedef void (*Logger)(void *environment, Status status, String category, String message);
enum { OK, WARNING, DISCARD, ERROR, FATAL };

typedef struct {
    tt_state state;
    Logger logger;
    void *environment;
} Instance;

#define STATE(c) (&((Instance *)(c))->state)

static Status fail(Component c, String message) {
    Instance *i = (Instance *)c;
    if (i->logger) i->logger(i->environment, ERROR, "error", message);
    return ERROR;
}

TT_EXPORT String fmi3GetVersion(void) { return "3.0"; }
TT_EXPORT Status fmi3SetDebugLogging(Component c, bool on, size_t n, const String categories[]) {
    (void)c; (void)on; (void)n; (void)categories;
    return OK;
}

static Component instantiate(String token, void *environment, Logger logger) {
    Instance *i;
    if (!token || strcmp(token, TT_TOKEN) != 0) {
        if (logger) logger(environment, ERROR, "error", "the instantiation token is of another model description");
        return NULL;
    }
    i = (Instance *)calloc(1, sizeof *i);
    if (!i) return NULL;
    i->logger = logger;
    i->environment = environment;
    tt_reset(&i->state);
    return i;
}
TT_EXPORT Component fmi3InstantiateModelExchange(String name, String token, String resources, bool visible,
                                                 bool logging, void *environment, Logger logger) {
    (void)name; (void)resources; (void)visible; (void)logging;
    return instantiate(token, environment, logger);
}
TT_EXPORT Component fmi3InstantiateCoSimulation(String name, String token, String resources, bool visible, bool logging,
                                                bool event_mode, bool early_return, const Reference required[],
                                                size_t n, void *environment, Logger logger, void (*update)(void)) {
    (void)name; (void)resources; (void)visible; (void)logging; (void)early_return; (void)required; (void)n; (void)update;
    if (event_mode) {
        if (logger) logger(environment, ERROR, "error", "this model has no event mode in co-simulation");
        return NULL;
    }
    return instantiate(token, environment, logger);
}
TT_EXPORT Component fmi3InstantiateScheduledExecution(String name, String token, String resources, bool visible,
                                                      bool logging, void *environment, Logger logger,
                                                      void (*clock)(void), void (*lock)(void), void (*unlock)(void)) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)clock; (void)lock; (void)unlock;
    if (logger) logger(environment, ERROR, "error", "scheduled execution is not provided");
    return NULL;
}
TT_EXPORT void fmi3FreeInstance(Component c) { free(c); }

TT_EXPORT Status fmi3EnterInitializationMode(Component c, bool has_tolerance, double tolerance, double start,
                                             bool has_stop, double stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    STATE(c)->time = start;
    return OK;
}
TT_EXPORT Status fmi3ExitInitializationMode(Component c) { tt_initialize(STATE(c)); return OK; }
TT_EXPORT Status fmi3EnterEventMode(Component c) { (void)c; return OK; }
TT_EXPORT Status fmi3Terminate(Component c) { (void)c; return OK; }
TT_EXPORT Status fmi3Reset(Component c) { tt_reset(STATE(c)); return OK; }

TT_EXPORT Status fmi3GetFloat64(Component c, const Reference r[], size_t n, double value[], size_t values) {
    size_t k;
    if (n != values) return fail(c, "fmi3GetFloat64: every variable has one value");
    for (k = 0; k < n; ++k)
        if (!tt_get(STATE(c), r[k], &value[k])) return fail(c, "fmi3GetFloat64: no variable has this value reference");
    return OK;
}
TT_EXPORT Status fmi3SetFloat64(Component c, const Reference r[], size_t n, const double value[], size_t values) {
    size_t k;
    if (n != values) return fail(c, "fmi3SetFloat64: every variable has one value");
    for (k = 0; k < n; ++k)
        if (!tt_set(STATE(c), r[k], value[k])) return fail(c, "fmi3SetFloat64: this variable cannot be set");
    return OK;
}
#define NO_VARIABLES(kind, type)                                                                                       \
    TT_EXPORT Status fmi3Get##kind(Component c, const Reference r[], size_t n, type value[], size_t values) {          \
        (void)r; (void)value; (void)values;                                                                            \
        return n ? fail(c, "there are variables of type Float64 alone") : OK;                                          \
    }                                                                                                                  \
    TT_EXPORT Status fmi3Set##kind(Component c, const Reference r[], size_t n, const type value[], size_t values) {    \
        (void)r; (void)value; (void)values;                                                                            \
        return n ? fail(c, "there are variables of type Float64 alone") : OK;                                          \
    }
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(Boolean, bool)
NO_VARIABLES(String, String)
TT_EXPORT Status fmi3GetBinary(Component c, const Reference r[], size_t n, size_t sizes[], Binary value[], size_t values) {
    (void)r; (void)sizes; (void)value; (void)values;
    return n ? fail(c, "there are variables of type Float64 alone") : OK;
}
TT_EXPORT Status fmi3SetBinary(Component c, const Reference r[], size_t n, const size_t sizes[], const Binary value[],
                               size_t values) {
    (void)r; (void)sizes; (void)value; (void)values;
    return n ? fail(c, "there are variables of type Float64 alone") : OK;
}
TT_EXPORT Status fmi3GetClock(Component c, const Reference r[], size_t n, bool value[]) {
    (void)r; (void)value;
    return n ? fail(c, "there are no clocks") : OK;
}
TT_EXPORT Status fmi3SetClock(Component c, const Reference r[], size_t n, const bool value[]) {
    (void)r; (void)value;
    return n ? fail(c, "there are no clocks") : OK;
}

TT_EXPORT Status fmi3GetFMUState(Component c, void **state) {
    if (!*state) *state = malloc(sizeof(tt_state));
    if (!*state) return fail(c, "fmi3GetFMUState: no memory");
    memcpy(*state, STATE(c), sizeof(tt_state));
    return OK;
}
TT_EXPORT Status fmi3SetFMUState(Component c, void *state) { memcpy(STATE(c), state, sizeof(tt_state)); return OK; }
TT_EXPORT Status fmi3FreeFMUState(Component c, void **state) {
    (void)c;
    free(*state);
    *state = NULL;
    return OK;
}
TT_EXPORT Status fmi3SerializedFMUStateSize(Component c, void *state, size_t *size) {
    (void)c; (void)state;
    *size = sizeof(tt_state);
    return OK;
}
TT_EXPORT Status fmi3SerializeFMUState(Component c, void *state, uint8_t bytes[], size_t size) {
    if (size < sizeof(tt_state)) return fail(c, "fmi3SerializeFMUState: the buffer is too small");
    memcpy(bytes, state, sizeof(tt_state));
    return OK;
}
TT_EXPORT Status fmi3DeserializeFMUState(Component c, const uint8_t bytes[], size_t size, void **state) {
    if (size < sizeof(tt_state)) return fail(c, "fmi3DeserializeFMUState: the buffer holds no state of this model");
    if (!*state) *state = malloc(sizeof(tt_state));
    if (!*state) return fail(c, "fmi3DeserializeFMUState: no memory");
    memcpy(*state, bytes, sizeof(tt_state));
    return OK;
}

/* Model exchange. */
TT_EXPORT Status fmi3UpdateDiscreteStates(Component c, bool *need_update, bool *terminate, bool *nominals_changed,
                                          bool *values_changed, bool *next_event_defined, double *next_event) {
    *need_update = *terminate = *nominals_changed = *next_event_defined = false;
    *next_event = 0.0;
    *values_changed = tt_event(STATE(c)) != 0;
    return OK;
}
TT_EXPORT Status fmi3EnterContinuousTimeMode(Component c) { (void)c; return OK; }
TT_EXPORT Status fmi3CompletedIntegratorStep(Component c, bool no_set, bool *enter_event, bool *terminate) {
    (void)c; (void)no_set;
    *enter_event = *terminate = false;
    return OK;
}
TT_EXPORT Status fmi3SetTime(Component c, double time) { STATE(c)->time = time; return OK; }
TT_EXPORT Status fmi3SetContinuousStates(Component c, const double x[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi3SetContinuousStates: wrong number of states");
    if (n) tt_set_states(STATE(c), x);
    return OK;
}
TT_EXPORT Status fmi3GetContinuousStateDerivatives(Component c, double derivative[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi3GetContinuousStateDerivatives: wrong number of states");
    tt_derivatives(STATE(c), derivative);
    return OK;
}
TT_EXPORT Status fmi3GetEventIndicators(Component c, double indicator[], size_t n) {
    if (n != (size_t)TT_INDICATORS) return fail(c, "fmi3GetEventIndicators: wrong number of indicators");
    if (n) tt_indicators(STATE(c), indicator);
    return OK;
}
TT_EXPORT Status fmi3GetContinuousStates(Component c, double x[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi3GetContinuousStates: wrong number of states");
    if (n) tt_get_states(STATE(c), x);
    return OK;
}
TT_EXPORT Status fmi3GetNominalsOfContinuousStates(Component c, double x[], size_t n) {
    size_t k;
    (void)c;
    for (k = 0; k < n; ++k) x[k] = 1.0;
    return OK;
}
TT_EXPORT Status fmi3GetNumberOfEventIndicators(Component c, size_t *n) { (void)c; *n = TT_INDICATORS; return OK; }
TT_EXPORT Status fmi3GetNumberOfContinuousStates(Component c, size_t *n) { (void)c; *n = TT_STATES; return OK; }

/* Co-simulation. */
TT_EXPORT Status fmi3EnterStepMode(Component c) { (void)c; return OK; }
TT_EXPORT Status fmi3GetOutputDerivatives(Component c, const Reference r[], size_t n, const int32_t orders[],
                                          double value[], size_t values) {
    (void)r; (void)n; (void)orders; (void)value; (void)values;
    return fail(c, "fmi3GetOutputDerivatives is not provided");
}
TT_EXPORT Status fmi3DoStep(Component c, double now, double size, bool no_set, bool *event, bool *terminate, bool *early,
                            double *last_time) {
    (void)no_set;
    *event = *terminate = *early = false;
    STATE(c)->time = now;
    if (!tt_advance(STATE(c), now + size)) {
        *last_time = STATE(c)->time;
        return fail(c, "fmi3DoStep: the motion cannot be followed; check inputs and parameters");
    }
    *last_time = now + size;
    return OK;
}

/* What a model of this kind has no use for. */
TT_EXPORT Status fmi3GetNumberOfVariableDependencies(Component c, Reference r, size_t *n) {
    (void)r; (void)n;
    return fail(c, "fmi3GetNumberOfVariableDependencies is not provided");
}
TT_EXPORT Status fmi3GetVariableDependencies(Component c, Reference r, size_t rows[], Reference independent[],
                                             size_t columns[], int kinds[], size_t n) {
    (void)r; (void)rows; (void)independent; (void)columns; (void)kinds; (void)n;
    return fail(c, "fmi3GetVariableDependencies is not provided");
}
TT_EXPORT Status fmi3GetDirectionalDerivative(Component c, const Reference u[], size_t nu, const Reference k[], size_t nk,
                                              const double seed[], size_t seeds, double out[], size_t outs) {
    (void)u; (void)nu; (void)k; (void)nk; (void)seed; (void)seeds; (void)out; (void)outs;
    return fail(c, "fmi3GetDirectionalDerivative is not provided");
}
TT_EXPORT Status fmi3GetAdjointDerivative(Component c, const Reference u[], size_t nu, const Reference k[], size_t nk,
                                          const double seed[], size_t seeds, double out[], size_t outs) {
    (void)u; (void)nu; (void)k; (void)nk; (void)seed; (void)seeds; (void)out; (void)outs;
    return fail(c, "fmi3GetAdjointDerivative is not provided");
}
TT_EXPORT Status fmi3EnterConfigurationMode(Component c) { return fail(c, "there are no structural parameters"); }
TT_EXPORT Status fmi3ExitConfigurationMode(Component c) { return fail(c, "there are no structural parameters"); }
TT_EXPORT Status fmi3GetIntervalDecimal(Component c, const Reference r[], size_t n, double interval[], int qualifier[]) {
    (void)r; (void)n; (void)interval; (void)qualifier;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status fmi3GetIntervalFraction(Component c, const Reference r[], size_t n, uint64_t counter[],
                                         uint64_t resolution[], int qualifier[]) {
    (void)r; (void)n; (void)counter; (void)resolution; (void)qualifier;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status fmi3GetShiftDecimal(Component c, const Reference r[], size_t n, double shift[]) {
    (void)r; (void)n; (void)shift;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status fmi3GetShiftFraction(Component c, const Reference r[], size_t n, uint64_t counter[],
                                      uint64_t resolution[]) {
    (void)r; (void)n; (void)counter; (void)resolution;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status fmi3SetIntervalDecimal(Component c, const Reference r[], size_t n, const double interval[]) {
    (void)r; (void)n; (void)interval;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status fmi3SetIntervalFraction(Component c, const Reference r[], size_t n, const uint64_t counter[],
                                         const uint64_t resolution[]) {
    (void)r; (void)n; (void)counter; (void)resolution;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status fmi3SetShiftDecimal(Component c, const Reference r[], size_t n, const double shift[]) {
    (void)r; (void)n; (void)shift;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status fmi3SetShiftFraction(Component c, const Reference r[], size_t n, const uint64_t counter[],
                                      const uint64_t resolution[]) {
    (void)r; (void)n; (void)counter; (void)resolution;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status fmi3EvaluateDiscreteStates(Component c) { (void)c; return OK; }
TT_EXPORT Status fmi3ActivateModelPartition(Component c, Reference r, double time) {
    (void)r; (void)time;
    return fail(c, "scheduled execution is not provided");
}

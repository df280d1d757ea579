/* The interface of FMI 3.0 (https://fmi-standard.org), model exchange and co-simulation.
   SPDX-License-Identifier: Apache-2.0 */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "textile_twin.h"

/* Prefix of all functions, for several units in one program: cc -DFMI3_FUNCTION_PREFIX=name_ */
#if defined(FMI3_ACTUAL_FUNCTION_PREFIX)
#define PREFIX FMI3_ACTUAL_FUNCTION_PREFIX
#elif defined(FMI3_FUNCTION_PREFIX)
#define PREFIX FMI3_FUNCTION_PREFIX
#else
#define PREFIX
#endif
#define JOINED(prefix, name) prefix##name
#define JOIN(prefix, name) JOINED(prefix, name)
#define FMI(name) JOIN(PREFIX, fmi3##name)

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

TT_EXPORT String FMI(GetVersion)(void) { return "3.0"; }
TT_EXPORT Status FMI(SetDebugLogging)(Component c, bool on, size_t n, const String categories[]) {
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
TT_EXPORT Component FMI(InstantiateModelExchange)(String name, String token, String resources, bool visible,
                                                 bool logging, void *environment, Logger logger) {
    (void)name; (void)resources; (void)visible; (void)logging;
    return instantiate(token, environment, logger);
}
TT_EXPORT Component FMI(InstantiateCoSimulation)(String name, String token, String resources, bool visible, bool logging,
                                                bool event_mode, bool early_return, const Reference required[],
                                                size_t n, void *environment, Logger logger, void (*update)(void)) {
    (void)name; (void)resources; (void)visible; (void)logging; (void)early_return; (void)required; (void)n; (void)update;
    if (event_mode) {
        if (logger) logger(environment, ERROR, "error", "this model has no event mode in co-simulation");
        return NULL;
    }
    return instantiate(token, environment, logger);
}
TT_EXPORT Component FMI(InstantiateScheduledExecution)(String name, String token, String resources, bool visible,
                                                      bool logging, void *environment, Logger logger,
                                                      void (*clock)(void), void (*lock)(void), void (*unlock)(void)) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)clock; (void)lock; (void)unlock;
    if (logger) logger(environment, ERROR, "error", "scheduled execution is not provided");
    return NULL;
}
TT_EXPORT void FMI(FreeInstance)(Component c) { free(c); }

TT_EXPORT Status FMI(EnterInitializationMode)(Component c, bool has_tolerance, double tolerance, double start,
                                             bool has_stop, double stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    STATE(c)->time = start;
    return OK;
}
TT_EXPORT Status FMI(ExitInitializationMode)(Component c) { tt_initialize(STATE(c)); return OK; }
TT_EXPORT Status FMI(EnterEventMode)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(Terminate)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(Reset)(Component c) { tt_reset(STATE(c)); return OK; }

TT_EXPORT Status FMI(GetFloat64)(Component c, const Reference r[], size_t n, double value[], size_t values) {
    size_t k;
    if (n != values) return fail(c, "fmi3GetFloat64: every variable has one value");
    for (k = 0; k < n; ++k)
        if (!tt_get(STATE(c), r[k], &value[k])) return fail(c, "fmi3GetFloat64: no variable has this value reference");
    return OK;
}
TT_EXPORT Status FMI(SetFloat64)(Component c, const Reference r[], size_t n, const double value[], size_t values) {
    size_t k;
    if (n != values) return fail(c, "fmi3SetFloat64: every variable has one value");
    for (k = 0; k < n; ++k)
        if (!tt_set(STATE(c), r[k], value[k])) return fail(c, "fmi3SetFloat64: this variable cannot be set");
    return OK;
}
#define NO_VARIABLES(kind, type)                                                                                       \
    TT_EXPORT Status FMI(Get##kind)(Component c, const Reference r[], size_t n, type value[], size_t values) {          \
        (void)r; (void)value; (void)values;                                                                            \
        return n ? fail(c, "there are variables of type Float64 alone") : OK;                                          \
    }                                                                                                                  \
    TT_EXPORT Status FMI(Set##kind)(Component c, const Reference r[], size_t n, const type value[], size_t values) {    \
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
TT_EXPORT Status FMI(GetBinary)(Component c, const Reference r[], size_t n, size_t sizes[], Binary value[], size_t values) {
    (void)r; (void)sizes; (void)value; (void)values;
    return n ? fail(c, "there are variables of type Float64 alone") : OK;
}
TT_EXPORT Status FMI(SetBinary)(Component c, const Reference r[], size_t n, const size_t sizes[], const Binary value[],
                               size_t values) {
    (void)r; (void)sizes; (void)value; (void)values;
    return n ? fail(c, "there are variables of type Float64 alone") : OK;
}
TT_EXPORT Status FMI(GetClock)(Component c, const Reference r[], size_t n, bool value[]) {
    (void)r; (void)value;
    return n ? fail(c, "there are no clocks") : OK;
}
TT_EXPORT Status FMI(SetClock)(Component c, const Reference r[], size_t n, const bool value[]) {
    (void)r; (void)value;
    return n ? fail(c, "there are no clocks") : OK;
}

TT_EXPORT Status FMI(GetFMUState)(Component c, void **state) {
    if (!*state) *state = malloc(sizeof(tt_state));
    if (!*state) return fail(c, "fmi3GetFMUState: no memory");
    memcpy(*state, STATE(c), sizeof(tt_state));
    return OK;
}
TT_EXPORT Status FMI(SetFMUState)(Component c, void *state) { memcpy(STATE(c), state, sizeof(tt_state)); return OK; }
TT_EXPORT Status FMI(FreeFMUState)(Component c, void **state) {
    (void)c;
    free(*state);
    *state = NULL;
    return OK;
}
TT_EXPORT Status FMI(SerializedFMUStateSize)(Component c, void *state, size_t *size) {
    (void)c; (void)state;
    *size = sizeof(tt_state);
    return OK;
}
TT_EXPORT Status FMI(SerializeFMUState)(Component c, void *state, uint8_t bytes[], size_t size) {
    if (size < sizeof(tt_state)) return fail(c, "fmi3SerializeFMUState: the buffer is too small");
    memcpy(bytes, state, sizeof(tt_state));
    return OK;
}
TT_EXPORT Status FMI(DeserializeFMUState)(Component c, const uint8_t bytes[], size_t size, void **state) {
    if (size < sizeof(tt_state)) return fail(c, "fmi3DeserializeFMUState: the buffer holds no state of this model");
    if (!*state) *state = malloc(sizeof(tt_state));
    if (!*state) return fail(c, "fmi3DeserializeFMUState: no memory");
    memcpy(*state, bytes, sizeof(tt_state));
    return OK;
}

/* Model exchange. */
TT_EXPORT Status FMI(UpdateDiscreteStates)(Component c, bool *need_update, bool *terminate, bool *nominals_changed,
                                          bool *values_changed, bool *next_event_defined, double *next_event) {
    *need_update = *terminate = *nominals_changed = *next_event_defined = false;
    *next_event = 0.0;
    *values_changed = tt_event(STATE(c)) != 0;
    return OK;
}
TT_EXPORT Status FMI(EnterContinuousTimeMode)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(CompletedIntegratorStep)(Component c, bool no_set, bool *enter_event, bool *terminate) {
    (void)c; (void)no_set;
    *enter_event = *terminate = false;
    return OK;
}
TT_EXPORT Status FMI(SetTime)(Component c, double time) { STATE(c)->time = time; return OK; }
TT_EXPORT Status FMI(SetContinuousStates)(Component c, const double x[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi3SetContinuousStates: wrong number of states");
    if (n) tt_set_states(STATE(c), x);
    return OK;
}
TT_EXPORT Status FMI(GetContinuousStateDerivatives)(Component c, double derivative[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi3GetContinuousStateDerivatives: wrong number of states");
    tt_derivatives(STATE(c), derivative);
    return OK;
}
TT_EXPORT Status FMI(GetEventIndicators)(Component c, double indicator[], size_t n) {
    if (n != (size_t)TT_INDICATORS) return fail(c, "fmi3GetEventIndicators: wrong number of indicators");
    if (n) tt_indicators(STATE(c), indicator);
    return OK;
}
TT_EXPORT Status FMI(GetContinuousStates)(Component c, double x[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi3GetContinuousStates: wrong number of states");
    if (n) tt_get_states(STATE(c), x);
    return OK;
}
TT_EXPORT Status FMI(GetNominalsOfContinuousStates)(Component c, double x[], size_t n) {
    size_t k;
    (void)c;
    for (k = 0; k < n; ++k) x[k] = 1.0;
    return OK;
}
TT_EXPORT Status FMI(GetNumberOfEventIndicators)(Component c, size_t *n) { (void)c; *n = TT_INDICATORS; return OK; }
TT_EXPORT Status FMI(GetNumberOfContinuousStates)(Component c, size_t *n) { (void)c; *n = TT_STATES; return OK; }

/* Co-simulation. */
TT_EXPORT Status FMI(EnterStepMode)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(GetOutputDerivatives)(Component c, const Reference r[], size_t n, const int32_t orders[],
                                          double value[], size_t values) {
    (void)r; (void)n; (void)orders; (void)value; (void)values;
    return fail(c, "fmi3GetOutputDerivatives is not provided");
}
TT_EXPORT Status FMI(DoStep)(Component c, double now, double size, bool no_set, bool *event, bool *terminate, bool *early,
                            double *last_time) {
    (void)no_set;
    *event = *terminate = *early = false;
    STATE(c)->time = now;
    if (!tt_advance(STATE(c), size)) {
        *last_time = STATE(c)->time;
        return fail(c, "fmi3DoStep: the motion cannot be followed; check inputs and parameters");
    }
    *last_time = now + size;
    return OK;
}

/* What a model of this kind has no use for. */
TT_EXPORT Status FMI(GetNumberOfVariableDependencies)(Component c, Reference r, size_t *n) {
    (void)r; (void)n;
    return fail(c, "fmi3GetNumberOfVariableDependencies is not provided");
}
TT_EXPORT Status FMI(GetVariableDependencies)(Component c, Reference r, size_t rows[], Reference independent[],
                                             size_t columns[], int kinds[], size_t n) {
    (void)r; (void)rows; (void)independent; (void)columns; (void)kinds; (void)n;
    return fail(c, "fmi3GetVariableDependencies is not provided");
}
TT_EXPORT Status FMI(GetDirectionalDerivative)(Component c, const Reference u[], size_t nu, const Reference k[], size_t nk,
                                              const double seed[], size_t seeds, double out[], size_t outs) {
    (void)u; (void)nu; (void)k; (void)nk; (void)seed; (void)seeds; (void)out; (void)outs;
    return fail(c, "fmi3GetDirectionalDerivative is not provided");
}
TT_EXPORT Status FMI(GetAdjointDerivative)(Component c, const Reference u[], size_t nu, const Reference k[], size_t nk,
                                          const double seed[], size_t seeds, double out[], size_t outs) {
    (void)u; (void)nu; (void)k; (void)nk; (void)seed; (void)seeds; (void)out; (void)outs;
    return fail(c, "fmi3GetAdjointDerivative is not provided");
}
TT_EXPORT Status FMI(EnterConfigurationMode)(Component c) { return fail(c, "there are no structural parameters"); }
TT_EXPORT Status FMI(ExitConfigurationMode)(Component c) { return fail(c, "there are no structural parameters"); }
TT_EXPORT Status FMI(GetIntervalDecimal)(Component c, const Reference r[], size_t n, double interval[], int qualifier[]) {
    (void)r; (void)n; (void)interval; (void)qualifier;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status FMI(GetIntervalFraction)(Component c, const Reference r[], size_t n, uint64_t counter[],
                                         uint64_t resolution[], int qualifier[]) {
    (void)r; (void)n; (void)counter; (void)resolution; (void)qualifier;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status FMI(GetShiftDecimal)(Component c, const Reference r[], size_t n, double shift[]) {
    (void)r; (void)n; (void)shift;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status FMI(GetShiftFraction)(Component c, const Reference r[], size_t n, uint64_t counter[],
                                      uint64_t resolution[]) {
    (void)r; (void)n; (void)counter; (void)resolution;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status FMI(SetIntervalDecimal)(Component c, const Reference r[], size_t n, const double interval[]) {
    (void)r; (void)n; (void)interval;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status FMI(SetIntervalFraction)(Component c, const Reference r[], size_t n, const uint64_t counter[],
                                         const uint64_t resolution[]) {
    (void)r; (void)n; (void)counter; (void)resolution;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status FMI(SetShiftDecimal)(Component c, const Reference r[], size_t n, const double shift[]) {
    (void)r; (void)n; (void)shift;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status FMI(SetShiftFraction)(Component c, const Reference r[], size_t n, const uint64_t counter[],
                                      const uint64_t resolution[]) {
    (void)r; (void)n; (void)counter; (void)resolution;
    return fail(c, "there are no clocks");
}
TT_EXPORT Status FMI(EvaluateDiscreteStates)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(ActivateModelPartition)(Component c, Reference r, double time) {
    (void)r; (void)time;
    return fail(c, "scheduled execution is not provided");
}

/* The interface of FMI 2.0 (https://fmi-standard.org), model exchange and co-simulation.
   SPDX-License-Identifier: Apache-2.0 */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include "textile_twin.h"

/* Prefix of all functions, for several units in one program: cc -DFMI2_FUNCTION_PREFIX=name_ */
#if defined(FMI2_ACTUAL_FUNCTION_PREFIX)
#define PREFIX FMI2_ACTUAL_FUNCTION_PREFIX
#elif defined(FMI2_FUNCTION_PREFIX)
#define PREFIX FMI2_FUNCTION_PREFIX
#else
#define PREFIX
#endif
#define JOINED(prefix, name) prefix##name
#define JOIN(prefix, name) JOINED(prefix, name)
#define FMI(name) JOIN(PREFIX, fmi2##name)

typedef void *Component;
typedef int Status, Boolean, Integer;
typedef unsigned int Reference;
typedef double Real;
typedef const char *String;
enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING };

typedef struct {
    void (*logger)(void *environment, String name, Status status, String category, String message, ...);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, Status status);
    void *environment;
} Callbacks;

typedef struct {
    Boolean new_discrete_states_needed, terminate, nominals_changed, values_changed, next_event_time_defined;
    Real next_event_time;
} EventInfo;

typedef struct {
    tt_state state;
    Callbacks callbacks;
    char name[256];
} Instance;

#define STATE(c) (&((Instance *)(c))->state)

static Status fail(Component c, String message) {
    Instance *i = (Instance *)c;
    if (i->callbacks.logger) i->callbacks.logger(i->callbacks.environment, i->name, ERROR, "error", message);
    return ERROR;
}

TT_EXPORT String FMI(GetTypesPlatform)(void) { return "default"; }
TT_EXPORT String FMI(GetVersion)(void) { return "2.0"; }
TT_EXPORT Status FMI(SetDebugLogging)(Component c, Boolean on, size_t n, const String categories[]) {
    (void)c; (void)on; (void)n; (void)categories;
    return OK;
}

TT_EXPORT Component FMI(Instantiate)(String name, int type, String token, String resources, const Callbacks *callbacks,
                                    Boolean visible, Boolean logging) {
    Instance *i;
    (void)type; (void)resources; (void)visible; (void)logging;
    if (!token || strcmp(token, TT_TOKEN) != 0) {
        if (callbacks && callbacks->logger)
            callbacks->logger(callbacks->environment, name, ERROR, "error", "the guid is of another model description");
        return NULL;
    }
    i = (Instance *)calloc(1, sizeof *i);
    if (!i) return NULL;
    if (callbacks) i->callbacks = *callbacks;
    if (name) strncpy(i->name, name, sizeof i->name - 1);
    tt_reset(&i->state);
    return i;
}
TT_EXPORT void FMI(FreeInstance)(Component c) { free(c); }

TT_EXPORT Status FMI(SetupExperiment)(Component c, Boolean has_tolerance, Real tolerance, Real start, Boolean has_stop,
                                     Real stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    STATE(c)->time = start;
    return OK;
}
TT_EXPORT Status FMI(EnterInitializationMode)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(ExitInitializationMode)(Component c) { tt_initialize(STATE(c)); return OK; }
TT_EXPORT Status FMI(Terminate)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(Reset)(Component c) { tt_reset(STATE(c)); return OK; }

TT_EXPORT Status FMI(GetReal)(Component c, const Reference r[], size_t n, Real value[]) {
    size_t k;
    for (k = 0; k < n; ++k)
        if (!tt_get(STATE(c), r[k], &value[k])) return fail(c, "fmi2GetReal: no variable has this value reference");
    return OK;
}
TT_EXPORT Status FMI(SetReal)(Component c, const Reference r[], size_t n, const Real value[]) {
    size_t k;
    for (k = 0; k < n; ++k)
        if (!tt_set(STATE(c), r[k], value[k])) return fail(c, "fmi2SetReal: this variable cannot be set");
    return OK;
}
#define NO_VARIABLES(kind, type)                                                                                       \
    TT_EXPORT Status FMI(Get##kind)(Component c, const Reference r[], size_t n, type value[]) {                         \
        (void)r; (void)value;                                                                                          \
        return n ? fail(c, "there are variables of type Real alone") : OK;                                             \
    }                                                                                                                  \
    TT_EXPORT Status FMI(Set##kind)(Component c, const Reference r[], size_t n, const type value[]) {                   \
        (void)r; (void)value;                                                                                          \
        return n ? fail(c, "there are variables of type Real alone") : OK;                                             \
    }
NO_VARIABLES(Integer, Integer)
NO_VARIABLES(Boolean, Boolean)
NO_VARIABLES(String, String)

TT_EXPORT Status FMI(GetFMUstate)(Component c, void **state) {
    if (!*state) *state = malloc(sizeof(tt_state));
    if (!*state) return fail(c, "fmi2GetFMUstate: no memory");
    memcpy(*state, STATE(c), sizeof(tt_state));
    return OK;
}
TT_EXPORT Status FMI(SetFMUstate)(Component c, void *state) { memcpy(STATE(c), state, sizeof(tt_state)); return OK; }
TT_EXPORT Status FMI(FreeFMUstate)(Component c, void **state) {
    (void)c;
    free(*state);
    *state = NULL;
    return OK;
}
TT_EXPORT Status FMI(SerializedFMUstateSize)(Component c, void *state, size_t *size) {
    (void)c; (void)state;
    *size = sizeof(tt_state);
    return OK;
}
TT_EXPORT Status FMI(SerializeFMUstate)(Component c, void *state, char bytes[], size_t size) {
    if (size < sizeof(tt_state)) return fail(c, "fmi2SerializeFMUstate: the buffer is too small");
    memcpy(bytes, state, sizeof(tt_state));
    return OK;
}
TT_EXPORT Status FMI(DeSerializeFMUstate)(Component c, const char bytes[], size_t size, void **state) {
    if (size < sizeof(tt_state)) return fail(c, "fmi2DeSerializeFMUstate: the buffer holds no state of this model");
    if (!*state) *state = malloc(sizeof(tt_state));
    if (!*state) return fail(c, "fmi2DeSerializeFMUstate: no memory");
    memcpy(*state, bytes, sizeof(tt_state));
    return OK;
}
TT_EXPORT Status FMI(GetDirectionalDerivative)(Component c, const Reference u[], size_t nu, const Reference k[],
                                              size_t nk, const Real dk[], Real du[]) {
    (void)u; (void)nu; (void)k; (void)nk; (void)dk; (void)du;
    return fail(c, "fmi2GetDirectionalDerivative is not provided");
}

/* Model exchange. */
TT_EXPORT Status FMI(EnterEventMode)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(NewDiscreteStates)(Component c, EventInfo *info) {
    memset(info, 0, sizeof *info);
    info->values_changed = tt_event(STATE(c));
    return OK;
}
TT_EXPORT Status FMI(EnterContinuousTimeMode)(Component c) { (void)c; return OK; }
TT_EXPORT Status FMI(CompletedIntegratorStep)(Component c, Boolean no_set, Boolean *enter_event, Boolean *terminate) {
    (void)c; (void)no_set;
    *enter_event = *terminate = 0;
    return OK;
}
TT_EXPORT Status FMI(SetTime)(Component c, Real time) { STATE(c)->time = time; return OK; }
TT_EXPORT Status FMI(SetContinuousStates)(Component c, const Real x[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi2SetContinuousStates: wrong number of states");
    if (n) tt_set_states(STATE(c), x);
    return OK;
}
TT_EXPORT Status FMI(GetDerivatives)(Component c, Real derivative[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi2GetDerivatives: wrong number of states");
    tt_derivatives(STATE(c), derivative);
    return OK;
}
TT_EXPORT Status FMI(GetEventIndicators)(Component c, Real indicator[], size_t n) {
    if (n != (size_t)TT_INDICATORS) return fail(c, "fmi2GetEventIndicators: wrong number of indicators");
    if (n) tt_indicators(STATE(c), indicator);
    return OK;
}
TT_EXPORT Status FMI(GetContinuousStates)(Component c, Real x[], size_t n) {
    if (n != (size_t)TT_STATES) return fail(c, "fmi2GetContinuousStates: wrong number of states");
    if (n) tt_get_states(STATE(c), x);
    return OK;
}
TT_EXPORT Status FMI(GetNominalsOfContinuousStates)(Component c, Real x[], size_t n) {
    size_t k;
    (void)c;
    for (k = 0; k < n; ++k) x[k] = 1.0;
    return OK;
}

/* Co-simulation. */
TT_EXPORT Status FMI(SetRealInputDerivatives)(Component c, const Reference r[], size_t n, const Integer order[],
                                             const Real value[]) {
    (void)r; (void)n; (void)order; (void)value;
    return fail(c, "fmi2SetRealInputDerivatives is not provided");
}
TT_EXPORT Status FMI(GetRealOutputDerivatives)(Component c, const Reference r[], size_t n, const Integer order[],
                                              Real value[]) {
    (void)r; (void)n; (void)order; (void)value;
    return fail(c, "fmi2GetRealOutputDerivatives is not provided");
}
TT_EXPORT Status FMI(DoStep)(Component c, Real now, Real size, Boolean no_set) {
    (void)no_set;
    STATE(c)->time = now;
    if (!tt_advance(STATE(c), size)) return fail(c, "fmi2DoStep: the motion cannot be followed; check inputs and parameters");
    return OK;
}
TT_EXPORT Status FMI(CancelStep)(Component c) { return fail(c, "fmi2CancelStep: no step is pending"); }
TT_EXPORT Status FMI(GetStatus)(Component c, int kind, Status *value) {
    (void)c; (void)kind; (void)value;
    return DISCARD;
}
TT_EXPORT Status FMI(GetRealStatus)(Component c, int kind, Real *value) {
    if (kind != 2) return DISCARD; /* the last successful time */
    *value = STATE(c)->time;
    return OK;
}
TT_EXPORT Status FMI(GetIntegerStatus)(Component c, int kind, Integer *value) {
    (void)c; (void)kind; (void)value;
    return DISCARD;
}
TT_EXPORT Status FMI(GetBooleanStatus)(Component c, int kind, Boolean *value) {
    (void)c;
    if (kind != 3) return DISCARD; /* terminated */
    *value = 0;
    return OK;
}
TT_EXPORT Status FMI(GetStringStatus)(Component c, int kind, String *value) {
    (void)c; (void)kind; (void)value;
    return DISCARD;
}

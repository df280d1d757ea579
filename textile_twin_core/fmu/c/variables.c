/* Variables of a unit by their value references.
   SPDX-License-Identifier: Apache-2.0 */
#include <string.h>
#include "textile_twin.h"

TT_LOCAL void tt_reset(tt_state *s) {
    memset(s, 0, sizeof *s);
    tt_start_values(s->parameter);
    s->parameters_changed = s->outputs_old = 1;
}

TT_LOCAL int tt_get(tt_state *s, uint32_t reference, double *value) {
    if (s->outputs_old || s->parameters_changed) tt_bring_up_to_date(s);
    if (reference - TT_OUTPUT < TT_OUTPUTS) { /* most often asked for */
        *value = s->output[reference - TT_OUTPUT];
        return 1;
    }
#if TT_CHAIN
    if (reference >= TT_DER_STATE) {
        double derivative[TT_STATES];
        if (reference - TT_DER_STATE >= TT_STATES) return 0;
        tt_derivatives(s, derivative);
        *value = derivative[reference - TT_DER_STATE];
        return 1;
    }
    if (reference >= TT_STATE) {
        if (reference - TT_STATE >= TT_STATES) return 0;
        *value = s->x[reference - TT_STATE];
        return 1;
    }
#endif
    if (reference >= TT_PARAMETER) {
        if (reference - TT_PARAMETER >= TT_PARAMETERS) return 0;
        *value = s->parameter[reference - TT_PARAMETER];
        return 1;
    }
    if (reference >= TT_INDICATOR) {
        double indicator[TT_SIZE(TT_INDICATORS)];
        if (reference - TT_INDICATOR >= TT_INDICATORS) return 0;
        tt_indicators(s, indicator);
        *value = indicator[reference - TT_INDICATOR];
        return 1;
    }
    switch (reference) {
    case TT_TIME: *value = s->time; return 1;
    case TT_THETA: *value = s->theta; return 1;
    case TT_OMEGA: *value = s->omega; return 1;
    case TT_ALPHA: *value = s->alpha; return 1;
    case TT_DRIVE_TORQUE: *value = s->torque; return TT_TORQUE_INPUT;
    case TT_DER_THETA: *value = s->omega; return TT_TORQUE_INPUT && !TT_CHAIN;
    default: return 0;
    }
}

TT_LOCAL int tt_set(tt_state *s, uint32_t reference, double value) {
    /* the angle of a shaft under a torque is an output of the chain, which its states determine */
    int determined = TT_CHAIN && TT_TORQUE_INPUT && s->initialized;
    s->outputs_old = 1;
#if TT_CHAIN
    if (reference >= TT_STATE) {
        if (reference - TT_STATE >= TT_STATES || !s->initialized) return 0;
        s->x[reference - TT_STATE] = value;
        return 1;
    }
#endif
    if (reference >= TT_PARAMETER) {
        if (reference - TT_PARAMETER >= TT_PARAMETERS) return 0;
        s->parameter[reference - TT_PARAMETER] = value;
        s->parameters_changed = 1;
        return 1;
    }
    switch (reference) {
    case TT_THETA: s->theta = value; return !determined;
    case TT_OMEGA: s->omega = value; return !determined;
    case TT_ALPHA: s->alpha = value; return !TT_TORQUE_INPUT;
    case TT_DRIVE_TORQUE: s->torque = value; return TT_TORQUE_INPUT;
    default: return 0;
    }
}

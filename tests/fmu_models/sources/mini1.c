/* mini.h as FMI 1, co-simulation and model exchange in one library. */
#include "mini.h"

#include "fmi1Functions.h"

#pragma GCC visibility push(default)

const char *mini1_fmiGetTypesPlatform(void) { return "standard32"; }
const char *mini1_fmiGetModelTypesPlatform(void) { return "standard32"; }
const char *mini1_fmiGetVersion(void) { return "1.0"; }
fmi1Status mini1_fmiSetDebugLogging(fmi1Component c, fmi1Boolean on) { return (void)c, (void)on, fmi1OK; }

#define GET(NAME, TYPE)                                                                            \
    fmi1Status mini1_fmiGet##NAME(fmi1Component c, const fmi1ValueReference vr[], size_t n,        \
                                    TYPE value[]) {                                                \
        for (size_t i = 0; i < n; ++i)                                                             \
            value[i] = (TYPE)mini_get((mini *)c, vr[i]);                                           \
        return fmi1OK;                                                                              \
    }
#define SET(NAME, TYPE)                                                                            \
    fmi1Status mini1_fmiSet##NAME(fmi1Component c, const fmi1ValueReference vr[], size_t n,        \
                                    const TYPE value[]) {                                          \
        for (size_t i = 0; i < n; ++i)                                                             \
            ((mini *)c)->v[vr[i]] = (double)value[i];                                              \
        return fmi1OK;                                                                              \
    }
GET(Real, fmi1Real)
GET(Integer, fmi1Integer)
GET(Boolean, fmi1Boolean)
SET(Real, fmi1Real)
SET(Integer, fmi1Integer)
SET(Boolean, fmi1Boolean)
fmi1Status mini1_fmiGetString(fmi1Component c, const fmi1ValueReference vr[], size_t n, fmi1String v[]) {
    return (void)c, (void)vr, (void)n, (void)v, fmi1Error;
}
fmi1Status mini1_fmiSetString(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                const fmi1String v[]) {
    return (void)vr, ((mini *)c)->v[BATCH] = (double)strlen(v[0]), n == 1 ? fmi1OK : fmi1Error;
}

/* Co-simulation */
fmi1Component mini1_fmiInstantiateSlave(fmi1String name, fmi1String guid, fmi1String where,
                                          fmi1String type, fmi1Real timeout, fmi1Boolean visible,
                                          fmi1Boolean interactive, fmi1CallbackFunctions f,
                                          fmi1Boolean log) {
    (void)name, (void)where, (void)type, (void)timeout, (void)visible, (void)interactive, (void)log;
    if (strcmp(guid, "{mini}") != 0) {
        f.logger(0, name, fmi1Error, "error", "the GUID is not {mini}");
        return 0;
    }
    return mini_new();
}
fmi1Status mini1_fmiInitializeSlave(fmi1Component c, fmi1Real start, fmi1Boolean has_stop, fmi1Real stop) {
    (void)has_stop, (void)stop;
    mini_begin((mini *)c, start);
    return fmi1OK;
}
fmi1Status mini1_fmiTerminateSlave(fmi1Component c) { return (void)c, fmi1OK; }
fmi1Status mini1_fmiResetSlave(fmi1Component c) { return (void)c, fmi1OK; }
void mini1_fmiFreeSlaveInstance(fmi1Component c) { free(c); }
fmi1Status mini1_fmiSetRealInputDerivatives(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                              const fmi1Integer o[], const fmi1Real v[]) {
    return (void)c, (void)vr, (void)n, (void)o, (void)v, fmi1Error;
}
fmi1Status mini1_fmiGetRealOutputDerivatives(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                               const fmi1Integer o[], fmi1Real v[]) {
    return (void)c, (void)vr, (void)n, (void)o, (void)v, fmi1Error;
}
fmi1Status mini1_fmiDoStep(fmi1Component c, fmi1Real time, fmi1Real size, fmi1Boolean fresh) {
    (void)time, (void)fresh;
    if (size > 1.5)
        return fmi1Discard;
    mini_step((mini *)c, size);
    return fmi1OK;
}
fmi1Status mini1_fmiCancelStep(fmi1Component c) { return (void)c, fmi1Error; }
fmi1Status mini1_fmiGetStatus(fmi1Component c, const fmi1StatusKind k, fmi1Status *v) {
    return (void)c, (void)k, (void)v, fmi1Error;
}
fmi1Status mini1_fmiGetRealStatus(fmi1Component c, const fmi1StatusKind k, fmi1Real *v) {
    *v = ((mini *)c)->time;
    return k == fmi1LastSuccessfulTime ? fmi1OK : fmi1Error;
}
fmi1Status mini1_fmiGetIntegerStatus(fmi1Component c, const fmi1StatusKind k, fmi1Integer *v) {
    return (void)c, (void)k, (void)v, fmi1Error;
}
fmi1Status mini1_fmiGetBooleanStatus(fmi1Component c, const fmi1StatusKind k, fmi1Boolean *v) {
    return (void)c, (void)k, (void)v, fmi1Error;
}
fmi1Status mini1_fmiGetStringStatus(fmi1Component c, const fmi1StatusKind k, fmi1String *v) {
    return (void)c, (void)k, (void)v, fmi1Error;
}

/* Model exchange */
fmi1Component mini1_fmiInstantiateModel(fmi1String name, fmi1String guid, fmi1CallbackFunctions f,
                                          fmi1Boolean log) {
    (void)name, (void)guid, (void)f, (void)log;
    return mini_new();
}
void mini1_fmiFreeModelInstance(fmi1Component c) { free(c); }
fmi1Status mini1_fmiSetTime(fmi1Component c, fmi1Real time) { return ((mini *)c)->time = time, fmi1OK; }
fmi1Status mini1_fmiSetContinuousStates(fmi1Component c, const fmi1Real x[], size_t n) {
    return (void)n, ((mini *)c)->v[H] = x[0], fmi1OK;
}
fmi1Status mini1_fmiCompletedIntegratorStep(fmi1Component c, fmi1Boolean *event) {
    return (void)c, *event = fmi1False, fmi1OK;
}
static void tell(const mini *m, fmi1EventInfo *info) {
    info->iterationConverged = fmi1True;
    info->stateValueReferencesChanged = info->stateValuesChanged = info->terminateSimulation = fmi1False;
    info->upcomingTimeEvent = fmi1True;
    info->nextEventTime = m->next_event;
}
fmi1Status mini1_fmiInitialize(fmi1Component c, fmi1Boolean has_tolerance, fmi1Real tolerance,
                                 fmi1EventInfo *info) {
    (void)has_tolerance, (void)tolerance;
    mini_begin((mini *)c, ((mini *)c)->time);
    tell((mini *)c, info);
    return fmi1OK;
}
fmi1Status mini1_fmiGetDerivatives(fmi1Component c, fmi1Real d[], size_t n) {
    return (void)n, d[0] = mini_derivative((mini *)c), fmi1OK;
}
fmi1Status mini1_fmiGetEventIndicators(fmi1Component c, fmi1Real z[], size_t n) {
    return (void)n, z[0] = mini_indicator((mini *)c), fmi1OK;
}
fmi1Status mini1_fmiEventUpdate(fmi1Component c, fmi1Boolean intermediate, fmi1EventInfo *info) {
    (void)intermediate;
    mini_events((mini *)c);
    tell((mini *)c, info);
    return fmi1OK;
}
fmi1Status mini1_fmiGetContinuousStates(fmi1Component c, fmi1Real x[], size_t n) {
    return (void)n, x[0] = ((mini *)c)->v[H], fmi1OK;
}
fmi1Status mini1_fmiGetNominalContinuousStates(fmi1Component c, fmi1Real x[], size_t n) {
    return (void)c, (void)n, x[0] = 1.0, fmi1OK;
}
fmi1Status mini1_fmiGetStateValueReferences(fmi1Component c, fmi1ValueReference vr[], size_t n) {
    return (void)c, (void)n, vr[0] = H, fmi1OK;
}
fmi1Status mini1_fmiTerminate(fmi1Component c) { return (void)c, fmi1OK; }

/* mini.h as FMI 2, co-simulation and model exchange, with faults: the variable `fault` makes a step
 * answer 1 Warning, 2 Discard, 3 Error, 4 Fatal, 5 Discard for having ended, 6 NaN, 7 infinity, 8
 * an endless event iteration (model exchange). Steps above 1.5 s are discarded. */
#include "mini.h"

#include "fmi2Functions.h"

typedef struct {
    mini m;
    fmi2CallbackLogger log;
    int ended;
} instance;

static instance *of(fmi2Component c) { return (instance *)c; }

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    return (void)c, (void)on, (void)n, (void)names, fmi2OK;
}
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String where,
                              const fmi2CallbackFunctions *f, fmi2Boolean visible, fmi2Boolean log) {
    instance *i;
    (void)name, (void)type, (void)where, (void)visible, (void)log;
    if (strcmp(guid, "{mini}") != 0) {
        f->logger(0, name, fmi2Error, "error", "the GUID is %s", "not {mini}");
        return 0;
    }
    i = (instance *)calloc(1, sizeof *i);
    i->m.v[PUMP_ON] = i->m.v[MODE] = 1.0;
    i->log = f->logger;
    return i;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean ht, fmi2Real t, fmi2Real start,
                               fmi2Boolean hs, fmi2Real stop) {
    return (void)ht, (void)t, (void)hs, (void)stop, of(c)->m.time = start, fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return mini_begin(&of(c)->m, of(c)->m.time), fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return (void)c, fmi2Error; }

static double shown(instance *i, unsigned vr) {
    if (vr == H && i->m.v[FAULT] == 6.0)
        return NAN;
    if (vr == H && i->m.v[FAULT] == 7.0)
        return INFINITY;
    return mini_get(&i->m, vr);
}
#define GET(NAME, TYPE)                                                                            \
    fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             TYPE value[]) {                                                       \
        for (size_t i = 0; i < n; ++i)                                                             \
            value[i] = (TYPE)shown(of(c), vr[i]);                                                  \
        return fmi2OK;                                                                             \
    }
#define SET(NAME, TYPE)                                                                            \
    fmi2Status fmi2Set##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             const TYPE value[]) {                                                 \
        for (size_t i = 0; i < n; ++i)                                                             \
            of(c)->m.v[vr[i]] = (double)value[i];                                                  \
        return fmi2OK;                                                                             \
    }
GET(Real, fmi2Real)
GET(Integer, fmi2Integer)
GET(Boolean, fmi2Boolean)
SET(Real, fmi2Real)
SET(Integer, fmi2Integer)
SET(Boolean, fmi2Boolean)

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                         const fmi2String v[]) {
    return (void)vr, of(c)->m.v[BATCH] = (double)strlen(v[0]), n == 1 ? fmi2OK : fmi2Error;
}

#define REFUSE(FUNCTION, PARAMETERS)                                                               \
    fmi2Status FUNCTION PARAMETERS { return fmi2Error; }
REFUSE(fmi2GetString, (fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String v[]))
REFUSE(fmi2GetDirectionalDerivative,
       (fmi2Component c, const fmi2ValueReference u[], size_t nu, const fmi2ValueReference k[],
        size_t nk, const fmi2Real s[], fmi2Real v[]))
REFUSE(fmi2SetRealInputDerivatives, (fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                     const fmi2Integer o[], const fmi2Real v[]))
REFUSE(fmi2GetRealOutputDerivatives, (fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                      const fmi2Integer o[], fmi2Real v[]))
REFUSE(fmi2CancelStep, (fmi2Component c))
REFUSE(fmi2GetStatus, (fmi2Component c, const fmi2StatusKind k, fmi2Status *v))
REFUSE(fmi2GetIntegerStatus, (fmi2Component c, const fmi2StatusKind k, fmi2Integer *v))
REFUSE(fmi2GetStringStatus, (fmi2Component c, const fmi2StatusKind k, fmi2String *v))
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real *v) {
    *v = of(c)->m.time;
    return k == fmi2LastSuccessfulTime ? fmi2OK : fmi2Error;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean *v) {
    *v = of(c)->ended;
    return k == fmi2Terminated ? fmi2OK : fmi2Error;
}

/* A plain copy: whoever restores it goes back bit for bit. */
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s) {
    if (!*s)
        *s = malloc(sizeof(instance));
    return memcpy(*s, c, sizeof(instance)), fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) {
    return of(c)->m = ((instance *)s)->m, fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) {
    return (void)c, free(*s), *s = 0, fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) {
    return (void)c, (void)s, *n = sizeof(instance), fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) {
    return (void)c, memcpy(b, s, n), fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s) {
    if (n != sizeof(instance))
        return fmi2Error;
    if (!*s)
        *s = malloc(n);
    return (void)c, memcpy(*s, b, n), fmi2OK;
}

/* Co-simulation */
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_set) {
    const int fault = (int)of(c)->m.v[FAULT];
    (void)time, (void)no_set;
    of(c)->ended = fault == 5;
    if (size > 1.5 || fault == 5)
        return fmi2Discard;
    if (fault >= 2 && fault <= 4) {
        of(c)->log(0, "mini2", (fmi2Status)fault, "status", "asked for status %d", fault);
        return (fmi2Status)fault;
    }
    mini_step(&of(c)->m, size);
    return fault == 1 ? fmi2Warning : fmi2OK;
}

/* Model exchange */
fmi2Status fmi2EnterEventMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    mini_events(&of(c)->m);
    memset(info, 0, sizeof *info);
    info->newDiscreteStatesNeeded = of(c)->m.v[FAULT] == 8.0;
    info->terminateSimulation = of(c)->m.v[FAULT] == 5.0;
    info->nextEventTimeDefined = fmi2True;
    info->nextEventTime = of(c)->m.next_event;
    return fmi2OK;
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set, fmi2Boolean *event,
                                       fmi2Boolean *end) {
    return (void)c, (void)no_set, *event = *end = fmi2False, fmi2OK;
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) { return of(c)->m.time = time, fmi2OK; }
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    return (void)n, of(c)->m.v[H] = x[0], fmi2OK;
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real d[], size_t n) {
    (void)n;
    d[0] = of(c)->m.v[FAULT] == 6.0 ? NAN : mini_derivative(&of(c)->m);
    return of(c)->m.v[FAULT] == 3.0 ? fmi2Error : fmi2OK;
}
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n) {
    return (void)n, z[0] = mini_indicator(&of(c)->m), fmi2OK;
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    return (void)n, x[0] = of(c)->m.v[H], fmi2OK;
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    return (void)c, (void)n, x[0] = 1.0, fmi2OK;
}

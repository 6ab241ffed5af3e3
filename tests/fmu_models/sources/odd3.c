/* What FMI 3 has and few tools export, without our wrapper: arrays of fixed and of structural size,
 * event mode, early return, intermediate updates, an end of the simulation, a clock, a binary, a
 * variable called time; co-simulation and model exchange of one model, solved in closed form.
 *
 * dx/dt = gain (u[1] + 0.3 low) - x. Every 0.7 s x becomes 1; low changes when x passes 0.5. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3FunctionTypes.h"

#pragma GCC visibility push(default)

enum { T, TIME, N, U, Y, M, FLAG, MODE, X, COUNT, BLOB, TICKS, GAIN, STOP_AT, DER_X, LOW, PAUSE, NAMES, BEAT = 20, HELD, ALARM, ALARMS };
enum { MOST = 16 };

typedef struct {
    double time, x, gain, stop_at, next, u[MOST];
    uint64_t n;
    int64_t mode;
    int32_t count, low, flag, pause, beats, alarms, wants_alarm;
    double held;
} memory;

typedef struct {
    memory m;
    int events_outside, may_return, exchange;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmi3IntermediateUpdateCallback update;
} instance;

static double target(const memory *m) { return m->gain * (m->u[0] + 0.3 * m->low); }

static void side(memory *m) {
    if (fabs(m->x - 0.5) < 1e-5)
        m->low = target(m) - m->x < 0.0;
    else
        m->low = m->x < 0.5;
}

static void events(memory *m) {
    if (m->time >= m->next - 1e-9) {
        m->x = 1.0;
        m->count += 1;
        m->next += 0.7;
    }
    side(m);
}

static instance *make(fmi3String token, fmi3InstanceEnvironment e, fmi3LogMessageCallback log) {
    instance *i;
    if (strcmp(token, "{odd}") != 0) {
        log(e, fmi3Error, "error", "the token is not {odd}");
        return 0;
    }
    i = (instance *)calloc(1, sizeof *i);
    i->m.n = 3, i->m.gain = 1.0, i->m.stop_at = 1e9, i->m.x = 1.0, i->m.mode = 1;
    i->environment = e, i->log = log;
    return i;
}

const char *fmi3GetVersion(void) { return "3.0"; }
fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String names[]) {
    return (void)i, (void)on, (void)n, (void)names, fmi3OK;
}
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean log_on,
    fmi3Boolean event_mode, fmi3Boolean early, const fmi3ValueReference vr[], size_t n,
    fmi3InstanceEnvironment e, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    instance *i = make(token, e, log);
    (void)name, (void)resources, (void)visible, (void)log_on, (void)vr, (void)n;
    if (i)
        i->events_outside = event_mode, i->may_return = early, i->update = update;
    return i;
}
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean log_on,
                                          fmi3InstanceEnvironment e, fmi3LogMessageCallback log) {
    instance *i = make(token, e, log);
    (void)name, (void)resources, (void)visible, (void)log_on;
    if (i)
        i->exchange = i->events_outside = 1;
    return i;
}
void fmi3FreeInstance(fmi3Instance i) { free(i); }
fmi3Status fmi3EnterConfigurationMode(fmi3Instance i) { return (void)i, fmi3OK; }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance i) { return (void)i, fmi3OK; }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean ht, fmi3Float64 t,
                                       fmi3Float64 start, fmi3Boolean hs, fmi3Float64 stop) {
    memory *m = &((instance *)c)->m;
    (void)ht, (void)t, (void)hs, (void)stop;
    m->time = start, m->next = start + 0.7;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    return side(&((instance *)c)->m), fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance i) { return (void)i, fmi3OK; }
fmi3Status fmi3EnterEventMode(fmi3Instance i) { return (void)i, fmi3OK; }
fmi3Status fmi3EnterStepMode(fmi3Instance i) { return (void)i, fmi3OK; }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance i) { return (void)i, fmi3OK; }
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end,
                                    fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *has,
                                    fmi3Float64 *next) {
    memory *m = &((instance *)c)->m;
    events(m);
    *again = *nominals = fmi3False, *values = *has = fmi3True, *next = m->next;
    *end = m->time >= m->stop_at;
    return fmi3OK;
}

static fmi3Status get_real(memory *m, unsigned vr, double **v) {
    switch (vr) {
    case T:
    case TIME: *(*v)++ = m->time; return fmi3OK;
    case X: *(*v)++ = m->x; return fmi3OK;
    case HELD: *(*v)++ = m->held; return fmi3OK;
    case GAIN: *(*v)++ = m->gain; return fmi3OK;
    case STOP_AT: *(*v)++ = m->stop_at; return fmi3OK;
    case DER_X: *(*v)++ = target(m) - m->x; return fmi3OK;
    case U:
    case Y:
        for (uint64_t k = 0; k < m->n; ++k)
            *(*v)++ = vr == U ? m->u[k] : 2.0 * m->u[k];
        return fmi3OK;
    case M:
        for (int k = 0; k < 6; ++k)
            *(*v)++ = m->x * (k + 1);
        return fmi3OK;
    }
    return fmi3Error;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 v[],
                          size_t count) {
    double *at = v;
    for (size_t i = 0; i < n; ++i)
        if (get_real(&((instance *)c)->m, vr[i], &at) != fmi3OK)
            return fmi3Error;
    return at == v + count ? fmi3OK : fmi3Error;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 v[], size_t count) {
    memory *m = &((instance *)c)->m;
    const double *at = v;
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] == U)
            for (uint64_t k = 0; k < m->n; ++k)
                m->u[k] = *at++;
        else if (vr[i] == GAIN)
            m->gain = *at++;
        else if (vr[i] == STOP_AT)
            m->stop_at = *at++;
        else
            return fmi3Error;
    }
    return at == v + count ? fmi3OK : fmi3Error;
}
#define ONE(NAME, TYPE, REFERENCE, FIELD)                                                          \
    fmi3Status fmi3Get##NAME(fmi3Instance c, const fmi3ValueReference vr[], size_t n, TYPE v[],    \
                             size_t m) {                                                           \
        for (size_t i = 0; i < n; ++i)                                                             \
            if (vr[i] == REFERENCE)                                                                \
                v[i] = (TYPE)((instance *)c)->m.FIELD;                                             \
        return n == m ? fmi3OK : fmi3Error;                                                        \
    }                                                                                              \
    fmi3Status fmi3Set##NAME(fmi3Instance c, const fmi3ValueReference vr[], size_t n,              \
                             const TYPE v[], size_t m) {                                           \
        for (size_t i = 0; i < n; ++i)                                                             \
            if (vr[i] == REFERENCE)                                                                \
                ((instance *)c)->m.FIELD = v[i];                                                   \
        return n == m ? fmi3OK : fmi3Error;                                                        \
    }
/* Events are counted on from the bytes of both names, the second ten times. */
fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const fmi3String v[], size_t m) {
    if (n != 1 || vr[0] != NAMES || m != 2)
        return fmi3Error;
    ((instance *)c)->m.count = (int32_t)(strlen(v[0]) + 10 * strlen(v[1]));
    return fmi3OK;
}
ONE(UInt64, fmi3UInt64, N, n)
ONE(Int64, fmi3Int64, MODE, mode)
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 v[],
                        size_t m) {
    const memory *own = &((instance *)c)->m;
    for (size_t i = 0; i < n; ++i)
        v[i] = vr[i] == COUNT ? own->count : vr[i] == ALARMS ? own->alarms : own->beats;
    return n == m ? fmi3OK : fmi3Error;
}
fmi3Status fmi3SetInt32(void) { return fmi3Error; }
/* Clocks from outside: each beat holds u[2] and sets an alarm 0.2 s ahead. */
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        const fmi3Clock v[]) {
    memory *m = &((instance *)c)->m;
    for (size_t i = 0; i < n; ++i) {
        if (!v[i])
            continue;
        if (vr[i] == BEAT)
            m->held = m->u[1], m->beats += 1, m->wants_alarm = 1;
        else if (vr[i] == ALARM)
            m->alarms += 1;
        else
            return fmi3Error;
    }
    return fmi3OK;
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                  fmi3Float64 v[], fmi3IntervalQualifier q[]) {
    memory *m = &((instance *)c)->m;
    if (n != 1 || vr[0] != ALARM)
        return fmi3Error;
    v[0] = 0.2, q[0] = m->wants_alarm ? fmi3IntervalChanged : fmi3IntervalUnchanged;
    return m->wants_alarm = 0, fmi3OK;
}
fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Boolean v[],
                          size_t m) {
    for (size_t i = 0; i < n; ++i)
        v[i] = vr[i] == LOW ? ((instance *)c)->m.low : ((instance *)c)->m.flag;
    return n == m ? fmi3OK : fmi3Error;
}
fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Boolean v[], size_t m) {
    for (size_t i = 0; i < n; ++i)
        ((instance *)c)->m.flag = v[i];
    return (void)vr, n == m ? fmi3OK : fmi3Error;
}

/* Second of the next passage of x through 0.5, infinity without one. */
static double passage(const memory *m) {
    const double a = target(m), ratio = (m->x - a) / (0.5 - a);
    const int leaves = m->low ? a > 0.5 : a < 0.5;
    return leaves && ratio > 1.0 ? m->time + log(ratio) : HUGE_VAL;
}

static void flow(memory *m, double until) {
    const double a = target(m);
    m->x = a + (m->x - a) * exp(m->time - until);
    m->time = until;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_set,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last) {
    instance *i = (instance *)c;
    memory *m = &i->m;
    const double goal = time + size;
    (void)no_set;
    *event = *end = *early = fmi3False;
    if (size > 1000.0 && goal < m->stop_at) { /* years: one cycle is like the other */
        const double left_out = 0.7 * floor((goal - m->next) / 0.7);
        m->time += left_out, m->next += left_out;
    }
    while (m->time < goal - 1e-12) {
        const double cross = passage(m);
        double until = fmin(goal, fmin(m->next, cross));
        if (m->stop_at <= until) {
            flow(m, fmax(m->time, m->stop_at));
            *end = *early = fmi3True, *last = m->time;
            return fmi3OK;
        }
        flow(m, until);
        if (until == cross)
            m->x = 0.5;
        if (i->update) {
            fmi3Boolean wanted = fmi3False;
            double at = 0.0;
            i->update(i->environment, m->time, fmi3False, fmi3True, fmi3True, fmi3False, &wanted,
                      &at);
        }
        if (until == cross || until >= m->next - 1e-12) {
            if (i->events_outside) {
                *event = fmi3True, *last = m->time;
                *early = m->time < goal - 1e-12;
                return fmi3OK;
            }
            events(m);
        }
    }
    *last = m->time;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) {
    return ((instance *)c)->m.time = time, fmi3OK;
}
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) {
    return ((instance *)c)->m.x = x[0], n == 1 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    return x[0] = ((instance *)c)->m.x, n == 1 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 d[], size_t n) {
    const memory *m = &((instance *)c)->m;
    return d[0] = target(m) - m->x, n == 1 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n) {
    return z[0] = ((instance *)c)->m.x - 0.5, n == 1 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    return (void)c, x[0] = 1.0, n == 1 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) {
    return (void)c, *n = 1, fmi3OK;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) {
    return (void)c, *n = 1, fmi3OK;
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_set, fmi3Boolean *event,
                                       fmi3Boolean *end) {
    return (void)c, (void)no_set, *event = *end = fmi3False, fmi3OK;
}
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *s) {
    if (!*s)
        *s = malloc(sizeof(memory));
    return memcpy(*s, &((instance *)c)->m, sizeof(memory)), fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) {
    return memcpy(&((instance *)c)->m, s, sizeof(memory)), fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *s) {
    return (void)c, free(*s), *s = 0, fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState s, size_t *n) {
    return (void)c, (void)s, *n = sizeof(memory), fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState s, fmi3Byte b[], size_t n) {
    return (void)c, memcpy(b, s, n), fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte b[], size_t n, fmi3FMUState *s) {
    if (!*s)
        *s = malloc(n);
    return (void)c, memcpy(*s, b, n), fmi3OK;
}

/* No prototypes are included, so what is not offered needs no parameters. */
#define REFUSE(FUNCTION)                                                                           \
    fmi3Status FUNCTION(void) { return fmi3Error; }
REFUSE(fmi3InstantiateScheduledExecution)
REFUSE(fmi3Reset)
REFUSE(fmi3GetFloat32)
REFUSE(fmi3GetInt8)
REFUSE(fmi3GetUInt8)
REFUSE(fmi3GetInt16)
REFUSE(fmi3GetUInt16)
REFUSE(fmi3GetUInt32)
REFUSE(fmi3GetString)
REFUSE(fmi3GetBinary)
REFUSE(fmi3GetClock)
REFUSE(fmi3SetFloat32)
REFUSE(fmi3SetInt8)
REFUSE(fmi3SetUInt8)
REFUSE(fmi3SetInt16)
REFUSE(fmi3SetUInt16)
REFUSE(fmi3SetUInt32)
REFUSE(fmi3SetBinary)
REFUSE(fmi3GetNumberOfVariableDependencies)
REFUSE(fmi3GetVariableDependencies)
REFUSE(fmi3GetDirectionalDerivative)
REFUSE(fmi3GetAdjointDerivative)
REFUSE(fmi3GetIntervalFraction)
REFUSE(fmi3GetShiftDecimal)
REFUSE(fmi3GetShiftFraction)
REFUSE(fmi3SetIntervalDecimal)
REFUSE(fmi3SetIntervalFraction)
REFUSE(fmi3SetShiftDecimal)
REFUSE(fmi3SetShiftFraction)
REFUSE(fmi3EvaluateDiscreteStates)
REFUSE(fmi3GetOutputDerivatives)
REFUSE(fmi3ActivateModelPartition)

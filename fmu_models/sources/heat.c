/* Temperature loop: a heat exchanger with a steam valve, two lags and a dead time, slow.
 *
 * T = T_0 + gain / ((t1 s + 1)(t2 s + 1)) exp(-dead_time s) (stem + load), exact for inputs that
 * are held from step to step. */
#define MODEL_IDENTIFIER heat
#define BASE_STEP 1.0
#define DEFAULT_STEP 5.0
#define PV_UNIT "degC"
#define PI_SP 60.0
#define PI_GAIN 1.2
#define PI_TIME 70.0

#include <stdint.h>

#include "controller.h"
#include "valve.h"

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output, limited to 0 ... 100")            \
    X(load, input, Real, 0.0, -ANY, ANY, "%", "load disturbance, added to the stem position")      \
    X(pv, output, Real, 0.0, -ANY, ANY, "degC", "measured outlet temperature")                     \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 1, 0, 3, "", "valve: 0 healthy, 1 He, 2 Kano, 3 Choudhury")         \
    X(stick_band, tunable, Real, 3.0, 0.0, ANY, "%", "stick band S = fS + fD")                     \
    X(slip_jump, tunable, Real, 1.0, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(noise_std, tunable, Real, 0.05, 0.0, ANY, "K", "standard deviation of the noise on PV")      \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    X(gain, fixed, Real, 0.8, -ANY, ANY, "K", "steady rise of temperature per percent of stem")    \
    X(base, fixed, Real, 20.0, -ANY, ANY, "degC", "temperature with the valve shut")               \
    X(time_constant1, fixed, Real, 60.0, 0.1, ANY, "s", "first lag")                               \
    X(time_constant2, fixed, Real, 15.0, 0.1, ANY, "s", "second lag")                              \
    X(dead_time, fixed, Integer, 20, 0, 600, "s", "dead time in whole seconds")                    \
    CONTROLLER_VARIABLES(X)

enum { DELAY_LENGTH = 601 }; /* one more than the longest dead time */

typedef struct {
    valve_state valve;
    pi_state controller;
    double lag1, lag2;
    double delayed[DELAY_LENGTH]; /* ring: what entered in the last steps */
    int64_t written;
} plant_memory;

#include "plant.h"
#include "sticky_valve.h"

static void measure(plant *p) {
    p->v.pv = p->v.base + p->v.gain * p->memory.lag2 + p->v.noise_std * noise_normal(&p->noise);
}

static const char *plant_initialise(plant *p) {
    noise_start(&p->noise, p->v.seed);
    stem_rest(p);
    p->memory.lag1 = p->memory.lag2 = p->v.stem + p->v.load;
    for (int i = 0; i < DELAY_LENGTH; ++i)
        p->memory.delayed[i] = p->memory.lag1;
    p->memory.written = 0;
    measure(p);
    return valve_check(p->v.stick_band, p->v.slip_jump);
}

/* Advance the two lags by one base step, the input held: the solution of the linear equations. */
static void advance_lags(plant *p, double input) {
    const double t1 = p->v.time_constant1, t2 = p->v.time_constant2;
    const double e1 = exp(-BASE_STEP / t1), e2 = exp(-BASE_STEP / t2);
    const double away = p->memory.lag1 - input;
    const double shared = fabs(t1 - t2) > 1e-6 * t1 ? t1 / (t1 - t2) * (e1 - e2)
                                                    : BASE_STEP / t1 * e1;
    p->memory.lag2 = input + away * shared + (p->memory.lag2 - input) * e2;
    p->memory.lag1 = input + away * e1;
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = valve_check(p->v.stick_band, p->v.slip_jump);
    double input;
    if (complaint)
        return complaint;
    input = stem_move(p, count) + p->v.load;
    for (int64_t i = 0; i < count; ++i) {
        const int64_t now = p->memory.written++;
        const int64_t then = now - (int64_t)p->v.dead_time;
        p->memory.delayed[now % DELAY_LENGTH] = input;
        advance_lags(p, p->memory.delayed[(then + DELAY_LENGTH) % DELAY_LENGTH]);
    }
    measure(p);
    return 0;
}

#include "fmi.h"

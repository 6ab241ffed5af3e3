/* Flow loop: a control valve in a line with friction, first-order response of line and
 * transmitter, noisy measurement.
 *
 * The valve has a linear inherent characteristic; the pressure drop over it is what the line leaves
 * of the total, so the flow follows a square root and the gain falls as the valve opens:
 * q = q_max sqrt(1 + load/100) f / sqrt(N + (1 - N) f^2), f = stem/100, N = valve authority.
 * (Pressure drops of line and valve in series, each proportional to q^2; IEC 60534-2-1 for the
 * valve, q = Kv f sqrt(dp).) */
#define MODEL_IDENTIFIER flow
#define BASE_STEP 0.1
#define DEFAULT_STEP 1.0
#define PV_UNIT "m3/h"
#define PI_SP 63.0
#define PI_GAIN 0.4
#define PI_TIME 2.0

#include "controller.h"
#include "valve.h"

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output, limited to 0 ... 100")            \
    X(load, input, Real, 0.0, -100.0, ANY, "%", "change of the supply pressure, of its nominal")   \
    X(pv, output, Real, 0.0, -ANY, ANY, "m3/h", "measured flow")                                   \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 1, 0, 3, "", "valve: 0 healthy, 1 He, 2 Kano, 3 Choudhury")         \
    X(stick_band, tunable, Real, 4.0, 0.0, ANY, "%", "stick band S = fS + fD")                     \
    X(slip_jump, tunable, Real, 1.0, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(noise_std, tunable, Real, 0.3, 0.0, ANY, "m3/h", "standard deviation of the noise on PV")    \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    X(flow_max, tunable, Real, 100.0, 0.0, ANY, "m3/h", "flow of the open valve")                  \
    X(authority, tunable, Real, 0.5, 0.01, 1.0, "1", "share of the pressure drop over the valve")  \
    X(time_constant, tunable, Real, 2.0, 0.01, ANY, "s", "of line and transmitter together")       \
    CONTROLLER_VARIABLES(X)

typedef struct {
    valve_state valve;
    pi_state controller;
    double flow;
} plant_memory;

#include "plant.h"
#include "sticky_valve.h"

static double steady_flow(const plant *p) {
    const double f = 0.01 * p->v.stem;
    const double n = p->v.authority;
    return p->v.flow_max * sqrt(1.0 + 0.01 * p->v.load) * f / sqrt(n + (1.0 - n) * f * f);
}

static void measure(plant *p) {
    p->v.pv = p->memory.flow + p->v.noise_std * noise_normal(&p->noise);
}

static const char *plant_initialise(plant *p) {
    noise_start(&p->noise, p->v.seed);
    stem_rest(p);
    p->memory.flow = steady_flow(p);
    measure(p);
    return valve_check(p->v.stick_band, p->v.slip_jump);
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = valve_check(p->v.stick_band, p->v.slip_jump);
    if (complaint)
        return complaint;
    stem_move(p, count);
    /* Exact for an input that is held. */
    p->memory.flow += (steady_flow(p) - p->memory.flow) *
                      (1.0 - exp(-(double)count * BASE_STEP / p->v.time_constant));
    measure(p);
    return 0;
}

#include "fmi.h"

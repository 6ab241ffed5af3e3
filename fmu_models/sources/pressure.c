/* Pressure loop: a gas vessel, filled through the control valve from a header and emptied by its
 * consumers, nonlinear and self-regulating.
 *
 * dP/dt = (inlet f sqrt(P_header - P) - outlet (1 + load/100) sqrt(P)) / volume, f = stem/100,
 * pressures above that of the consumers. Integrated with the classical Runge-Kutta method. */
#define MODEL_IDENTIFIER pressure
#define BASE_STEP 0.1
#define DEFAULT_STEP 1.0
#define PV_UNIT "bar"
#define PI_SP 4.1
#define PI_GAIN 15.0
#define PI_TIME 8.0

#include "controller.h"
#include "valve.h"

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output, limited to 0 ... 100")            \
    X(load, input, Real, 0.0, -100.0, ANY, "%", "change of the consumers' demand, of its nominal") \
    X(pv, output, Real, 0.0, -ANY, ANY, "bar", "measured pressure")                                \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 1, 0, 3, "", "valve: 0 healthy, 1 He, 2 Kano, 3 Choudhury")         \
    X(stick_band, tunable, Real, 4.0, 0.0, ANY, "%", "stick band S = fS + fD")                     \
    X(slip_jump, tunable, Real, 1.0, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(noise_std, tunable, Real, 0.005, 0.0, ANY, "bar", "standard deviation of the noise on PV")   \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    X(header, tunable, Real, 10.0, 0.1, ANY, "bar", "pressure of the header")                      \
    X(inlet, tunable, Real, 1.0, 0.0, ANY, "1", "inflow at 1 bar through the open valve")          \
    X(outlet, tunable, Real, 0.6, 0.001, ANY, "1", "outflow at 1 bar")                             \
    X(volume, tunable, Real, 2.0, 0.1, ANY, "s", "inflow that raises the pressure by 1 bar")       \
    CONTROLLER_VARIABLES(X)

typedef struct {
    valve_state valve;
    pi_state controller;
    double pressure;
} plant_memory;

#include "plant.h"
#include "sticky_valve.h"

static double demand(const plant *p) { return p->v.outlet * (1.0 + 0.01 * p->v.load); }

static double rate(const plant *p, double pressure) {
    const double drop = p->v.header - pressure;
    const double in = 0.01 * p->v.stem * p->v.inlet * sqrt(fabs(drop)) * (drop < 0.0 ? -1.0 : 1.0);
    return (in - demand(p) * sqrt(pressure > 0.0 ? pressure : 0.0)) / p->v.volume;
}

static void measure(plant *p) {
    p->v.pv = p->memory.pressure + p->v.noise_std * noise_normal(&p->noise);
}

static const char *plant_initialise(plant *p) {
    double in, out;
    noise_start(&p->noise, p->v.seed);
    stem_rest(p);
    in = 0.01 * p->v.stem * p->v.inlet;
    out = demand(p);
    p->memory.pressure = in > 0.0 ? p->v.header * in * in / (in * in + out * out) : 0.0;
    measure(p);
    return valve_check(p->v.stick_band, p->v.slip_jump);
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = valve_check(p->v.stick_band, p->v.slip_jump);
    const double h = BASE_STEP;
    if (complaint)
        return complaint;
    stem_move(p, count);
    for (int64_t i = 0; i < count; ++i) {
        const double y = p->memory.pressure;
        const double k1 = rate(p, y);
        const double k2 = rate(p, y + 0.5 * h * k1);
        const double k3 = rate(p, y + 0.5 * h * k2);
        const double k4 = rate(p, y + h * k3);
        p->memory.pressure = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        if (p->memory.pressure < 0.0)
            p->memory.pressure = 0.0;
    }
    measure(p);
    return 0;
}

#include "fmi.h"

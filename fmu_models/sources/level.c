/* Level loop: a tank that a control valve fills and a pump empties at a constant rate, an
 * integrating process.
 *
 * dh/dt = (stem + load - outflow) / fill_time, with all flows in percent of the open valve's; the
 * outflow balances the inflow at the start. The tank can run empty and overflow. */
#define MODEL_IDENTIFIER level
#define BASE_STEP 1.0
#define DEFAULT_STEP 1.0
#define PV_UNIT "%"
#define PI_SP 50.0
#define PI_GAIN 4.0
#define PI_TIME 200.0

#include "controller.h"
#include "valve.h"

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output, limited to 0 ... 100")            \
    X(load, input, Real, 0.0, -ANY, ANY, "%", "additional inflow, of that of the open valve")      \
    X(pv, output, Real, 0.0, -ANY, ANY, "%", "measured level")                                     \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 1, 0, 3, "", "valve: 0 healthy, 1 He, 2 Kano, 3 Choudhury")         \
    X(stick_band, tunable, Real, 5.0, 0.0, ANY, "%", "stick band S = fS + fD")                     \
    X(slip_jump, tunable, Real, 1.5, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(noise_std, tunable, Real, 0.05, 0.0, ANY, "%", "standard deviation of the noise on PV")      \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    X(level_start, fixed, Real, 50.0, 0.0, 100.0, "%", "level at the start")                       \
    X(fill_time, tunable, Real, 200.0, 1.0, ANY, "s", "time to fill the tank, valve open")         \
    CONTROLLER_VARIABLES(X)

typedef struct {
    valve_state valve;
    pi_state controller;
    double level;
    double outflow;
} plant_memory;

#include "plant.h"
#include "sticky_valve.h"

static void measure(plant *p) {
    p->v.pv = p->memory.level + p->v.noise_std * noise_normal(&p->noise);
}

static const char *plant_initialise(plant *p) {
    noise_start(&p->noise, p->v.seed);
    stem_rest(p);
    p->memory.level = p->v.level_start;
    p->memory.outflow = p->v.stem + p->v.load;
    measure(p);
    return valve_check(p->v.stick_band, p->v.slip_jump);
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = valve_check(p->v.stick_band, p->v.slip_jump);
    double rate;
    if (complaint)
        return complaint;
    rate = (stem_move(p, count) + p->v.load - p->memory.outflow) / p->v.fill_time;
    p->memory.level =
        plant_clamp(p->memory.level + (double)count * BASE_STEP * rate, 0.0, 100.0);
    measure(p);
    return 0;
}

#include "fmi.h"

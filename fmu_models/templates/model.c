/* NAME: a sticky valve before a first-order process with a load disturbance.
 *
 * A model of your own. It builds and runs as it stands; what to fill in is marked with (1) to (6):
 *
 * (1) this comment: its first paragraph becomes the description of the FMU;
 * (2) the internal step and the sampling period in seconds, and the default tuning of the PI
 *     controller inside (percent of OP per unit of PV, seconds);
 * (3) the table of variables: name, kind (input, output, fixed or tunable), type (Real or Integer),
 *     start value, lowest, highest, unit, description. Keep op, pv, stem, valve, stick_band,
 *     slip_jump and op_start for the valve, CONTROLLER_VARIABLES for the controller;
 * (4) what the plant remembers from step to step: numbers and arrays, no pointers, so that a
 *     snapshot is a copy of it;
 * (5) where it stands at the start: at rest, with OP and load as they are;
 * (6) how it moves on by `count` internal steps, the inputs held.
 *
 * Build it, look at it, run it:
 *
 *     python -m fmu_models.build NAME.c --output .
 *     fieldlink fmu info NAME.fmi3.fmu
 *     fieldlink fmu run NAME.fmi3.fmu --set controller=1 --set op_start=40 --plot NAME.png
 */

/* (2) */
#define MODEL_IDENTIFIER NAME
#define BASE_STEP 0.1
#define DEFAULT_STEP 1.0
#define PV_UNIT "degC"
#define PI_SP 50.0
#define PI_GAIN 1.0
#define PI_TIME 10.0

#include "controller.h"
#include "valve.h"

/* (3) */
#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output, limited to 0 ... 100")            \
    X(load, input, Real, 0.0, -ANY, ANY, "%", "load disturbance, added to the stem position")      \
    X(pv, output, Real, 0.0, -ANY, ANY, "degC", "measured process variable")                       \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 1, 0, 3, "", "valve: 0 healthy, 1 He, 2 Kano, 3 Choudhury")         \
    X(stick_band, tunable, Real, 5.0, 0.0, ANY, "%", "stick band S = fS + fD")                     \
    X(slip_jump, tunable, Real, 2.0, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(noise_std, tunable, Real, 0.05, 0.0, ANY, "K", "standard deviation of the noise on PV")      \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    X(gain, tunable, Real, 1.0, -ANY, ANY, "K", "steady change of PV per percent of stem")         \
    X(time_constant, tunable, Real, 20.0, 0.1, ANY, "s", "of the process")                         \
    CONTROLLER_VARIABLES(X)

/* (4) */
typedef struct {
    valve_state valve;
    pi_state controller;
    double temperature;
} plant_memory;

#include "plant.h"
#include "sticky_valve.h"

static double steady(const plant *p) { return p->v.gain * (p->v.stem + p->v.load); }

static void measure(plant *p) {
    p->v.pv = p->memory.temperature + p->v.noise_std * noise_normal(&p->noise);
}

/* (5) Return 0, or what is wrong with the parameters. */
static const char *plant_initialise(plant *p) {
    noise_start(&p->noise, p->v.seed);
    stem_rest(p);
    p->memory.temperature = steady(p);
    measure(p);
    return valve_check(p->v.stick_band, p->v.slip_jump);
}

/* (6) Return 0, or why the step is refused. */
static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = valve_check(p->v.stick_band, p->v.slip_jump);
    if (complaint)
        return complaint;
    stem_move(p, count);
    p->memory.temperature += (steady(p) - p->memory.temperature) *
                             (1.0 - exp(-(double)count * BASE_STEP / p->v.time_constant));
    measure(p);
    return 0;
}

#include "fmi.h"

/* Example 1 of Bacci di Capaci, Vaccari, Pannocchia, Scali: Identification and estimation of valve
 * stiction by the use of a smoothed model (2018): 1 / ((4 s + 1)(6 s + 1)(2 s + 1)), sampled with a
 * zero-order hold every second, behind He's valve with fS = 7, fD = 4.
 *
 * Equation (15) prints the coefficients rounded, which leaves a steady gain of 1.012; these are the
 * exact ones of (14), with a gain of 1. They round to the printed ones. */
#define MODEL_IDENTIFIER example1
#define BASE_STEP 1.0
#define DEFAULT_STEP 1.0
#define PV_UNIT "1"
#define PI_SP 50.0
#define PI_GAIN 0.8
#define PI_TIME 10.0
#define PROCESS_A {-2.231813167674652366, 1.645024301974050480, -0.399849654344847355}
#define PROCESS_B {0.002770040421539427980, 0.008839767573438738630, 0.001751671959572592970}

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output")                                  \
    X(load, input, Real, 0.0, -ANY, ANY, "%", "load disturbance, added to the stem position")      \
    X(pv, output, Real, 0.0, -ANY, ANY, "1", "measured process variable")                          \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 1, 0, 3, "", "valve: 0 healthy, 1 He, 2 Kano, 3 Choudhury")         \
    X(stick_band, tunable, Real, 11.0, 0.0, ANY, "%", "stick band S = fS + fD")                    \
    X(slip_jump, tunable, Real, 3.0, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(noise_std, tunable, Real, 0.01, 0.0, ANY, "1", "standard deviation of the equation noise v") \
    X(output_noise_std, tunable, Real, 0.0, 0.0, ANY, "1", "standard deviation added to PV")       \
    X(bias, tunable, Real, 0.0, -ANY, ANY, "1", "constant added to PV")                            \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    CONTROLLER_VARIABLES(X)

#include "paper_example.h"

#include "fmi.h"

/* Example 2 of Bacci di Capaci, Vaccari, Pannocchia, Scali: Identification and estimation of valve
 * stiction by the use of a smoothed model (2018): the ARX(3,3) process (18), sampled every second,
 * behind He's valve with fS = 5, fD = 2.
 *
 * Equation (18) prints the coefficients rounded, which leaves a steady gain of 0.948. They are
 * those of 1 / ((10 s + 1)(5 s + 1)(s + 1)) with a zero-order hold, to every printed digit; the
 * exact ones stand here, with a gain of 1. The standard deviation of v is 10^-1.5. */
#define MODEL_IDENTIFIER example2
#define BASE_STEP 1.0
#define DEFAULT_STEP 1.0
#define PV_UNIT "1"
#define PI_SP 50.0
#define PI_GAIN 1.2
#define PI_TIME 12.5
#define PROCESS_A {-2.091447612285383753, 1.374883516291999516, -0.272531793034012603}
#define PROCESS_B {0.002444750123915985150, 0.007181253681469063540, 0.001278107167218110760}

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output")                                  \
    X(load, input, Real, 0.0, -ANY, ANY, "%", "load disturbance, added to the stem position")      \
    X(pv, output, Real, 0.0, -ANY, ANY, "1", "measured process variable")                          \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 1, 0, 3, "", "valve: 0 healthy, 1 He, 2 Kano, 3 Choudhury")         \
    X(stick_band, tunable, Real, 7.0, 0.0, ANY, "%", "stick band S = fS + fD")                     \
    X(slip_jump, tunable, Real, 3.0, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(noise_std, tunable, Real, 0.0316227766016838, 0.0, ANY, "1",                                 \
      "standard deviation of the equation noise v")                                                \
    X(output_noise_std, tunable, Real, 0.0, 0.0, ANY, "1", "standard deviation added to PV")       \
    X(bias, tunable, Real, 0.0, -ANY, ANY, "1", "constant added to PV")                            \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    CONTROLLER_VARIABLES(X)

#include "paper_example.h"

#include "fmi.h"

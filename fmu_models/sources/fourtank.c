/* Four tanks and two sticky valves: two loops that disturb each other in one plant.
 *
 * Johansson: The quadruple-tank process: a multivariable laboratory process with an adjustable
 * zero. IEEE Trans. Control Systems Technology 8 (2000) 456-465, equations (1)-(2) with the
 * parameters of its Tables 1 and 2, minimum-phase setting P-: each valve feeds a lower tank and,
 * crosswise, an upper one that drains into the other lower tank. A valve's stem stands for the
 * voltage of a pump there, with 100 % as 6 V, so that 50 % is the paper's operating point. For the
 * non-minimum-phase setting P+ set gamma1 = 0.43, gamma2 = 0.34, k1 = 3.14, k2 = 3.29.
 *
 * The PI controllers inside pair pv1 with op1 and pv2 with op2, tuned as in the paper, section V
 * (K = 3.0 and 2.7 V/V, Ti = 30 and 40 s, level transmitters of 0.5 V/cm).
 *
 * Integrated with the classical Runge-Kutta method. */
#define MODEL_IDENTIFIER fourtank
#define BASE_STEP 0.1
#define DEFAULT_STEP 1.0

#include "controller.h"
#include "valve.h"

#define VARIABLES(X)                                                                               \
    X(op1, input, Real, 50.0, -ANY, ANY, "%", "output of controller 1, limited to 0 ... 100")      \
    X(op2, input, Real, 50.0, -ANY, ANY, "%", "output of controller 2, limited to 0 ... 100")      \
    X(load1, input, Real, 0.0, -ANY, ANY, "ml/s", "additional inflow of tank 1")                   \
    X(load2, input, Real, 0.0, -ANY, ANY, "ml/s", "additional inflow of tank 2")                   \
    X(sp1, input, Real, 12.4, -ANY, ANY, "cm", "set-point of the controller inside, loop 1")       \
    X(sp2, input, Real, 12.7, -ANY, ANY, "cm", "set-point of the controller inside, loop 2")       \
    X(pv1, output, Real, 0.0, -ANY, ANY, "cm", "measured level of tank 1 (lower left)")            \
    X(pv2, output, Real, 0.0, -ANY, ANY, "cm", "measured level of tank 2 (lower right)")           \
    X(level3, output, Real, 0.0, -ANY, ANY, "cm", "level of tank 3, which drains into tank 1")     \
    X(level4, output, Real, 0.0, -ANY, ANY, "cm", "level of tank 4, which drains into tank 2")     \
    X(stem1, output, Real, 0.0, -ANY, ANY, "%", "stem position of valve 1, for judging only")      \
    X(stem2, output, Real, 0.0, -ANY, ANY, "%", "stem position of valve 2, for judging only")      \
    X(op1_out, output, Real, 0.0, -ANY, ANY, "%", "OP as applied to valve 1")                      \
    X(op2_out, output, Real, 0.0, -ANY, ANY, "%", "OP as applied to valve 2")                      \
    X(valve1, tunable, Integer, 1, 0, 3, "", "valve 1: 0 healthy, 1 He, 2 Kano, 3 Choudhury")      \
    X(valve2, tunable, Integer, 1, 0, 3, "", "valve 2: 0 healthy, 1 He, 2 Kano, 3 Choudhury")      \
    X(stick_band1, tunable, Real, 4.0, 0.0, ANY, "%", "stick band S = fS + fD of valve 1")         \
    X(stick_band2, tunable, Real, 4.0, 0.0, ANY, "%", "stick band S = fS + fD of valve 2")         \
    X(slip_jump1, tunable, Real, 1.0, 0.0, ANY, "%", "slip jump J = fS - fD of valve 1")           \
    X(slip_jump2, tunable, Real, 1.0, 0.0, ANY, "%", "slip jump J = fS - fD of valve 2")           \
    X(controller1, tunable, Integer, 0, 0, 1, "", "0: OP of loop 1 is op1; 1: a PI controller")    \
    X(controller2, tunable, Integer, 0, 0, 1, "", "0: OP of loop 2 is op2; 1: a PI controller")    \
    X(pi_gain1, tunable, Real, 25.0, -ANY, ANY, "", "of controller 1, percent of OP per cm")       \
    X(pi_gain2, tunable, Real, 22.5, -ANY, ANY, "", "of controller 2, percent of OP per cm")       \
    X(pi_time1, tunable, Real, 30.0, 0.001, ANY, "s", "integral time of controller 1")             \
    X(pi_time2, tunable, Real, 40.0, 0.001, ANY, "s", "integral time of controller 2")             \
    X(noise_std, tunable, Real, 0.02, 0.0, ANY, "cm", "standard deviation of the noise on PVs")    \
    X(op1_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP 1 at which the plant rests at the start")  \
    X(op2_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP 2 at which the plant rests at the start")  \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    X(gamma1, tunable, Real, 0.70, 0.0, 1.0, "1", "share of valve 1 that goes to tank 1")          \
    X(gamma2, tunable, Real, 0.60, 0.0, 1.0, "1", "share of valve 2 that goes to tank 2")          \
    X(k1, tunable, Real, 3.33, 0.0, ANY, "", "flow of valve 1 in ml/s per volt")                   \
    X(k2, tunable, Real, 3.35, 0.0, ANY, "", "flow of valve 2 in ml/s per volt")                   \
    X(volts, tunable, Real, 6.0, 0.1, ANY, "", "voltage that the open valve stands for")

enum { TANKS = 4 };

typedef struct {
    valve_state valve[2];
    pi_state controller[2];
    double level[TANKS];
} plant_memory;

#include "plant.h"

static const double area[TANKS] = {28.0, 32.0, 28.0, 32.0};       /* cm2, of the tanks */
static const double outlet[TANKS] = {0.071, 0.057, 0.071, 0.057}; /* cm2, of their holes */
static const double two_g = 2.0 * 981.0;                          /* cm/s2 */

static double drain(int i, double level) {
    return outlet[i] * sqrt(two_g * (level > 0.0 ? level : 0.0));
}

/* The flows of both valves into each tank, ml/s. */
static void inflows(const plant *p, double q[TANKS]) {
    const double q1 = 0.01 * p->v.stem1 * p->v.volts * p->v.k1;
    const double q2 = 0.01 * p->v.stem2 * p->v.volts * p->v.k2;
    q[0] = p->v.gamma1 * q1 + p->v.load1;
    q[1] = p->v.gamma2 * q2 + p->v.load2;
    q[2] = (1.0 - p->v.gamma2) * q2;
    q[3] = (1.0 - p->v.gamma1) * q1;
}

static void rates(const double q[TANKS], const double h[TANKS], double dh[TANKS]) {
    dh[0] = (q[0] - drain(0, h[0]) + drain(2, h[2])) / area[0];
    dh[1] = (q[1] - drain(1, h[1]) + drain(3, h[3])) / area[1];
    dh[2] = (q[2] - drain(2, h[2])) / area[2];
    dh[3] = (q[3] - drain(3, h[3])) / area[3];
}

static const char *check(const plant *p) {
    const char *complaint = valve_check(p->v.stick_band1, p->v.slip_jump1);
    return complaint ? complaint : valve_check(p->v.stick_band2, p->v.slip_jump2);
}

static void measure(plant *p) {
    p->v.pv1 = p->memory.level[0] + p->v.noise_std * noise_normal(&p->noise);
    p->v.pv2 = p->memory.level[1] + p->v.noise_std * noise_normal(&p->noise);
    p->v.level3 = p->memory.level[2];
    p->v.level4 = p->memory.level[3];
}

/* The level at which a tank drains as much as flows in. */
static double rest_level(int i, double flow) {
    const double speed = (flow > 0.0 ? flow : 0.0) / outlet[i];
    return speed * speed / two_g;
}

static const char *plant_initialise(plant *p) {
    double q[TANKS];
    noise_start(&p->noise, p->v.seed);
    p->v.op1_out = plant_clamp(p->v.op1, 0.0, 100.0);
    p->v.op2_out = plant_clamp(p->v.op2, 0.0, 100.0);
    pi_rest(&p->memory.controller[0], p->v.op1_out);
    pi_rest(&p->memory.controller[1], p->v.op2_out);
    valve_rest(&p->memory.valve[0], p->v.stick_band1, p->v.slip_jump1, p->v.op1_out);
    valve_rest(&p->memory.valve[1], p->v.stick_band2, p->v.slip_jump2, p->v.op2_out);
    p->v.stem1 = p->v.op1_out;
    p->v.stem2 = p->v.op2_out;
    inflows(p, q);
    p->memory.level[2] = rest_level(2, q[2]);
    p->memory.level[3] = rest_level(3, q[3]);
    p->memory.level[0] = rest_level(0, q[0] + q[2]);
    p->memory.level[1] = rest_level(1, q[1] + q[3]);
    measure(p);
    return check(p);
}

static void move_valves(plant *p, double period) {
    const double op1 = pi_op(&p->memory.controller[0], p->v.controller1 > 0.0, p->v.pi_gain1,
                             p->v.pi_time1, p->v.sp1 - p->v.pv1, p->v.op1, period);
    const double op2 = pi_op(&p->memory.controller[1], p->v.controller2 > 0.0, p->v.pi_gain2,
                             p->v.pi_time2, p->v.sp2 - p->v.pv2, p->v.op2, period);
    p->v.op1_out = plant_clamp(op1, 0.0, 100.0);
    p->v.op2_out = plant_clamp(op2, 0.0, 100.0);
    p->v.stem1 = plant_clamp(valve_move(&p->memory.valve[0], (int)p->v.valve1, p->v.stick_band1,
                                        p->v.slip_jump1, p->v.op1_out),
                             0.0, 100.0);
    p->v.stem2 = plant_clamp(valve_move(&p->memory.valve[1], (int)p->v.valve2, p->v.stick_band2,
                                        p->v.slip_jump2, p->v.op2_out),
                             0.0, 100.0);
}

static void advance_levels(double h[TANKS], const double q[TANKS]) {
    double k1[TANKS], k2[TANKS], k3[TANKS], k4[TANKS], at[TANKS];
    rates(q, h, k1);
    for (int i = 0; i < TANKS; ++i)
        at[i] = h[i] + 0.5 * BASE_STEP * k1[i];
    rates(q, at, k2);
    for (int i = 0; i < TANKS; ++i)
        at[i] = h[i] + 0.5 * BASE_STEP * k2[i];
    rates(q, at, k3);
    for (int i = 0; i < TANKS; ++i)
        at[i] = h[i] + BASE_STEP * k3[i];
    rates(q, at, k4);
    for (int i = 0; i < TANKS; ++i)
        h[i] = fmax(0.0, h[i] + BASE_STEP / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = check(p);
    double q[TANKS];
    if (complaint)
        return complaint;
    move_valves(p, (double)count * BASE_STEP);
    inflows(p, q);
    for (int64_t i = 0; i < count; ++i)
        advance_levels(p->memory.level, q);
    measure(p);
    return 0;
}

#include "fmi.h"

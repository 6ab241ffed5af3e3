/* A PI controller that may sit inside a plant, so that a closed loop needs no talk between samples.
 *
 * Velocity form: dOP = gain (de + e period / integral_time), e = SP - PV, added to the OP that was
 * applied, limited to 0 ... 100: nothing winds up, and switching it on starts from the OP that it
 * finds (Astrom, Hagglund: PID Controllers, 2nd ed., ISA 1995, section 3.5). It acts once a step,
 * on the PV that the step before put out, as a PLC would that scans at that period.
 */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdint.h>

/* The rows of a model with one loop; its memory has a pi_state called controller. The model defines
 * the default tuning: PI_SP, PI_GAIN (percent of OP per unit of PV), PI_TIME (seconds). */
#define CONTROLLER_VARIABLES(X)                                                                    \
    X(sp, input, Real, PI_SP, -ANY, ANY, PV_UNIT, "set-point of the controller inside")            \
    X(op_out, output, Real, 0.0, -ANY, ANY, "%", "OP as applied: op, or what the controller did")  \
    X(controller, tunable, Integer, 0, 0, 1, "", "0: OP is the input op; 1: a PI controller")      \
    X(pi_gain, tunable, Real, PI_GAIN, -ANY, ANY, "", "of the controller, percent of OP per PV")   \
    X(pi_time, tunable, Real, PI_TIME, 0.001, ANY, "s", "integral time of the controller")

typedef struct {
    double op;    /* applied last */
    double error; /* of the sample before */
    int32_t active;
    int32_t unused; /* keeps the size the same on every platform */
} pi_state;

static inline double pi_limit(double op) { return op < 0.0 ? 0.0 : op > 100.0 ? 100.0 : op; }

/* Start with OP at `op`. */
static inline void pi_rest(pi_state *pi, double op) {
    pi->op = op;
    pi->error = 0.0;
    pi->active = 0;
    pi->unused = 0;
}

/* Return the OP to apply now: `op` while the controller is off. */
static inline double pi_op(pi_state *pi, int on, double gain, double integral_time, double error,
                           double op, double period) {
    if (on) {
        const double change = pi->active ? error - pi->error : 0.0;
        op = pi_limit(pi->op + gain * (change + error * period / integral_time));
    }
    pi->active = on;
    pi->error = error;
    pi->op = op;
    return op;
}

/* The same for a model with one loop whose table has CONTROLLER_VARIABLES. */
#define controlled_op(p, count)                                                                    \
    pi_op(&(p)->memory.controller, (p)->v.controller > 0.0, (p)->v.pi_gain, (p)->v.pi_time,        \
          (p)->v.sp - (p)->v.pv, (p)->v.op, (double)(count)*BASE_STEP)

#endif

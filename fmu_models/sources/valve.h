/* Data-driven valves: the stem position from the controller output, one call a sample.
 *
 * All of them are told the stick band S = fS + fD and the slip jump J = fS - fD, in units of OP,
 * with 0 <= J <= S. Fast valve: only the position at which the stem comes to rest is computed.
 */
#ifndef VALVE_H
#define VALVE_H

#include <math.h>
#include <stdint.h>

enum { VALVE_HEALTHY = 0, VALVE_HE = 1, VALVE_KANO = 2, VALVE_CHOUDHURY = 3 };

typedef struct {
    double stem;      /* position of the stem */
    double op;        /* OP of the sample before */
    double change;    /* change of OP in the sample before; its sign in Choudhury's model */
    double stuck_op;  /* OP when the stem came to rest */
    double direction; /* last direction of travel, +1 or -1 */
    int32_t resting;
    int32_t same_direction; /* Choudhury's I: it came to rest because OP did, not by a reversal */
} valve_state;

static inline const char *valve_check(double stick_band, double slip_jump) {
    return slip_jump <= stick_band
               ? 0
               : "slip_jump must not exceed stick_band (S = fS + fD, J = fS - fD, fD >= 0)";
}

/* Let the stem rest at `op`, as if it had moved upwards and OP had then turned back: He's and Kano's
 * valve slip at OP = stem +- (S + J) / 2, Choudhury's upwards at S + (S - J) / 2. */
static inline void valve_rest(valve_state *valve, double stick_band, double slip_jump, double op) {
    valve->stem = op;
    valve->op = op;
    valve->change = 0.0;
    valve->stuck_op = op + 0.5 * (stick_band - slip_jump);
    valve->direction = 1.0;
    valve->resting = 1;
    valve->same_direction = 0;
}

/* He, Wang, Pottmann, Qin: A curve fitting method for detecting valve stiction in oscillating
 * control loops. Ind. Eng. Chem. Res. 46 (2007) 4549-4560; equation (4) of Bacci di Capaci,
 * Vaccari, Pannocchia, Scali (2018). */
static inline void valve_he(valve_state *valve, double stick_band, double slip_jump, double op) {
    const double static_friction = 0.5 * (stick_band + slip_jump);
    const double dynamic_friction = 0.5 * (stick_band - slip_jump);
    const double error = op - valve->stem;
    if (error > static_friction)
        valve->stem = op - dynamic_friction;
    else if (error < -static_friction)
        valve->stem = op + dynamic_friction;
}

/* Kano, Maruta, Kugemoto, Shimizu: Practical model and detection algorithm for valve stiction.
 * IFAC DYCOPS 2004, flow chart of the model: the stem comes to rest when OP stops or reverses,
 * and leaves when OP has gone on by more than J or back by more than S. */
static inline void valve_kano(valve_state *valve, double stick_band, double slip_jump, double op) {
    const double change = op - valve->op;
    if (!valve->resting && change * valve->change <= 0.0) {
        valve->resting = 1;
        valve->stuck_op = valve->op;
    }
    if (valve->resting) {
        const double onward = valve->direction * (op - valve->stuck_op);
        if (-onward > stick_band) {
            valve->direction = -valve->direction;
            valve->resting = 0;
        } else if (onward > slip_jump) {
            valve->resting = 0;
        }
    }
    if (!valve->resting)
        valve->stem = op - 0.5 * valve->direction * (stick_band - slip_jump);
    valve->change = change;
}

/* Choudhury, Thornhill, Shah: Modelling valve stiction. Control Engineering Practice 13 (2005)
 * 641-658: the stem comes to rest when the sign of the slope of OP changes; it leaves when OP has
 * changed by more than S after a reversal, by more than J after a pause (I = 1). */
static inline void valve_choudhury(valve_state *valve, double stick_band, double slip_jump,
                                   double op) {
    const double slope = (op > valve->op) - (op < valve->op);
    if (!valve->resting && slope != valve->change) {
        valve->resting = 1;
        valve->stuck_op = valve->op;
        valve->same_direction = slope == 0.0;
    }
    if (valve->resting) {
        const double needed = valve->same_direction ? slip_jump : stick_band;
        if (fabs(op - valve->stuck_op) > needed && slope != 0.0)
            valve->resting = 0;
    }
    if (!valve->resting)
        valve->stem = op - 0.5 * slope * (stick_band - slip_jump);
    valve->change = slope;
}

/* Move the stem for one sample of `op` and return its position. */
static inline double valve_move(valve_state *valve, int kind, double stick_band, double slip_jump,
                         double op) {
    switch (kind) {
    case VALVE_HE:
        valve_he(valve, stick_band, slip_jump, op);
        break;
    case VALVE_KANO:
        valve_kano(valve, stick_band, slip_jump, op);
        break;
    case VALVE_CHOUDHURY:
        valve_choudhury(valve, stick_band, slip_jump, op);
        break;
    default:
        valve->stem = op;
        break;
    }
    valve->op = op;
    return valve->stem;
}

#endif

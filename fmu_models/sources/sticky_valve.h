/* The stem that every model of one loop with a data-driven valve has: OP from the controller, within
 * its range, one move a step. For models whose table has op, pv, stem, valve, stick_band, slip_jump
 * and CONTROLLER_VARIABLES, and whose memory has a valve_state called valve and a pi_state called
 * controller. Include it after "plant.h". */
#ifndef STICKY_VALVE_H
#define STICKY_VALVE_H

static void stem_rest(plant *p) {
    pi_rest(&p->memory.controller, p->v.op);
    p->v.op_out = plant_clamp(p->v.op, 0.0, 100.0);
    valve_rest(&p->memory.valve, p->v.stick_band, p->v.slip_jump, p->v.op_out);
    p->v.stem = p->memory.valve.stem;
}

/* Decide OP and move the stem once, as the data-driven models do with a new sample of OP; return the
 * stem. `count` base steps make the sampling period. */
static double stem_move(plant *p, int64_t count) {
    p->v.op_out = plant_clamp(controlled_op(p, count), 0.0, 100.0);
    p->v.stem = plant_clamp(valve_move(&p->memory.valve, (int)p->v.valve, p->v.stick_band,
                                       p->v.slip_jump, p->v.op_out),
                            0.0, 100.0);
    return p->v.stem;
}

#endif

/* The stem that every model with a data-driven valve has: OP within its range, one move a step.
 * For models whose table has op, stem, valve, stick_band and slip_jump, and whose memory has a
 * valve_state called valve. Include it after "plant.h". */
#ifndef STICKY_VALVE_H
#define STICKY_VALVE_H

static void stem_rest(plant *p) {
    valve_rest(&p->memory.valve, p->v.stick_band, p->v.slip_jump,
               plant_clamp(p->v.op, 0.0, 100.0));
    p->v.stem = p->memory.valve.stem;
}

/* Move the stem once, as the data-driven models do with a new sample of OP, and return it. */
static double stem_move(plant *p) {
    p->v.stem = plant_clamp(valve_move(&p->memory.valve, (int)p->v.valve, p->v.stick_band,
                                       p->v.slip_jump, plant_clamp(p->v.op, 0.0, 100.0)),
                            0.0, 100.0);
    return p->v.stem;
}

#endif

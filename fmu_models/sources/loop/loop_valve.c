/* A sticky valve alone (He's): the stem follows OP as far as its friction lets it. */
#define MODEL_IDENTIFIER loop_valve
#define BASE_STEP 1.0
#define DEFAULT_STEP 1.0

#include <stdint.h>

#include "valve.h"

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output")                                  \
    X(stem, output, Real, 50.0, -ANY, ANY, "%", "stem position")                                   \
    X(stick_band, tunable, Real, 11.0, 0.0, ANY, "%", "stick band S = fS + fD")                    \
    X(slip_jump, tunable, Real, 3.0, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at the start")

typedef struct {
    valve_state valve;
} plant_memory;

#include "plant.h"

static const char *plant_initialise(plant *p) {
    valve_rest(&p->memory.valve, p->v.stick_band, p->v.slip_jump, p->v.op);
    p->v.stem = p->memory.valve.stem;
    return valve_check(p->v.stick_band, p->v.slip_jump);
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = valve_check(p->v.stick_band, p->v.slip_jump);
    (void)count;
    if (complaint)
        return complaint;
    p->v.stem = valve_move(&p->memory.valve, VALVE_HE, p->v.stick_band, p->v.slip_jump, p->v.op);
    return 0;
}

#include "fmi.h"

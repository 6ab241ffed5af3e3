/* A PI controller alone: OP from PV and set-point, once a step. With loop_valve and loop_process it
 * makes the system of three FMUs that is the same loop as example1 with its controller inside. */
#define MODEL_IDENTIFIER loop_controller
#define BASE_STEP 1.0
#define DEFAULT_STEP 1.0

#include <stdint.h>

#define VARIABLES(X)                                                                               \
    X(pv, input, Real, 50.0, -ANY, ANY, "1", "measured process variable")                          \
    X(sp, input, Real, 50.0, -ANY, ANY, "1", "set-point")                                          \
    X(op, output, Real, 50.0, -ANY, ANY, "%", "controller output, 0 ... 100")                      \
    X(op_start, fixed, Real, 50.0, 0.0, 100.0, "%", "OP at the start")                             \
    X(gain, tunable, Real, 0.8, -ANY, ANY, "", "percent of OP per PV")                             \
    X(integral_time, tunable, Real, 10.0, 0.001, ANY, "s", "integral time")

#define PV_UNIT "1"
#include "controller.h"

typedef struct {
    pi_state controller;
} plant_memory;

#include "plant.h"

static const char *plant_initialise(plant *p) {
    p->v.op = p->v.op_start;
    pi_rest(&p->memory.controller, p->v.op);
    return 0;
}

static const char *plant_advance(plant *p, int64_t count) {
    p->v.op = pi_op(&p->memory.controller, 1, p->v.gain, p->v.integral_time, p->v.sp - p->v.pv,
                    p->v.op, (double)count * BASE_STEP);
    return 0;
}

#include "fmi.h"

/* The body that the two numerical examples of Bacci di Capaci et al. (2018) share: sticky valve,
 * ARX(3,3) process with equation noise v, optional noise on the measurement. The including model
 * file has the coefficients PROCESS_A and PROCESS_B. */
#include "arx.h"
#include "controller.h"
#include "valve.h"

typedef struct {
    valve_state valve;
    pi_state controller;
    arx_state process;
} plant_memory;

#include "plant.h"

static const double process_a[3] = PROCESS_A;
static const double process_b[3] = PROCESS_B;

static void measure(plant *p) {
    p->v.stem = p->memory.valve.stem;
    p->v.pv = p->memory.process.y[0] + p->v.bias + p->v.output_noise_std * noise_normal(&p->noise);
}

static const char *plant_initialise(plant *p) {
    const double gain = (process_b[0] + process_b[1] + process_b[2]) /
                        (1.0 + process_a[0] + process_a[1] + process_a[2]);
    const double x = p->v.op + p->v.load;
    noise_start(&p->noise, p->v.seed);
    pi_rest(&p->memory.controller, p->v.op);
    p->v.op_out = p->v.op;
    valve_rest(&p->memory.valve, p->v.stick_band, p->v.slip_jump, p->v.op);
    arx_rest(&p->memory.process, gain * x, x);
    measure(p);
    return valve_check(p->v.stick_band, p->v.slip_jump);
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = valve_check(p->v.stick_band, p->v.slip_jump);
    double stem;
    if (complaint)
        return complaint;
    /* One move a step, as the data-driven models do with a new sample of OP. */
    p->v.op_out = controlled_op(p, count);
    stem = valve_move(&p->memory.valve, (int)p->v.valve, p->v.stick_band, p->v.slip_jump,
                      p->v.op_out);
    for (int64_t i = 0; i < count; ++i) {
        const double v = p->v.noise_std * noise_normal(&p->noise);
        arx_step(&p->memory.process, process_a, process_b, stem + p->v.load, v);
        measure(p);
    }
    return 0;
}

/* The process of example1 alone, 1 / ((4 s + 1)(6 s + 1)(2 s + 1)) sampled every second, without
 * noise. */
#define MODEL_IDENTIFIER loop_process
#define BASE_STEP 1.0
#define DEFAULT_STEP 1.0

#include <stdint.h>

#include "arx.h"

#define VARIABLES(X)                                                                               \
    X(stem, input, Real, 50.0, -ANY, ANY, "%", "stem position")                                    \
    X(pv, output, Real, 50.0, -ANY, ANY, "1", "process variable")                                  \
    X(stem_start, fixed, Real, 50.0, -ANY, ANY, "%", "stem position at the start")

typedef struct {
    arx_state process;
} plant_memory;

#include "plant.h"

static const double process_a[3] = {-2.231813167674652366, 1.645024301974050480,
                                    -0.399849654344847355};
static const double process_b[3] = {0.002770040421539427980, 0.008839767573438738630,
                                    0.001751671959572592970};

static const char *plant_initialise(plant *p) {
    const double gain = (process_b[0] + process_b[1] + process_b[2]) /
                        (1.0 + process_a[0] + process_a[1] + process_a[2]);
    arx_rest(&p->memory.process, gain * p->v.stem, p->v.stem);
    p->v.pv = p->memory.process.y[0];
    return 0;
}

static const char *plant_advance(plant *p, int64_t count) {
    for (int64_t i = 0; i < count; ++i)
        p->v.pv = arx_step(&p->memory.process, process_a, process_b, p->v.stem, 0.0);
    return 0;
}

#include "fmi.h"

/* A plant that goes wrong on purpose, for the tests of isolation: at the start or in a step it
 * aborts, reads through a null pointer, never returns, or refuses. */
#define _POSIX_C_SOURCE 199309L
#define MODEL_IDENTIFIER faulty
#define BASE_STEP 1.0
#define DEFAULT_STEP 1.0

#include <stdint.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output")                                  \
    X(pv, output, Real, 0.0, -ANY, ANY, "1", "follows op")                                         \
    X(steps, output, Integer, 0, -ANY, ANY, "", "steps done")                                      \
    X(fault, tunable, Integer, 0, 0, 7, "", "1 abort, 2 segfault, 3 endless, 4 no, 5 NaN, 6 slow, 7 fork") \
    X(at_start, fixed, Integer, 0, 0, 1, "", "1: the fault happens at the start, not in a step")   \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at the start")

typedef struct {
    int64_t done;
} plant_memory;

#include "plant.h"

static const char *misbehave(plant *p) {
    volatile int *nowhere = 0;
    volatile int on = 1;
    switch ((int)p->v.fault) {
    case 1:
        abort();
    case 2:
        *nowhere = 1;
        break;
    case 3:
        while (on) {
        }
        break;
    case 4:
        return "this plant refuses";
    case 5:
        p->v.pv = NAN;
        break;
    case 6: /* 0.3 s a step */
        nanosleep(&(struct timespec){0, 300000000}, 0);
        break;
    case 7: /* a process of its own, which nobody waits for */
        if (fork() == 0)
            for (;;)
                pause();
        break;
    }
    return 0;
}

static const char *plant_initialise(plant *p) {
    p->memory.done = 0;
    p->v.pv = p->v.op;
    return p->v.at_start > 0.0 ? misbehave(p) : 0;
}

static const char *plant_advance(plant *p, int64_t count) {
    p->memory.done += count;
    p->v.steps = (double)p->memory.done;
    p->v.pv = p->v.op;
    return misbehave(p);
}

#include "fmi.h"

/* What every plant has: the variables of its table, a noise source, its own memory, and time.
 *
 * A model file defines, before it includes this header,
 *   MODEL_IDENTIFIER  its name as a C token,
 *   BASE_STEP         its internal step in seconds,
 *   DEFAULT_STEP      the sampling period it is meant for (a multiple of BASE_STEP),
 *   VARIABLES(X)      one row a variable:
 *                     X(name, kind, type, start, low, high, "unit", "text")
 *                     kind: input, output, fixed (a parameter set before the start) or tunable
 *                     (a parameter that may change at any time); type: Real or Integer;
 *                     a bound is a number, ANY or -ANY; a header's rows come in as
 *                     NAME_VARIABLES(X) (controller.h has some),
 *   plant_memory      a struct without pointers: what the model keeps between steps,
 * then plant_initialise and plant_advance, and at last includes "fmi.h".
 * A fixed parameter called like an input with _start behind it (op_start) is that input's value at
 * the start, unless the importer sets the input itself.
 * The build reads the same rows to write modelDescription.xml.
 */
#ifndef PLANT_H
#define PLANT_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "noise.h"

#define ANY HUGE_VAL

#define PLANT_FIELD(name, kind, type, start, low, high, unit, text) double name;
#define PLANT_COUNT(name, kind, type, start, low, high, unit, text) +1
#define PLANT_ROW(name, kind, type, start, low, high, unit, text)                                  \
    {#name, KIND_##kind, TYPE_##type, start, low, high},

enum { KIND_input, KIND_output, KIND_fixed, KIND_tunable, KIND_time };
enum { TYPE_Real, TYPE_Integer };

/* Value reference 0 is time; the rows follow in order. */
enum { VARIABLE_COUNT = 1 VARIABLES(PLANT_COUNT) };

typedef struct {
    double time;
    VARIABLES(PLANT_FIELD)
} plant_variables;

typedef struct {
    const char *name;
    int kind;
    int type;
    double start, low, high;
} plant_row;

static const plant_row plant_table[VARIABLE_COUNT] = {
    {"time", KIND_time, TYPE_Real, 0.0, -ANY, ANY}, VARIABLES(PLANT_ROW)};

typedef struct {
    plant_variables v;
    plant_memory memory;
    noise_source noise;
    double start_time;
    int64_t steps; /* base steps since the start: time = start_time + steps * BASE_STEP */
    int32_t phase;
    int32_t unused; /* keeps the size the same on every platform */
    unsigned char given[(VARIABLE_COUNT + 7) / 8 * 8]; /* 1: the importer has set it */
} plant;

/* Put the plant at rest at its inputs, and set the outputs. Called again whenever a parameter
 * changed before the start. Returns 0, or what is wrong with the parameters. */
static const char *plant_initialise(plant *p);

/* Apply the inputs, advance by `count` base steps and set the outputs. Returns 0 or a complaint. */
static const char *plant_advance(plant *p, int64_t count);

static inline double plant_clamp(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

#endif

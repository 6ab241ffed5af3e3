/* What FMI 2 and FMI 3 have in common: an instance, its variables, steps and snapshots. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2Functions.h"
#include "fmi3Functions.h"
#include "token.h"

enum { PHASE_INSTANTIATED, PHASE_INITIALISING, PHASE_STEPPING, PHASE_TERMINATED };
enum { FMU_OK = 0, FMU_ERROR = 3 }; /* the same numbers in fmi2Status and fmi3Status */

typedef struct {
    plant state;
    fmi2CallbackLogger log2;
    fmi3LogMessageCallback log3;
    void *environment;
    char name[64];
} fmu_instance;

typedef struct {
    char token[48];
    plant state;
} fmu_snapshot;

/* Report what is wrong through the importer's logger; returns FMU_ERROR. */
static int fmu_complain(fmu_instance *fmu, const char *format, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (fmu->log2)
        fmu->log2(fmu->environment, fmu->name, fmi2Error, "error", "%s", text);
    if (fmu->log3)
        fmu->log3(fmu->environment, fmi3Error, "error", text);
    return FMU_ERROR;
}

static void fmu_reset(fmu_instance *fmu) {
    memset(&fmu->state, 0, sizeof fmu->state);
    for (int i = 0; i < VARIABLE_COUNT; ++i)
        ((double *)&fmu->state.v)[i] = plant_table[i].start;
    fmu->state.phase = PHASE_INSTANTIATED;
}

static fmu_instance *fmu_create(const char *name, const char *token, fmi2CallbackLogger log2,
                                fmi3LogMessageCallback log3, void *environment) {
    fmu_instance *fmu = (fmu_instance *)calloc(1, sizeof *fmu);
    if (!fmu)
        return 0;
    fmu->log2 = log2;
    fmu->log3 = log3;
    fmu->environment = environment;
    snprintf(fmu->name, sizeof fmu->name, "%s", name ? name : "");
    if (!token || strcmp(token, FMU_TOKEN) != 0) {
        fmu_complain(fmu, "the description's token %s is not that of this library, %s",
                     token ? token : "(none)", FMU_TOKEN);
        free(fmu);
        return 0;
    }
    fmu_reset(fmu);
    return fmu;
}

/* Let NAME_start decide the input NAME that the importer has not set. */
static void fmu_start_inputs(plant *p) {
    double *values = (double *)&p->v;
    for (int i = 1; i < VARIABLE_COUNT; ++i) {
        const size_t length = strlen(plant_table[i].name);
        if (plant_table[i].kind != KIND_input || p->given[i])
            continue;
        for (int j = 1; j < VARIABLE_COUNT; ++j)
            if (plant_table[j].kind == KIND_fixed &&
                strncmp(plant_table[j].name, plant_table[i].name, length) == 0 &&
                strcmp(plant_table[j].name + length, "_start") == 0)
                values[i] = values[j];
    }
}

static int fmu_initialise(fmu_instance *fmu) {
    plant *p = &fmu->state;
    const char *complaint;
    fmu_start_inputs(p);
    p->steps = 0;
    p->v.time = p->start_time;
    complaint = plant_initialise(p);
    return complaint ? fmu_complain(fmu, "%s", complaint) : FMU_OK;
}

static int fmu_enter_initialisation(fmu_instance *fmu, double start_time) {
    if (fmu->state.phase != PHASE_INSTANTIATED)
        return fmu_complain(fmu, "initialisation can be entered once only, before the first step");
    if (!isfinite(start_time))
        return fmu_complain(fmu, "the start time is not a finite number");
    fmu->state.start_time = start_time;
    fmu->state.phase = PHASE_INITIALISING;
    return FMU_OK;
}

static int fmu_exit_initialisation(fmu_instance *fmu) {
    if (fmu->state.phase != PHASE_INITIALISING)
        return fmu_complain(fmu, "initialisation was not entered");
    if (fmu_initialise(fmu) != FMU_OK)
        return FMU_ERROR;
    fmu->state.phase = PHASE_STEPPING;
    return FMU_OK;
}

static int fmu_get(fmu_instance *fmu, unsigned reference, int type, double *value) {
    if (reference >= VARIABLE_COUNT || plant_table[reference].type != type)
        return fmu_complain(fmu, "there is no such variable: value reference %u", reference);
    if (fmu->state.phase == PHASE_INITIALISING && fmu_initialise(fmu) != FMU_OK)
        return FMU_ERROR;
    *value = ((const double *)&fmu->state.v)[reference];
    return FMU_OK;
}

static int fmu_set(fmu_instance *fmu, unsigned reference, int type, double value) {
    const plant_row *row;
    if (reference >= VARIABLE_COUNT || plant_table[reference].type != type)
        return fmu_complain(fmu, "there is no such variable: value reference %u", reference);
    row = plant_table + reference;
    if (row->kind == KIND_output || row->kind == KIND_time)
        return fmu_complain(fmu, "%s is an output and cannot be set", row->name);
    if (row->kind == KIND_fixed && fmu->state.phase >= PHASE_STEPPING)
        return fmu_complain(fmu, "%s can be set before the start only", row->name);
    if (!isfinite(value) || value < row->low || value > row->high)
        return fmu_complain(fmu, "%s = %g is not within %g ... %g", row->name, value, row->low,
                            row->high);
    ((double *)&fmu->state.v)[reference] = value;
    fmu->state.given[reference] = 1;
    return FMU_OK;
}

static int fmu_step(fmu_instance *fmu, double time, double size) {
    plant *p = &fmu->state;
    const double count = floor(size / BASE_STEP + 0.5);
    const char *complaint;
    if (p->phase != PHASE_STEPPING)
        return fmu_complain(fmu, "a step was asked for outside of simulation");
    if (!(count >= 1.0) || fabs(size - count * BASE_STEP) > 1e-6 * BASE_STEP || count > 1e9)
        return fmu_complain(fmu, "the step must be a multiple of %g s; %g s was asked for",
                            (double)BASE_STEP, size);
    if (!(fabs(time - p->v.time) <= 1e-6 * size + 1e-9 * fabs(time)))
        return fmu_complain(fmu, "the step starts at %.17g s, but the model is at %.17g s", time,
                            p->v.time);
    complaint = plant_advance(p, (int64_t)count);
    if (complaint)
        return fmu_complain(fmu, "%s", complaint);
    p->steps += (int64_t)count;
    p->v.time = p->start_time + (double)p->steps * BASE_STEP;
    for (int i = 0; i < VARIABLE_COUNT; ++i)
        if (!isfinite(((const double *)&p->v)[i]))
            return fmu_complain(fmu, "%s is no finite number any more", plant_table[i].name);
    return FMU_OK;
}

static int fmu_save(fmu_instance *fmu, void **snapshot) {
    if (!*snapshot)
        *snapshot = calloc(1, sizeof(fmu_snapshot));
    if (!*snapshot)
        return fmu_complain(fmu, "no memory for a snapshot");
    memcpy(((fmu_snapshot *)*snapshot)->token, FMU_TOKEN, sizeof FMU_TOKEN);
    ((fmu_snapshot *)*snapshot)->state = fmu->state;
    return FMU_OK;
}

static int fmu_load(fmu_instance *fmu, const void *snapshot) {
    if (!snapshot)
        return fmu_complain(fmu, "there is no snapshot to restore");
    fmu->state = ((const fmu_snapshot *)snapshot)->state;
    return FMU_OK;
}

static int fmu_serialise(fmu_instance *fmu, const void *snapshot, void *bytes, size_t size) {
    if (!snapshot || size < sizeof(fmu_snapshot))
        return fmu_complain(fmu, "the buffer is too small for a snapshot");
    memcpy(bytes, snapshot, sizeof(fmu_snapshot));
    return FMU_OK;
}

static int fmu_deserialise(fmu_instance *fmu, const void *bytes, size_t size, void **snapshot) {
    if (size != sizeof(fmu_snapshot) || memcmp(bytes, FMU_TOKEN, sizeof FMU_TOKEN) != 0)
        return fmu_complain(fmu, "the bytes are not a snapshot of this model and version");
    if (!*snapshot)
        *snapshot = calloc(1, sizeof(fmu_snapshot));
    if (!*snapshot)
        return fmu_complain(fmu, "no memory for a snapshot");
    memcpy(*snapshot, bytes, size);
    return FMU_OK;
}

#endif

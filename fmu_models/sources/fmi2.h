/* The functions of FMI 2.0 co-simulation over instance.h. */
#ifndef FMI2_H
#define FMI2_H

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n,
                               const fmi2String names[]) {
    (void)c, (void)on, (void)n, (void)names;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || !functions)
        return 0;
    return fmu_create(name, guid, functions->logger, 0, functions->componentEnvironment);
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    fmu_instance *fmu = (fmu_instance *)c;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    fmu->state.start_time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    fmu_instance *fmu = (fmu_instance *)c;
    return (fmi2Status)fmu_enter_initialisation(fmu, fmu->state.start_time);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return (fmi2Status)fmu_exit_initialisation((fmu_instance *)c);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    ((fmu_instance *)c)->state.phase = PHASE_TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    fmu_reset((fmu_instance *)c);
    return fmi2OK;
}

#define FMI2_GET(NAME, TYPE, KIND)                                                                 \
    fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             TYPE value[]) {                                                       \
        for (size_t i = 0; i < n; ++i) {                                                           \
            double x = 0.0;                                                                        \
            if (fmu_get((fmu_instance *)c, vr[i], KIND, &x) != FMU_OK)                             \
                return fmi2Error;                                                                  \
            value[i] = (TYPE)x;                                                                    \
        }                                                                                          \
        return fmi2OK;                                                                             \
    }

#define FMI2_SET(NAME, TYPE, KIND)                                                                 \
    fmi2Status fmi2Set##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             const TYPE value[]) {                                                 \
        for (size_t i = 0; i < n; ++i)                                                             \
            if (fmu_set((fmu_instance *)c, vr[i], KIND, (double)value[i]) != FMU_OK)               \
                return fmi2Error;                                                                  \
        return fmi2OK;                                                                             \
    }

FMI2_GET(Real, fmi2Real, TYPE_Real)
FMI2_GET(Integer, fmi2Integer, TYPE_Integer)
FMI2_SET(Real, fmi2Real, TYPE_Real)
FMI2_SET(Integer, fmi2Integer, TYPE_Integer)

/* What a plant of this kind has no use for. */
#define FMI2_REFUSE(FUNCTION, PARAMETERS)                                                          \
    fmi2Status FUNCTION PARAMETERS {                                                               \
        return (fmi2Status)fmu_complain((fmu_instance *)c, #FUNCTION " is not offered");           \
    }

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return (fmi2Status)fmu_save((fmu_instance *)c, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    return (fmi2Status)fmu_load((fmu_instance *)c, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = 0;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(fmu_snapshot);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size) {
    return (fmi2Status)fmu_serialise((fmu_instance *)c, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state) {
    return (fmi2Status)fmu_deserialise((fmu_instance *)c, bytes, size, state);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_set_state) {
    (void)no_set_state;
    return (fmi2Status)fmu_step((fmu_instance *)c, time, size);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime)
        return fmu_complain((fmu_instance *)c, "steps are not asynchronous");
    *value = ((fmu_instance *)c)->state.v.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (kind != fmi2Terminated)
        return fmu_complain((fmu_instance *)c, "steps are not asynchronous");
    *value = fmi2False;
    return fmi2OK;
}

FMI2_REFUSE(fmi2GetBoolean,
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]))
FMI2_REFUSE(fmi2SetBoolean,
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]))
FMI2_REFUSE(fmi2GetString,
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]))
FMI2_REFUSE(fmi2SetString,
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[]))
FMI2_REFUSE(fmi2GetDirectionalDerivative,
            (fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
             const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
             fmi2Real value[]))
FMI2_REFUSE(fmi2SetRealInputDerivatives,
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
             const fmi2Real value[]))
FMI2_REFUSE(fmi2GetRealOutputDerivatives,
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
             fmi2Real value[]))
FMI2_REFUSE(fmi2CancelStep, (fmi2Component c))
FMI2_REFUSE(fmi2GetStatus, (fmi2Component c, const fmi2StatusKind kind, fmi2Status *value))
FMI2_REFUSE(fmi2GetIntegerStatus, (fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value))
FMI2_REFUSE(fmi2GetStringStatus, (fmi2Component c, const fmi2StatusKind kind, fmi2String *value))

#endif

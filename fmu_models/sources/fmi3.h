/* The functions of FMI 3.0 co-simulation over instance.h. */
#ifndef FMI3_H
#define FMI3_H

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n,
                               const fmi3String names[]) {
    (void)instance, (void)on, (void)n, (void)names;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early_return;
    (void)intermediate, (void)intermediates, (void)update;
    return fmu_create(name, token, 0, log, environment);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    if (log)
        log(environment, fmi3Error, "error", "this is a co-simulation model only");
    return 0;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
    (void)update, (void)lock, (void)unlock;
    return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, log);
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean has_stop, fmi3Float64 stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return (fmi3Status)fmu_enter_initialisation((fmu_instance *)instance, start);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    return (fmi3Status)fmu_exit_initialisation((fmu_instance *)instance);
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
    ((fmu_instance *)instance)->state.phase = PHASE_TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    fmu_reset((fmu_instance *)instance);
    return fmi3OK;
}

#define FMI3_GET(NAME, TYPE, KIND)                                                                 \
    fmi3Status fmi3Get##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,       \
                             TYPE value[], size_t values) {                                        \
        if (values != n)                                                                           \
            return (fmi3Status)fmu_complain((fmu_instance *)instance, "every variable is scalar"); \
        for (size_t i = 0; i < n; ++i) {                                                           \
            double x = 0.0;                                                                        \
            if (fmu_get((fmu_instance *)instance, vr[i], KIND, &x) != FMU_OK)                      \
                return fmi3Error;                                                                  \
            value[i] = (TYPE)x;                                                                    \
        }                                                                                          \
        return fmi3OK;                                                                             \
    }

#define FMI3_SET(NAME, TYPE, KIND)                                                                 \
    fmi3Status fmi3Set##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,       \
                             const TYPE value[], size_t values) {                                  \
        if (values != n)                                                                           \
            return (fmi3Status)fmu_complain((fmu_instance *)instance, "every variable is scalar"); \
        for (size_t i = 0; i < n; ++i)                                                             \
            if (fmu_set((fmu_instance *)instance, vr[i], KIND, (double)value[i]) != FMU_OK)        \
                return fmi3Error;                                                                  \
        return fmi3OK;                                                                             \
    }

FMI3_GET(Float64, fmi3Float64, TYPE_Real)
FMI3_GET(Int32, fmi3Int32, TYPE_Integer)
FMI3_SET(Float64, fmi3Float64, TYPE_Real)
FMI3_SET(Int32, fmi3Int32, TYPE_Integer)

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    return (fmi3Status)fmu_save((fmu_instance *)instance, state);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    return (fmi3Status)fmu_load((fmu_instance *)instance, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    (void)instance;
    free(*state);
    *state = 0;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    (void)instance, (void)state;
    *size = sizeof(fmu_snapshot);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    return (fmi3Status)fmu_serialise((fmu_instance *)instance, state, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    return (fmi3Status)fmu_deserialise((fmu_instance *)instance, bytes, size, state);
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 size,
                      fmi3Boolean no_set_state, fmi3Boolean *event_needed, fmi3Boolean *terminate,
                      fmi3Boolean *early_return, fmi3Float64 *last_time) {
    const int status = fmu_step((fmu_instance *)instance, time, size);
    (void)no_set_state;
    *event_needed = *terminate = *early_return = fmi3False;
    *last_time = ((fmu_instance *)instance)->state.v.time;
    return (fmi3Status)status;
}

/* What a plant of this kind has no use for. */
#define FMI3_REFUSE(FUNCTION, PARAMETERS)                                                          \
    fmi3Status FUNCTION PARAMETERS {                                                               \
        return (fmi3Status)fmu_complain((fmu_instance *)instance, #FUNCTION " is not offered");    \
    }

FMI3_REFUSE(fmi3EnterEventMode, (fmi3Instance instance))
FMI3_REFUSE(fmi3GetFloat32,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float32 values[],
             size_t m))
FMI3_REFUSE(fmi3GetInt8,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Int8 values[],
             size_t m))
FMI3_REFUSE(fmi3GetUInt8,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt8 values[],
             size_t m))
FMI3_REFUSE(fmi3GetInt16,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Int16 values[],
             size_t m))
FMI3_REFUSE(fmi3GetUInt16,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt16 values[],
             size_t m))
FMI3_REFUSE(fmi3GetUInt32,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt32 values[],
             size_t m))
FMI3_REFUSE(fmi3GetInt64,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Int64 values[],
             size_t m))
FMI3_REFUSE(fmi3GetUInt64,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 values[],
             size_t m))
FMI3_REFUSE(fmi3GetBoolean,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Boolean values[],
             size_t m))
FMI3_REFUSE(fmi3GetString,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3String values[],
             size_t m))
FMI3_REFUSE(fmi3GetBinary,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, size_t valueSizes[],
             fmi3Binary values[], size_t m))
FMI3_REFUSE(fmi3GetClock,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Clock values[]))
FMI3_REFUSE(fmi3SetFloat32,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float32
             values[], size_t m))
FMI3_REFUSE(fmi3SetInt8,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Int8
             values[], size_t m))
FMI3_REFUSE(fmi3SetUInt8,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt8
             values[], size_t m))
FMI3_REFUSE(fmi3SetInt16,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Int16
             values[], size_t m))
FMI3_REFUSE(fmi3SetUInt16,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt16
             values[], size_t m))
FMI3_REFUSE(fmi3SetUInt32,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt32
             values[], size_t m))
FMI3_REFUSE(fmi3SetInt64,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Int64
             values[], size_t m))
FMI3_REFUSE(fmi3SetUInt64,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt64
             values[], size_t m))
FMI3_REFUSE(fmi3SetBoolean,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Boolean
             values[], size_t m))
FMI3_REFUSE(fmi3SetString,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3String
             values[], size_t m))
FMI3_REFUSE(fmi3SetBinary,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const size_t
             valueSizes[], const fmi3Binary values[], size_t m))
FMI3_REFUSE(fmi3SetClock,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Clock
             values[]))
FMI3_REFUSE(fmi3GetNumberOfVariableDependencies,
            (fmi3Instance instance, fmi3ValueReference valueReference, size_t *nDependencies))
FMI3_REFUSE(fmi3GetVariableDependencies,
            (fmi3Instance instance, fmi3ValueReference dependent, size_t
             elementIndicesOfDependent[], fmi3ValueReference independents[], size_t
             elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[], size_t
             nDependencies))
FMI3_REFUSE(fmi3GetDirectionalDerivative,
            (fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns, const
             fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
             fmi3Float64 sensitivity[], size_t nSensitivity))
FMI3_REFUSE(fmi3GetAdjointDerivative,
            (fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns, const
             fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
             fmi3Float64 sensitivity[], size_t nSensitivity))
FMI3_REFUSE(fmi3EnterConfigurationMode, (fmi3Instance instance))
FMI3_REFUSE(fmi3ExitConfigurationMode, (fmi3Instance instance))
FMI3_REFUSE(fmi3GetIntervalDecimal,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64
             intervals[], fmi3IntervalQualifier qualifiers[]))
FMI3_REFUSE(fmi3GetIntervalFraction,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
             fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]))
FMI3_REFUSE(fmi3GetShiftDecimal,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[]))
FMI3_REFUSE(fmi3GetShiftFraction,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
             fmi3UInt64 resolutions[]))
FMI3_REFUSE(fmi3SetIntervalDecimal,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64
             intervals[]))
FMI3_REFUSE(fmi3SetIntervalFraction,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt64
             counters[], const fmi3UInt64 resolutions[]))
FMI3_REFUSE(fmi3SetShiftDecimal,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64
             shifts[]))
FMI3_REFUSE(fmi3SetShiftFraction,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt64
             counters[], const fmi3UInt64 resolutions[]))
FMI3_REFUSE(fmi3EvaluateDiscreteStates, (fmi3Instance instance))
FMI3_REFUSE(fmi3UpdateDiscreteStates,
            (fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate, fmi3Boolean
             *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged, fmi3Boolean
             *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined, fmi3Float64
             *nextEventTime))
FMI3_REFUSE(fmi3EnterContinuousTimeMode, (fmi3Instance instance))
FMI3_REFUSE(fmi3CompletedIntegratorStep,
            (fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean
             *enterEventMode, fmi3Boolean *terminateSimulation))
FMI3_REFUSE(fmi3SetTime, (fmi3Instance instance, fmi3Float64 time))
FMI3_REFUSE(fmi3SetContinuousStates,
            (fmi3Instance instance, const fmi3Float64 continuousStates[], size_t nContinuousStates))
FMI3_REFUSE(fmi3GetContinuousStateDerivatives,
            (fmi3Instance instance, fmi3Float64 derivatives[], size_t nContinuousStates))
FMI3_REFUSE(fmi3GetEventIndicators,
            (fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators))
FMI3_REFUSE(fmi3GetContinuousStates,
            (fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates))
FMI3_REFUSE(fmi3GetNominalsOfContinuousStates,
            (fmi3Instance instance, fmi3Float64 nominals[], size_t nContinuousStates))
FMI3_REFUSE(fmi3GetNumberOfEventIndicators, (fmi3Instance instance, size_t *nEventIndicators))
FMI3_REFUSE(fmi3GetNumberOfContinuousStates, (fmi3Instance instance, size_t *nContinuousStates))
FMI3_REFUSE(fmi3EnterStepMode, (fmi3Instance instance))
FMI3_REFUSE(fmi3GetOutputDerivatives,
            (fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Int32
             orders[], fmi3Float64 values[], size_t m))
FMI3_REFUSE(fmi3ActivateModelPartition,
            (fmi3Instance instance, fmi3ValueReference clockReference, fmi3Float64 activationTime))

#endif

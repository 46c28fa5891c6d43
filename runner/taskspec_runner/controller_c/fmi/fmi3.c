/* The controller of the task "@TITLE@" as an FMU of FMI 3.0, for co-simulation.
 *
 * Made by taskspec @VERSION@. The importer has fmi3Functions.h. */
#define FMI3_FUNCTION_PREFIX @NAME@_
#include "fmi3Functions.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct fmu_host {
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmi3Boolean logging;
};

static void host_log(const struct fmu_host *h, int status, const char *category, const char *text)
{
    if (h->log != NULL && (h->logging || status >= fmi3Error))
        h->log(h->environment, (fmi3Status)status, category, text);
}

#include "fmu.h"

FMI3_Export const char *fmi3GetVersion(void) { return "3.0"; }

FMI3_Export fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n,
                                           const fmi3String categories[])
{
    (void)n, (void)categories;
    ((struct fmu *)instance)->host.logging = on;
    return fmi3OK;
}

FMI3_Export fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    struct fmu_host host = {environment, log, logging};
    (void)name, (void)resources, (void)visible, (void)early;
    (void)intermediate, (void)n, (void)update;
    if (events) {
        host_log(&host, FMU_ERROR, "logStatusError", "it has no event mode");
        return NULL;
    }
    return fmu_new(&host, token);
}

FMI3_Export fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    struct fmu_host host = {environment, log, logging};
    (void)name, (void)token, (void)resources, (void)visible;
    host_log(&host, FMU_ERROR, "logStatusError", "it is for co-simulation only");
    return NULL;
}

FMI3_Export fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)update, (void)lock, (void)unlock;
    return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, log);
}

FMI3_Export void fmi3FreeInstance(fmi3Instance instance) { fmu_free(instance); }

FMI3_Export fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean tolerant, fmi3Float64 tolerance, fmi3Float64 start,
    fmi3Boolean stops, fmi3Float64 stop)
{
    (void)tolerant, (void)tolerance, (void)stops, (void)stop;
    return (fmi3Status)fmu_initialize(instance, start);
}

FMI3_Export fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    return (fmi3Status)fmu_initialized(instance);
}

FMI3_Export fmi3Status fmi3Terminate(fmi3Instance instance)
{
    ((struct fmu *)instance)->mode = FMU_TERMINATED;
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3Reset(fmi3Instance instance)
{
    fmu_reset(instance);
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 size,
                                  fmi3Boolean never_back, fmi3Boolean *event,
                                  fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    fmi3Status status = (fmi3Status)fmu_step(instance, time, size);
    (void)never_back;
    *event = *terminate = *early = fmi3False;
    *last = ((struct fmu *)instance)->time;
    return status;
}

/* Getters and setters of a type by functions that say whether there is such a variable. */
#define FMU_ACCESS(Type, get, set)                                                               \
    FMI3_Export fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference r[],    \
                                         size_t n, fmi3##Type value[], size_t m)                 \
    {                                                                                            \
        size_t i;                                                                                \
        for (i = 0; i < n; i++)                                                                  \
            if (i >= m || !get(instance, r[i], &value[i])) break;                                \
        return i == n && n == m ? fmi3OK : (fmi3Status)fmu_refuse(instance, FMU_NO #Type);       \
    }                                                                                            \
    FMI3_Export fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference r[],    \
                                         size_t n, const fmi3##Type value[], size_t m)           \
    {                                                                                            \
        size_t i;                                                                                \
        for (i = 0; i < n; i++)                                                                  \
            if (i >= m || !set(instance, r[i], value[i])) break;                                 \
        return i == n && n == m ? fmi3OK : (fmi3Status)fmu_refuse(instance, FMU_NO #Type);       \
    }
#define FMU_NO "there is no such variable, or it cannot be set now, or not to this value: "
#define FMU_NONE(instance, reference, value) ((void)(reference), (void)(value), false)

FMU_ACCESS(Float64, fmu_get_number, fmu_set_number)
FMU_ACCESS(Int64, fmu_get_whole, fmu_set_whole)
FMU_ACCESS(String, fmu_get_text, FMU_NONE)
FMU_ACCESS(Float32, FMU_NONE, FMU_NONE)
FMU_ACCESS(Int8, FMU_NONE, FMU_NONE)
FMU_ACCESS(UInt8, FMU_NONE, FMU_NONE)
FMU_ACCESS(Int16, FMU_NONE, FMU_NONE)
FMU_ACCESS(UInt16, FMU_NONE, FMU_NONE)
FMU_ACCESS(Int32, FMU_NONE, FMU_NONE)
FMU_ACCESS(UInt32, FMU_NONE, FMU_NONE)
FMU_ACCESS(UInt64, FMU_NONE, FMU_NONE)
FMU_ACCESS(Boolean, FMU_NONE, FMU_NONE)

FMI3_Export fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    *state = fmu_copy(instance, *state);
    return *state != NULL ? fmi3OK : (fmi3Status)fmu_refuse(instance, "there is no memory");
}

FMI3_Export fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    return (fmi3Status)fmu_restore(instance, state);
}

FMI3_Export fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

/* ---- what the standard wants to be there for capabilities that this FMU has not */

#define FMU_LACKS(function, parameters)                                                          \
    FMI3_Export fmi3Status function parameters                                                   \
    {                                                                                            \
        return (fmi3Status)fmu_refuse(instance, "this FMU has no " #function);                   \
    }
typedef const fmi3ValueReference fmu_references;

FMU_LACKS(fmi3GetBinary, (fmi3Instance instance, fmu_references r[], size_t n, size_t sizes[],
                          fmi3Binary values[], size_t m))
FMU_LACKS(fmi3SetBinary, (fmi3Instance instance, fmu_references r[], size_t n,
                          const size_t sizes[], const fmi3Binary values[], size_t m))
FMU_LACKS(fmi3GetClock, (fmi3Instance instance, fmu_references r[], size_t n, fmi3Clock values[]))
FMU_LACKS(fmi3SetClock, (fmi3Instance instance, fmu_references r[], size_t n,
                         const fmi3Clock values[]))
FMU_LACKS(fmi3GetIntervalDecimal, (fmi3Instance instance, fmu_references r[], size_t n,
                                   fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]))
FMU_LACKS(fmi3GetIntervalFraction, (fmi3Instance instance, fmu_references r[], size_t n,
                                    fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                    fmi3IntervalQualifier qualifiers[]))
FMU_LACKS(fmi3SetIntervalDecimal, (fmi3Instance instance, fmu_references r[], size_t n,
                                   const fmi3Float64 intervals[]))
FMU_LACKS(fmi3SetIntervalFraction, (fmi3Instance instance, fmu_references r[], size_t n,
                                    const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]))
FMU_LACKS(fmi3GetShiftDecimal, (fmi3Instance instance, fmu_references r[], size_t n,
                                fmi3Float64 shifts[]))
FMU_LACKS(fmi3GetShiftFraction, (fmi3Instance instance, fmu_references r[], size_t n,
                                 fmi3UInt64 counters[], fmi3UInt64 resolutions[]))
FMU_LACKS(fmi3SetShiftDecimal, (fmi3Instance instance, fmu_references r[], size_t n,
                                const fmi3Float64 shifts[]))
FMU_LACKS(fmi3SetShiftFraction, (fmi3Instance instance, fmu_references r[], size_t n,
                                 const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]))
FMU_LACKS(fmi3GetNumberOfVariableDependencies, (fmi3Instance instance, fmi3ValueReference r,
                                                size_t *n))
FMU_LACKS(fmi3GetVariableDependencies, (fmi3Instance instance, fmi3ValueReference dependent,
                                        size_t elements[], fmi3ValueReference independents[],
                                        size_t others[], fmi3DependencyKind kinds[], size_t n))
FMU_LACKS(fmi3SerializedFMUStateSize, (fmi3Instance instance, fmi3FMUState state, size_t *size))
FMU_LACKS(fmi3SerializeFMUState, (fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[],
                                  size_t size))
FMU_LACKS(fmi3DeserializeFMUState, (fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                    fmi3FMUState *state))
FMU_LACKS(fmi3GetDirectionalDerivative, (fmi3Instance instance, fmu_references unknowns[],
                                         size_t n, fmu_references knowns[], size_t m,
                                         const fmi3Float64 seed[], size_t seeds,
                                         fmi3Float64 sensitivity[], size_t sensitivities))
FMU_LACKS(fmi3GetAdjointDerivative, (fmi3Instance instance, fmu_references unknowns[], size_t n,
                                     fmu_references knowns[], size_t m, const fmi3Float64 seed[],
                                     size_t seeds, fmi3Float64 sensitivity[],
                                     size_t sensitivities))
FMU_LACKS(fmi3GetOutputDerivatives, (fmi3Instance instance, fmu_references r[], size_t n,
                                     const fmi3Int32 orders[], fmi3Float64 values[], size_t m))
FMU_LACKS(fmi3EnterConfigurationMode, (fmi3Instance instance))
FMU_LACKS(fmi3ExitConfigurationMode, (fmi3Instance instance))
FMU_LACKS(fmi3EnterEventMode, (fmi3Instance instance))
FMU_LACKS(fmi3EnterStepMode, (fmi3Instance instance))
FMU_LACKS(fmi3EvaluateDiscreteStates, (fmi3Instance instance))
FMU_LACKS(fmi3UpdateDiscreteStates, (fmi3Instance instance, fmi3Boolean *update,
                                     fmi3Boolean *terminate, fmi3Boolean *nominals,
                                     fmi3Boolean *values, fmi3Boolean *defined,
                                     fmi3Float64 *next))
/* Of model exchange and scheduled execution; there are importers that load them in any case. */
FMU_LACKS(fmi3EnterContinuousTimeMode, (fmi3Instance instance))
FMU_LACKS(fmi3CompletedIntegratorStep, (fmi3Instance instance, fmi3Boolean never_back,
                                        fmi3Boolean *event, fmi3Boolean *terminate))
FMU_LACKS(fmi3SetTime, (fmi3Instance instance, fmi3Float64 time))
FMU_LACKS(fmi3SetContinuousStates, (fmi3Instance instance, const fmi3Float64 states[], size_t n))
FMU_LACKS(fmi3GetContinuousStates, (fmi3Instance instance, fmi3Float64 states[], size_t n))
FMU_LACKS(fmi3GetContinuousStateDerivatives, (fmi3Instance instance, fmi3Float64 values[],
                                              size_t n))
FMU_LACKS(fmi3GetEventIndicators, (fmi3Instance instance, fmi3Float64 values[], size_t n))
FMU_LACKS(fmi3GetNominalsOfContinuousStates, (fmi3Instance instance, fmi3Float64 values[],
                                              size_t n))
FMU_LACKS(fmi3GetNumberOfEventIndicators, (fmi3Instance instance, size_t *n))
FMU_LACKS(fmi3GetNumberOfContinuousStates, (fmi3Instance instance, size_t *n))
FMU_LACKS(fmi3ActivateModelPartition, (fmi3Instance instance, fmi3ValueReference clock,
                                       fmi3Float64 time))

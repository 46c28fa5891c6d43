/* The controller of the task "@TITLE@" as an FMU of FMI 2.0, for co-simulation.
 *
 * Made by taskspec @VERSION@. The importer has fmi2Functions.h. */
#define FMI2_FUNCTION_PREFIX @NAME@_
#include "fmi2Functions.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FMU_NAME 128

struct fmu_host {
    const fmi2CallbackFunctions *functions;
    fmi2Boolean logging;
    char name[FMU_NAME];
};

static void host_log(const struct fmu_host *h, int status, const char *category, const char *text)
{
    if (h->functions != NULL && h->functions->logger != NULL &&
        (h->logging || status >= fmi2Error))
        h->functions->logger(h->functions->componentEnvironment, h->name, (fmi2Status)status,
                             category, "%s", text);
}

#include "fmu.h"

FMI2_Export const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

FMI2_Export const char *fmi2GetVersion(void) { return "2.0"; }

FMI2_Export fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n,
                                           const fmi2String categories[])
{
    (void)n, (void)categories;
    ((struct fmu *)c)->host.logging = on;
    return fmi2OK;
}

FMI2_Export fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token,
                                          fmi2String resources,
                                          const fmi2CallbackFunctions *functions,
                                          fmi2Boolean visible, fmi2Boolean logging)
{
    struct fmu_host host = {functions, logging, ""};
    (void)resources, (void)visible;
    if (name != NULL) strncat(host.name, name, FMU_NAME - 1);
    if (type != fmi2CoSimulation) {
        host_log(&host, FMU_ERROR, "logStatusError", "it is for co-simulation only");
        return NULL;
    }
    return fmu_new(&host, token);
}

FMI2_Export void fmi2FreeInstance(fmi2Component c) { fmu_free(c); }

FMI2_Export fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant,
                                           fmi2Real tolerance, fmi2Real start, fmi2Boolean stops,
                                           fmi2Real stop)
{
    (void)tolerant, (void)tolerance, (void)stops, (void)stop;
    ((struct fmu *)c)->time = start;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return (fmi2Status)fmu_initialize(c, ((struct fmu *)c)->time);
}

FMI2_Export fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return (fmi2Status)fmu_initialized(c);
}

FMI2_Export fmi2Status fmi2Terminate(fmi2Component c)
{
    ((struct fmu *)c)->mode = FMU_TERMINATED;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2Reset(fmi2Component c)
{
    fmu_reset(c);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size,
                                  fmi2Boolean never_back)
{
    (void)never_back;
    return (fmi2Status)fmu_step(c, time, size);
}

static bool fmu_get_integer(struct fmu *f, uint32_t reference, fmi2Integer *value)
{
    int64_t whole = 0;
    bool there = fmu_get_whole(f, reference, &whole);
    *value = (fmi2Integer)whole;
    return there;
}

/* Getters and setters of a type by functions that say whether there is such a variable. */
#define FMU_ACCESS(Type, get, set)                                                               \
    FMI2_Export fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference r[],          \
                                         size_t n, fmi2##Type value[])                           \
    {                                                                                            \
        size_t i;                                                                                \
        for (i = 0; i < n; i++)                                                                  \
            if (!get(c, r[i], &value[i])) return (fmi2Status)fmu_refuse(c, FMU_NO #Type);        \
        return fmi2OK;                                                                           \
    }                                                                                            \
    FMI2_Export fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference r[],          \
                                         size_t n, const fmi2##Type value[])                     \
    {                                                                                            \
        size_t i;                                                                                \
        for (i = 0; i < n; i++)                                                                  \
            if (!set(c, r[i], value[i])) return (fmi2Status)fmu_refuse(c, FMU_NO #Type);         \
        return fmi2OK;                                                                           \
    }
#define FMU_NO "there is no such variable, or it cannot be set now, or not to this value: "
#define FMU_NONE(instance, reference, value) ((void)(reference), (void)(value), false)

FMU_ACCESS(Real, fmu_get_number, fmu_set_number)
FMU_ACCESS(Integer, fmu_get_integer, fmu_set_whole)
FMU_ACCESS(String, fmu_get_text, FMU_NONE)
FMU_ACCESS(Boolean, FMU_NONE, FMU_NONE)

FMI2_Export fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    *state = fmu_copy(c, *state);
    return *state != NULL ? fmi2OK : (fmi2Status)fmu_refuse(c, "there is no memory");
}

FMI2_Export fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    return (fmi2Status)fmu_restore(c, state);
}

FMI2_Export fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* Steps are over when fmi2DoStep returns; it returns no other status than these. */
FMI2_Export fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind,
                                         fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((struct fmu *)c)->time;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind,
                                            fmi2Boolean *value)
{
    (void)c;
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = 0;
    return fmi2OK;
}

/* ---- what the standard wants to be there for capabilities that this FMU has not */

#define FMU_LACKS(function, parameters)                                                          \
    FMI2_Export fmi2Status function parameters                                                   \
    {                                                                                            \
        return (fmi2Status)fmu_refuse(c, "this FMU has no " #function);                          \
    }
typedef const fmi2ValueReference fmu_references;

FMU_LACKS(fmi2GetStatus, (fmi2Component c, const fmi2StatusKind kind, fmi2Status *value))
FMU_LACKS(fmi2GetIntegerStatus, (fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value))
FMU_LACKS(fmi2GetStringStatus, (fmi2Component c, const fmi2StatusKind kind, fmi2String *value))
FMU_LACKS(fmi2CancelStep, (fmi2Component c))
FMU_LACKS(fmi2SerializedFMUstateSize, (fmi2Component c, fmi2FMUstate state, size_t *size))
FMU_LACKS(fmi2SerializeFMUstate, (fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                  size_t size))
FMU_LACKS(fmi2DeSerializeFMUstate, (fmi2Component c, const fmi2Byte bytes[], size_t size,
                                    fmi2FMUstate *state))
FMU_LACKS(fmi2GetDirectionalDerivative, (fmi2Component c, fmu_references unknowns[], size_t n,
                                         fmu_references knowns[], size_t m,
                                         const fmi2Real seed[], fmi2Real sensitivity[]))
FMU_LACKS(fmi2SetRealInputDerivatives, (fmi2Component c, fmu_references r[], size_t n,
                                        const fmi2Integer order[], const fmi2Real value[]))
FMU_LACKS(fmi2GetRealOutputDerivatives, (fmi2Component c, fmu_references r[], size_t n,
                                         const fmi2Integer order[], fmi2Real value[]))

/* Of model exchange; there are importers that load them in any case. */
FMU_LACKS(fmi2EnterEventMode, (fmi2Component c))
FMU_LACKS(fmi2NewDiscreteStates, (fmi2Component c, fmi2EventInfo *event))
FMU_LACKS(fmi2EnterContinuousTimeMode, (fmi2Component c))
FMU_LACKS(fmi2CompletedIntegratorStep, (fmi2Component c, fmi2Boolean never_back,
                                        fmi2Boolean *event, fmi2Boolean *terminate))
FMU_LACKS(fmi2SetTime, (fmi2Component c, fmi2Real time))
FMU_LACKS(fmi2SetContinuousStates, (fmi2Component c, const fmi2Real states[], size_t n))
FMU_LACKS(fmi2GetContinuousStates, (fmi2Component c, fmi2Real states[], size_t n))
FMU_LACKS(fmi2GetDerivatives, (fmi2Component c, fmi2Real values[], size_t n))
FMU_LACKS(fmi2GetEventIndicators, (fmi2Component c, fmi2Real values[], size_t n))
FMU_LACKS(fmi2GetNominalsOfContinuousStates, (fmi2Component c, fmi2Real values[], size_t n))

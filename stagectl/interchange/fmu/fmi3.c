/* The functions of FMI 3.0 around the model in model.h: co-simulation in whole control periods.

   What a stage does not have (events, clocks, derivatives, other types of variables) returns fmi3Error.
   Source of the functions and their meaning: Functional Mock-up Interface 3.0.2. */

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "fmi3Functions.h"

#if defined(__GNUC__) /* functions of a standard, and kernels of one shape, do not need all that they are given */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#include "model.h"

enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED };

typedef struct {
    model m;
    int mode;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} unit;

static fmi3Status failed(unit *u, const char *words, ...) {
    char text[300];
    va_list values;
    va_start(values, words);
    vsnprintf(text, sizeof text, words, values);
    va_end(values);
    if (u && u->log) u->log(u->environment, fmi3Error, "logStatusError", text);
    return fmi3Error;
}

static void observed(model *m) {
    m->measured = stage_measured(m->p.encoder, m->x, m->noise);
    m->reported = stage_reported(m->p.drive, m->x, PERIOD);
    m->friction = plant_with_effects_opposing(m->p.mechanics, m->x);
}

static void at_rest(model *m) {
    model_ready(m);
    m->x = equilibrium_standing(m->p, m->x.stops, m->x.memory.stops, m->start_position, m->session_time, 0.0);
    observed(m);
}

/* Set-up */

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference intermediate[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    unit *u = calloc(1, sizeof(unit));
    if (!u) return NULL;
    u->log = log, u->environment = environment;
    if (strcmp(token, TOKEN) != 0) {
        failed(u, "instantiationToken is %s; must be %s: modelDescription.xml is of another model", token, TOKEN);
        free(u);
        return NULL;
    }
    fmi3Reset(u);
    return u;
}

void fmi3FreeInstance(fmi3Instance i) { free(i); }

fmi3Status fmi3EnterInitializationMode(
    fmi3Instance i, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean stops,
    fmi3Float64 stop) {
    unit *u = i;
    u->m.begin = u->m.time = start;
    u->mode = INITIALIZING;
    at_rest(&u->m);
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance i) {
    ((unit *)i)->mode = STEPPING;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance i) {
    ((unit *)i)->mode = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance i) {
    unit *u = i;
    memset(&u->m, 0, sizeof u->m);
    model_start(&u->m);
    at_rest(&u->m);
    u->mode = INSTANTIATED;
    return fmi3OK;
}

/* Variables */

static fmi3Status may_be_set(unit *u, fmi3ValueReference reference, double value) {
    if (reference >= VARIABLES || TABLE[reference].settable == 0)
        return failed(u, "value reference %u cannot be set", (unsigned)reference);
    if (TABLE[reference].settable == 1 && u->mode >= STEPPING)
        return failed(u, "%s is fixed: set it before the initialization ends", TABLE[reference].name);
    if (!model_admits(reference, value))
        return failed(u, "%s = %g; must lie in %s", TABLE[reference].name, value, TABLE[reference].range);
    return fmi3OK;
}

static void changed(unit *u) {
    if (u->mode < STEPPING) at_rest(&u->m);
    else model_ready(&u->m), observed(&u->m);
}

#define ACCESS(TYPE, PLACE)                                                                                        \
    fmi3Status fmi3Get##TYPE(                                                                                      \
        fmi3Instance i, const fmi3ValueReference references[], size_t n, fmi3##TYPE values[], size_t count) {      \
        for (size_t k = 0; k < n; k++) {                                                                           \
            const void *place = n == count ? PLACE(&((unit *)i)->m, references[k]) : NULL;                         \
            if (!place) return failed(i, "value reference %u is no single " #TYPE, (unsigned)references[k]);       \
            memcpy(&values[k], place, sizeof values[k]);                                                           \
        }                                                                                                          \
        return fmi3OK;                                                                                             \
    }                                                                                                              \
    fmi3Status fmi3Set##TYPE(                                                                                      \
        fmi3Instance i, const fmi3ValueReference references[], size_t n, const fmi3##TYPE values[], size_t count) {\
        for (size_t k = 0; k < n; k++) {                                                                           \
            void *place = n == count ? PLACE(&((unit *)i)->m, references[k]) : NULL;                               \
            if (!place) return failed(i, "value reference %u is no single " #TYPE, (unsigned)references[k]);       \
            if (may_be_set(i, references[k], (double)values[k]) != fmi3OK) return fmi3Error;                       \
            memcpy(place, &values[k], sizeof values[k]);                                                           \
        }                                                                                                          \
        changed(i);                                                                                                \
        return fmi3OK;                                                                                             \
    }

ACCESS(Float64, model_number)
ACCESS(Int64, model_whole)

/* Motion */

fmi3Status fmi3EnterStepMode(fmi3Instance i) {
    ((unit *)i)->mode = STEPPING;
    return fmi3OK;
}

fmi3Status fmi3DoStep(
    fmi3Instance i, fmi3Float64 now, fmi3Float64 step, fmi3Boolean keeps, fmi3Boolean *event, fmi3Boolean *terminate,
    fmi3Boolean *early, fmi3Float64 *reached) {
    unit *u = i;
    model *m = &u->m;
    const double periods = step / PERIOD, whole = floor(periods + 0.5);
    *event = *terminate = *early = false;
    *reached = m->time;
    if (u->mode != STEPPING) return failed(u, "a step before the initialization has ended, or after the end");
    if (fabs(now - m->time) > 0.5 * PERIOD) return failed(u, "a step from %g s, where the time is %g s", now, m->time);
    if (whole < 1.0 || fabs(periods - whole) > 1e-6 * whole)
        return failed(u, "a step of %g s; must be a whole number of control periods of %g s", step, PERIOD);
    for (int64_t k = 0; k < (int64_t)whole; k++)
        m->x = stage_period(m->p, m->x, m->command, m->noise, PERIOD, SUBSTEPS);
    m->periods += (int64_t)whole;
    *reached = m->time = m->begin + (double)m->periods * PERIOD;
    observed(m);
    return fmi3OK;
}

/* The state: a copy of the model */

fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *state) {
    if (!*state) *state = malloc(sizeof(model));
    if (!*state) return failed(i, "no memory for the state");
    memcpy(*state, &((unit *)i)->m, sizeof(model));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState state) {
    memcpy(&((unit *)i)->m, state, sizeof(model));
    model_ready(&((unit *)i)->m);
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *state) {
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState state, size_t *size) {
    *size = sizeof(model);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    if (size != sizeof(model)) return failed(i, "a state of %zu bytes; must be %zu", size, sizeof(model));
    memcpy(bytes, state, size);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    if (size != sizeof(model)) return failed(i, "a state of %zu bytes; must be %zu", size, sizeof(model));
    if (fmi3GetFMUState(i, state) != fmi3OK) return fmi3Error;
    memcpy(*state, bytes, size);
    return fmi3OK;
}

/* What a stage does not have */

#define LACKS(NAME, ...) \
    fmi3Status fmi3##NAME(__VA_ARGS__) { return failed(i, "fmi3" #NAME ": the stage has nothing of the kind"); }
#define NONE(NAME, ...) LACKS(NAME, fmi3Instance i, __VA_ARGS__)
#define NO_TYPE(TYPE)                                                                       \
    NONE(Get##TYPE, const fmi3ValueReference r[], size_t n, fmi3##TYPE v[], size_t m)       \
    NONE(Set##TYPE, const fmi3ValueReference r[], size_t n, const fmi3##TYPE v[], size_t m)
#define REFERENCES const fmi3ValueReference r[], size_t n

NO_TYPE(Float32) NO_TYPE(Int8) NO_TYPE(UInt8) NO_TYPE(Int16) NO_TYPE(UInt16) NO_TYPE(Int32) NO_TYPE(UInt32)
NO_TYPE(UInt64) NO_TYPE(Boolean) NO_TYPE(String)
NONE(GetBinary, REFERENCES, size_t sizes[], fmi3Binary v[], size_t m)
NONE(SetBinary, REFERENCES, const size_t sizes[], const fmi3Binary v[], size_t m)
NONE(GetClock, REFERENCES, fmi3Clock v[])
NONE(SetClock, REFERENCES, const fmi3Clock v[])
NONE(GetNumberOfVariableDependencies, fmi3ValueReference r, size_t *n)
NONE(GetVariableDependencies, fmi3ValueReference r, size_t e[], fmi3ValueReference s[], size_t f[],
     fmi3DependencyKind k[], size_t n)
NONE(GetDirectionalDerivative, REFERENCES, const fmi3ValueReference k[], size_t l, const fmi3Float64 s[], size_t m,
     fmi3Float64 v[], size_t o)
NONE(GetAdjointDerivative, REFERENCES, const fmi3ValueReference k[], size_t l, const fmi3Float64 s[], size_t m,
     fmi3Float64 v[], size_t o)
NONE(GetOutputDerivatives, REFERENCES, const fmi3Int32 o[], fmi3Float64 v[], size_t m)
NONE(GetIntervalDecimal, REFERENCES, fmi3Float64 v[], fmi3IntervalQualifier q[])
NONE(GetIntervalFraction, REFERENCES, fmi3UInt64 c[], fmi3UInt64 o[], fmi3IntervalQualifier q[])
NONE(GetShiftDecimal, REFERENCES, fmi3Float64 v[])
NONE(GetShiftFraction, REFERENCES, fmi3UInt64 c[], fmi3UInt64 o[])
NONE(SetIntervalDecimal, REFERENCES, const fmi3Float64 v[])
NONE(SetIntervalFraction, REFERENCES, const fmi3UInt64 c[], const fmi3UInt64 o[])
NONE(SetShiftDecimal, REFERENCES, const fmi3Float64 v[])
NONE(SetShiftFraction, REFERENCES, const fmi3UInt64 c[], const fmi3UInt64 o[])
NONE(UpdateDiscreteStates, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *c, fmi3Boolean *d, fmi3Boolean *e,
     fmi3Float64 *t)
NONE(ActivateModelPartition, fmi3ValueReference r, fmi3Float64 t)
NONE(CompletedIntegratorStep, fmi3Boolean k, fmi3Boolean *e, fmi3Boolean *t)
NONE(SetTime, fmi3Float64 t)
NONE(SetContinuousStates, const fmi3Float64 v[], size_t n)
NONE(GetContinuousStateDerivatives, fmi3Float64 v[], size_t n)
NONE(GetEventIndicators, fmi3Float64 v[], size_t n)
NONE(GetContinuousStates, fmi3Float64 v[], size_t n)
NONE(GetNominalsOfContinuousStates, fmi3Float64 v[], size_t n)
NONE(GetNumberOfEventIndicators, size_t *n)
NONE(GetNumberOfContinuousStates, size_t *n)
LACKS(EnterContinuousTimeMode, fmi3Instance i)
LACKS(EnterEventMode, fmi3Instance i)
LACKS(EnterConfigurationMode, fmi3Instance i)
LACKS(ExitConfigurationMode, fmi3Instance i)
LACKS(EvaluateDiscreteStates, fmi3Instance i)

fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) { return NULL; }

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) { return NULL; }

/* A tank as other tools would export it, without our wrapper: dh/dt = mode * inflow - h while the
 * pump is on, a state event when h passes 2 (alarm), a time event every 5 s (batch), which is counted on from the
 * bytes of a label. */
#ifndef MINI_H
#define MINI_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { INFLOW, H, DER_H, PUMP_ON, MODE, ALARM, BATCH, FAULT, VARIABLES };

typedef struct {
    double v[VARIABLES];
    double time, next_event;
    double last_step; /* the step that is discarded must be shorter than this */
} mini;

static mini *mini_new(void) {
    mini *m = (mini *)calloc(1, sizeof *m);
    m->v[PUMP_ON] = m->v[MODE] = 1.0;
    return m;
}

static double mini_derivative(const mini *m) {
    return (m->v[PUMP_ON] > 0.0 ? m->v[MODE] * m->v[INFLOW] : 0.0) - m->v[H];
}

static double mini_indicator(const mini *m) { return m->v[H] - 2.0; }

static void mini_events(mini *m) {
    m->v[ALARM] = m->v[H] >= 2.0 - 1e-9;
    while (m->time >= m->next_event - 1e-9) {
        m->v[BATCH] += 1.0;
        m->next_event += 5.0;
    }
}

static void mini_begin(mini *m, double time) {
    m->time = time;
    m->next_event = time + 5.0;
    mini_events(m);
}

static double mini_get(mini *m, unsigned i) {
    m->v[DER_H] = mini_derivative(m);
    return m->v[i];
}

/* Explicit steps of 1 ms: what is inside of many co-simulation FMUs. */
static void mini_step(mini *m, double size) {
    const int n = (int)floor(size / 1e-3 + 0.5);
    for (int i = 0; i < n; ++i) {
        m->v[H] += 1e-3 * mini_derivative(m);
        m->time += 1e-3;
        mini_events(m);
    }
}

#endif

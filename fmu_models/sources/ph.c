/* pH loop: a neutralisation tank, whose gain changes manyfold with the operating point.
 *
 * Acid (HNO3), buffer (NaHCO3) and base (NaOH with a trace of NaHCO3) meet in a stirred tank of
 * constant volume; the valve doses the base. Two reaction invariants a stream, their balances and
 * the equilibrium that gives pH: Henson, Seborg: Adaptive nonlinear control of a pH neutralization
 * process. IEEE Trans. Control Systems Technology 2 (1994) 169-182, with its parameters (tank of
 * 207 cm2 and 14 cm, pK 6.35 and 10.25) and its nominal flows of 16.6, 0.55 and 15.55 ml/s, at which
 * pH is 7.0; the level, a second loop there, is held. The electrode is a first-order lag.
 *
 * The invariants are integrated exactly for flows that are held. */
#define MODEL_IDENTIFIER ph
#define BASE_STEP 0.5
#define DEFAULT_STEP 5.0
#define PV_UNIT "1"
#define PI_SP 7.0
#define PI_GAIN 2.0
#define PI_TIME 90.0

#include "controller.h"
#include "valve.h"

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output, limited to 0 ... 100")            \
    X(load, input, Real, 0.0, -100.0, ANY, "%", "change of the buffer flow, of its nominal")       \
    X(pv, output, Real, 0.0, -ANY, ANY, "1", "measured pH")                                        \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 1, 0, 3, "", "valve: 0 healthy, 1 He, 2 Kano, 3 Choudhury")         \
    X(stick_band, tunable, Real, 3.0, 0.0, ANY, "%", "stick band S = fS + fD")                     \
    X(slip_jump, tunable, Real, 1.0, 0.0, ANY, "%", "slip jump J = fS - fD")                       \
    X(noise_std, tunable, Real, 0.02, 0.0, ANY, "1", "standard deviation of the noise on PV")      \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    X(acid, tunable, Real, 16.6, 0.1, ANY, "ml/s", "flow of acid, 0.003 mol/l HNO3")               \
    X(buffer, tunable, Real, 0.55, 0.0, ANY, "ml/s", "flow of buffer, 0.03 mol/l NaHCO3")          \
    X(base_max, tunable, Real, 31.1, 0.0, ANY, "ml/s", "flow of base, 0.003 mol/l, valve open")    \
    X(volume, tunable, Real, 2898.0, 1.0, ANY, "ml", "of the tank")                                \
    X(electrode, tunable, Real, 5.0, 0.01, ANY, "s", "time constant of the electrode")             \
    CONTROLLER_VARIABLES(X)

typedef struct {
    valve_state valve;
    pi_state controller;
    double wa, wb; /* reaction invariants in the tank in mol/l: charge, carbonate */
    double ph;     /* in the tank */
    double shown;  /* by the electrode, without noise */
} plant_memory;

#include "plant.h"
#include "sticky_valve.h"

/* Charge balance in mol/l at a pH: grows steadily with pH. */
static double imbalance(const plant *p, double ph) {
    const double first = pow(10.0, 6.35 - ph), second = pow(10.0, ph - 10.25);
    return p->memory.wa + pow(10.0, ph - 14.0) - pow(10.0, -ph) +
           p->memory.wb * (1.0 + 2.0 * second) / (1.0 + first + second);
}

/* The secant between a pH that is too low and one that is too high, halved where it is slow. */
static double equilibrium(const plant *p) {
    double low = -2.0, high = 16.0, ph = p->memory.ph;
    double last = ph + 1e-3, at_last = imbalance(p, last);
    for (int i = 0; i < 100 && high - low > 1e-12; ++i) {
        const double at = imbalance(p, ph);
        const double slope = (at - at_last) / (ph - last);
        double next;
        if (at == 0.0)
            break;
        if (at > 0.0)
            high = ph;
        else
            low = ph;
        next = ph - at / slope;
        if (!(next > low && next < high))
            next = 0.5 * (low + high);
        last = ph;
        at_last = at;
        if (fabs(next - ph) < 1e-12)
            break;
        ph = next;
    }
    return ph;
}

typedef struct {
    double flow, wa, wb; /* through the tank, and what the tank tends to */
} streams;

static streams mixed(const plant *p) {
    const double base = 0.01 * p->v.stem * p->v.base_max;
    const double buffer = p->v.buffer * (1.0 + 0.01 * p->v.load);
    streams s;
    s.flow = p->v.acid + buffer + base;
    s.wa = (3e-3 * p->v.acid - 0.03 * buffer - 3.05e-3 * base) / s.flow;
    s.wb = (0.03 * buffer + 5e-5 * base) / s.flow;
    return s;
}

static void measure(plant *p) { p->v.pv = p->memory.shown + p->v.noise_std * noise_normal(&p->noise); }

static const char *plant_initialise(plant *p) {
    streams s;
    noise_start(&p->noise, p->v.seed);
    stem_rest(p);
    s = mixed(p);
    p->memory.wa = s.wa;
    p->memory.wb = s.wb;
    p->memory.ph = 7.0;
    p->memory.ph = p->memory.shown = equilibrium(p);
    measure(p);
    return valve_check(p->v.stick_band, p->v.slip_jump);
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = valve_check(p->v.stick_band, p->v.slip_jump);
    double stay, follow;
    streams s;
    if (complaint)
        return complaint;
    stem_move(p, count);
    s = mixed(p);
    stay = exp(-BASE_STEP * s.flow / p->v.volume);
    follow = 1.0 - exp(-BASE_STEP / p->v.electrode);
    for (int64_t i = 0; i < count; ++i) {
        const double before = p->memory.ph;
        p->memory.wa = s.wa + (p->memory.wa - s.wa) * stay;
        p->memory.wb = s.wb + (p->memory.wb - s.wb) * stay;
        p->memory.ph = equilibrium(p);
        /* The electrode follows the mean of the step's two ends. */
        p->memory.shown += (0.5 * (before + p->memory.ph) - p->memory.shown) * follow;
    }
    measure(p);
    return 0;
}

#include "fmi.h"

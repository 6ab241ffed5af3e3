/* A valve from first principles: pneumatic spring-and-diaphragm actuator, stem and packing, with
 * Karnopp's or the LuGre friction model, before a first-order process.
 *
 * m dv/dt = k travel (u/100) - k x - friction(v), u = the actuator's pressure in percent of span,
 * behind a first-order lag of positioner and tubing. Mass, spring, viscous friction and Stribeck
 * velocity are those of Kayihan and Doyle, Friction compensation for a process control valve,
 * Control Engineering Practice 8 (2000) 799-812, which Choudhury, Thornhill and Shah (2005) use
 * too: 3 lb, 300 lbf/in, 3.5 lbf s/in, 0.01 in/s, a span of 1200 lbf and so 4 in of travel.
 * Static and Coulomb friction follow from the stick band and the slip jump in percent of that span
 * force. With a step of pressure the stem of this overdamped actuator comes to rest where He's
 * model puts it; with a lag of pressure it may slip early, stick again, and rest up to J short.
 *
 * Integrated on a grid of 0.1 ms, implicit in velocity. Where the grid's steps are known in advance
 * they are taken together: a stem that sticks waits for the pressure, whose exponential is known,
 * and with Coulomb friction alone, away from Stribeck's velocity, the steps are one linear map. So
 * the stem is that of every step of the grid, but for rounding; a test keeps that. */
#define MODEL_IDENTIFIER physical
#define BASE_STEP 0.0001
#define DEFAULT_STEP 1.0
#define PV_UNIT "1"
#define PI_SP 50.0
#define PI_GAIN 1.0
#define PI_TIME 5.0

#include <math.h>
#include <stdint.h>

#include "controller.h"

enum { VALVE_FRICTIONLESS = 0, VALVE_KARNOPP = 4, VALVE_LUGRE = 5 };

#define VARIABLES(X)                                                                               \
    X(op, input, Real, 50.0, -ANY, ANY, "%", "controller output, limited to 0 ... 100")            \
    X(load, input, Real, 0.0, -ANY, ANY, "%", "load disturbance, added to the stem position")      \
    X(pv, output, Real, 0.0, -ANY, ANY, "1", "measured process variable")                          \
    X(stem, output, Real, 0.0, -ANY, ANY, "%", "stem position, for judging only")                  \
    X(valve, tunable, Integer, 4, 0, 5, "", "valve: 0 healthy, 4 Karnopp, 5 LuGre")                \
    X(stick_band, tunable, Real, 8.0, 0.0, ANY, "%", "stick band, (Fs + Fc) of the span force")    \
    X(slip_jump, tunable, Real, 2.0, 0.0, ANY, "%", "slip jump, (Fs - Fc) of the span force")      \
    X(noise_std, tunable, Real, 0.05, 0.0, ANY, "1", "standard deviation of the noise on PV")      \
    X(op_start, fixed, Real, 50.0, -ANY, ANY, "%", "OP at which the plant rests at the start")     \
    X(seed, fixed, Integer, 1, 0, 2147483647, "", "seed of the noise")                             \
    X(time_constant, tunable, Real, 5.0, 0.01, ANY, "s", "of the process, PV from stem; gain 1")   \
    X(actuator_lag, tunable, Real, 0.2, 0.001, ANY, "s", "of the actuator's pressure")             \
    X(mass, tunable, Real, 1.361, 0.01, ANY, "kg", "of the moving parts")                          \
    X(spring, tunable, Real, 52538.0, 1.0, ANY, "N/m", "stiffness of the spring")                  \
    X(travel, tunable, Real, 0.1016, 0.001, ANY, "m", "of the stem")                               \
    X(viscous, tunable, Real, 612.9, 0.0, ANY, "N.s/m", "viscous friction")                        \
    X(stribeck, tunable, Real, 0.000254, 0.000001, ANY, "m/s", "Stribeck velocity")                \
    X(bristle, tunable, Real, 10000000.0, 1000.0, 50000000.0, "N/m", "of LuGre bristles")          \
    CONTROLLER_VARIABLES(X)

typedef struct {
    pi_state controller;
    double pressure; /* percent of span */
    double x, v;     /* m, m/s */
    double z;        /* deflection of LuGre's bristles in m */
    double y;        /* process */
} plant_memory;

#include "plant.h"

typedef struct {
    double span, static_force, coulomb; /* N */
} forces;

static const char *check(const plant *p) {
    const int kind = (int)p->v.valve;
    if (kind != VALVE_FRICTIONLESS && kind != VALVE_KARNOPP && kind != VALVE_LUGRE)
        return "valve must be 0 (healthy), 4 (Karnopp) or 5 (LuGre) in this model";
    return p->v.slip_jump <= p->v.stick_band ? 0 : "slip_jump must not exceed stick_band";
}

static forces present_forces(const plant *p) {
    forces f;
    f.span = p->v.spring * p->v.travel;
    f.static_force = 0.005 * (p->v.stick_band + p->v.slip_jump) * f.span;
    f.coulomb = 0.005 * (p->v.stick_band - p->v.slip_jump) * f.span;
    if ((int)p->v.valve == VALVE_FRICTIONLESS)
        f.static_force = f.coulomb = 0.0;
    return f;
}

/* Sliding friction without its viscous part: from static to Coulomb as the velocity grows. */
static double sliding(const plant *p, const forces *f, double v) {
    const double r = v / p->v.stribeck;
    return f->coulomb + (f->static_force - f->coulomb) * exp(-r * r);
}

/* Karnopp: Computer simulation of stick-slip friction in mechanical dynamic systems. J. Dynamic
 * Systems, Measurement, and Control 107 (1985) 100-103. Within a small velocity the stem sticks,
 * and friction balances the driving force up to the static one. Returns the velocity after h. */
static double karnopp(const plant *p, const forces *f, double drive, double h) {
    const double slow = 0.1 * p->v.stribeck;
    double v = p->memory.v, direction;
    if (fabs(v) < slow && fabs(drive) <= f->static_force)
        return 0.0;
    direction = fabs(v) < slow ? (drive > 0.0 ? 1.0 : -1.0) : (v > 0.0 ? 1.0 : -1.0);
    v = (p->v.mass * v + h * (drive - direction * sliding(p, f, v))) /
        (p->v.mass + h * (p->v.viscous + h * p->v.spring));
    /* Friction never drives: what would turn round comes to rest first. */
    return f->static_force > 0.0 && v * direction < 0.0 ? 0.0 : v;
}

/* Canudas de Wit, Olsson, Astrom, Lischinsky: A new model for control of systems with friction.
 * IEEE Trans. Automatic Control 40 (1995) 419-425, equations (1)-(3); bristles critically damped,
 * bristle deflection and velocity implicit. */
static void advance_lugre(plant *p, const forces *f, double drive) {
    const double stiffness = p->v.bristle, h = BASE_STEP;
    const double damping = 2.0 * sqrt(stiffness * p->v.mass);
    const double limit = fmax(sliding(p, f, p->memory.v), 1.0); /* N: g(v) must not vanish */
    const double slip = stiffness * fabs(p->memory.v) * p->memory.z / limit;
    const double v = (p->v.mass * p->memory.v +
                      h * (drive - stiffness * p->memory.z + (damping + h * stiffness) * slip)) /
                     (p->v.mass + h * (damping + p->v.viscous + h * stiffness));
    p->memory.z = (p->memory.z + h * v) / (1.0 + h * stiffness * fabs(v) / limit);
    p->memory.v = v;
}

/* Steps of the grid, at most ``most``, in which Karnopp's stem stays where it is. */
static int64_t resting_steps(const plant *p, const forces *f, double op, int64_t most) {
    const double scale = 0.01 * f->span, held = p->v.spring * p->memory.x;
    const double rest = p->memory.pressure - op, decay = -BASE_STEP / p->v.actuator_lag;
    const double first = scale * (op + rest * exp(decay)) - held;
    const double last = scale * (op + rest * exp(decay * (double)most)) - held;
    double border, steps;
    if (fabs(p->memory.v) >= 0.1 * p->v.stribeck)
        return 0;
    if (p->memory.v == 0.0 && ((p->memory.x <= 0.0 && first < 0.0 && last < 0.0) ||
                               (p->memory.x >= p->v.travel && first > 0.0 && last > 0.0)))
        return most; /* pressed against an end stop */
    if (fabs(first) > f->static_force)
        return 0;
    if (fabs(last) <= f->static_force)
        return most;
    border = ((last > 0.0 ? f->static_force : -f->static_force) + held) / scale;
    steps = log((border - op) / rest) / decay;
    return steps > 1.0 ? (int64_t)steps : 1;
}

static void measure(plant *p) {
    p->v.stem = 100.0 * p->memory.x / p->v.travel;
    p->v.pv = p->memory.y + p->v.noise_std * noise_normal(&p->noise);
}

static const char *plant_initialise(plant *p) {
    noise_start(&p->noise, p->v.seed);
    pi_rest(&p->memory.controller, p->v.op);
    p->memory.pressure = p->v.op_out = plant_clamp(p->v.op, 0.0, 100.0);
    p->memory.x = 0.01 * p->memory.pressure * p->v.travel;
    p->memory.v = p->memory.z = 0.0;
    p->memory.y = p->memory.pressure + p->v.load;
    measure(p);
    return check(p);
}

/* What the lags of pressure and process let through in a time. */
typedef struct {
    double fill, follow;
} lags;

static lags present_lags(const plant *p, double h) {
    lags l;
    l.fill = 1.0 - exp(-h / p->v.actuator_lag);
    l.follow = 1.0 - exp(-h / p->v.time_constant);
    return l;
}

static double driving_force(const plant *p, const forces *f) {
    return 0.01 * f->span * p->memory.pressure - p->v.spring * p->memory.x;
}

static void move_one_step(plant *p, const forces *f, const lags *l, double op) {
    p->memory.pressure += l->fill * (op - p->memory.pressure);
    if ((int)p->v.valve == VALVE_LUGRE)
        advance_lugre(p, f, driving_force(p, f));
    else
        p->memory.v = karnopp(p, f, driving_force(p, f), BASE_STEP);
    p->memory.x += BASE_STEP * p->memory.v;
    if (p->memory.x < 0.0 || p->memory.x > p->v.travel) {
        p->memory.x = plant_clamp(p->memory.x, 0.0, p->v.travel);
        p->memory.v = 0.0;
    }
    p->memory.y += l->follow * (100.0 * p->memory.x / p->v.travel + p->v.load - p->memory.y);
}

/* A sliding stem: pressure less OP, velocity, position, process. */
typedef struct {
    double q, v, x, y;
} motion;

/* Where JUMP steps of the grid bring a unit of each: of the four, of a constant force, of the load.
 * Ten steps are 1 ms, a twelfth of the actuator's own lag viscous/spring: few are taken in vain. */
#define JUMP 10
typedef struct {
    int known;
    motion of_q, of_v, of_x, of_y, of_force, of_load;
} jumps;

static motion slide(const plant *p, const lags *l, motion m, double force, double load) {
    const double h = BASE_STEP;
    for (int k = 0; k < JUMP; ++k) {
        m.q -= l->fill * m.q;
        m.v = (p->v.mass * m.v +
               h * (0.01 * p->v.spring * p->v.travel * m.q - p->v.spring * m.x + force)) /
              (p->v.mass + h * (p->v.viscous + h * p->v.spring));
        m.x += h * m.v;
        m.y += l->follow * (100.0 * m.x / p->v.travel + load - m.y);
    }
    return m;
}

static void find_jumps(const plant *p, const lags *l, jumps *j) {
    j->of_q = slide(p, l, (motion){1.0, 0.0, 0.0, 0.0}, 0.0, 0.0);
    j->of_v = slide(p, l, (motion){0.0, 1.0, 0.0, 0.0}, 0.0, 0.0);
    j->of_x = slide(p, l, (motion){0.0, 0.0, 1.0, 0.0}, 0.0, 0.0);
    j->of_y = slide(p, l, (motion){0.0, 0.0, 0.0, 1.0}, 0.0, 0.0);
    j->of_force = slide(p, l, (motion){0.0, 0.0, 0.0, 0.0}, 1.0, 0.0);
    j->of_load = slide(p, l, (motion){0.0, 0.0, 0.0, 0.0}, 0.0, 1.0);
    j->known = 1;
}

/* Friction is Coulomb's to the last bit from 6.1 times Stribeck's velocity on, where
 * exp(-r * r) < 1e-16; the rest is room for what happens between the two ends of a jump. */
#define FAST 8.0
/* The velocity may change by this part of it in a jump: so it stays fast between the two ends. */
#define STEADY 0.2

/* Take JUMP steps of the grid at once and return 1 where friction is Coulomb's in all of them. */
static int jump(plant *p, const forces *f, const lags *l, jumps *j, double op) {
    const double v = p->memory.v, x = p->memory.x, y = p->memory.y, q = p->memory.pressure - op;
    const double fast = f->static_force > 0.0 ? FAST * p->v.stribeck : -1.0;
    double force, after_v, after_x;
    if (fabs(v) <= fast)
        return 0;
    if (!j->known)
        find_jumps(p, l, j);
    force = 0.01 * f->span * op - (v > 0.0 ? f->coulomb : -f->coulomb);
    after_v = j->of_q.v * q + j->of_v.v * v + j->of_x.v * x + j->of_force.v * force;
    after_x = j->of_q.x * q + j->of_v.x * v + j->of_x.x * x + j->of_force.x * force;
    if (fabs(after_v) <= fast || fabs(after_v - v) > STEADY * fabs(v) + 0.01 * p->v.stribeck ||
        after_x < 0.0 || after_x > p->v.travel)
        return 0;
    p->memory.pressure = op + j->of_q.q * q;
    p->memory.v = after_v;
    p->memory.x = after_x;
    p->memory.y = j->of_q.y * q + j->of_v.y * v + j->of_x.y * x + j->of_y.y * y +
                  j->of_force.y * force + j->of_load.y * p->v.load;
    return 1;
}

static void rest(plant *p, double op, int64_t n) {
    const lags l = present_lags(p, BASE_STEP * (double)n);
    p->memory.v = 0.0;
    p->memory.pressure += l.fill * (op - p->memory.pressure);
    p->memory.y += l.follow * (100.0 * p->memory.x / p->v.travel + p->v.load - p->memory.y);
}

static const char *plant_advance(plant *p, int64_t count) {
    const char *complaint = check(p);
    const forces f = present_forces(p);
    const lags one = present_lags(p, BASE_STEP);
    const int skips = (int)p->v.valve != VALVE_LUGRE; /* LuGre's bristles never rest */
    jumps found;
    double op;
    if (complaint)
        return complaint;
    found.known = 0;
    op = p->v.op_out = plant_clamp(controlled_op(p, count), 0.0, 100.0);
    for (int64_t left = count; left > 0;) {
        int64_t n = skips ? resting_steps(p, &f, op, left) : 0;
        if (n > 0)
            rest(p, op, n);
        else if (skips && left >= JUMP && jump(p, &f, &one, &found, op))
            n = JUMP;
        else
            move_one_step(p, &f, &one, op), n = 1;
        left -= n;
    }
    measure(p);
    return 0;
}

#include "fmi.h"

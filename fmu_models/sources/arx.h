/* A third-order process in ARX form, equation (7) of Bacci di Capaci et al. (2018):
 * y_k = -a1 y_(k-1) - a2 y_(k-2) - a3 y_(k-3) + b1 x_(k-1) + b2 x_(k-2) + b3 x_(k-3) + v_k. */
#ifndef ARX_H
#define ARX_H

typedef struct {
    double y[3]; /* y_k, y_(k-1), y_(k-2) */
    double x[2]; /* x_(k-1), x_(k-2) */
} arx_state;

static inline void arx_rest(arx_state *s, double y, double x) {
    s->y[0] = s->y[1] = s->y[2] = y;
    s->x[0] = s->x[1] = x;
}

/* Take x_k and v_(k+1); return y_(k+1). */
static inline double arx_step(arx_state *s, const double a[3], const double b[3], double x,
                              double v) {
    const double y = -a[0] * s->y[0] - a[1] * s->y[1] - a[2] * s->y[2] + b[0] * x + b[1] * s->x[0] +
                     b[2] * s->x[1] + v;
    s->y[2] = s->y[1];
    s->y[1] = s->y[0];
    s->y[0] = y;
    s->x[1] = s->x[0];
    s->x[0] = x;
    return y;
}

#endif

/* White Gaussian noise from a seed: the same numbers on every machine with the same log and sqrt.
 *
 * Generator: SplitMix64 (Steele, Lea, Flood: Fast splittable pseudorandom number generators,
 * OOPSLA 2014). Normal numbers: Marsaglia's polar method (SIAM Review 6, 1964, 260-264).
 * The state holds no pointer, so a snapshot is a copy of bytes.
 */
#ifndef NOISE_H
#define NOISE_H

#include <math.h>
#include <stdint.h>

typedef struct {
    uint64_t counter;
    double spare;
    int32_t has_spare;
    int32_t unused; /* keeps the size the same on every platform */
} noise_source;

/* Start the sequence of `seed`. */
static inline void noise_start(noise_source *noise, double seed) {
    noise->counter = (uint64_t)(int64_t)seed * UINT64_C(0xD1342543DE82EF95);
    noise->spare = 0.0;
    noise->has_spare = 0;
    noise->unused = 0;
}

static inline double noise_uniform(noise_source *noise) {
    uint64_t z = (noise->counter += UINT64_C(0x9E3779B97F4A7C15));
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    z ^= z >> 31;
    return (double)(z >> 11) * (1.0 / 9007199254740992.0);
}

/* Return the next number of mean 0 and standard deviation 1. */
static inline double noise_normal(noise_source *noise) {
    double a, b, square;
    if (noise->has_spare) {
        noise->has_spare = 0;
        return noise->spare;
    }
    do {
        a = 2.0 * noise_uniform(noise) - 1.0;
        b = 2.0 * noise_uniform(noise) - 1.0;
        square = a * a + b * b;
    } while (square >= 1.0 || square == 0.0);
    square = sqrt(-2.0 * log(square) / square);
    noise->spare = b * square;
    noise->has_spare = 1;
    return a * square;
}

#endif

/* Elementary functions without a branch or a call, so that compilers make vector code of loops that use them. Errors: some units in
 * the last place, of x^y as many times |y log x| more. What lies outside their range gives NaN: a lane leaves such a row to core.c,
 * which asks the mathematical library then. Both get the same bits elsewhere.
 *
 * No && of comparisons: choices one behind the other are what compilers make vectors of.
 *
 * Arguments are reduced as Cody and Waite do (constants in parts whose products are exact); polynomials are Taylor's, long enough.
 */
#ifndef ELEMENTARY_H
#define ELEMENTARY_H

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#define ELEMENTARY static inline __attribute__((always_inline))
#define ROUNDER 0x1.8p52 /* a small number plus this has its nearest integer in the lowest bits */
#define LN2_HIGH 0x1.62e42feep-1
#define LN2_LOW 0x1.a39ef35793c76p-33
#define QUARTER_HIGH 0x1.921fb544p+0 /* pi/2 */
#define QUARTER_MIDDLE 0x1.0b4611a6p-34
#define QUARTER_LOW 0x1.3198a2e037073p-69
#define LEAST_EXPONENT (-708.0) /* of e; below it exp is 0 */
#define MOST_EXPONENT 709.0
#define MOST_ANGLE 1e6 /* rad */

ELEMENTARY uint64_t bits_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

ELEMENTARY double of_bits(uint64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* a + b x + c x^2 ... in pairs (Estrin): few steps wait for others. */
ELEMENTARY double polynomial(double x, double a, double b, double c, double d, double e, double f, double g, double h, double i, double j,
                             double k, double l) {
    const double x2 = x * x, x4 = x2 * x2;
    const double first = (a + b * x) + (c + d * x) * x2, second = (e + f * x) + (g + h * x) * x2;
    const double third = (i + j * x) + (k + l * x) * x2;
    return (first + second * x4) + third * (x4 * x4);
}

/* exp(x) = scale * (1 + rest), rest within a factor sqrt(2); x from LEAST_EXPONENT to MOST_EXPONENT. */
ELEMENTARY double exponential_parts(double x, double *scale) {
    const double rounded = x * 0x1.71547652b82fep0 + ROUNDER, n = rounded - ROUNDER;
    const double r = (x - n * LN2_HIGH) - n * LN2_LOW;
    const double sum = polynomial(r, 0.5, 1 / 6.0, 1 / 24.0, 1 / 120.0, 1 / 720.0, 1 / 5040.0, 1 / 40320.0, 1 / 362880.0, 1 / 3628800.0,
                                  1 / 39916800.0, 1 / 479001600.0, 1 / 6227020800.0);
    *scale = of_bits((bits_of(rounded) << 52) + bits_of(1.0));
    return r + r * r * sum;
}

ELEMENTARY double vector_exp(double x) {
    const double low = x > LEAST_EXPONENT ? x : LEAST_EXPONENT; /* of a NaN, too */
    double scale;
    const double rest = exponential_parts(low < MOST_EXPONENT ? low : MOST_EXPONENT, &scale);
    const double value = x < LEAST_EXPONENT ? 0 : scale + scale * rest;
    return x <= MOST_EXPONENT ? value : NAN;
}

ELEMENTARY double vector_log(double x) {
    const uint64_t bits = bits_of(x), half = bits_of(0x1.6a09e667f3bcdp-1), offset = (uint64_t)1024 << 52;
    const uint64_t raised = (bits - half + offset) >> 52; /* the exponent and 1024 */
    const double m = of_bits(bits - (raised << 52) + offset), n = of_bits(bits_of(0x1p52) + raised) - (0x1p52 + 1024);
    const double s = (m - 1) / (m + 1), square = s * s;
    const double sum = polynomial(square, 1 / 3.0, 1 / 5.0, 1 / 7.0, 1 / 9.0, 1 / 11.0, 1 / 13.0, 1 / 15.0, 1 / 17.0, 1 / 19.0, 1 / 21.0,
                                  1 / 23.0, 0);
    const double value = n * LN2_HIGH + (2 * s + (2 * s * square * sum + n * LN2_LOW));
    const double bounded = x <= DBL_MAX ? value : NAN;
    return x >= DBL_MIN ? bounded : NAN;
}

/* x^y; of a negative x with an integer y. */
ELEMENTARY double vector_pow(double x, double y) {
    const double size = vector_exp(y * vector_log(fabs(x))), half = 0.5 * y;
    const double whole = (y + ROUNDER) - ROUNDER, even = (half + ROUNDER) - ROUNDER;
    const double turned = half == even ? size : -size;
    const double of_whole = whole == y ? turned : NAN, of_negative = fabs(y) < 0x1p50 ? of_whole : NAN;
    const double of_zero = y > 0 ? 0 : of_negative, other = x == 0 ? of_zero : of_negative;
    return x > 0 ? size : other;
}

/* sin(x + turns pi/2) */
ELEMENTARY double turned_sine(double x, uint64_t turns) {
    const double rounded = x * 0x1.45f306dc9c883p-1 + ROUNDER, n = rounded - ROUNDER;
    const uint64_t quarter = bits_of(rounded) + turns;
    const double r = ((x - n * QUARTER_HIGH) - n * QUARTER_MIDDLE) - n * QUARTER_LOW, square = r * r;
    const double odd = polynomial(square, -1 / 6.0, 1 / 120.0, -1 / 5040.0, 1 / 362880.0, -1 / 39916800.0, 1 / 6227020800.0,
                                  -1 / 1307674368000.0, 1 / 355687428096000.0, 0, 0, 0, 0);
    const double even = polynomial(square, 1 / 24.0, -1 / 720.0, 1 / 40320.0, -1 / 3628800.0, 1 / 479001600.0, -1 / 87178291200.0,
                                   1 / 20922789888000.0, 0, 0, 0, 0, 0);
    const double sine = r + r * square * odd, cosine = 1 - (0.5 * square - square * square * even);
    const double value = quarter & 1 ? cosine : sine;
    const double signed_value = quarter & 2 ? -value : value;
    return fabs(x) <= MOST_ANGLE ? signed_value : NAN;
}

ELEMENTARY double vector_sin(double x) { return turned_sine(x, 0); }
ELEMENTARY double vector_cos(double x) { return turned_sine(x, 1); }
ELEMENTARY double vector_tan(double x) { return turned_sine(x, 0) / turned_sine(x, 1); }

ELEMENTARY double vector_tanh(double x) {
    const double twice = 2 * fabs(x), far = 44; /* from there on 1 */
    double scale;
    const double rest = exponential_parts(twice < far ? twice : far, &scale), grown = scale * rest + (scale - 1);
    const double value = grown / (grown + 2);
    return x == x ? x < 0 ? -value : value : NAN;
}

/* The same for one instance. */
#define ASKING(name) \
    ELEMENTARY double scalar_##name(double x) { \
        const double y = vector_##name(x); \
        return y == y ? y : name(x); \
    }
ASKING(exp)
ASKING(log)
ASKING(sin)
ASKING(cos)
ASKING(tan)
ASKING(tanh)

ELEMENTARY double scalar_pow(double x, double y) {
    const double z = vector_pow(x, y);
    return z == z ? z : pow(x, y);
}

#endif

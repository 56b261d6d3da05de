// Vectors of half as many doubles as floats. Comparisons give Longs, with all bits of a lane set or none.
#pragma once

#include <cmath>

#include "simd.h"

namespace egosplat {

constexpr int DOUBLES = LANES / 2;
typedef double Doubles __attribute__((vector_size(DOUBLES * 8)));
typedef int64_t Longs __attribute__((vector_size(DOUBLES * 8)));

INLINE Doubles load(const double* p) {
    Doubles v;
    memcpy(&v, p, sizeof v);
    return v;
}

INLINE Doubles root(Doubles v) {
#if defined(__AVX512F__)
    return _mm512_sqrt_pd(v);
#elif defined(__AVX2__)
    return _mm256_sqrt_pd(v);
#else
    for (int i = 0; i < DOUBLES; i++) v[i] = std::sqrt(v[i]);
    return v;
#endif
}

INLINE Doubles dot(const Doubles* a, const Doubles* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
INLINE Longs finite(Doubles v) { return v - v == Doubles{}; }

}  // namespace egosplat

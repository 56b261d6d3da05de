// Vectors of LANES floats for AVX-512, AVX2 and, through the compiler's vector extension, any other processor.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#define INLINE static inline __attribute__((always_inline))

namespace egosplat {

#if defined(__AVX512F__)
constexpr int LANES = 16;
using Mask = __mmask16;
#elif defined(__AVX2__)
constexpr int LANES = 8;
#else
constexpr int LANES = 4;
#endif

typedef float Floats __attribute__((vector_size(LANES * 4)));
typedef int32_t Ints __attribute__((vector_size(LANES * 4)));
typedef uint32_t Bits __attribute__((vector_size(LANES * 4)));

#if !defined(__AVX512F__)
using Mask = Ints;  // all bits of a lane set, or none
#endif

INLINE Floats broadcast(float x) { return x - Floats{}; }

INLINE Floats load(const float* p) {
    Floats v;
    memcpy(&v, p, sizeof v);
    return v;
}

INLINE void store(float* p, Floats v) { memcpy(p, &v, sizeof v); }

// 0, 1, 2, ... LANES - 1
INLINE Floats ramp() {
    Floats v;
    for (int i = 0; i < LANES; i++) v[i] = float(i);
    return v;
}

INLINE Ints int_ramp() {
    Ints v;
    for (int i = 0; i < LANES; i++) v[i] = i;
    return v;
}

// 2^x in the lanes of `in`, 0 in the others, by a polynomial of degree 5 in the fraction of x; relative error below
// 2e-7 for -126 <= x < 127. Lanes of `in` outside this range are undefined.
#if defined(__AVX512F__)

INLINE Floats fma(Floats a, Floats b, Floats c) { return _mm512_fmadd_ps(a, b, c); }
INLINE Floats fnma(Floats a, Floats b, Floats c) { return _mm512_fnmadd_ps(a, b, c); }
INLINE Floats min(Floats a, Floats b) { return _mm512_min_ps(a, b); }
INLINE Floats max(Floats a, Floats b) { return _mm512_max_ps(a, b); }
INLINE Floats root(Floats a) { return _mm512_sqrt_ps(a); }
INLINE Mask at_least(Floats a, Floats b) { return _mm512_cmp_ps_mask(a, b, _CMP_GE_OQ); }
INLINE Mask at_least(Mask within, Floats a, Floats b) { return _mm512_mask_cmp_ps_mask(within, a, b, _CMP_GE_OQ); }
INLINE Mask above(Floats a, Floats b) { return _mm512_cmp_ps_mask(a, b, _CMP_GT_OQ); }
INLINE Mask differs(Floats a, Floats b) { return _mm512_cmp_ps_mask(a, b, _CMP_NEQ_UQ); }
INLINE Floats where(Mask m, Floats a, Floats b) { return _mm512_mask_mov_ps(b, m, a); }
INLINE Floats where(Mask m, Floats a) { return _mm512_maskz_mov_ps(m, a); }
INLINE bool any(Mask m) { return m != 0; }
INLINE uint32_t bits(Mask m) { return m; }
INLINE Mask minus(Mask a, Mask b) { return _kandn_mask16(b, a); }
INLINE Floats reciprocal(Floats x) {
    Floats r = _mm512_rcp14_ps(x);
    return r * fnma(x, r, broadcast(2.0f));
}
INLINE Floats exp2(Mask in, Floats x) {
    Floats f = _mm512_reduce_ps(x, _MM_FROUND_TO_NEG_INF);
    Floats p = broadcast(1.87757668e-3f);
    p = fma(p, f, broadcast(8.98934009e-3f));
    p = fma(p, f, broadcast(5.58263181e-2f));
    p = fma(p, f, broadcast(2.40153617e-1f));
    p = fma(p, f, broadcast(6.93153073e-1f));
    p = fma(p, f, broadcast(9.99999925e-1f));
    // Masked here, because Intel takes many cycles where a power of two underflows.
    return _mm512_maskz_scalef_ps(in, p, x);
}
// Moves the lanes of `v` in `m` to the front.
INLINE Floats compress(Mask m, Floats v) { return _mm512_maskz_compress_ps(m, v); }
// One step of the sum over lanes: interleaves a and b and adds pairs that are 1, 2, 4 or 8 lanes apart.
template <int LEVEL>
INLINE Floats fold(Floats a, Floats b) {
    if constexpr (LEVEL == 0) return Floats(_mm512_unpacklo_ps(a, b)) + Floats(_mm512_unpackhi_ps(a, b));
    if constexpr (LEVEL == 1)
        return Floats(_mm512_castpd_ps(_mm512_unpacklo_pd(_mm512_castps_pd(a), _mm512_castps_pd(b)))) +
               Floats(_mm512_castpd_ps(_mm512_unpackhi_pd(_mm512_castps_pd(a), _mm512_castps_pd(b))));
    return Floats(_mm512_shuffle_f32x4(a, b, 0x88)) + Floats(_mm512_shuffle_f32x4(a, b, 0xdd));
}
constexpr int LEVELS = 4;

#else

INLINE Floats fma(Floats a, Floats b, Floats c) {
#if defined(__AVX2__)
    return _mm256_fmadd_ps(a, b, c);
#else
    return a * b + c;
#endif
}
INLINE Floats fnma(Floats a, Floats b, Floats c) {
#if defined(__AVX2__)
    return _mm256_fnmadd_ps(a, b, c);
#else
    return c - a * b;
#endif
}
INLINE Floats root(Floats v) {
#if defined(__AVX2__)
    return _mm256_sqrt_ps(v);
#else
    for (int i = 0; i < LANES; i++) v[i] = std::sqrt(v[i]);
    return v;
#endif
}
INLINE Floats min(Floats a, Floats b) { return a < b ? a : b; }
INLINE Floats max(Floats a, Floats b) { return a > b ? a : b; }
INLINE Mask at_least(Floats a, Floats b) { return a >= b; }
INLINE Mask at_least(Mask within, Floats a, Floats b) { return within & (a >= b); }
INLINE Mask above(Floats a, Floats b) { return a > b; }
INLINE Mask differs(Floats a, Floats b) { return a != b; }
INLINE Floats where(Mask m, Floats a, Floats b) {
#if defined(__AVX2__)
    return _mm256_blendv_ps(b, a, (__m256)m);
#else
    return (Floats)(((Ints)a & m) | ((Ints)b & ~m));
#endif
}
INLINE Floats where(Mask m, Floats a) { return (Floats)((Ints)a & m); }
INLINE uint32_t bits(Mask m) {
#if defined(__AVX2__)
    return uint32_t(_mm256_movemask_ps((__m256)m));
#elif defined(__x86_64__)
    return uint32_t(_mm_movemask_ps((__m128)m));
#else
    uint32_t b = 0;
    for (int i = 0; i < LANES; i++) b |= uint32_t(m[i] & 1) << i;
    return b;
#endif
}
INLINE bool any(Mask m) { return bits(m) != 0; }
INLINE Mask minus(Mask a, Mask b) { return a & ~b; }
INLINE Floats reciprocal(Floats x) {
#if defined(__AVX2__)
    Floats r = _mm256_rcp_ps(x);
    return r * fnma(x, r, broadcast(2.0f));
#else
    return 1.0f / x;
#endif
}
INLINE Floats exp2(Mask in, Floats x) {
    // Adding 1.5 * 2^23 rounds to an integer, which is then in the lowest bits.
    const Floats shift = broadcast(12582912.0f);
    Floats t = x + shift;
    Floats f = x - (t - shift);
    Floats p = broadcast(1.32764720e-3f);
    p = fma(p, f, broadcast(9.67554133e-3f));
    p = fma(p, f, broadcast(5.55071327e-2f));
    p = fma(p, f, broadcast(2.40221197e-1f));
    p = fma(p, f, broadcast(6.93146967e-1f));
    p = fma(p, f, broadcast(1.0f));
    return where(in, (Floats)((Bits)p + ((Bits)t << 23)));
}
#if defined(__AVX2__)
struct Compression {
    alignas(32) int32_t order[256][8];
    Compression() {
        for (int m = 0; m < 256; m++) {
            int n = 0;
            for (int i = 0; i < 8; i++)
                if (m >> i & 1) order[m][n++] = i;
            while (n < 8) order[m][n++] = 0;
        }
    }
};
static const Compression COMPRESSION;
INLINE Floats compress(Mask m, Floats v) {
    return _mm256_permutevar8x32_ps(v, _mm256_load_si256((const __m256i*)COMPRESSION.order[bits(m)]));
}
#else
INLINE Floats compress(Mask m, Floats v) {
    Floats out = {};
    int n = 0;
    for (int i = 0; i < LANES; i++)
        if (m[i]) out[n++] = v[i];
    return out;
}
#endif
#if defined(__AVX2__)
template <int LEVEL>
INLINE Floats fold(Floats a, Floats b) {
    if constexpr (LEVEL == 0)
        return __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13) +
               __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
    if constexpr (LEVEL == 1)
        return __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13) +
               __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11) +
           __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15);
}
constexpr int LEVELS = 3;
#else
template <int LEVEL>
INLINE Floats fold(Floats a, Floats b) {
    if constexpr (LEVEL == 0)
        return __builtin_shufflevector(a, b, 0, 4, 1, 5) + __builtin_shufflevector(a, b, 2, 6, 3, 7);
    return __builtin_shufflevector(a, b, 0, 1, 4, 5) + __builtin_shufflevector(a, b, 2, 3, 6, 7);
}
constexpr int LEVELS = 2;
#endif

#endif

// Folds the first n of N vectors into ceil(n / 2), repeatedly: lane i of the result is the sum over lanes of v[i].
template <int N, int LEVEL = 0>
INLINE Floats sums_over_lanes(const Floats* v) {
    if constexpr (LEVEL == LEVELS) {
        return v[0];
    } else {
        constexpr int M = (N + 1) / 2;
        Floats half[M];
#pragma GCC unroll 16
        for (int i = 0; i < M; i++) half[i] = fold<LEVEL>(v[2 * i], v[2 * i + 1 < N ? 2 * i + 1 : 2 * i]);
        return sums_over_lanes<M, LEVEL + 1>(half);
    }
}

constexpr int padded(int n) { return (n + LANES - 1) / LANES * LANES; }

// out[i] += sum over lanes of v[i] for i < N. `out` holds padded(N) floats; those from N on are undefined afterwards.
template <int N>
INLINE void add_sums_over_lanes(const Floats* v, float* out) {
    constexpr int HEAD = N < LANES ? N : LANES;
    store(out, load(out) + sums_over_lanes<HEAD>(v));
    if constexpr (N > LANES) add_sums_over_lanes<N - LANES>(v + LANES, out + LANES);
}

}  // namespace egosplat

// Rearrangements of vectors: transposition, and one channel of interleaved pixels.
#pragma once

#include "simd.h"

namespace egosplat {

// The first four interleave each 16 bytes of a and b: lower or upper floats, lower or upper pairs of floats.
// The others select 16-byte blocks: the even or odd ones of a, then those of b.
#if defined(__AVX512F__)

INLINE Floats lower_floats(Floats a, Floats b) { return _mm512_unpacklo_ps(a, b); }
INLINE Floats upper_floats(Floats a, Floats b) { return _mm512_unpackhi_ps(a, b); }
INLINE Floats lower_pairs(Floats a, Floats b) { return (Floats)_mm512_unpacklo_pd((__m512d)a, (__m512d)b); }
INLINE Floats upper_pairs(Floats a, Floats b) { return (Floats)_mm512_unpackhi_pd((__m512d)a, (__m512d)b); }
INLINE Floats even_quads(Floats a, Floats b) { return _mm512_shuffle_f32x4(a, b, 0x88); }
INLINE Floats odd_quads(Floats a, Floats b) { return _mm512_shuffle_f32x4(a, b, 0xdd); }

#elif defined(__AVX2__)

INLINE Floats lower_floats(Floats a, Floats b) { return __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13); }
INLINE Floats upper_floats(Floats a, Floats b) { return __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15); }
INLINE Floats lower_pairs(Floats a, Floats b) { return __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13); }
INLINE Floats upper_pairs(Floats a, Floats b) { return __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15); }
INLINE Floats even_quads(Floats a, Floats b) { return __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11); }
INLINE Floats odd_quads(Floats a, Floats b) { return __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15); }

#else

INLINE Floats lower_floats(Floats a, Floats b) { return __builtin_shufflevector(a, b, 0, 4, 1, 5); }
INLINE Floats upper_floats(Floats a, Floats b) { return __builtin_shufflevector(a, b, 2, 6, 3, 7); }
INLINE Floats lower_pairs(Floats a, Floats b) { return __builtin_shufflevector(a, b, 0, 1, 4, 5); }
INLINE Floats upper_pairs(Floats a, Floats b) { return __builtin_shufflevector(a, b, 2, 3, 6, 7); }
INLINE Floats even_quads(Floats a, Floats) { return a; }
INLINE Floats odd_quads(Floats, Floats b) { return b; }

#endif

// Lane i of vector j becomes lane j of vector i.
INLINE void transpose(Floats (&v)[LANES]) {
    Floats quads[LANES];  // [4 j + k]: rows 4 j to 4 j + 3, columns k, k + 4, ...
#pragma GCC unroll 4
    for (int i = 0; i < LANES; i += 4) {
        const Floats lower01 = lower_floats(v[i], v[i + 1]), lower23 = lower_floats(v[i + 2], v[i + 3]);
        const Floats upper01 = upper_floats(v[i], v[i + 1]), upper23 = upper_floats(v[i + 2], v[i + 3]);
        quads[i] = lower_pairs(lower01, lower23), quads[i + 1] = upper_pairs(lower01, lower23);
        quads[i + 2] = lower_pairs(upper01, upper23), quads[i + 3] = upper_pairs(upper01, upper23);
    }
    if constexpr (LANES == 4) {
        for (int k = 0; k < 4; k++) v[k] = quads[k];
        return;
    }
#pragma GCC unroll 4
    for (int k = 0; k < 4; k++) {
        // Unused if LANES is 4, but must stay inside the array.
        const int next = LANES > 4 ? 4 : 0, last = LANES > 4 ? LANES - 8 : 0;
        const Floats even = even_quads(quads[k], quads[next + k]), odd = odd_quads(quads[k], quads[next + k]);
        if constexpr (LANES == 8) {
            v[k] = even, v[next + k] = odd;
        } else {
            const Floats even2 = even_quads(quads[last + k], quads[last + next + k]);
            const Floats odd2 = odd_quads(quads[last + k], quads[last + next + k]);
            v[k] = even_quads(even, even2), v[last + k] = odd_quads(even, even2);
            v[next + k] = even_quads(odd, odd2), v[last + next + k] = odd_quads(odd, odd2);
        }
    }
}

// Lane i of the result is lane order[i] of v.
INLINE Floats permute(Floats v, Ints order) {
#if defined(__AVX512F__)
    return _mm512_permutexvar_ps((__m512i)order, v);
#elif defined(__AVX2__)
    return _mm256_permutevar8x32_ps(v, (__m256i)order);
#else
    Floats out = {};
    for (int i = 0; i < LANES; i++) out[i] = v[order[i]];
    return out;
#endif
}

// Reads one of three interleaved channels: among three vectors, each lane holds the channel in exactly one.
class Deinterleave {
    Mask second, third;
    Ints order;

public:
    explicit Deinterleave(int channel) {
        Floats in_second = {}, in_third = {};
        for (int i = 0; i < LANES; i++) {
            const int at = 3 * i + channel, vector = at / LANES, lane = at % LANES;
            order[i] = lane;
            in_second[lane] = vector == 1, in_third[lane] = vector == 2;
        }
        second = above(in_second, Floats{}), third = above(in_third, Floats{});
    }
    inline Floats read(const float* pixels) const {
        const Floats lanes = where(second, load(pixels + LANES), load(pixels));
        return permute(where(third, load(pixels + 2 * LANES), lanes), order);
    }
};

}  // namespace egosplat

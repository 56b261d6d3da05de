// The window of SSIM, a Gaussian with 11 taps and standard deviation 1.5, along a sequence of vectors.
#pragma once

#include "simd.h"

namespace egosplat {

constexpr int REACH = 5, HALO = 2 * REACH;

// WINDOW[k], at distance k: exp(-k^2 / 4.5) divided by the sum of all eleven.
constexpr float WINDOW[REACH + 1] = {0.2660117248617943f,   0.21300553771125366f,  0.1093606895097f,
                                     0.03600077212843082f,  0.007598758135239184f, 0.0010283800844791f};

// out[i] = sum over k of WINDOW[|k|] in(i + REACH + k), for N values of i. Unrolled: the eleven vectors under the
// window stay in registers, and each is read once. The symmetry of the window saves nearly half of the products.
template <int N, class In>
INLINE void blur(In in, Floats* out) {
    Floats v[N + HALO];
#pragma GCC unroll 10
    for (int i = 0; i < HALO; i++) v[i] = in(i);
#pragma GCC unroll 16
    for (int i = 0; i < N; i++) {
        v[i + HALO] = in(i + HALO);
        Floats sum = v[i + REACH] * broadcast(WINDOW[0]);
#pragma GCC unroll 5
        for (int k = 1; k <= REACH; k++) sum = fma(v[i + REACH - k] + v[i + REACH + k], broadcast(WINDOW[k]), sum);
        out[i] = sum;
    }
}

}  // namespace egosplat

// The images of a loss, read as vectors of s = x + y and d = x - y, see loss.h.
#pragma once

#include "shuffles.h"

namespace egosplat {

// Larger values get weight 0, like non-finite ones: their fourth power would overflow.
constexpr float LARGEST_VALUE = 1e8f;

// target (height, width, 3), weight (height, width) or null; render, gradient (3, height, width).
struct LossImages {
    int width, height;
    const float *render, *target, *weight;
    float* gradient;  // null: compute the value only
    float l1_factor, ssim_factor;
};

INLINE Floats magnitude(Floats v) { return (Floats)((Ints)v & 0x7fffffff); }

// One channel of `LossImages`.
struct Plane {
    const LossImages& images;
    const int channel;
    const Deinterleave deinterleave;

    Plane(const LossImages& images, int channel) : images(images), channel(channel), deinterleave(channel) {}

    size_t at(int y, int x) const { return size_t(y) * images.width + x; }
    size_t plane() const { return size_t(channel) * images.height * images.width; }

    // s, d and the weight of LANES pixels from (y, x); zero beyond the image.
    inline void read(int y, int x, Floats& s, Floats& d, Floats& weight) const {
        s = d = weight = Floats{};
        if (y >= images.height) return;
        const int n = images.width - x;
        const float *render = images.render + plane() + at(y, x), *target = images.target + 3 * at(y, x);
        const float* weights = images.weight ? images.weight + at(y, x) : nullptr;
        if (n >= LANES)
            combine(load(render), deinterleave.read(target), weights ? load(weights) : broadcast(1.0f), s, d, weight);
        else
            read_edge(render, target, weights, n, s, d, weight);
    }

    // Prefetches pixels. The rows of several arrays are more streams than the hardware prefetcher follows.
    // Always inlined, because GCC 12 drops calls of a function that only prefetches.
    inline __attribute__((always_inline)) void prefetch(int y, int x) const {
        if (y >= images.height || x >= images.width) return;
        __builtin_prefetch(images.render + plane() + at(y, x));
        for (int i = 0; i < 3; i++) __builtin_prefetch(images.target + 3 * at(y, x) + i * LANES);
        if (images.weight) __builtin_prefetch(images.weight + at(y, x));
    }

    void read_edge(const float* render, const float* target, const float* weights, int n, Floats& s, Floats& d,
                   Floats& weight) const {
        float r[LANES] = {}, t[3 * LANES] = {}, w[LANES] = {};
        memcpy(r, render, 4 * n), memcpy(t, target, 12 * n);
        for (int i = 0; i < n; i++) w[i] = weights ? weights[i] : 1.0f;
        combine(load(r), deinterleave.read(t), load(w), s, d, weight);
    }

    INLINE void combine(Floats x, Floats y, Floats w, Floats& s, Floats& d, Floats& weight) {
        const Floats largest = broadcast(LARGEST_VALUE);
        Mask usable = at_least(largest, magnitude(y));
        y = where(usable, y);
        usable = at_least(at_least(usable, largest, magnitude(x)), largest, magnitude(w));
        weight = where(usable, min(max(w, Floats{}), broadcast(1.0f)));
        d = where(usable, weight * (x - y));
        s = y + y + d;
    }

    inline void write_gradient(int y, int x, Floats v) const {
        float* p = images.gradient + plane() + at(y, x);
        const int n = images.width - x;
        if (n >= LANES) return store(p, v);
        for (int i = 0; i < n; i++) p[i] = v[i];
    }
};

}  // namespace egosplat

// The exposure of a photograph, and its gradients: a color c becomes c exp(log_gain (1 + k / 4) / (1 + k c^2)), k for
// the compression of highlights. What exceeds a saturated color of the photograph is cut off, and has no gradient.
#pragma once

#include <algorithm>
#include <vector>

#include "shuffles.h"

namespace egosplat {

constexpr float SATURATED = 0.98f, BRIGHTEST = 10.0f, LOG2_E = 1.44269504088896f;
constexpr int64_t EXPOSED_PART = 8192;  // pixels whose sums are added first; a multiple of LANES

// tone: the logarithms of the three gains, then k. photograph (pixels, 3), or null.
struct Exposure {
    int64_t pixels;
    const float *tone, *photograph;

    // What becomes of LANES colors: gain, 1 / (1 + k c^2), the bounded color, and where the photograph cuts it off.
    struct Colors {
        Floats gain, curve, bounded, limit;
        Mask cut;
    };

    INLINE void expose(const Exposure& e, int channel, Floats color, Floats limit, Colors& out) {
        const float k = e.tone[3], log2_gain = LOG2_E * e.tone[channel] * (1.0f + 0.25f * k);
        out.bounded = min(color, broadcast(BRIGHTEST));
        out.curve = 1.0f / fma(broadcast(k) * out.bounded, out.bounded, broadcast(1.0f));
        const Floats power = broadcast(log2_gain) * out.curve;
        out.gain = exp2(at_least(power, broadcast(-126.0f)), min(power, broadcast(126.0f)));
        out.limit = limit;
        out.cut = at_least(above(color * out.gain, limit), limit, broadcast(SATURATED));
    }

    // Calls call(colors, numbers, at, count) for the vectors of a part of a channel: `numbers` are those of `planes`,
    // each (3, pixels), at the same place; the last vector of the image has fewer than LANES.
    template <int PLANES, class Call>
    void visit(int channel, int64_t part, const float* const (&planes)[PLANES], Call call) const {
        const Deinterleave deinterleave(channel);
        const int64_t end = std::min(pixels, (part + 1) * EXPOSED_PART);
        for (int64_t i = part * EXPOSED_PART; i < end; i += LANES) {
            const int count = int(std::min(int64_t(LANES), end - i));
            Floats numbers[PLANES], limit = broadcast(-1.0f);
            float some[3 * LANES] = {};
            for (int p = 0; p < PLANES; p++) {
                const float* from = planes[p] + channel * pixels + i;
                if (count < LANES) memcpy(some, from, 4 * count);
                numbers[p] = load(count < LANES ? some : from);
            }
            if (photograph) {
                const float* from = photograph + 3 * i;
                if (count < LANES) memcpy(some, from, 12 * count);
                limit = deinterleave.read(count < LANES ? some : from);
            }
            Colors colors;
            expose(*this, channel, numbers[0], limit, colors);
            call(colors, numbers, channel * pixels + i, count);
        }
    }

    int64_t parts() const { return (pixels + EXPOSED_PART - 1) / EXPOSED_PART; }
};

INLINE void write_some(float* to, Floats v, int count) {
    if (count >= LANES) return store(to, v);
    memcpy(to, &v, 4 * count);
}

// render, result (3, pixels).
inline void expose(const Exposure& e, int threads, const float* render, float* result) {
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int64_t part = 0; part < e.parts(); part++)
        for (int channel = 0; channel < 3; channel++) {
            const float* const planes[1] = {render};
            e.visit(channel, part, planes, [&](const Exposure::Colors& c, const Floats* n, int64_t at, int count) {
                write_some(result + at, where(c.cut, c.limit, n[0] * c.gain), count);
            });
        }
}

// v_result, v_render (3, pixels); v_tone (4). Sums are in an order that does not depend on the threads.
inline void expose_backward(const Exposure& e, int threads, const float* render, const float* v_result,
                            float* v_render, double* v_tone) {
    std::vector<double> sums(e.parts() * 4);
    const float k = e.tone[3], scale = 1.0f + 0.25f * k;
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int64_t part = 0; part < e.parts(); part++)
        for (int channel = 0; channel < 3; channel++) {
            const float* const planes[2] = {render, v_result};
            const float log_gain = e.tone[channel];
            Floats v_gain = {}, v_k = {};
            e.visit(channel, part, planes, [&](const Exposure::Colors& c, const Floats* n, int64_t at, int count) {
                const Floats v = where(c.cut, Floats{}, n[1]) * c.gain, v_log = v * n[0];
                const Floats square = c.bounded * c.bounded * c.curve, v_exponent = v_log * c.curve;
                v_gain += v_exponent * scale;
                v_k += v_exponent * log_gain * (0.25f - scale * square);
                // The curve has no slope where the color is bounded.
                const Floats slope = where(above(n[0], broadcast(BRIGHTEST)), Floats{}, c.bounded * c.curve);
                write_some(v_render + at, v - v_exponent * slope * (2.0f * k * scale * log_gain), count);
            });
            for (int i = 0; i < LANES; i++) sums[4 * part + channel] += v_gain[i], sums[4 * part + 3] += v_k[i];
        }
    for (size_t i = 0; i < sums.size(); i++) v_tone[i % 4] += sums[i];
}

}  // namespace egosplat

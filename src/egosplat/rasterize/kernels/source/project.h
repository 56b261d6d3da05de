// Projection of Gaussians into one camera and their channels for this view (3DGS, section 4).
//
// Computed in float64 per Gaussian; the cost is negligible next to compositing.
#pragma once

#include <cstdint>
#include <cstring>

#include "footprint.h"
#include "harmonics.h"

namespace egosplat {

constexpr double ALPHA_THRESHOLD = 1 / 255.0;
constexpr double MAX_RADIUS = 1 << 24;

// Parameters of the Gaussians, or gradients with respect to them (null if not wanted).
template <class Number>
struct Parameters {
    Number *means, *quats, *scales, *opacities;  // (n, 3), (n, 4) wxyz, (n, 3), (n,)
    Number *sh, *features;                       // (n, stored, 3), (n, feature_count); null if absent
};

// Inputs of compositing, or gradients with respect to them (null if there are none).
template <class Number>
struct Projections {
    Number *means, *conics, *depths, *opacities;  // (n, 2), (n, 3), (n,), (n,)
    Number* channels;                             // (n, channels): color, features, depth, those that exist
};

struct Layout {
    int n;
    int stored, coefficients;  // number of spherical harmonics in memory, and to evaluate
    int feature_count;
    bool depth;

    int colors() const { return coefficients ? 3 : 0; }
    int channels() const { return colors() + feature_count + depth; }
};

// Returns whether Gaussian i is visible. If so, fills `out`, spreads (n,), its variances in y, and radii (n, 2).
inline bool project_one(int i, const Camera& camera, const double* center, const Layout& layout,
                        Parameters<const float> in, Projections<float> out, float* spreads, int32_t* radii) {
    Footprint f;
    if (!f.make(camera, in.means + 3 * i, in.quats + 4 * i, in.scales + 3 * i)) return false;
    const double opacity = camera.antialiased ? in.opacities[i] * f.compensation() : in.opacities[i];
    if (!(opacity >= ALPHA_THRESHOLD)) return false;
    const double extent = std::sqrt(2 * std::log(opacity / ALPHA_THRESHOLD));
    const double u = camera.fx * f.p[0] / f.p[2] + camera.cx, v = camera.fy * f.p[1] / f.p[2] + camera.cy;
    const double ru = std::ceil(extent * std::sqrt(f.uu)), rv = std::ceil(extent * std::sqrt(f.vv));
    if (!std::isfinite(ru + rv) || !(ru > camera.radius_clip || rv > camera.radius_clip) || !(ru > 0) || !(rv > 0))
        return false;
    if (!(u + ru > 0 && u - ru < camera.width && v + rv > 0 && v - rv < camera.height)) return false;
    const float results[7] = {float(u), float(v), float(f.vv / f.blurred_det), float(-f.uv / f.blurred_det),
                              float(f.uu / f.blurred_det), float(f.p[2]), float(opacity)};
    for (float result : results)
        if (!std::isfinite(result)) return false;
    if (!(results[2] > 0 && results[4] > 0)) return false;  // too wide for float32

    out.means[2 * i] = results[0], out.means[2 * i + 1] = results[1];
    for (int j = 0; j < 3; j++) out.conics[3 * i + j] = results[2 + j];
    out.depths[i] = results[5], out.opacities[i] = results[6];
    spreads[i] = float(f.vv);
    float* channel = out.channels + size_t(i) * layout.channels();
    if (layout.coefficients) {
        // Coefficients beyond the degree count 0 times, so that a non-finite one still makes the sum non-finite.
        double basis[MAX_COEFFICIENTS] = {}, color[3] = {0.5, 0.5, 0.5};
        const Direction d(center, in.means + 3 * i);
        harmonics(layout.coefficients, d.n[0], d.n[1], d.n[2], basis);
        const float* sh = in.sh + size_t(i) * layout.stored * 3;
        for (int k = 0; k < layout.stored; k++)
            for (int c = 0; c < 3; c++) color[c] += basis[k] * sh[3 * k + c];
        if (!std::isfinite(color[0] + color[1] + color[2])) return false;
        for (int c = 0; c < 3; c++) channel[c] = float(std::max(color[c], 0.0));
    }
    if (layout.feature_count)
        memcpy(channel + layout.colors(), in.features + size_t(i) * layout.feature_count, 4 * layout.feature_count);
    if (layout.depth) channel[layout.channels() - 1] = results[5];
    for (int c = 0; c < layout.channels(); c++)
        if (!std::isfinite(channel[c])) return false;
    radii[2 * i] = int32_t(std::min(ru, MAX_RADIUS)), radii[2 * i + 1] = int32_t(std::min(rv, MAX_RADIUS));
    return true;
}

template <class Number>
void clear(Number* p, size_t i, int count) {
    if (p) std::fill_n(p + i * count, count, Number(0));
}

// Fills all outputs; culled Gaussians get radius 0 and zeros.
inline void project_forward(const Camera& camera, const Layout& layout, Parameters<const float> in,
                            Projections<float> out, float* spreads, int32_t* radii, int threads) {
    double center[3];
    camera.center(center);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int i = 0; i < layout.n; i++) {
        if (project_one(i, camera, center, layout, in, out, spreads, radii)) continue;
        clear(out.means, i, 2), clear(out.conics, i, 3), clear(out.depths, i, 1), clear(out.opacities, i, 1);
        clear(out.channels, i, layout.channels()), clear(spreads, i, 1), clear(radii, i, 2);
    }
}

}  // namespace egosplat

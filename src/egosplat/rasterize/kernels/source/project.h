// Projection of Gaussians into one camera and their channels for this view (3DGS, section 4).
//
// Computed in float64, a Gaussian in each lane of a vector; colors are summed one Gaussian after another.
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

// Tells which Gaussians cannot be visible, without their covariance.
class Frustum {
    const Camera& camera;
    double widest[2], rim;  // bounds of the radius: widest scale / z + rim [px]

public:
    explicit Frustum(const Camera& camera) : camera(camera) {
        const double focal[2] = {camera.fx, camera.fy}, extent = std::sqrt(2 * std::log(1 / ALPHA_THRESHOLD));
        double low[2], high[2];
        camera.slopes(low, high);
        for (int a = 0; a < 2; a++) {
            const double steepest = std::max(std::abs(low[a]), std::abs(high[a]));
            // The margin covers rounding.
            widest[a] = 1.000001 * extent * std::abs(focal[a]) * std::sqrt(1 + steepest * steepest);
        }
        rim = 1.000001 * (1 + extent * std::sqrt(camera.eps2d));
    }

    // Whether the center of Gaussian i is not between the planes, or all of it is beside the image.
    bool leaves_out(int i, const Parameters<const float>& in) const {
        const float *mean = in.means + 3 * size_t(i), *scale = in.scales + 3 * size_t(i);
        const double* w = camera.rotation;
        double p[3];
        for (int j = 0; j < 3; j++)
            p[j] = w[3 * j] * mean[0] + w[3 * j + 1] * mean[1] + w[3 * j + 2] * mean[2] + camera.translation[j];
        if (!(p[2] >= camera.near_plane && p[2] <= camera.far_plane)) return true;
        if (!(in.opacities[i] <= 1) || !(p[2] > 0)) return false;
        const double longest = std::max(std::abs(scale[0]), std::max(std::abs(scale[1]), std::abs(scale[2])));
        const double rx = widest[0] * longest + rim * p[2], ry = widest[1] * longest + rim * p[2];
        const double x = camera.fx * p[0] + camera.cx * p[2], y = camera.fy * p[1] + camera.cy * p[2];
        return x < -rx || x - rx > camera.width * p[2] || y < -ry || y - ry > camera.height * p[2];
    }
};

// Writes what Gaussian i shows in each channel; returns false if a number is not finite. basis: its SH, `step` apart.
inline bool shade(int i, const Layout& layout, const double* basis, int step, Parameters<const float> in, float depth,
                  float* channel) {
    if (layout.coefficients) {
        // Coefficients beyond the degree count 0 times, so that a non-finite one still makes the sum non-finite.
        double color[3] = {0.5, 0.5, 0.5};
        const float* sh = in.sh + size_t(i) * layout.stored * 3;
        for (int k = 0; k < layout.stored; k++)
            for (int c = 0; c < 3; c++) color[c] += basis[k * step] * sh[3 * k + c];
        if (!std::isfinite(color[0] + color[1] + color[2])) return false;
        for (int c = 0; c < 3; c++) channel[c] = float(std::max(color[c], 0.0));
    }
    if (layout.feature_count)
        memcpy(channel + layout.colors(), in.features + size_t(i) * layout.feature_count, 4 * layout.feature_count);
    if (layout.depth) channel[layout.channels() - 1] = depth;
    bool whole = true;
    for (int c = 0; c < layout.channels(); c++) whole &= std::isfinite(channel[c]);
    return whole;
}

// Fills `out`, spreads (n,), variances in y, and radii (n, 2) of the visible Gaussians of a batch.
inline void project_batch(const Camera& camera, const double* center, const Layout& layout, const Batch& batch,
                          Parameters<const float> in, Projections<float> out, float* spreads, int32_t* radii) {
    for (int j = 0; j < batch.count; j += DOUBLES) {
        Footprint f;
        Footprint::make(f, camera, batch, j);
        Doubles opacity = load(batch.opacity + j), extent = {};
        if (camera.antialiased) opacity *= f.compensation();
        Longs seen = f.sound & (opacity >= ALPHA_THRESHOLD);
        for (int l = 0; l < DOUBLES; l++)
            if (seen[l]) extent[l] = std::sqrt(2 * std::log(opacity[l] / ALPHA_THRESHOLD));
        const Doubles u = camera.fx * f.p[0] / f.p[2] + camera.cx, v = camera.fy * f.p[1] / f.p[2] + camera.cy;
        Doubles ru = extent * root(f.uu), rv = extent * root(f.vv);
        for (int l = 0; l < DOUBLES; l++) ru[l] = std::ceil(ru[l]), rv[l] = std::ceil(rv[l]);
        seen &= finite(ru + rv) & ((ru > camera.radius_clip) | (rv > camera.radius_clip)) & (ru > 0) & (rv > 0);
        seen &= (u + ru > 0) & (u - ru < double(camera.width)) & (v + rv > 0) & (v - rv < double(camera.height));
        const Doubles numbers[7] = {u, v, f.vv / f.blurred_det, -f.uv / f.blurred_det, f.uu / f.blurred_det,
                                    f.p[2], opacity};
        Doubles basis[MAX_COEFFICIENTS] = {};
        if (layout.coefficients) {
            const Direction d(center, batch, j);
            harmonics(layout.coefficients, d.n[0], d.n[1], d.n[2], basis);
        }
        for (int l = 0; l < std::min(DOUBLES, batch.count - j); l++) {
            if (!seen[l]) continue;
            float results[7];
            bool whole = true;
            for (int k = 0; k < 7; k++) results[k] = float(numbers[k][l]), whole &= std::isfinite(results[k]);
            if (!whole || !(results[2] > 0 && results[4] > 0)) continue;  // too wide for float32
            const size_t i = batch.id[j + l];
            float* channel = out.channels + i * layout.channels();
            if (!shade(i, layout, (const double*)basis + l, DOUBLES, in, results[5], channel)) {
                std::fill_n(channel, layout.channels(), 0.0f);
                continue;
            }
            out.means[2 * i] = results[0], out.means[2 * i + 1] = results[1];
            for (int k = 0; k < 3; k++) out.conics[3 * i + k] = results[2 + k];
            out.depths[i] = results[5], out.opacities[i] = results[6], spreads[i] = float(f.vv[l]);
            radii[2 * i] = int32_t(std::min(ru[l], MAX_RADIUS));
            radii[2 * i + 1] = int32_t(std::min(rv[l], MAX_RADIUS));
        }
    }
}

// Prefetches the coefficients of a Gaussian in a batch, which are used when the batch is full. Always inlined, because
// GCC drops calls of a function that only prefetches.
template <int WRITE>
inline __attribute__((always_inline)) void prefetch_harmonics(const float* sh, const Layout& layout, int i) {
    if (!sh) return;
    const float* row = sh + size_t(i) * layout.stored * 3;
    for (int k = 0; k < layout.stored * 3; k += 16) __builtin_prefetch(row + k, WRITE);
}

constexpr int PART = 1024;  // Gaussians that one thread projects at a time

template <class Number>
void clear(Number* p, size_t i, size_t count, size_t columns) {
    if (p) std::fill_n(p + i * columns, count * columns, Number(0));
}

// Fills all outputs; culled Gaussians get radius 0 and zeros.
inline void project_forward(const Camera& camera, const Layout& layout, Parameters<const float> in,
                            Projections<float> out, float* spreads, int32_t* radii, int threads) {
    double center[3];
    camera.center(center);
    const Frustum frustum(camera);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int begin = 0; begin < layout.n; begin += PART) {
        const int count = std::min(PART, layout.n - begin);
        clear(out.means, begin, count, 2), clear(out.conics, begin, count, 3), clear(out.depths, begin, count, 1);
        clear(out.opacities, begin, count, 1), clear(out.channels, begin, count, layout.channels());
        clear(spreads, begin, count, 1), clear(radii, begin, count, 2);
        Batch batch;
        for (int i = begin; i < begin + count; i++) {
            if (!frustum.leaves_out(i, in)) {
                batch.take(i, in.means, in.quats, in.scales, in.opacities);
                if (layout.coefficients) prefetch_harmonics<0>(in.sh, layout, i);
            }
            if (batch.count < Batch::ROOM && i + 1 < begin + count) continue;
            project_batch(camera, center, layout, batch, in, out, spreads, radii);
            batch.count = 0;
        }
    }
}

}  // namespace egosplat

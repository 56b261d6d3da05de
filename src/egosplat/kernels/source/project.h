// From Gaussians to what one camera's image is composited of (Zwicker et al. 2002; 3DGS, section 4), and back.
//
// In float64 within a Gaussian, where the cost is nothing beside the compositing.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include "harmonics.h"

namespace egosplat {

constexpr double FRUSTUM_MARGIN = 0.3;  // linearised at most this share of half the field of view outside the image
constexpr double ALPHA_THRESHOLD = 1 / 255.0;
constexpr double MAX_RADIUS = 1 << 24;

struct Camera {
    double rotation[9], translation[3];  // world to camera
    double fx, fy, cx, cy;
    int width, height;
    double near_plane, far_plane, radius_clip, eps2d;
    bool antialiased;

    // Where the camera stands in the world.
    void centre(double* c) const {
        for (int j = 0; j < 3; j++)
            c[j] = -(rotation[j] * translation[0] + rotation[3 + j] * translation[1] +
                     rotation[6 + j] * translation[2]);
    }
};

// The Gaussians' parameters, or derivatives with respect to them (null where none are asked for).
template <class Number>
struct Parameters {
    Number *means, *quats, *scales, *opacities;  // (n, 3), (n, 4) wxyz, (n, 3), (n,)
    Number *sh, *features;                       // (n, stored, 3), (n, feature_count); null where there are none
};

// What is composited, or derivatives with respect to it (null where there are none).
template <class Number>
struct Projections {
    Number *means, *conics, *depths, *opacities;  // (n, 2), (n, 3), (n,), (n,)
    Number* channels;                             // (n, channels): colour, features, depth, as asked for
};

struct Layout {
    int n;
    int stored, coefficients;  // spherical harmonics a colour has, and those that are used
    int feature_count;
    bool depth;

    int colors() const { return coefficients ? 3 : 0; }
    int channels() const { return colors() + feature_count + depth; }
};

// One Gaussian on its way to the image.
struct Footprint {
    double p[3];           // in the camera
    double slope[2];       // x / z, y / z, bounded
    bool bounded[2];
    double q[4], inverse_norm;
    double turn[9];        // camera from the Gaussian's axes
    double scale[3];
    double jacobian[2][3];
    double root[2][3];     // a square root of the covariance in the image
    double uu, uv, vv, det, blurred_det;

    // False where nothing of it can be seen.
    bool make(const Camera& camera, const float* mean, const float* quat, const float* s) {
        const double* w = camera.rotation;
        for (int i = 0; i < 3; i++)
            p[i] = w[3 * i] * mean[0] + w[3 * i + 1] * mean[1] + w[3 * i + 2] * mean[2] + camera.translation[i];
        if (!(p[2] >= camera.near_plane && p[2] <= camera.far_plane)) return false;
        for (int i = 0; i < 4; i++) q[i] = quat[i];
        const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        if (!(norm > 0) || !std::isfinite(norm)) return false;
        inverse_norm = 1 / norm;
        for (double& v : q) v *= inverse_norm;
        double r[9];
        rotation_of(r);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                turn[3 * i + j] = w[3 * i] * r[j] + w[3 * i + 1] * r[3 + j] + w[3 * i + 2] * r[6 + j];
        const double focal[2] = {camera.fx, camera.fy}, principal[2] = {camera.cx, camera.cy};
        const double size[2] = {double(camera.width), double(camera.height)}, inverse_z = 1 / p[2];
        for (int a = 0; a < 2; a++) {
            const double margin = FRUSTUM_MARGIN * 0.5 * size[a] / focal[a];
            const double low = -principal[a] / focal[a] - margin, high = (size[a] - principal[a]) / focal[a] + margin;
            const double free = p[a] * inverse_z;
            slope[a] = std::min(std::max(free, low), high);
            bounded[a] = free < low || free > high;
            jacobian[a][a] = focal[a] * inverse_z, jacobian[a][1 - a] = 0;
            jacobian[a][2] = -focal[a] * slope[a] * inverse_z;
        }
        for (int j = 0; j < 3; j++) {
            scale[j] = s[j];
            for (int a = 0; a < 2; a++)
                root[a][j] = (jacobian[a][a] * turn[3 * a + j] + jacobian[a][2] * turn[6 + j]) * scale[j];
        }
        uu = dot(root[0], root[0]), uv = dot(root[0], root[1]), vv = dot(root[1], root[1]);
        // Lagrange's identity: of a needle, uu vv - uv^2 has no digits left.
        double normal[3];
        for (int j = 0; j < 3; j++)
            normal[j] = root[0][(j + 1) % 3] * root[1][(j + 2) % 3] - root[0][(j + 2) % 3] * root[1][(j + 1) % 3];
        det = dot(normal, normal);
        blurred_det = det + camera.eps2d * (uu + vv) + camera.eps2d * camera.eps2d;
        uu += camera.eps2d, vv += camera.eps2d;
        return blurred_det > 0 && std::isfinite(blurred_det);
    }

    double compensation() const { return std::sqrt(det / blurred_det); }

    void rotation_of(double* r) const {
        const double w = q[0], x = q[1], y = q[2], z = q[3];
        r[0] = 1 - 2 * (y * y + z * z), r[1] = 2 * (x * y - w * z), r[2] = 2 * (x * z + w * y);
        r[3] = 2 * (x * y + w * z), r[4] = 1 - 2 * (x * x + z * z), r[5] = 2 * (y * z - w * x);
        r[6] = 2 * (x * z - w * y), r[7] = 2 * (y * z + w * x), r[8] = 1 - 2 * (x * x + y * y);
    }

    static double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
};

struct Direction {
    double n[3], inverse_norm;

    Direction(const double* centre, const float* mean) {
        for (int i = 0; i < 3; i++) n[i] = mean[i] - centre[i];
        const double norm = std::sqrt(Footprint::dot(n, n));
        inverse_norm = norm > 0 ? 1 / norm : 0;
        for (double& v : n) v *= inverse_norm;
    }
};

// Whether anything is composited of it; then fills `out`, spreads (n,) and radii (n, 2), else leaves them.
inline bool project_one(int i, const Camera& camera, const double* centre, const Layout& layout,
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
    if (!(results[2] > 0 && results[4] > 0)) return false;  // wider than float32 can tell

    out.means[2 * i] = results[0], out.means[2 * i + 1] = results[1];
    for (int j = 0; j < 3; j++) out.conics[3 * i + j] = results[2 + j];
    out.depths[i] = results[5], out.opacities[i] = results[6];
    spreads[i] = float(f.vv);
    float* channel = out.channels + size_t(i) * layout.channels();
    if (layout.coefficients) {
        // Those beyond the degree count 0 times, so that a number that is not finite shows there too.
        double basis[MAX_COEFFICIENTS] = {}, color[3] = {0.5, 0.5, 0.5};
        const Direction d(centre, in.means + 3 * i);
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

// Fills everything; what is not composited has radius 0 and zeros.
inline void project_forward(const Camera& camera, const Layout& layout, Parameters<const float> in,
                            Projections<float> out, float* spreads, int32_t* radii, int threads) {
    double centre[3];
    camera.centre(centre);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int i = 0; i < layout.n; i++) {
        if (project_one(i, camera, centre, layout, in, out, spreads, radii)) continue;
        clear(out.means, i, 2), clear(out.conics, i, 3), clear(out.depths, i, 1), clear(out.opacities, i, 1);
        clear(out.channels, i, layout.channels()), clear(spreads, i, 1), clear(radii, i, 2);
    }
}

// Derivatives with respect to the camera's pose.
struct PoseGradient {
    double rotation[9] = {}, translation[3] = {};
};

// From derivatives with respect to the covariance in the image to those with respect to mean, rotation, scale.
struct FootprintGradient {
    double p[3] = {};       // mean in the camera
    double turn[9];         // camera from the Gaussian's axes
    double scale[3];

    FootprintGradient(const Camera& camera, const Footprint& f, const double* v_mean, const double* v_conic,
                      double v_depth, double v_compensation) {
        const double a = f.vv / f.blurred_det, b = -f.uv / f.blurred_det, c = f.uu / f.blurred_det;
        // Of an inverse Q of a covariance: -Q V Q, with V's off-diagonal shared between its two places.
        const double h = 0.5 * v_conic[1];
        const double e0 = a * v_conic[0] + b * h, e1 = a * h + b * v_conic[2];
        const double e2 = b * v_conic[0] + c * h, e3 = b * h + c * v_conic[2];
        double v_uu = -(e0 * a + e1 * b), v_uv = -2 * (e0 * b + e1 * c), v_vv = -(e2 * b + e3 * c);
        if (v_compensation != 0 && f.det > 0) {
            // compensation^2 = det / blurred_det
            const double v_ratio = v_compensation / (2 * f.compensation()), d2 = f.blurred_det * f.blurred_det;
            const double uu = f.uu - camera.eps2d, vv = f.vv - camera.eps2d, rest = f.blurred_det - f.det;
            v_uu += v_ratio * (vv * rest - f.det * camera.eps2d) / d2;
            v_vv += v_ratio * (uu * rest - f.det * camera.eps2d) / d2;
            v_uv += v_ratio * -2 * f.uv * rest / d2;
        }
        double v_jacobian[2][3] = {};
        for (int j = 0; j < 3; j++) {
            const double v_root[2] = {2 * v_uu * f.root[0][j] + v_uv * f.root[1][j],
                                      2 * v_vv * f.root[1][j] + v_uv * f.root[0][j]};
            scale[j] = 0;
            for (int i = 0; i < 3; i++) {
                const double v_axis = f.jacobian[0][i] * v_root[0] + f.jacobian[1][i] * v_root[1];
                scale[j] += v_axis * f.turn[3 * i + j];
                turn[3 * i + j] = v_axis * f.scale[j];
                for (int a2 = 0; a2 < 2; a2++) v_jacobian[a2][i] += v_root[a2] * f.turn[3 * i + j] * f.scale[j];
            }
        }
        const double focal[2] = {camera.fx, camera.fy}, inverse_z = 1 / f.p[2];
        p[2] = v_depth;
        for (int a2 = 0; a2 < 2; a2++) {
            const double scaled = focal[a2] * inverse_z, free = f.p[a2] * inverse_z;
            p[a2] += v_mean[a2] * scaled;
            p[2] -= v_mean[a2] * scaled * free;
            p[2] += scaled * inverse_z * (f.slope[a2] * v_jacobian[a2][2] - v_jacobian[a2][a2]);
            if (f.bounded[a2]) continue;
            const double v_slope = -scaled * v_jacobian[a2][2];
            p[a2] += v_slope * inverse_z;
            p[2] -= v_slope * free * inverse_z;
        }
    }
};

inline void quaternion_gradient(const Footprint& f, const double* v_rotation, float* v_quat) {
    const double w = f.q[0], x = f.q[1], y = f.q[2], z = f.q[3], *v = v_rotation;
    const double g[4] = {
        2 * (x * (v[7] - v[5]) + y * (v[2] - v[6]) + z * (v[3] - v[1])),
        2 * (w * (v[7] - v[5]) + y * (v[1] + v[3]) + z * (v[2] + v[6]) - 2 * x * (v[4] + v[8])),
        2 * (w * (v[2] - v[6]) + x * (v[1] + v[3]) + z * (v[5] + v[7]) - 2 * y * (v[0] + v[8])),
        2 * (w * (v[3] - v[1]) + x * (v[2] + v[6]) + y * (v[5] + v[7]) - 2 * z * (v[0] + v[4])),
    };
    const double along = g[0] * w + g[1] * x + g[2] * y + g[3] * z;
    for (int i = 0; i < 4; i++) v_quat[i] = float((g[i] - along * f.q[i]) * f.inverse_norm);
}

// Derivatives of a colour: to its coefficients, and, added, to the mean (and against it, to the camera's centre).
inline void color_gradient(int i, const double* centre, const Layout& layout, Parameters<const float> in,
                           const float* channel, const float* v_channel, float* v_sh, double* v_mean) {
    double basis[MAX_COEFFICIENTS], along[MAX_COEFFICIENTS] = {}, v[3], v_color[3];
    const Direction d(centre, in.means + 3 * i);
    harmonics(layout.coefficients, d.n[0], d.n[1], d.n[2], basis);
    const float* sh = in.sh + size_t(i) * layout.stored * 3;
    for (int c = 0; c < 3; c++) v_color[c] = channel[c] > 0 ? v_channel[c] : 0;  // the colour is bounded by 0
    for (int k = 0; k < layout.coefficients; k++)
        for (int c = 0; c < 3; c++) {
            along[k] += sh[3 * k + c] * v_color[c];
            if (v_sh) v_sh[3 * k + c] = float(basis[k] * v_color[c]);
        }
    if (v_sh) std::fill(v_sh + 3 * layout.coefficients, v_sh + 3 * layout.stored, 0.0f);
    harmonics_gradient(layout.coefficients, d.n[0], d.n[1], d.n[2], along, v);
    const double radial = Footprint::dot(v, d.n);
    for (int j = 0; j < 3; j++) v_mean[j] += (v[j] - radial * d.n[j]) * d.inverse_norm;
}

inline void project_one_backward(int i, const Camera& camera, const double* centre, const Layout& layout,
                                 Parameters<const float> in, const float* channels, Projections<const float> v,
                                 Parameters<float> out, PoseGradient* pose) {
    const int width = layout.channels();
    const float* v_channel = v.channels + size_t(i) * width;
    double v_direction[3] = {};
    if (layout.coefficients && (out.sh || out.means))
        color_gradient(i, centre, layout, in, channels + size_t(i) * width, v_channel,
                       out.sh ? out.sh + size_t(i) * layout.stored * 3 : nullptr, v_direction);
    if (out.features && layout.feature_count)
        memcpy(out.features + size_t(i) * layout.feature_count, v_channel + layout.colors(), 4 * layout.feature_count);
    if (!out.means) return;
    Footprint f;
    f.make(camera, in.means + 3 * i, in.quats + 4 * i, in.scales + 3 * i);
    const double v_mean[2] = {v.means[2 * i], v.means[2 * i + 1]};
    const double v_conic[3] = {v.conics[3 * i], v.conics[3 * i + 1], v.conics[3 * i + 2]};
    const double v_depth = v.depths[i] + (layout.depth ? v_channel[width - 1] : 0.0f);
    const double v_compensation = camera.antialiased ? double(v.opacities[i]) * in.opacities[i] : 0;
    const FootprintGradient g(camera, f, v_mean, v_conic, v_depth, v_compensation);
    out.opacities[i] = camera.antialiased ? float(v.opacities[i] * f.compensation()) : v.opacities[i];
    const double* w = camera.rotation;
    double v_rotation[9];
    for (int j = 0; j < 3; j++) {
        out.scales[3 * i + j] = float(g.scale[j]);
        out.means[3 * i + j] = float(w[j] * g.p[0] + w[3 + j] * g.p[1] + w[6 + j] * g.p[2] + v_direction[j]);
        for (int k = 0; k < 3; k++)
            v_rotation[3 * j + k] = w[j] * g.turn[k] + w[3 + j] * g.turn[3 + k] + w[6 + j] * g.turn[6 + k];
    }
    quaternion_gradient(f, v_rotation, out.quats + 4 * i);
    if (!pose) return;
    double r[9];
    f.rotation_of(r);
    for (int a = 0; a < 3; a++) {
        // The centre, -inverse(rotation) translation, moves against the direction.
        const double v_centre = -Footprint::dot(w + 3 * a, v_direction);
        pose->translation[a] += g.p[a] - v_centre;
        for (int b = 0; b < 3; b++)
            pose->rotation[3 * a + b] += g.p[a] * in.means[3 * i + b] + Footprint::dot(g.turn + 3 * a, r + 3 * b) -
                                         v_centre * centre[b];
    }
}

// Fills all of `out` that is not null; `pose` may be null. Summed in blocks, alike for any number of threads.
inline void project_backward(const Camera& camera, const Layout& layout, Parameters<const float> in,
                             const int32_t* radii, const float* channels, Projections<const float> v,
                             Parameters<float> out, PoseGradient* pose, int threads) {
    constexpr int BLOCK = 1024;
    const int blocks = (layout.n + BLOCK - 1) / BLOCK;
    std::vector<PoseGradient> partial(pose ? blocks : 0);
    double centre[3];
    camera.centre(centre);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int block = 0; block < blocks; block++)
        for (int i = block * BLOCK; i < std::min(layout.n, (block + 1) * BLOCK); i++) {
            if (radii[2 * i] > 0) {
                project_one_backward(i, camera, centre, layout, in, channels, v, out, pose ? &partial[block] : nullptr);
                continue;
            }
            clear(out.means, i, 3), clear(out.quats, i, 4), clear(out.scales, i, 3), clear(out.opacities, i, 1);
            clear(out.sh, i, layout.stored * 3), clear(out.features, i, layout.feature_count);
        }
    for (const PoseGradient& p : partial) {
        for (int j = 0; j < 9; j++) pose->rotation[j] += p.rotation[j];
        for (int j = 0; j < 3; j++) pose->translation[j] += p.translation[j];
    }
}

}  // namespace egosplat

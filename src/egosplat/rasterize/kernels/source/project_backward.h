// The gradients of projection (project.h) with respect to Gaussians and pose.
#pragma once

#include <vector>

#include "project.h"

namespace egosplat {

// Gradient with respect to the camera pose.
struct PoseGradient {
    double rotation[9] = {}, translation[3] = {};
};

// Gradients with respect to mean, rotation and scale, from those with respect to the covariance in the image.
struct FootprintGradient {
    double p[3] = {};       // mean in the camera
    double turn[9];         // camera_from_gaussian rotation
    double scale[3];

    FootprintGradient(const Camera& camera, const Footprint& f, const double* v_mean, const double* v_conic,
                      double v_depth, double v_compensation) {
        const double a = f.vv / f.blurred_det, b = -f.uv / f.blurred_det, c = f.uu / f.blurred_det;
        // The gradient through the inverse Q of a covariance is -Q V Q; both places of the off-diagonal share V's.
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

// Adds the gradient of a color to its coefficients and to the mean (and, negated, to the camera center).
inline void color_gradient(int i, const double* center, const Layout& layout, Parameters<const float> in,
                           const float* channel, const float* v_channel, float* v_sh, double* v_mean) {
    double basis[MAX_COEFFICIENTS], along[MAX_COEFFICIENTS] = {}, v[3], v_color[3];
    const Direction d(center, in.means + 3 * i);
    harmonics(layout.coefficients, d.n[0], d.n[1], d.n[2], basis);
    const float* sh = in.sh + size_t(i) * layout.stored * 3;
    for (int c = 0; c < 3; c++) v_color[c] = channel[c] > 0 ? v_channel[c] : 0;  // the color is clamped at 0
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

inline void project_one_backward(int i, const Camera& camera, const double* center, const Layout& layout,
                                 Parameters<const float> in, const float* channels, Projections<const float> v,
                                 Parameters<float> out, PoseGradient* pose) {
    const int width = layout.channels();
    const float* v_channel = v.channels + size_t(i) * width;
    double v_direction[3] = {};
    if (layout.coefficients && (out.sh || out.means))
        color_gradient(i, center, layout, in, channels + size_t(i) * width, v_channel,
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
        // The direction is mean - center, and the center is -inverse(rotation) translation.
        const double v_center = -Footprint::dot(w + 3 * a, v_direction);
        pose->translation[a] += g.p[a] - v_center;
        for (int b = 0; b < 3; b++)
            pose->rotation[3 * a + b] += g.p[a] * in.means[3 * i + b] + Footprint::dot(g.turn + 3 * a, r + 3 * b) -
                                         v_center * center[b];
    }
}

// Fills every member of `out` that is not null; `pose` may be null. Summed in blocks that do not depend on the threads.
inline void project_backward(const Camera& camera, const Layout& layout, Parameters<const float> in,
                             const int32_t* radii, const float* channels, Projections<const float> v,
                             Parameters<float> out, PoseGradient* pose, int threads) {
    constexpr int BLOCK = 1024;
    const int blocks = (layout.n + BLOCK - 1) / BLOCK;
    std::vector<PoseGradient> partial(pose ? blocks : 0);
    double center[3];
    camera.center(center);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int block = 0; block < blocks; block++)
        for (int i = block * BLOCK; i < std::min(layout.n, (block + 1) * BLOCK); i++) {
            if (radii[2 * i] > 0) {
                project_one_backward(i, camera, center, layout, in, channels, v, out, pose ? &partial[block] : nullptr);
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

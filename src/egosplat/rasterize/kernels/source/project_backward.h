// The gradients of projection (project.h) with respect to Gaussians and pose.
#pragma once

#include <vector>

#include "project.h"

namespace egosplat {

// Gradient with respect to the camera pose.
struct PoseGradient {
    double rotation[9] = {}, translation[3] = {};
};

// Gradients with respect to the numbers of projected Gaussians of a batch.
struct BatchGradient {
    alignas(64) double mean[2][Batch::ROOM] = {}, conic[3][Batch::ROOM] = {}, depth[Batch::ROOM] = {};
    alignas(64) double opacity[Batch::ROOM] = {};

    void take(int j, int i, const Layout& layout, Projections<const float> v) {
        for (int k = 0; k < 2; k++) mean[k][j] = v.means[2 * size_t(i) + k];
        for (int k = 0; k < 3; k++) conic[k][j] = v.conics[3 * size_t(i) + k];
        depth[j] = v.depths[i] + (layout.depth ? v.channels[(i + size_t(1)) * layout.channels() - 1] : 0.0f);
        opacity[j] = v.opacities[i];
    }
};

// Gradients with respect to mean, rotation and scale, from those with respect to the covariance in the image.
struct FootprintGradient {
    Doubles p[3] = {};       // mean in the camera
    Doubles turn[9];         // camera_from_gaussian rotation
    Doubles scale[3];

    FootprintGradient(const Camera& camera, const Footprint& f, const BatchGradient& v, int j, Doubles v_compensation) {
        const Doubles v_mean[2] = {load(v.mean[0] + j), load(v.mean[1] + j)};
        const Doubles v_conic[3] = {load(v.conic[0] + j), load(v.conic[1] + j), load(v.conic[2] + j)};
        const Doubles a = f.vv / f.blurred_det, b = -f.uv / f.blurred_det, c = f.uu / f.blurred_det;
        // The gradient through the inverse Q of a covariance is -Q V Q; both places of the off-diagonal share V's.
        const Doubles h = 0.5 * v_conic[1];
        const Doubles e0 = a * v_conic[0] + b * h, e1 = a * h + b * v_conic[2];
        const Doubles e2 = b * v_conic[0] + c * h, e3 = b * h + c * v_conic[2];
        Doubles v_uu = -(e0 * a + e1 * b), v_uv = -2 * (e0 * b + e1 * c), v_vv = -(e2 * b + e3 * c);
        if (camera.antialiased) {
            // compensation^2 = det / blurred_det
            const Longs counts = (v_compensation != 0) & (f.det > 0);
            const Doubles v_ratio = v_compensation / (2 * f.compensation()), d2 = f.blurred_det * f.blurred_det;
            const Doubles uu = f.uu - camera.eps2d, vv = f.vv - camera.eps2d, rest = f.blurred_det - f.det;
            v_uu += counts ? v_ratio * (vv * rest - f.det * camera.eps2d) / d2 : Doubles{};
            v_vv += counts ? v_ratio * (uu * rest - f.det * camera.eps2d) / d2 : Doubles{};
            v_uv += counts ? v_ratio * -2 * f.uv * rest / d2 : Doubles{};
        }
        Doubles v_jacobian[2][2] = {};
        for (int k = 0; k < 3; k++) {
            const Doubles v_root[2] = {2 * v_uu * f.root[0][k] + v_uv * f.root[1][k],
                                       2 * v_vv * f.root[1][k] + v_uv * f.root[0][k]};
            const Doubles v_axis[3] = {f.jacobian[0][0] * v_root[0], f.jacobian[1][0] * v_root[1],
                                       f.jacobian[0][1] * v_root[0] + f.jacobian[1][1] * v_root[1]};
            scale[k] = Doubles{};
            for (int i = 0; i < 3; i++) {
                scale[k] += v_axis[i] * f.turn[3 * i + k];
                turn[3 * i + k] = v_axis[i] * f.scale[k];
            }
            for (int a2 = 0; a2 < 2; a2++) {
                v_jacobian[a2][0] += v_root[a2] * f.turn[3 * a2 + k] * f.scale[k];
                v_jacobian[a2][1] += v_root[a2] * f.turn[6 + k] * f.scale[k];
            }
        }
        const double focal[2] = {camera.fx, camera.fy};
        const Doubles inverse_z = 1 / f.p[2];
        p[2] = load(v.depth + j);
        for (int a2 = 0; a2 < 2; a2++) {
            const Doubles scaled = focal[a2] * inverse_z, free = f.p[a2] * inverse_z;
            p[a2] += v_mean[a2] * scaled;
            p[2] -= v_mean[a2] * scaled * free;
            p[2] += scaled * inverse_z * (f.slope[a2] * v_jacobian[a2][1] - v_jacobian[a2][0]);
            const Doubles v_slope = -scaled * v_jacobian[a2][1];
            p[a2] = f.bounded[a2] ? p[a2] : p[a2] + v_slope * inverse_z;
            p[2] = f.bounded[a2] ? p[2] : p[2] - v_slope * free * inverse_z;
        }
    }
};

INLINE void quaternion_gradient(const Footprint& f, const Doubles* v, Doubles* v_quat) {
    const Doubles w = f.q[0], x = f.q[1], y = f.q[2], z = f.q[3];
    const Doubles g[4] = {
        2 * (x * (v[7] - v[5]) + y * (v[2] - v[6]) + z * (v[3] - v[1])),
        2 * (w * (v[7] - v[5]) + y * (v[1] + v[3]) + z * (v[2] + v[6]) - 2 * x * (v[4] + v[8])),
        2 * (w * (v[2] - v[6]) + x * (v[1] + v[3]) + z * (v[5] + v[7]) - 2 * y * (v[0] + v[8])),
        2 * (w * (v[3] - v[1]) + x * (v[2] + v[6]) + y * (v[5] + v[7]) - 2 * z * (v[0] + v[4])),
    };
    const Doubles along = g[0] * w + g[1] * x + g[2] * y + g[3] * z;
    for (int i = 0; i < 4; i++) v_quat[i] = (g[i] - along * f.q[i]) * f.inverse_norm;
}

// Writes the gradients of coefficients from those of colors, and finds those of the mean (and, negated, of the camera
// center).
inline void color_gradient(const double* center, const Layout& layout, const Batch& batch, int j,
                           Parameters<const float> in, const float* channels, const float* v_channels, float* v_sh,
                           Doubles* v_mean) {
    Doubles basis[MAX_COEFFICIENTS], along[MAX_COEFFICIENTS] = {}, v[3];
    const Direction d(center, batch, j);
    harmonics(layout.coefficients, d.n[0], d.n[1], d.n[2], basis);
    for (int l = 0; l < std::min(DOUBLES, batch.count - j); l++) {
        const size_t i = batch.id[j + l], at = i * layout.stored * 3;
        const float *channel = channels + i * layout.channels(), *v_channel = v_channels + i * layout.channels();
        const double *b = (const double*)basis + l;
        double v_color[3], *to = (double*)along + l;
        for (int c = 0; c < 3; c++) v_color[c] = channel[c] > 0 ? v_channel[c] : 0;  // the color is clamped at 0
        for (int k = 0; k < layout.coefficients; k++)
            for (int c = 0; c < 3; c++) {
                to[k * DOUBLES] += in.sh[at + 3 * k + c] * v_color[c];
                if (v_sh) v_sh[at + 3 * k + c] = float(b[k * DOUBLES] * v_color[c]);
            }
        if (v_sh) std::fill(v_sh + at + 3 * layout.coefficients, v_sh + at + 3 * layout.stored, 0.0f);
    }
    harmonics_gradient(layout.coefficients, d.n[0], d.n[1], d.n[2], along, v);
    const Doubles radial = dot(v, d.n);
    for (int k = 0; k < 3; k++) v_mean[k] = (v[k] - radial * d.n[k]) * d.inverse_norm;
}

// Adds the pose gradient of `count` Gaussians, one after the other.
inline void add_pose(const Camera& camera, const double* center, const Footprint& f, const FootprintGradient& g,
                     const Batch& batch, int j, int count, const Doubles* v_direction, PoseGradient& pose) {
    Doubles r[9], rotation[9], translation[3];
    f.rotation_of(r);
    for (int a = 0; a < 3; a++) {
        // The direction is mean - center, and the center is -inverse(rotation) translation.
        const double* w = camera.rotation + 3 * a;
        const Doubles v_center = -(w[0] * v_direction[0] + w[1] * v_direction[1] + w[2] * v_direction[2]);
        translation[a] = g.p[a] - v_center;
        for (int b = 0; b < 3; b++)
            rotation[3 * a + b] = g.p[a] * load(batch.mean[b] + j) + dot(g.turn + 3 * a, r + 3 * b) -
                                  v_center * center[b];
    }
    for (int l = 0; l < count; l++) {
        for (int k = 0; k < 9; k++) pose.rotation[k] += rotation[k][l];
        for (int k = 0; k < 3; k++) pose.translation[k] += translation[k][l];
    }
}

inline void project_batch_backward(const Camera& camera, const double* center, const Layout& layout,
                                   const Batch& batch, const BatchGradient& gradient, Parameters<const float> in,
                                   const float* channels, Projections<const float> v, Parameters<float> out,
                                   PoseGradient* pose) {
    for (int j = 0; j < batch.count; j += DOUBLES) {
        const int count = std::min(DOUBLES, batch.count - j);
        Doubles v_direction[3] = {};
        if (layout.coefficients && (out.sh || out.means))
            color_gradient(center, layout, batch, j, in, channels, v.channels, out.sh, v_direction);
        if (out.features && layout.feature_count)
            for (int l = 0; l < count; l++) {
                const size_t i = batch.id[j + l];
                memcpy(out.features + i * layout.feature_count, v.channels + i * layout.channels() + layout.colors(),
                       4 * layout.feature_count);
            }
        if (!out.means) continue;
        Footprint f;
        Footprint::make(f, camera, batch, j);
        const Doubles v_opacity = load(gradient.opacity + j), opacity = load(batch.opacity + j);
        const FootprintGradient g(camera, f, gradient, j, v_opacity * opacity);
        const Doubles v_seen = camera.antialiased ? v_opacity * f.compensation() : v_opacity;
        const double* w = camera.rotation;
        Doubles v_mean[3], v_rotation[9], v_quat[4];
        for (int i = 0; i < 3; i++) {
            v_mean[i] = w[i] * g.p[0] + w[3 + i] * g.p[1] + w[6 + i] * g.p[2] + v_direction[i];
            for (int k = 0; k < 3; k++)
                v_rotation[3 * i + k] = w[i] * g.turn[k] + w[3 + i] * g.turn[3 + k] + w[6 + i] * g.turn[6 + k];
        }
        quaternion_gradient(f, v_rotation, v_quat);
        for (int l = 0; l < count; l++) {
            const size_t i = batch.id[j + l];
            for (int k = 0; k < 3; k++) out.means[3 * i + k] = float(v_mean[k][l]);
            for (int k = 0; k < 4; k++) out.quats[4 * i + k] = float(v_quat[k][l]);
            for (int k = 0; k < 3; k++) out.scales[3 * i + k] = float(g.scale[k][l]);
            out.opacities[i] = float(v_seen[l]);
        }
        if (pose) add_pose(camera, center, f, g, batch, j, count, v_direction, *pose);
    }
}

// Fills every member of `out` that is not null; `pose` may be null. Summed in parts that do not depend on the threads.
inline void project_backward(const Camera& camera, const Layout& layout, Parameters<const float> in,
                             const int32_t* radii, const float* channels, Projections<const float> v,
                             Parameters<float> out, PoseGradient* pose, int threads) {
    const int parts = (layout.n + PART - 1) / PART;
    std::vector<PoseGradient> partial(pose ? parts : 0);
    double center[3];
    camera.center(center);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int part = 0; part < parts; part++) {
        const int end = std::min(layout.n, (part + 1) * PART);
        Batch batch;
        BatchGradient gradient;
        for (int i = part * PART; i < end; i++) {
            if (radii[2 * i] > 0) {
                gradient.take(batch.count, i, layout, v);
                batch.take(i, in.means, in.quats, in.scales, in.opacities);
                prefetch_harmonics<0>(in.sh, layout, i), prefetch_harmonics<1>(out.sh, layout, i);
            } else {
                clear(out.means, i, 1, 3), clear(out.quats, i, 1, 4), clear(out.scales, i, 1, 3);
                clear(out.opacities, i, 1, 1), clear(out.sh, i, 1, layout.stored * 3);
                clear(out.features, i, 1, layout.feature_count);
            }
            if (batch.count < Batch::ROOM && i + 1 < end) continue;
            project_batch_backward(camera, center, layout, batch, gradient, in, channels, v, out,
                                   pose ? &partial[part] : nullptr);
            batch.count = 0;
        }
    }
    for (const PoseGradient& p : partial) {
        for (int j = 0; j < 9; j++) pose->rotation[j] += p.rotation[j];
        for (int j = 0; j < 3; j++) pose->translation[j] += p.translation[j];
    }
}

}  // namespace egosplat

// Gaussians in one camera: their means and covariances in the image (Zwicker et al. 2002), in float64. A vector has one
// number of each Gaussian.
#pragma once

#include <algorithm>
#include <cmath>

#include "doubles.h"

namespace egosplat {

constexpr double FRUSTUM_MARGIN = 0.3;  // fraction of half the field of view outside the image

struct Camera {
    double rotation[9], translation[3];  // world to camera
    double fx, fy, cx, cy;
    int width, height;
    double near_plane, far_plane, radius_clip, eps2d;
    bool antialiased;

    // Camera center in the world.
    void center(double* c) const {
        for (int j = 0; j < 3; j++)
            c[j] = -(rotation[j] * translation[0] + rotation[3 + j] * translation[1] +
                     rotation[6 + j] * translation[2]);
    }

    // Bounds of x / z and of y / z, a margin outside the image.
    void slopes(double* low, double* high) const {
        const double focal[2] = {fx, fy}, principal[2] = {cx, cy}, size[2] = {double(width), double(height)};
        for (int a = 0; a < 2; a++) {
            const double margin = FRUSTUM_MARGIN * 0.5 * size[a] / focal[a];
            low[a] = -principal[a] / focal[a] - margin, high[a] = (size[a] - principal[a]) / focal[a] + margin;
        }
    }
};

// Parameters of up to ROOM Gaussians, each in an array of its own.
struct Batch {
    static constexpr int ROOM = 64;
    int count = 0;
    int32_t id[ROOM];
    alignas(64) double mean[3][ROOM] = {}, quat[4][ROOM] = {}, scale[3][ROOM] = {}, opacity[ROOM] = {};

    void take(int i, const float* means, const float* quats, const float* scales, const float* opacities) {
        const int j = count++;
        id[j] = i;
        for (int k = 0; k < 3; k++) mean[k][j] = means[3 * size_t(i) + k], scale[k][j] = scales[3 * size_t(i) + k];
        for (int k = 0; k < 4; k++) quat[k][j] = quats[4 * size_t(i) + k];
        opacity[j] = opacities[i];
    }
};

// Intermediate values of the projection.
struct Footprint {
    Doubles p[3];           // mean in the camera
    Doubles slope[2];       // x / z, y / z, bounded
    Longs bounded[2];
    Doubles q[4], inverse_norm;
    Doubles turn[9];        // camera_from_gaussian rotation
    Doubles scale[3];
    Doubles jacobian[2][2]; // by x and z, by y and z
    Doubles root[2][3];     // a square root of the covariance in the image
    Doubles uu, uv, vv, det, blurred_det;
    Longs sound;            // not of a Gaussian that is invisible because of its numbers

    // The Gaussians from place j of the batch; their z is in range.
    INLINE void make(Footprint& f, const Camera& camera, const Batch& batch, int j) {
        const double *w = camera.rotation, focal[2] = {camera.fx, camera.fy};
        const Doubles mean[3] = {load(batch.mean[0] + j), load(batch.mean[1] + j), load(batch.mean[2] + j)};
        for (int i = 0; i < 3; i++)
            f.p[i] = w[3 * i] * mean[0] + w[3 * i + 1] * mean[1] + w[3 * i + 2] * mean[2] + camera.translation[i];
        for (int i = 0; i < 4; i++) f.q[i] = load(batch.quat[i] + j);
        const Doubles norm = egosplat::root(f.q[0] * f.q[0] + f.q[1] * f.q[1] + f.q[2] * f.q[2] + f.q[3] * f.q[3]);
        f.sound = (norm > 0) & finite(norm);
        f.inverse_norm = 1 / norm;
        for (Doubles& v : f.q) v *= f.inverse_norm;
        Doubles r[9];
        f.rotation_of(r);
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                f.turn[3 * i + k] = w[3 * i] * r[k] + w[3 * i + 1] * r[3 + k] + w[3 * i + 2] * r[6 + k];
        double low[2], high[2];
        camera.slopes(low, high);
        const Doubles inverse_z = 1 / f.p[2];
        for (int a = 0; a < 2; a++) {
            const Doubles free = f.p[a] * inverse_z, least = low[a] + Doubles{}, most = high[a] + Doubles{};
            f.bounded[a] = (free < least) | (free > most);
            f.slope[a] = free < least ? least : free > most ? most : free;
            f.jacobian[a][0] = focal[a] * inverse_z, f.jacobian[a][1] = -focal[a] * f.slope[a] * inverse_z;
        }
        for (int k = 0; k < 3; k++) {
            f.scale[k] = load(batch.scale[k] + j);
            for (int a = 0; a < 2; a++)
                f.root[a][k] = (f.jacobian[a][0] * f.turn[3 * a + k] + f.jacobian[a][1] * f.turn[6 + k]) * f.scale[k];
        }
        f.uu = dot(f.root[0], f.root[0]), f.uv = dot(f.root[0], f.root[1]), f.vv = dot(f.root[1], f.root[1]);
        // Lagrange's identity: uu vv - uv^2 has no digits left for elongated Gaussians.
        Doubles normal[3];
        for (int k = 0; k < 3; k++) {
            const int next = (k + 1) % 3, last = (k + 2) % 3;
            normal[k] = f.root[0][next] * f.root[1][last] - f.root[0][last] * f.root[1][next];
        }
        f.det = dot(normal, normal);
        f.blurred_det = f.det + camera.eps2d * (f.uu + f.vv) + camera.eps2d * camera.eps2d;
        f.uu += camera.eps2d, f.vv += camera.eps2d;
        f.sound &= (f.blurred_det > 0) & finite(f.blurred_det);
    }

    inline Doubles compensation() const { return egosplat::root(det / blurred_det); }

    inline void rotation_of(Doubles* r) const {
        const Doubles w = q[0], x = q[1], y = q[2], z = q[3];
        r[0] = 1 - 2 * (y * y + z * z), r[1] = 2 * (x * y - w * z), r[2] = 2 * (x * z + w * y);
        r[3] = 2 * (x * y + w * z), r[4] = 1 - 2 * (x * x + z * z), r[5] = 2 * (y * z - w * x);
        r[6] = 2 * (x * z - w * y), r[7] = 2 * (y * z + w * x), r[8] = 1 - 2 * (x * x + y * y);
    }
};

// Unit vectors from the camera to Gaussians.
struct Direction {
    Doubles n[3], inverse_norm;

    Direction(const double* center, const Batch& batch, int j) {
        for (int i = 0; i < 3; i++) n[i] = load(batch.mean[i] + j) - center[i];
        const Doubles norm = root(dot(n, n));
        inverse_norm = norm > 0 ? 1 / norm : Doubles{};
        for (Doubles& v : n) v *= inverse_norm;
    }
};

}  // namespace egosplat

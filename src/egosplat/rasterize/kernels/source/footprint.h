// One Gaussian in one camera: its mean and covariance in the image (Zwicker et al. 2002), in float64.
#pragma once

#include <algorithm>
#include <cmath>

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
};

// Intermediate values of the projection of one Gaussian.
struct Footprint {
    double p[3];           // mean in the camera
    double slope[2];       // x / z, y / z, bounded
    bool bounded[2];
    double q[4], inverse_norm;
    double turn[9];        // camera_from_gaussian rotation
    double scale[3];
    double jacobian[2][3];
    double root[2][3];     // a square root of the covariance in the image
    double uu, uv, vv, det, blurred_det;

    // Returns false if the Gaussian is invisible.
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
        // Lagrange's identity: uu vv - uv^2 has no digits left for elongated Gaussians.
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

    Direction(const double* center, const float* mean) {
        for (int i = 0; i < 3; i++) n[i] = mean[i] - center[i];
        const double norm = std::sqrt(Footprint::dot(n, n));
        inverse_norm = norm > 0 ? 1 / norm : 0;
        for (double& v : n) v *= inverse_norm;
    }
};

}  // namespace egosplat

// Real spherical harmonics up to degree 3, with the order and signs of 3DGS.
#pragma once

#include "doubles.h"

namespace egosplat {

constexpr int MAX_COEFFICIENTS = 16;

// b[k], k < coefficients, at the unit vectors (x, y, z).
INLINE void harmonics(int coefficients, Doubles x, Doubles y, Doubles z, Doubles* b) {
    const Doubles xx = x * x, yy = y * y, zz = z * z;
    b[0] = 0.28209479177387814 + Doubles{};
    if (coefficients < 4) return;
    b[1] = -0.4886025119029199 * y;
    b[2] = 0.4886025119029199 * z;
    b[3] = -0.4886025119029199 * x;
    if (coefficients < 9) return;
    b[4] = 1.0925484305920792 * x * y;
    b[5] = -1.0925484305920792 * y * z;
    b[6] = 0.31539156525252005 * (2 * zz - xx - yy);
    b[7] = -1.0925484305920792 * x * z;
    b[8] = 0.5462742152960396 * (xx - yy);
    if (coefficients < 16) return;
    b[9] = -0.5900435899266435 * y * (3 * xx - yy);
    b[10] = 2.890611442640554 * x * y * z;
    b[11] = -0.4570457994644658 * y * (4 * zz - xx - yy);
    b[12] = 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy);
    b[13] = -0.4570457994644658 * x * (4 * zz - xx - yy);
    b[14] = 1.445305721320277 * z * (xx - yy);
    b[15] = -0.5900435899266435 * x * (xx - 3 * yy);
}

// v = sum_k s[k] d b[k] / d (x, y, z)
INLINE void harmonics_gradient(int coefficients, Doubles x, Doubles y, Doubles z, const Doubles* s, Doubles* v) {
    v[0] = v[1] = v[2] = Doubles{};
    if (coefficients < 4) return;
    v[0] -= 0.4886025119029199 * s[3];
    v[1] -= 0.4886025119029199 * s[1];
    v[2] += 0.4886025119029199 * s[2];
    if (coefficients < 9) return;
    const double a = 1.0925484305920792, b = 2 * 0.31539156525252005;
    v[0] += a * (y * s[4] - z * s[7] + x * s[8]) - b * x * s[6];
    v[1] += a * (x * s[4] - z * s[5] - y * s[8]) - b * y * s[6];
    v[2] += -a * (y * s[5] + x * s[7]) + 2 * b * z * s[6];
    if (coefficients < 16) return;
    const Doubles xx = x * x, yy = y * y, zz = z * z;
    const double c = 0.5900435899266435, d = 2.890611442640554, e = 0.4570457994644658, f = 0.3731763325901154;
    v[0] += -6 * c * x * y * s[9] + d * y * z * s[10] + 2 * e * x * y * s[11] - 6 * f * x * z * s[12] -
            e * (4 * zz - 3 * xx - yy) * s[13] + d * x * z * s[14] - 3 * c * (xx - yy) * s[15];
    v[1] += -3 * c * (xx - yy) * s[9] + d * x * z * s[10] - e * (4 * zz - xx - 3 * yy) * s[11] - 6 * f * y * z * s[12] +
            2 * e * x * y * s[13] - d * y * z * s[14] + 6 * c * x * y * s[15];
    v[2] += d * x * y * s[10] - 8 * e * y * z * s[11] + 3 * f * (2 * zz - xx - yy) * s[12] - 8 * e * x * z * s[13] +
            0.5 * d * (xx - yy) * s[14];
}

}  // namespace egosplat

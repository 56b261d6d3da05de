// Intersection of a ray with a triangle, in float64.
//
// Woop, Benthin and Wald, Watertight Ray/Triangle Intersection, 2013: the axes are sheared so that the ray becomes
// the third one. Two triangles compute their shared edge with the same products, so no ray passes between them.
#pragma once

#include <cmath>
#include <cstdint>
#include <utility>

namespace rays {

struct Hit {
    double distance;  // along the ray
    double u, v;      // weights of the second and of the third corner
    int32_t face;     // -1: none
};

struct Triangle {
    float corners[3][3];
    int32_t face;
};

struct Ray {
    double origin[3], shear[3];
    int x, y, z;  // z: the axis along which the ray is longest

    Ray(const float* from, const float* direction) : z(0) {
        for (int axis = 0; axis < 3; axis++) {
            origin[axis] = from[axis];
            if (std::fabs(direction[axis]) > std::fabs(direction[z])) z = axis;
        }
        x = (z + 1) % 3, y = (z + 2) % 3;
        if (direction[z] < 0) std::swap(x, y);
        shear[2] = 1.0 / direction[z];
        shear[0] = direction[x] * shear[2];
        shear[1] = direction[y] * shear[2];
    }
};

// Replaces `best` by the hit of the triangle if that is nearer. Among equally near hits the first face wins, so the
// result does not depend on the order in which triangles are tested.
inline void meet(const Ray& ray, const Triangle& triangle, Hit& best) {
    double px[3], py[3], pz[3];
    for (int k = 0; k < 3; k++) {
        const float* corner = triangle.corners[k];
        const double depth = corner[ray.z] - ray.origin[ray.z];
        px[k] = corner[ray.x] - ray.origin[ray.x] - ray.shear[0] * depth;
        py[k] = corner[ray.y] - ray.origin[ray.y] - ray.shear[1] * depth;
        pz[k] = ray.shear[2] * depth;
    }
    const double first = px[2] * py[1] - py[2] * px[1];
    const double second = px[0] * py[2] - py[0] * px[2];
    const double third = px[1] * py[0] - py[1] * px[0];
    if ((first < 0 || second < 0 || third < 0) && (first > 0 || second > 0 || third > 0)) return;
    const double sum = first + second + third;
    if (sum == 0) return;
    const double distance = (first * pz[0] + second * pz[1] + third * pz[2]) / sum;
    if (!(distance > 0 && distance <= best.distance)) return;
    if (distance == best.distance && best.face >= 0 && best.face < triangle.face) return;
    best = {distance, second / sum, third / sum, triangle.face};
}

}  // namespace rays

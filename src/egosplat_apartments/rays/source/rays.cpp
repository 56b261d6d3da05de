// Ray casting against triangles, with the same result on every processor.
//
// Only additions, multiplications, divisions and comparisons decide; IEEE 754 defines them to the last bit. Compiled
// with -ffp-contract=off, because a fused multiply-add rounds once instead of twice.
#include "tree.h"

#ifdef __FAST_MATH__
#error "rays must be compiled without -ffast-math"
#endif

using rays::Hit;
using rays::Tree;

extern "C" {

const char* rays_source_hash() { return EGOSPLAT_SOURCE_HASH; }

// (V, 3) vertices, (F, 3) vertex numbers. Returns null if out of memory.
void* rays_build(const float* vertices, const int32_t* faces, int64_t count) {
    try {
        return new Tree(vertices, faces, count);
    } catch (...) {
        return nullptr;
    }
}

void rays_free(void* tree) { delete static_cast<Tree*>(tree); }

// Casts rays from origins + i * stride along (N, 3) directions.
void rays_cast(const void* tree, int64_t count, const float* origins, int64_t stride, const float* directions, int32_t* face,
               float* distance, float* u, float* v) {
    for (int64_t i = 0; i < count; i++) {
        const Hit hit = static_cast<const Tree*>(tree)->cast(
            origins + stride * i, directions + 3 * i, std::numeric_limits<double>::infinity(), false);
        face[i] = hit.face;
        distance[i] = float(hit.distance), u[i] = float(hit.u), v[i] = float(hit.v);
    }
}

// Tests whether each ray hits anything within its reach.
void rays_blocked(const void* tree, int64_t count, const float* origins, int64_t stride, const float* directions,
                  const float* reach, uint8_t* blocked) {
    for (int64_t i = 0; i < count; i++) {
        const Hit hit = static_cast<const Tree*>(tree)->cast(origins + stride * i, directions + 3 * i, reach[i], true);
        blocked[i] = hit.face >= 0;
    }
}
}

// One column of a band: the Gaussians that reach a tile, and the tile's pixels in planar images.
#pragma once

#include "tiles.h"

namespace egosplat {

// The Gaussians of one tile as the rows of a band need them, relative to the corner of the tile.
struct Column {
    std::vector<float> l11, l21, l22, u0, v0, log2_opacity;
    std::vector<int32_t> member;
    std::vector<const float*> color;
    int count = 0;

    void fill(const Tiles& tiles, int band, int tile, const float* colors, int stride) {
        const int32_t* begin = tiles.tile_begin[band].data() + tile;
        const int32_t* entries = tiles.entries[band].data() + begin[0];
        count = begin[1] - begin[0];
        const size_t room = padded(count);
        for (auto* v : {&l11, &l21, &l22, &u0, &v0, &log2_opacity})
            if (v->size() < room) v->resize(2 * room);
        if (member.size() < room) member.resize(2 * room), color.resize(2 * room);
        const float left = float(tile * LANES), top = float(band * ROWS);
        for (int k = 0; k < count; k++) {
            const int m = member[k] = entries[k] + tiles.band_begin[band];
            const Splat& s = tiles.splats[tiles.members[m]];
            l11[k] = s.l11, l21[k] = s.l21, l22[k] = s.l22, log2_opacity[k] = s.log2_opacity;
            u0[k] = s.l11 * (left - s.mx) + s.l21 * (top - s.my);
            v0[k] = s.l22 * (top - s.my);
            color[k] = colors + size_t(tiles.members[m]) * stride;
        }
        // The padding reaches no row.
        for (size_t k = count; k < room; k++) l11[k] = l21[k] = l22[k] = u0[k] = v0[k] = 0, log2_opacity[k] = -1e9f;
    }
};

// Whether the ellipse reaches pixels of the row: `exponent` minus the smallest u^2 there exceeds that of MIN_ALPHA.
INLINE Mask reaches(Floats l11, Floats u, Floats exponent) {
    const Floats first = fma(l11, broadcast(0.5f), u), last = fma(l11, broadcast(LANES - 0.5f), u);
    const Floats nearest = max(max(first, -last), Floats{});
    return at_least(fnma(nearest, nearest, exponent), broadcast(LOG2_MIN_ALPHA - SLACK));
}

struct Image {
    float* data;
    int width, height;

    float* at(int c, int y, int x) const { return data + (size_t(c) * height + y) * width + x; }
    // Prefetches the next tile. The rows of all planes are more streams than the hardware prefetcher follows.
    // Always inlined, because GCC drops calls of a function that only prefetches.
    template <int WRITE>
    inline __attribute__((always_inline)) void prefetch(int c, int band, int tile) const {
        const int rows = std::min(ROWS, height - band * ROWS), x = std::min(tile * LANES, width - 1);
        for (int r = 0; r < rows; r++) __builtin_prefetch(at(c, band * ROWS + r, x), WRITE, 2);
    }
    INLINE Floats read(const float* p, int n) {
        if (n >= LANES) return load(p);
        Floats v = {};
        for (int i = 0; i < n; i++) v[i] = p[i];
        return v;
    }
    INLINE void write(float* p, int n, Floats v) {
        if (n >= LANES) return store(p, v);
        for (int i = 0; i < n; i++) p[i] = v[i];
    }
};

}  // namespace egosplat

// The compositing weights of single pixels, by the rules of composite.h.
#pragma once

#include "tiles.h"

namespace egosplat {

// Calls call(id of the Gaussian, weight) for what the pixel shows, nearest first.
template <class Call>
void visit_pixel(const Tiles& tiles, int x, int y, Call call) {
    const int band = y / ROWS, tile = x / LANES;
    const int32_t* begin = tiles.tile_begin[band].data() + tile;
    const int32_t* members = &tiles.members[tiles.band_begin[band]];
    float left = 1.0f;
    for (int k = begin[0]; k < begin[1]; k++) {
        const Splat& s = tiles.splats[members[tiles.entries[band][k]]];
        const float dx = x + 0.5f - s.mx, dy = y + 0.5f - s.my;
        const float u = s.l11 * dx + s.l21 * dy, v = s.l22 * dy;
        const float exponent = s.log2_opacity - u * u - v * v;
        if (!(exponent >= LOG2_MIN_ALPHA)) continue;
        const float alpha = std::min(std::exp2(exponent), MAX_ALPHA), rest = left * (1.0f - alpha);
        if (rest <= MIN_TRANSMITTANCE) return;
        call(s.id, left * alpha);
        left = rest;
    }
}

// Lists the weights of pixels (count, 2), column and row. begin (count + 1) is always filled; ids and weights have room
// for `room` numbers, and are filled only if all fit.
inline void pixel_weights(int n, int width, int height, int threads, const float* means, const float* conics,
                          const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                          int count, const int32_t* pixels, int64_t room, int64_t* begin, int64_t* ids,
                          float* weights) {
    Tiles tiles;
    fill_tiles(tiles, n, width, height, means, conics, spreads, opacities, depths, radii, threads);
    begin[0] = 0;
#pragma omp parallel for schedule(dynamic, 64) num_threads(threads)
    for (int p = 0; p < count; p++) {
        int64_t found = 0;
        visit_pixel(tiles, pixels[2 * p], pixels[2 * p + 1], [&](int32_t, float) { found++; });
        begin[p + 1] = found;
    }
    for (int p = 0; p < count; p++) begin[p + 1] += begin[p];
    if (begin[count] > room) return;
#pragma omp parallel for schedule(dynamic, 64) num_threads(threads)
    for (int p = 0; p < count; p++) {
        int64_t at = begin[p];
        visit_pixel(tiles, pixels[2 * p], pixels[2 * p + 1],
                    [&](int32_t id, float weight) { ids[at] = id, weights[at++] = weight; });
    }
}

}  // namespace egosplat

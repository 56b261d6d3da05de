// Compositing of values of which a Gaussian has few that are not 0, by the rules of composite.h.
#pragma once

#include "composite.h"

namespace egosplat {

// The values of Gaussian i are value[begin[i]] to value[begin[i + 1] - 1], of the channels `channel`.
struct SparseValues {
    const int64_t *begin, *channel;
    const float* value;
};

// render (channels, height, width), zero on entry.
inline void sparse_render(int n, int width, int height, int threads, const float* means, const float* conics,
                          const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                          SparseValues values, float* render) {
    Tiles tiles;
    fill_tiles(tiles, n, width, height, means, conics, spreads, opacities, depths, radii, threads);
    const Image image = {render, width, height};
    for_tiles(tiles, threads, [&](const Column& column, RowList& list, int band, int tile) {
        const int x = tile * LANES, n_pixels = width - x, rows = std::min(ROWS, height - band * ROWS);
        const Floats T = where(at_least(broadcast(n_pixels - 0.5f), ramp()), broadcast(1.0f));
        for (int row = 0; row < rows; row++)
            visit_row(column, list, row, T, [&](int k, Floats w) {
                const int id = tiles.id_of(column.member[k]);
                for (int64_t v = values.begin[id]; v < values.begin[id + 1]; v++) {
                    float* at = image.at(int(values.channel[v]), band * ROWS + row, x);
                    Image::write(at, n_pixels, fma(w, broadcast(values.value[v]), Image::read(at, n_pixels)));
                }
            });
    });
}

}  // namespace egosplat

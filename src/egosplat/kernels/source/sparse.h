// Compositing of values of which a Gaussian has few that are not 0, by the rules of composite.h.
#pragma once

#include "composite.h"

namespace egosplat {

// The values of Gaussian i are value[begin[i]] to value[begin[i + 1] - 1], of the channels `channel`.
struct SparseValues {
    const int64_t *begin, *channel;
    const float* value;
};

// As forward_row, but a Gaussian is added to the planes of its own channels alone.
inline void sparse_row(const Tiles& tiles, const Column& column, RowList& list, int row, int x, int y,
                       SparseValues values, Image render) {
    const int n = tiles.width - x;
    Floats alphas[BLOCK], T = where(at_least(broadcast(n - 0.5f), ramp()), broadcast(1.0f));
    for (int begin = 0; begin < column.count; begin += BLOCK) {
        list.fill(column, begin, std::min(begin + BLOCK, padded(column.count)), row + 0.5f);
        alphas_of(list, alphas);
        for (int j = 0; j < list.count; j++) {
            const int id = tiles.splats[tiles.members[column.member[list.place_of(j)]]].id;
            const Floats weight = T * alphas[j];
            T = max(T * (1.0f - alphas[j]), broadcast(LEAST_TRANSMITTANCE));
            const Mask kept = above(T, broadcast(MIN_TRANSMITTANCE));
            const Floats w = where(kept, weight);
            for (int64_t k = values.begin[id]; k < values.begin[id + 1]; k++) {
                float* pixels = render.at(int(values.channel[k]), y, x);
                Image::write(pixels, n, fma(w, broadcast(values.value[k]), Image::read(pixels, n)));
            }
            if (!any(kept)) return;
        }
    }
}

// render (channels, height, width), zero on entry.
inline void sparse_render(int n, int width, int height, int threads, const float* means, const float* conics,
                          const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                          SparseValues values, float* render) {
    Tiles tiles;
    fill_tiles(tiles, n, width, height, means, conics, spreads, opacities, depths, radii, threads);
#pragma omp parallel num_threads(threads)
    {
        Column column;
        RowList list;
#pragma omp for schedule(dynamic)
        for (int band = 0; band < tiles.bands; band++)
            for (int tile = 0; tile < tiles.columns; tile++) {
                column.fill(tiles, band, tile, nullptr, 0);
                for (int row = 0; row < std::min(ROWS, height - band * ROWS); row++)
                    sparse_row(tiles, column, list, row, tile * LANES, band * ROWS + row, values,
                               {render, width, height});
            }
    }
}

}  // namespace egosplat

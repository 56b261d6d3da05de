// The compositing weight of each Gaussian at one pixel of its own, by the rules of composite.h.
#pragma once

#include "composite.h"

namespace egosplat {

// The pixels of the Gaussians of a column: row and lane within its tile, -1 outside.
struct OwnPixels {
    std::vector<int32_t> row, lane;

    // pixels (n, 2), column and row.
    void fill(const Tiles& tiles, const Column& column, int band, int tile, const int32_t* pixels) {
        row.assign(column.count, -1), lane.assign(column.count, -1);
        // The last tiles reach beyond the image.
        const int width = std::min(LANES, tiles.width - tile * LANES);
        const int height = std::min(ROWS, tiles.height - band * ROWS);
        for (int k = 0; k < column.count; k++) {
            const int32_t* pixel = pixels + 2 * size_t(tiles.splats[tiles.members[column.member[k]]].id);
            const int x = pixel[0] - tile * LANES, y = pixel[1] - band * ROWS;
            if (x >= 0 && x < width && y >= 0 && y < height) row[k] = y, lane[k] = x;
        }
    }
};

// As forward_row without colours.
inline void own_weights_row(const Tiles& tiles, const Column& column, const OwnPixels& own, RowList& list, int row,
                            float* weights) {
    Floats alphas[BLOCK], T = broadcast(1.0f);
    for (int begin = 0; begin < column.count; begin += BLOCK) {
        list.fill(column, begin, std::min(begin + BLOCK, padded(column.count)), row + 0.5f);
        alphas_of(list, alphas);
        for (int j = 0; j < list.count; j++) {
            const int k = list.place_of(j);
            const Floats weight = T * alphas[j];
            T = max(T * (1.0f - alphas[j]), broadcast(LEAST_TRANSMITTANCE));
            const Mask kept = above(T, broadcast(MIN_TRANSMITTANCE));
            if (own.row[k] == row)
                weights[tiles.splats[tiles.members[column.member[k]]].id] = where(kept, weight)[own.lane[k]];
            if (!any(kept)) return;
        }
    }
}

// weights (n,), zero on entry. pixels (n, 2), column and row; outside the image for no pixel.
inline void own_weights(int n, int width, int height, int threads, const float* means, const float* conics,
                        const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                        const int32_t* pixels, float* weights) {
    Tiles tiles;
    fill_tiles(tiles, n, width, height, means, conics, spreads, opacities, depths, radii, threads);
#pragma omp parallel num_threads(threads)
    {
        Column column;
        OwnPixels own;
        RowList list;
#pragma omp for schedule(dynamic)
        for (int band = 0; band < tiles.bands; band++)
            for (int tile = 0; tile < tiles.columns; tile++) {
                column.fill(tiles, band, tile, nullptr, 0);
                own.fill(tiles, column, band, tile, pixels);
                for (int row = 0; row < ROWS; row++)
                    if (std::find(own.row.begin(), own.row.end(), row) != own.row.end())
                        own_weights_row(tiles, column, own, list, row, weights);
            }
    }
}

}  // namespace egosplat

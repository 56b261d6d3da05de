// The compositing weight of each Gaussian at one pixel of its own, by the rules of composite.h.
#pragma once

#include "composite.h"

namespace egosplat {

// The pixels of the Gaussians of a column: row and lane within its tile, -1 outside.
struct OwnPixels {
    std::vector<int32_t> row, lane;

    // pixels (n, 2), column and row.
    OwnPixels(const Tiles& tiles, const Column& column, int band, int tile, const int32_t* pixels)
        : row(column.count, -1), lane(column.count, -1) {
        // The last tiles reach beyond the image.
        const int width = std::min(LANES, tiles.width - tile * LANES);
        const int height = std::min(ROWS, tiles.height - band * ROWS);
        for (int k = 0; k < column.count; k++) {
            const int32_t* pixel = pixels + 2 * size_t(tiles.id_of(column.member[k]));
            const int x = pixel[0] - tile * LANES, y = pixel[1] - band * ROWS;
            if (x >= 0 && x < width && y >= 0 && y < height) row[k] = y, lane[k] = x;
        }
    }

    bool any_in(int wanted) const { return std::find(row.begin(), row.end(), wanted) != row.end(); }
};

// weights (n,), zero on entry. pixels (n, 2), column and row; outside the image for no pixel.
inline void own_weights(int n, int width, int height, int threads, const float* means, const float* conics,
                        const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                        const int32_t* pixels, float* weights) {
    Tiles tiles;
    fill_tiles(tiles, n, width, height, means, conics, spreads, opacities, depths, radii, threads);
    for_tiles(tiles, threads, [&](const Column& column, RowList& list, int band, int tile) {
        const OwnPixels own(tiles, column, band, tile, pixels);
        for (int row = 0; row < ROWS; row++) {
            if (!own.any_in(row)) continue;
            visit_row(column, list, row, broadcast(1.0f), [&](int k, Floats w) {
                if (own.row[k] == row) weights[tiles.id_of(column.member[k])] = w[own.lane[k]];
            });
        }
    });
}

}  // namespace egosplat

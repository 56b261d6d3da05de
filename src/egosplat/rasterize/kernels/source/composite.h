// Compositing of projected Gaussians.
//
// For each pixel, front to back: alpha_i = min(MAX_ALPHA, opacity_i 2^-(u^2 + v^2)), weight w_i = T_i alpha_i and
// T_{i+1} = T_i (1 - alpha_i). A Gaussian with alpha_i < MIN_ALPHA is skipped. The first one that would leave
// T <= MIN_TRANSMITTANCE is not composited and ends the pixel. The render is sum_i w_i c_i + T_end background.
#pragma once

#include "column.h"

namespace egosplat {

constexpr int BLOCK = 64;  // Gaussians per chunk of a row's list
// Keeps the transmittance behind an opaque pixel from becoming subnormal, which is slow.
constexpr float LEAST_TRANSMITTANCE = 1e-30f;

// The Gaussians of a column that reach one row.
struct RowList {
    alignas(64) float l11[BLOCK + LANES], u[BLOCK + LANES], exponent[BLOCK + LANES], place[BLOCK + LANES];
    int count;

    void fill(const Column& column, int begin, int end, float y) {
        count = 0;
        const Floats row = broadcast(y);
        Ints k_lanes = int_ramp() + begin;
        for (int k = begin; k < end; k += LANES, k_lanes += LANES) {
            const Floats l = load(&column.l11[k]);
            const Floats v_ = fma(load(&column.l22[k]), row, load(&column.v0[k]));
            const Floats e = fnma(v_, v_, load(&column.log2_opacity[k]));
            const Floats u_ = fma(load(&column.l21[k]), row, load(&column.u0[k]));
            const Mask in = reaches(l, u_, e);
            store(l11 + count, compress(in, l));
            store(u + count, compress(in, u_));
            store(exponent + count, compress(in, e));
            store(place + count, compress(in, (Floats)k_lanes));
            count += __builtin_popcount(bits(in));
        }
    }

    int place_of(int j) const {
        int32_t k;
        memcpy(&k, place + j, 4);
        return k;
    }
};

// The alpha of each Gaussian of a list at the pixels of its row, 0 below MIN_ALPHA. A separate loop, so that
// consecutive exponentials overlap; in `forward_row` the sums occupy the registers that this needs.
INLINE void alphas_of(const RowList& list, Floats* alphas) {
    const Floats px = ramp() + 0.5f;
    for (int j = 0; j < list.count; j++) {
        const Floats u = fma(px, broadcast(list.l11[j]), broadcast(list.u[j]));
        const Floats e = fnma(u, u, broadcast(list.exponent[j]));
        alphas[j] = min(exp2(at_least(e, broadcast(LOG2_MIN_ALPHA)), e), broadcast(MAX_ALPHA));
    }
}

// Composites one row of a tile. No flag marks where a pixel has ended: T never rises, so once a Gaussian would leave
// it at or below MIN_TRANSMITTANCE, all later ones would too.
template <int C>
INLINE void forward_row(const Column& column, RowList& list, int row, Floats (&color)[C], Floats& left) {
    Floats alphas[BLOCK], T = left;
    for (int c = 0; c < C; c++) color[c] = Floats{};
    for (int begin = 0; begin < column.count; begin += BLOCK) {
        list.fill(column, begin, std::min(begin + BLOCK, padded(column.count)), row + 0.5f);
        alphas_of(list, alphas);
        for (int j = 0; j < list.count; j++) {
            const int k = list.place_of(j);
            const float* c_k = column.color[k];
            const Floats weight = T * alphas[j];
            T = max(T * (1.0f - alphas[j]), broadcast(LEAST_TRANSMITTANCE));
            const Mask kept = above(T, broadcast(MIN_TRANSMITTANCE));
            const Floats w = where(kept, weight);
            left = where(kept, T, left);
            for (int c = 0; c < C; c++) color[c] = fma(w, broadcast(c_k[c]), color[c]);
            if (!any(kept)) return;
        }
    }
}

// As forward_row without colors: calls call(place in the column, weights at the pixels of the row), nearest first.
template <class Call>
INLINE void visit_row(const Column& column, RowList& list, int row, Floats T, Call call) {
    Floats alphas[BLOCK];
    for (int begin = 0; begin < column.count; begin += BLOCK) {
        list.fill(column, begin, std::min(begin + BLOCK, padded(column.count)), row + 0.5f);
        alphas_of(list, alphas);
        for (int j = 0; j < list.count; j++) {
            const Floats weight = T * alphas[j];
            T = max(T * (1.0f - alphas[j]), broadcast(LEAST_TRANSMITTANCE));
            const Mask kept = above(T, broadcast(MIN_TRANSMITTANCE));
            call(list.place_of(j), where(kept, weight));
            if (!any(kept)) return;
        }
    }
}

// Calls call(column, list, band, tile) for each tile; the bands are divided among threads.
template <class Call>
void for_tiles(const Tiles& tiles, int threads, Call call) {
#pragma omp parallel num_threads(threads)
    {
        Column column;
        RowList list;
#pragma omp for schedule(dynamic)
        for (int band = 0; band < tiles.bands; band++)
            for (int tile = 0; tile < tiles.columns; tile++) {
                column.fill(tiles, band, tile, nullptr, 0);
                call(column, list, band, tile);
            }
    }
}

// render (C, H, W) and alpha (H, W) of one band.
template <int C>
void forward_band(const Tiles& tiles, int band, const float* colors, int stride, const float* background, Image render,
                  Image alpha, Column& column) {
    RowList list;
    Floats color[ROWS][C], T[ROWS];
    for (int tile = 0; tile < tiles.columns; tile++) {
        column.fill(tiles, band, tile, colors, stride);
        const int x = tile * LANES, n = tiles.width - x, rows = std::min(ROWS, tiles.height - band * ROWS);
        for (int c = 0; c < C; c++) render.prefetch<1>(c, band, tile + 1);
        for (int r = 0; r < rows; r++) {
            T[r] = where(at_least(broadcast(n - 0.5f), ramp()), broadcast(1.0f));
            forward_row<C>(column, list, r, color[r], T[r]);
        }
        // Plane by plane, because the planes of one pixel often share a cache set.
        for (int r = 0; r < rows; r++) Image::write(alpha.at(0, band * ROWS + r, x), n, 1.0f - T[r]);
        for (int c = 0; c < C; c++)
            for (int r = 0; r < rows; r++)
                Image::write(render.at(c, band * ROWS + r, x), n,
                             background ? fma(T[r], broadcast(background[c]), color[r][c]) : color[r][c]);
    }
}

}  // namespace egosplat

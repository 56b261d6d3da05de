// The gradients of compositing (composite.h).
//
// Also front to back: the contribution from behind a Gaussian is the total of the pixel minus what came before, so the
// forward pass stores nothing but the render itself.
#pragma once

#include "composite.h"

namespace egosplat {

constexpr int MOMENTS = 6;  // sums of v {1, dx, dy, dx^2, dx dy, dy^2}, v = alpha dL/dalpha

// The rows of a tile that a Gaussian reaches, with its exponent, u and distance there.
struct Rows {
    alignas(64) float exponent[ROWS], u[ROWS], dy[ROWS], dy2[ROWS];
    uint32_t reached = 0;

    INLINE void fill(Rows& rows, const Column& column, int k, float dy0) {
        rows.reached = 0;
        for (int r = 0; r < ROWS; r += LANES) {
            const Floats row = ramp() + (r + 0.5f), l11 = broadcast(column.l11[k]);
            const Floats v = fma(broadcast(column.l22[k]), row, broadcast(column.v0[k]));
            const Floats e = fnma(v, v, broadcast(column.log2_opacity[k]));
            const Floats u_ = fma(broadcast(column.l21[k]), row, broadcast(column.u0[k]));
            const Floats d = row + dy0;
            rows.reached |= bits(reaches(l11, u_, e)) << r;
            store(rows.exponent + r, e), store(rows.u + r, u_), store(rows.dy + r, d), store(rows.dy2 + r, d * d);
        }
    }
};

// The pixels of a tile: transmittance so far, the remaining part of dL/drender . render, and dL/drender.
template <int C>
struct Pixels {
    Floats T[ROWS], rest[ROWS], gradient[ROWS][C];
    uint32_t rows;  // those with a gradient; the others, such as those outside the lens circle, would add zeros

    template <bool GEOMETRY>
    void fill(const Tiles& tiles, int band, int tile, Image render, Image alpha, Image v_render, Image v_alpha) {
        const int x = tile * LANES, n = tiles.width - x;
        const Floats one = where(at_least(broadcast(n - 0.5f), ramp()), broadcast(1.0f));
        const int count = std::min(ROWS, tiles.height - band * ROWS);
        Mask given[ROWS];
        for (int r = 0; r < count; r++) {
            const int y = band * ROWS + r;
            T[r] = one, rest[r] = Floats{}, given[r] = Mask{};
            if (GEOMETRY && v_alpha.data) {
                const Floats v = Image::read(v_alpha.at(0, y, x), n);
                rest[r] = v * (Image::read(alpha.at(0, y, x), n) - 1.0f), given[r] = differs(v, Floats{});
            }
        }
        for (int c = 0; c < C; c++)
            for (int r = 0; r < count; r++) {
                const int y = band * ROWS + r;
                gradient[r][c] = Image::read(v_render.at(c, y, x), n);
                given[r] |= differs(gradient[r][c], Floats{});
                if (GEOMETRY) rest[r] = fma(gradient[r][c], Image::read(render.at(c, y, x), n), rest[r]);
            }
        rows = 0;
        for (int r = 0; r < count; r++) rows |= uint32_t(any(given[r])) << r;
    }
};

// Sum of g_c color_c, in four independent chains.
template <int C>
INLINE Floats dot(const Floats* g, const float* color) {
    Floats part[4] = {};
    for (int c = 0; c < C; c++) part[c % 4] = fma(g[c], broadcast(color[c]), part[c % 4]);
    const Floats sum = C > 1 ? part[0] + part[1] : part[0];
    return C > 3 ? sum + (part[2] + part[3]) : C > 2 ? sum + part[2] : sum;
}

// Adds the contribution of one tile to `slots`, padded(MOMENTS + C) floats for each member of the band: the moments
// and dL/dcolor, or dL/dcolor alone if the geometry is frozen.
template <int C, bool GEOMETRY>
void backward_tile(const Tiles& tiles, const Column& column, Pixels<C>& pixels, int left, int top, float* slots,
                   int slot_stride) {
    constexpr int M = GEOMETRY ? MOMENTS : 0;
    const Floats px = ramp() + 0.5f;
    Rows rows;
    Floats raw[ROWS], scale[ROWS], v_over_scale[ROWS];
    uint32_t alive = pixels.rows;
    for (int k = 0; k < column.count && alive; k++) {
        const Splat& splat = tiles.splats[tiles.members[column.member[k]]];
        Rows::fill(rows, column, k, top - splat.my);
        const uint32_t reached = rows.reached & alive;
        if (!reached) continue;
        const Floats l11 = broadcast(column.l11[k]);
        for (uint32_t todo = reached; todo; todo &= todo - 1) {
            const int r = __builtin_ctz(todo);
            const Floats u = fma(px, l11, broadcast(rows.u[r]));
            const Floats e = fnma(u, u, broadcast(rows.exponent[r]));
            raw[r] = exp2(at_least(e, broadcast(LOG2_MIN_ALPHA)), e);
        }
        const float* color = column.color[k];
        Floats sums[M + C], m0 = {}, m1 = {}, m2 = {};
        for (int c = 0; c < C; c++) sums[M + c] = Floats{};
        for (uint32_t todo = reached; todo; todo &= todo - 1) {
            const int r = __builtin_ctz(todo);
            const Floats a = min(raw[r], broadcast(MAX_ALPHA)), T = pixels.T[r];
            const Floats through = 1.0f - a, after = max(T * through, broadcast(LEAST_TRANSMITTANCE));
            const Mask kept = above(after, broadcast(MIN_TRANSMITTANCE));
            const Floats weight = where(kept, a * T);
            pixels.T[r] = after;
            if (!any(kept)) alive &= ~(1u << r);
            const Floats* g = pixels.gradient[r];
            for (int c = 0; c < C; c++) sums[M + c] = fma(weight, g[c], sums[M + c]);
            if constexpr (GEOMETRY) {
                const Floats q = dot<C>(g, color), rest = fnma(weight, q, pixels.rest[r]);
                pixels.rest[r] = rest;
                // 0 where the Gaussian is skipped or alpha is at its bound
                scale[r] = where(at_least(kept, broadcast(MAX_ALPHA), raw[r]), a * reciprocal(through));
                v_over_scale[r] = after * q - rest;
            }
        }
        if constexpr (GEOMETRY)
            for (uint32_t todo = reached; todo; todo &= todo - 1) {
                const int r = __builtin_ctz(todo);
                const Floats v = scale[r] * v_over_scale[r];
                m0 += v;
                m1 = fma(v, broadcast(rows.dy[r]), m1);
                m2 = fma(v, broadcast(rows.dy2[r]), m2);
            }
        if constexpr (GEOMETRY) {
            const Floats dx = px + (left - splat.mx);
            sums[0] = m0, sums[1] = m0 * dx, sums[2] = m1, sums[3] = sums[1] * dx, sums[4] = m1 * dx, sums[5] = m2;
        }
        add_sums_over_lanes<M + C>(sums, slots + size_t(column.member[k]) * slot_stride);
    }
}

template <int C, bool GEOMETRY>
void backward_band(const Tiles& tiles, int band, const float* colors, int stride, Image render, Image alpha,
                   Image v_render, Image v_alpha, float* slots, int slot_stride, Column& column) {
    Pixels<C> pixels;
    std::fill(slots + size_t(tiles.band_begin[band]) * slot_stride,
              slots + size_t(tiles.band_begin[band + 1]) * slot_stride, 0.0f);
    for (int tile = 0; tile < tiles.columns; tile++) {
        if (tiles.tile_begin[band][tile] == tiles.tile_begin[band][tile + 1]) continue;
        pixels.template fill<GEOMETRY>(tiles, band, tile, render, alpha, v_render, v_alpha);
        for (int c = 0; c < C; c++) {
            v_render.prefetch<0>(c, band, tile + 1);
            if (GEOMETRY) render.prefetch<0>(c, band, tile + 1);
        }
        if (!pixels.rows) continue;
        column.fill(tiles, band, tile, colors, stride);
        backward_tile<C, GEOMETRY>(tiles, column, pixels, tile * LANES, band * ROWS, slots, slot_stride);
    }
}

}  // namespace egosplat

// Compositing of projected Gaussians, and its derivatives.
//
// Of a pixel, front to back: alpha_i = min(MAX_ALPHA, opacity_i 2^-(u^2 + v^2)), weight w_i = T_i alpha_i,
// T_{i+1} = T_i (1 - alpha_i); a Gaussian with alpha_i < MIN_ALPHA is passed over, and the first one that would leave
// T <= MIN_TRANSMITTANCE ends the pixel without being composited. The render is sum_i w_i c_i + T_end background.
//
// The derivatives are taken front to back too: what lies behind Gaussian i is what the pixel holds less what has been
// met, so nothing but the render itself is kept from the forward pass.
#pragma once

#include "tiles.h"

namespace egosplat {

constexpr int BLOCK = 64;  // Gaussians that one row's list is made of at a time
constexpr float MIN_FLOAT = 1e-30f;  // what lies behind an opaque pixel must not become subnormal, which is slow
constexpr int MOMENTS = 6;  // sums of v {1, dx, dy, dx^2, dx dy, dy^2}, v = alpha dL/dalpha

// What a band's rows need of the Gaussians of one tile, relative to the tile's corner.
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
        // Beyond the end nothing is reached.
        for (size_t k = count; k < room; k++) l11[k] = l21[k] = l22[k] = u0[k] = v0[k] = 0, log2_opacity[k] = -1e9f;
    }
};

// Whether the ellipse reaches the row's pixels: `exponent` less the least u^2 over them is still above MIN_ALPHA's.
INLINE Mask reaches(Floats l11, Floats u, Floats exponent) {
    const Floats first = fma(l11, broadcast(0.5f), u), last = fma(l11, broadcast(LANES - 0.5f), u);
    const Floats nearest = max(max(first, -last), Floats{});
    return at_least(fnma(nearest, nearest, exponent), broadcast(LOG2_MIN_ALPHA - SLACK));
}

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

// The alpha of each Gaussian of a list at the pixels of its row, 0 below MIN_ALPHA. A loop of its own: the latency
// of one exponential then hides behind the next, which the sums of `forward_row` would leave no room for.
INLINE void alphas_of(const RowList& list, Floats* alphas) {
    const Floats px = ramp() + 0.5f;
    for (int j = 0; j < list.count; j++) {
        const Floats u = fma(px, broadcast(list.l11[j]), broadcast(list.u[j]));
        const Floats e = fnma(u, u, broadcast(list.exponent[j]));
        alphas[j] = where(at_least(e, broadcast(LOG2_MIN_ALPHA)), min(exp2(e), broadcast(MAX_ALPHA)));
    }
}

// One row of a tile. T need not be stopped where a pixel ends: it only falls, so that what would leave it at or below
// MIN_TRANSMITTANCE is known from T alone, then and for all that lies behind.
template <int C>
INLINE void forward_row(const Column& column, RowList& list, int row, Floats (&color)[C], Floats& left, int& last) {
    Floats alphas[BLOCK], T = left;
    for (int c = 0; c < C; c++) color[c] = Floats{};
    last = 0;
    for (int begin = 0; begin < column.count; begin += BLOCK) {
        list.fill(column, begin, std::min(begin + BLOCK, padded(column.count)), row + 0.5f);
        alphas_of(list, alphas);
        for (int j = 0; j < list.count; j++) {
            const int k = list.place_of(j);
            const float* c_k = column.color[k];
            const Floats weight = T * alphas[j];
            T = max(T * (1.0f - alphas[j]), broadcast(MIN_FLOAT));
            const Mask kept = above(T, broadcast(MIN_TRANSMITTANCE));
            const Floats w = where(kept, weight);
            left = where(kept, T, left);
            for (int c = 0; c < C; c++) color[c] = fma(w, broadcast(c_k[c]), color[c]);
            last = k + 1;
            if (!any(kept)) return;
        }
    }
}

struct Image {
    float* data;
    int width, height;

    float* at(int c, int y, int x) const { return data + (size_t(c) * height + y) * width + x; }
    // A tile's next neighbour, on its way while this one is worked on: so many rows of so many planes are more
    // streams than the processor follows by itself.
    // Inlined, because GCC drops calls of a function that does nothing but that.
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

// render (C, H, W) and alpha (H, W) of one band; last_of[tile * ROWS + row] is how many Gaussians the row looked at.
template <int C>
void forward_band(const Tiles& tiles, int band, const float* colors, int stride, const float* background, Image render,
                  Image alpha, int32_t* last_of, Column& column) {
    RowList list;
    Floats color[ROWS][C], T[ROWS];
    for (int tile = 0; tile < tiles.columns; tile++) {
        column.fill(tiles, band, tile, colors, stride);
        const int x = tile * LANES, n = tiles.width - x, rows = std::min(ROWS, tiles.height - band * ROWS);
        for (int c = 0; c < C; c++) render.prefetch<1>(c, band, tile + 1);
        for (int r = 0; r < rows; r++) {
            T[r] = where(at_least(broadcast(n - 0.5f), ramp()), broadcast(1.0f));
            forward_row<C>(column, list, r, color[r], T[r], last_of[tile * ROWS + r]);
        }
        // Plane by plane: the planes of one pixel often lie in the same set of the cache.
        for (int r = 0; r < rows; r++) Image::write(alpha.at(0, band * ROWS + r, x), n, 1.0f - T[r]);
        for (int c = 0; c < C; c++)
            for (int r = 0; r < rows; r++)
                Image::write(render.at(c, band * ROWS + r, x), n,
                             background ? fma(T[r], broadcast(background[c]), color[r][c]) : color[r][c]);
    }
}

// Which rows of a tile a Gaussian reaches, and its exponent, u and distance there.
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

// The pixels of a tile: transmittance so far, what is still to come of dL/drender . render, and dL/drender.
template <int C>
struct Pixels {
    Floats T[ROWS], rest[ROWS], gradient[ROWS][C];
    uint32_t rows;
    int deepest;

    template <bool GEOMETRY>
    void fill(const Tiles& tiles, int band, int tile, Image render, Image alpha, Image v_render, Image v_alpha,
              const int32_t* last_of) {
        const int x = tile * LANES, n = tiles.width - x;
        const Floats one = where(at_least(broadcast(n - 0.5f), ramp()), broadcast(1.0f));
        const int count = std::min(ROWS, tiles.height - band * ROWS);
        rows = 0, deepest = 0;
        for (int r = 0; r < count; r++) {
            const int y = band * ROWS + r;
            rows |= uint32_t(last_of[r] > 0) << r;
            deepest = std::max(deepest, last_of[r]);
            T[r] = one, rest[r] = Floats{};
            if (GEOMETRY && v_alpha.data)
                rest[r] = Image::read(v_alpha.at(0, y, x), n) * (Image::read(alpha.at(0, y, x), n) - 1.0f);
        }
        for (int c = 0; c < C; c++)
            for (int r = 0; r < count; r++) {
                const int y = band * ROWS + r;
                gradient[r][c] = Image::read(v_render.at(c, y, x), n);
                if (GEOMETRY) rest[r] = fma(gradient[r][c], Image::read(render.at(c, y, x), n), rest[r]);
            }
    }
};

// Sum of g_c color_c, in four chains that do not wait for each other.
template <int C>
INLINE Floats dot(const Floats* g, const float* color) {
    Floats part[4] = {};
    for (int c = 0; c < C; c++) part[c % 4] = fma(g[c], broadcast(color[c]), part[c % 4]);
    return (part[0] + part[1]) + (part[2] + part[3]);
}

// Adds to `slots` (one of padded(MOMENTS + C) floats for each member of a band) what one tile contributes:
// the moments and dL/dcolor, or dL/dcolor alone where the geometry is frozen.
template <int C, bool GEOMETRY>
void backward_tile(const Tiles& tiles, const Column& column, Pixels<C>& pixels, const int32_t* last_of, int left,
                   int top, float* slots, int slot_stride) {
    constexpr int M = GEOMETRY ? MOMENTS : 0;
    const Floats px = ramp() + 0.5f;
    Rows rows;
    Floats raw[ROWS], scale[ROWS], v_over_scale[ROWS];
    uint32_t alive = pixels.rows;
    for (int k = 0; k < pixels.deepest; k++) {
        const Splat& splat = tiles.splats[tiles.members[column.member[k]]];
        Rows::fill(rows, column, k, top - splat.my);
        for (uint32_t ended = alive; ended; ended &= ended - 1)
            if (const int r = __builtin_ctz(ended); k >= last_of[r]) alive &= ~(1u << r);
        const uint32_t reached = rows.reached & alive;
        if (!reached) continue;
        const Floats l11 = broadcast(column.l11[k]);
        for (uint32_t todo = reached; todo; todo &= todo - 1) {
            const int r = __builtin_ctz(todo);
            const Floats u = fma(px, l11, broadcast(rows.u[r]));
            const Floats e = fnma(u, u, broadcast(rows.exponent[r]));
            raw[r] = where(at_least(e, broadcast(LOG2_MIN_ALPHA)), exp2(e));
        }
        const float* color = column.color[k];
        Floats sums[M + C], m0 = {}, m1 = {}, m2 = {};
        for (int c = 0; c < C; c++) sums[M + c] = Floats{};
        for (uint32_t todo = reached; todo; todo &= todo - 1) {
            const int r = __builtin_ctz(todo);
            const Floats a = min(raw[r], broadcast(MAX_ALPHA)), T = pixels.T[r];
            const Floats through = 1.0f - a, after = max(T * through, broadcast(MIN_FLOAT));
            const Mask kept = above(after, broadcast(MIN_TRANSMITTANCE));
            const Floats weight = where(kept, a * T);
            pixels.T[r] = after;
            const Floats* g = pixels.gradient[r];
            for (int c = 0; c < C; c++) sums[M + c] = fma(weight, g[c], sums[M + c]);
            if constexpr (GEOMETRY) {
                const Floats q = dot<C>(g, color), rest = fnma(weight, q, pixels.rest[r]);
                pixels.rest[r] = rest;
                // 0 where nothing is kept, or where alpha is at its bound
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
                   Image v_render, Image v_alpha, const int32_t* last_of, float* slots, int slot_stride,
                   Column& column) {
    Pixels<C> pixels;
    std::fill(slots + size_t(tiles.band_begin[band]) * slot_stride,
              slots + size_t(tiles.band_begin[band + 1]) * slot_stride, 0.0f);
    for (int tile = 0; tile < tiles.columns; tile++) {
        column.fill(tiles, band, tile, colors, stride);
        if (!column.count) continue;
        pixels.template fill<GEOMETRY>(tiles, band, tile, render, alpha, v_render, v_alpha, last_of + tile * ROWS);
        for (int c = 0; c < C; c++) {
            v_render.prefetch<0>(c, band, tile + 1);
            if (GEOMETRY) render.prefetch<0>(c, band, tile + 1);
        }
        backward_tile<C, GEOMETRY>(tiles, column, pixels, last_of + tile * ROWS, tile * LANES, band * ROWS, slots,
                                   slot_stride);
    }
}

}  // namespace egosplat

// Entry points of compositing: channels in chunks, bands over threads, gradients collected per Gaussian.
//
// No order of summation depends on the number of threads: the tiles of a band are added from left to right into slots
// of the band, then the bands of a Gaussian from top to bottom.
#pragma once

#include <mutex>

#include "composite_backward.h"

namespace egosplat {

constexpr int MAX_CHUNK = 16;  // more channels do not fit the registers

struct Raster {
    int n, channels, stride;
    Tiles tiles;
    std::vector<float> colors;       // (visible, stride), nearest first
    std::vector<float> slots;        // backward pass only
};

// Keeps finished rasters for reuse, which saves allocating and clearing their memory.
class Pool {
    std::mutex mutex;
    std::vector<Raster*> idle;

public:
    Raster* take() {
        std::lock_guard<std::mutex> lock(mutex);
        if (idle.empty()) return new Raster;
        Raster* raster = idle.back();
        idle.pop_back();
        return raster;
    }
    void give(Raster* raster) {
        std::lock_guard<std::mutex> lock(mutex);
        if (idle.size() < 2) idle.push_back(raster);
        else delete raster;
    }
};
static Pool POOL;

template <int C, class Call>
void with_channels(int channels, Call call) {
    if constexpr (C <= MAX_CHUNK) {
        if (channels == C) call(std::integral_constant<int, C>());
        else with_channels<C + 1>(channels, call);
    }
}

// Calls call(first channel, number of channels as a constant) for chunks of nearly equal size.
template <class Call>
void for_chunks(int channels, Call call) {
    const int chunks = (channels + MAX_CHUNK - 1) / MAX_CHUNK;
    for (int i = 0; i < chunks; i++) {
        const int begin = channels * i / chunks, end = channels * (i + 1) / chunks;
        with_channels<1>(end - begin, [&](auto c) { call(begin, c); });
    }
}

inline Raster* raster_forward(int n, int channels, int width, int height, int threads, const float* means,
                              const float* conics, const float* spreads, const float* opacities, const float* colors,
                              const float* depths, const int32_t* radii, const float* background, float* render,
                              float* alpha) {
    Raster* raster = POOL.take();
    raster->n = n, raster->channels = channels, raster->stride = channels;
    Tiles& tiles = raster->tiles;
    fill_tiles(tiles, n, width, height, means, conics, spreads, opacities, depths, radii, threads);
    const int visible = int(tiles.splats.size()), stride = raster->stride;
    raster->colors.resize(size_t(visible) * stride);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int i = 0; i < visible; i++)
        memcpy(&raster->colors[size_t(i) * stride], colors + size_t(tiles.splats[i].id) * channels, 4 * channels);
    for_chunks(channels, [&](int first, auto c) {
        constexpr int C = decltype(c)::value;
        Image out = {render + size_t(first) * width * height, width, height};
#pragma omp parallel num_threads(threads)
        {
            Column column;
#pragma omp for schedule(dynamic)
            for (int b = 0; b < tiles.bands; b++)
                forward_band<C>(tiles, b, raster->colors.data() + first, stride,
                                background ? background + first : nullptr, out, {alpha, width, height}, column);
        }
    });
    return raster;
}

// Outputs of the backward pass; the first three are null if the geometry is frozen.
struct Gradients {
    float *means, *conics, *opacities, *colors;
};

template <int C, bool GEOMETRY>
void gather(const Raster& raster, int i, int first, const float* conics, bool add, Gradients out) {
    constexpr int M = GEOMETRY ? MOMENTS : 0, STRIDE = padded(M + C);
    const Tiles& tiles = raster.tiles;
    float sum[M + C] = {};
    const size_t later = std::min(size_t(tiles.first_member[i]) + LOOKAHEAD, tiles.member_of.size() - 1);
    const float* ahead = &raster.slots[size_t(tiles.member_of[later]) * STRIDE];
    for (int j = 0; j < M + C; j += 16) __builtin_prefetch(ahead + j);
    const size_t next = tiles.splats[std::min(size_t(i) + LOOKAHEAD, tiles.splats.size() - 1)].id;
    __builtin_prefetch(out.colors + next * raster.channels + first, 1);
    if constexpr (GEOMETRY) {
        __builtin_prefetch(conics + 3 * next);
        __builtin_prefetch(out.means + 2 * next, 1), __builtin_prefetch(out.conics + 3 * next, 1);
        __builtin_prefetch(out.opacities + next, 1);
    }
    for (int k = tiles.first_member[i]; k < tiles.first_member[i + 1]; k++) {
        const float* slot = &raster.slots[size_t(tiles.member_of[k]) * STRIDE];
        for (int j = 0; j < M + C; j++) sum[j] += slot[j];
    }
    const int id = tiles.splats[i].id;
    for (int c = 0; c < C; c++) out.colors[size_t(id) * raster.channels + first + c] = sum[M + c];
    if constexpr (GEOMETRY) {
        const float a = conics[3 * id], b = conics[3 * id + 1], c = conics[3 * id + 2];
        const float v[6] = {a * sum[1] + b * sum[2], b * sum[1] + c * sum[2], -0.5f * sum[3],
                            -sum[4],                 -0.5f * sum[5],          sum[0] / tiles.splats[i].opacity};
        float* to[6] = {out.means + 2 * id,      out.means + 2 * id + 1,  out.conics + 3 * id,
                        out.conics + 3 * id + 1, out.conics + 3 * id + 2, out.opacities + id};
        for (int j = 0; j < 6; j++) *to[j] = add ? *to[j] + v[j] : v[j];
    }
}

template <int C, bool GEOMETRY>
void backward_chunk(Raster& raster, int first, int threads, const float* conics, const float* render,
                    const float* alpha, const float* v_render, const float* v_alpha, Gradients out) {
    Tiles& tiles = raster.tiles;
    constexpr int STRIDE = padded((GEOMETRY ? MOMENTS : 0) + C);
    const int width = tiles.width, height = tiles.height;
    const size_t plane = size_t(width) * height;
    if (raster.slots.size() < tiles.members.size() * STRIDE) raster.slots.resize(tiles.members.size() * STRIDE);
    auto image = [&](const float* data, size_t channel) {
        return Image{data ? const_cast<float*>(data) + channel * plane : nullptr, width, height};
    };
#pragma omp parallel num_threads(threads)
    {
        Column column;
#pragma omp for schedule(dynamic)
        for (int b = 0; b < tiles.bands; b++)
            backward_band<C, GEOMETRY>(tiles, b, raster.colors.data() + first, raster.stride, image(render, first),
                                       image(alpha, 0), image(v_render, first), image(v_alpha, 0),
                                       raster.slots.data(), STRIDE, column);
#pragma omp for schedule(static)
        for (int i = 0; i < int(tiles.splats.size()); i++)
            gather<C, GEOMETRY>(raster, i, first, conics, first > 0, out);
    }
}

// The outputs must be zero on entry: those of invisible Gaussians are not written.
inline void raster_backward(Raster& raster, int threads, const float* conics, const float* render, const float* alpha,
                            const float* v_render, const float* v_alpha, Gradients out) {
    for_chunks(raster.channels, [&](int first, auto c) {
        constexpr int C = decltype(c)::value;
        const float* v_alpha_once = first == 0 ? v_alpha : nullptr;
        if (out.means)
            backward_chunk<C, true>(raster, first, threads, conics, render, alpha, v_render, v_alpha_once, out);
        else
            backward_chunk<C, false>(raster, first, threads, conics, render, alpha, v_render, v_alpha_once, out);
    });
}

// sums (n, channels), zero on entry: `image` (channels, height, width) summed over the compositing weights.
inline void raster_sum(int n, int channels, int width, int height, int threads, const float* means,
                       const float* conics, const float* spreads, const float* opacities, const float* depths,
                       const int32_t* radii, const float* image, float* sums) {
    Raster* raster = POOL.take();
    raster->n = n, raster->channels = channels, raster->stride = 0;
    fill_tiles(raster->tiles, n, width, height, means, conics, spreads, opacities, depths, radii, threads);
    raster_backward(*raster, threads, conics, nullptr, nullptr, image, nullptr, {nullptr, nullptr, nullptr, sums});
    POOL.give(raster);
}

}  // namespace egosplat

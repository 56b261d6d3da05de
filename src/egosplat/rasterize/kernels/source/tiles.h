// The Gaussians that reach each tile, nearest first.
//
// The image is cut into bands of ROWS rows, and each band into tiles of LANES columns. A Gaussian belongs to exactly
// the tiles where its alpha reaches MIN_ALPHA. With T = log2(opacity / MIN_ALPHA) that is u^2 + v^2 <= T, where
//     u = l11 (x - mx) + l21 (y - my),   v = l22 (y - my),
// use the Cholesky factor of log2(e) / 2 times the conic. A sum of squares cannot turn negative by rounding.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "simd.h"

namespace egosplat {

constexpr int ROWS = 16;
constexpr float MIN_ALPHA = 1 / 255.0f, MAX_ALPHA = 0.999f, MIN_TRANSMITTANCE = 1e-4f;
constexpr float LOG2_MIN_ALPHA = -7.99435343685886f;
// Margin around the edge of a Gaussian, in log2 of alpha, so that rounding loses no pixel.
constexpr float SLACK = 1e-3f;
// Prefetch distance for random accesses, in loop iterations.
constexpr size_t LOOKAHEAD = 16;

// A visible Gaussian in the form of the inner loops, 32 bytes.
struct Splat {
    float mx, my;         // mean [px]
    float l11, l21, l22;  // Cholesky factor, see above
    float log2_opacity;
    float opacity;
    int32_t id;  // its index among all Gaussians
};

struct Tiles {
    int width, height, columns, bands;
    std::vector<Splat> splats;           // visible, nearest first
    std::vector<int32_t> band_begin;     // start of each band, and the end, in `members`
    std::vector<int32_t> members;        // indices into `splats`, by band, nearest first
    std::vector<int32_t> first_member;   // start of each splat, and the end, in `member_of`
    std::vector<int32_t> member_of;      // indices into `members`, by splat
    std::vector<std::vector<int32_t>> tile_begin;  // by band: start of each tile, and the end, in `entries`
    std::vector<std::vector<int32_t>> entries;     // by band: indices into its members, by tile, nearest first

    // The Gaussian of a member.
    int32_t id_of(int member) const { return splats[members[member]].id; }
};

struct Rectangle {
    int x0, x1, y0, y1;  // first and last pixel, inclusive
};

// Sorts the bits of depths, which order like the positive depths. Stable: equal depths keep their order.
inline void sort_by_depth(std::vector<uint64_t>& keys, std::vector<uint64_t>& scratch) {
    constexpr int BITS = 11, BUCKETS = 1 << BITS;
    scratch.resize(keys.size());
    for (int shift = 32; shift < 64; shift += BITS) {
        uint32_t begin[BUCKETS] = {};
        for (uint64_t key : keys) begin[key >> shift & (BUCKETS - 1)]++;
        uint32_t total = 0;
        for (uint32_t& b : begin) total += b, b = total - b;
        for (uint64_t key : keys) scratch[begin[key >> shift & (BUCKETS - 1)]++] = key;
        keys.swap(scratch);
    }
}

// `spread` is the variance in y, 1 / (c - b^2 / a). For elongated Gaussians, that difference has few digits left.
inline bool make_splat(int id, const float* mean, const float* conic, const float* spread, float opacity,
                       Splat& splat) {
    const double a = conic[0], b = conic[1], c = conic[2], rest = spread ? 1.0 / *spread : c - b * b / a;
    if (!(opacity >= MIN_ALPHA) || !(a > 0) || !(rest > 0)) return false;
    const double half_log2e = 0.72134752044448170;
    const double l11 = std::sqrt(half_log2e * a);
    splat = {mean[0], mean[1], float(l11), float(l11 * b / a), float(std::sqrt(half_log2e * rest)),
             std::log2(opacity), opacity, id};
    return std::isfinite(mean[0]) && std::isfinite(mean[1]) && std::isfinite(splat.l11) && std::isfinite(splat.l21) &&
           splat.l11 > 0 && splat.l22 > 0;
}

inline int first_pixel(float edge, int last) {
    return int(std::min(std::max(std::ceil(edge - 0.5f), 0.0f), float(last)));
}
inline int last_pixel(float edge, int last) {
    return int(std::min(std::max(std::floor(edge - 0.5f), -1.0f), float(last)));
}

// The pixels that the ellipse of the splat may touch; returns false if there are none.
inline bool bounds(const Splat& s, int width, int height, Rectangle& box) {
    const float reach = std::sqrt(s.log2_opacity - LOG2_MIN_ALPHA + SLACK);
    const float half_y = reach / s.l22, half_x = half_y * std::sqrt(s.l21 * s.l21 + s.l22 * s.l22) / s.l11;
    if (!(s.mx + half_x > 0 && s.mx - half_x < width && s.my + half_y > 0 && s.my - half_y < height)) return false;
    box = {first_pixel(s.mx - half_x, width), last_pixel(s.mx + half_x, width - 1),
           first_pixel(s.my - half_y, height), last_pixel(s.my + half_y, height - 1)};
    return box.x0 <= box.x1 && box.y0 <= box.y1;
}

// The columns of tiles that splats reach in a band. Arrays, so that the compiler uses vectors.
struct Reaches {
    static constexpr int COUNT = 64;
    float mx[COUNT] = {}, my[COUNT] = {}, l11[COUNT] = {}, l21[COUNT] = {}, l22[COUNT] = {}, log2_opacity[COUNT] = {};
    int32_t first[COUNT], last[COUNT];  // tiles; the last one is before the first one if there are none

    void take(int j, const Splat& s) {
        mx[j] = s.mx, my[j] = s.my, l11[j] = s.l11, l21[j] = s.l21, l22[j] = s.l22, log2_opacity[j] = s.log2_opacity;
    }

    // The rows have the pixel centers y0 to y1.
    void find(int width, float y0, float y1) {
        for (int j = 0; j < COUNT; j++) {
            const float t = log2_opacity[j] - LOG2_MIN_ALPHA + SLACK, reach = std::sqrt(t);
            const float steepest = l21[j] * reach / (l22[j] * std::sqrt(l21[j] * l21[j] + l22[j] * l22[j]));
            const float below = y0 - my[j], above = y1 - my[j];
            auto edge = [&](float at, float sign) {
                const float dy = std::min(std::max(at, below), above);
                const float rest = std::max(t - l22[j] * l22[j] * dy * dy, 0.0f);
                return mx[j] + (sign * std::sqrt(rest) - l21[j] * dy) / l11[j];
            };
            // The margin of 0.01 px covers the rounding of these operations.
            const int x0 = first_pixel(edge(steepest, -1) - 0.01f, width);
            const int x1 = last_pixel(edge(-steepest, 1) + 0.01f, width - 1);
            first[j] = x0 / LANES, last[j] = x0 <= x1 ? x1 / LANES : -1;
        }
    }
};

inline void enter_band(Tiles& tiles, int band) {
    const int begin = tiles.band_begin[band], count = tiles.band_begin[band + 1] - begin;
    auto& tile_begin = tiles.tile_begin[band];
    auto& entries = tiles.entries[band];
    tile_begin.assign(tiles.columns + 1, 0);
    std::vector<std::pair<int32_t, int32_t>> reach(count);
    const float y0 = band * ROWS + 0.5f, y1 = std::min(tiles.height, (band + 1) * ROWS) - 0.5f;
    Reaches some;
    for (int m = 0; m < count; m += Reaches::COUNT) {
        const int taken = std::min(Reaches::COUNT, count - m);
        for (int j = 0; j < taken; j++) some.take(j, tiles.splats[tiles.members[begin + m + j]]);
        some.find(tiles.width, y0, y1);
        for (int j = 0; j < taken; j++) {
            reach[m + j] = {some.first[j], some.last[j]};
            for (int t = some.first[j]; t <= some.last[j]; t++) tile_begin[t + 1]++;
        }
    }
    for (int t = 0; t < tiles.columns; t++) tile_begin[t + 1] += tile_begin[t];
    entries.resize(tile_begin[tiles.columns]);
    std::vector<int32_t> next(tile_begin.begin(), tile_begin.end() - 1);
    for (int m = 0; m < count; m++)
        for (int t = reach[m].first; t <= reach[m].second; t++) entries[next[t]++] = m;
}

// Fills `tiles`. `radii` (n, 2) is 0 for culled Gaussians; `spreads` (n,), variances in y, may be null.
inline void fill_tiles(Tiles& tiles, int n, int width, int height, const float* means, const float* conics,
                       const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                       int threads) {
    tiles.width = width, tiles.height = height;
    tiles.columns = (width + LANES - 1) / LANES, tiles.bands = (height + ROWS - 1) / ROWS;
    std::vector<uint64_t> keys, scratch;
    keys.reserve(n);
    for (int i = 0; i < n; i++) {
        if (radii[2 * i] <= 0 || radii[2 * i + 1] <= 0) continue;
        uint32_t depth;
        memcpy(&depth, depths + i, 4);
        keys.push_back(uint64_t(depth) << 32 | uint32_t(i));
    }
    sort_by_depth(keys, scratch);

    tiles.splats.clear();
    tiles.splats.reserve(keys.size());
    std::vector<Rectangle> boxes;
    boxes.reserve(keys.size());
    tiles.band_begin.assign(tiles.bands + 1, 0);
    tiles.first_member.assign(1, 0);
    for (size_t k = 0; k < keys.size(); k++) {
        if (k + LOOKAHEAD < keys.size()) {
            const uint32_t later = uint32_t(keys[k + LOOKAHEAD]);
            __builtin_prefetch(means + 2 * later), __builtin_prefetch(conics + 3 * later);
            __builtin_prefetch(opacities + later), __builtin_prefetch(spreads ? spreads + later : opacities + later);
        }
        const int id = int(uint32_t(keys[k]));
        Splat splat;
        Rectangle box;
        const float* spread = spreads ? spreads + id : nullptr;
        if (!make_splat(id, means + 2 * id, conics + 3 * id, spread, opacities[id], splat)) continue;
        if (!bounds(splat, width, height, box)) continue;
        tiles.splats.push_back(splat);
        box.y0 /= ROWS, box.y1 /= ROWS;
        boxes.push_back(box);
        for (int b = box.y0; b <= box.y1; b++) tiles.band_begin[b + 1]++;
        tiles.first_member.push_back(tiles.first_member.back() + box.y1 - box.y0 + 1);
    }
    for (int b = 0; b < tiles.bands; b++) tiles.band_begin[b + 1] += tiles.band_begin[b];
    tiles.members.resize(tiles.band_begin[tiles.bands]);
    tiles.member_of.resize(tiles.members.size());
    std::vector<int32_t> next(tiles.band_begin.begin(), tiles.band_begin.end() - 1);
    for (size_t i = 0, k = 0; i < boxes.size(); i++)
        for (int b = boxes[i].y0; b <= boxes[i].y1; b++) {
            tiles.members[next[b]] = int32_t(i);
            tiles.member_of[k++] = next[b]++;
        }
    tiles.tile_begin.resize(tiles.bands);
    tiles.entries.resize(tiles.bands);
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (int b = 0; b < tiles.bands; b++) enter_band(tiles, b);
}

}  // namespace egosplat

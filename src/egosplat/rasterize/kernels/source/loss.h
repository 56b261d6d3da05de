// The loss of 3DGS, (1 - lambda) mean |x - y| + lambda (1 - mean SSIM(x, y)), and its gradient with respect to the
// render, where y is the target and x = y + weight (render - y).
//
// SSIM (Wang et al. 2004) needs only four windowed means if computed from s = x + y and d = x - y. With their means
// ms and md, P = ms^2, Q = md^2, V = mean(s^2) - P and U = mean(d^2) - Q,
//     SSIM = (P - Q + 2 C1) (V - U + 2 C2) / ((P + Q + 2 C1) (V + U + 2 C2)).
// Its derivative with respect to x takes three more: 2 (blur(a) + s blur(b) + d blur(c)), see `maps_of`.
//
// The image is processed in strips of LANES rows, and each strip, channel by channel, in blocks of LANES columns.
// A vector holds neighbors in a row during the vertical blur and neighbors in a column during the horizontal one;
// blocks are transposed in between. Only the few rows that the next strip needs leave the cache.
#pragma once

#include <algorithm>
#include <vector>

#include "blur.h"
#include "loss_images.h"

namespace egosplat {

constexpr float C1 = 0.01f * 0.01f, C2 = 0.03f * 0.03f;
constexpr int LAG = (HALO + LANES - 1) / LANES;  // blocks, or strips, between pixels and their gradient
constexpr int KEPT = LANES + HALO, BEHIND = LAG * LANES, AHEAD = 16;

struct LossSums {
    double absolute, ssim;
};

// SSIM of LANES pixels, and the maps a, b, c to blur for its derivative; all zero outside `inside`.
INLINE Floats maps_of(Mask inside, Floats ms, Floats md, Floats mean_ss, Floats mean_dd, Floats& a, Floats& b,
                      Floats& c) {
    const Floats P = ms * ms, Q = md * md, V = mean_ss - P + 2 * C2, U = mean_dd - Q;
    const Floats sum1 = P + Q + 2 * C1, difference1 = P - Q + 2 * C1, sum2 = V + U, difference2 = V - U;
    const Floats inverse = where(inside, reciprocal(sum1 * sum2));
    const Floats by1 = difference1 * inverse, by2 = difference2 * inverse, ssim = by1 * difference2;
    const Floats over1 = by1 * by2 * sum2, over2 = by1 * by2 * sum1;  // ssim / sum1, ssim / sum2
    a = (ms - md) * (by2 - by1) + (ms + md) * (over2 - over1);
    b = by1 - over2, c = -by1 - over2;
    return ssim;
}

// The rows of a block that later strips need.
struct Tail {
    Floats s[HALO], d[HALO], weight[HALO], a[HALO], b[HALO], c[HALO];
};

// Strips of the image from top to bottom. Strip t reads LANES rows from t LANES + REACH, computes SSIM for those
// from t LANES, and the gradient for those from t LANES - REACH.
class Strips {
    static constexpr int ROOM = BEHIND + 4 * LANES;

    const LossImages& images;
    const int blocks;
    const Plane planes[3];
    std::vector<Tail>& all_tails;
    Tail* tails;
    const Plane* plane;
    Floats s[LAG + 1][KEPT], d[LAG + 1][KEPT], weight[LAG + 1][KEPT];  // latest blocks, by rows
    Floats means[4][ROOM], maps[3][ROOM];                             // by columns, BEHIND of them past
    int begin, top;
    bool wanted;
    double absolute[LANES], ssims[LANES];

    void take_in(int block) {
        const int k = block % (LAG + 1), x = block * LANES;
        Tail& tail = tails[block];
        for (int i = 0; i < HALO; i++) s[k][i] = tail.s[i], d[k][i] = tail.d[i], weight[k][i] = tail.weight[i];
        for (int i = HALO; i < KEPT; i++) {
            plane->prefetch(top - REACH + i, x + AHEAD);
            plane->read(top - REACH + i, x, s[k][i], d[k][i], weight[k][i]);
        }
        for (int i = 0; i < HALO; i++)
            tail.s[i] = s[k][LANES + i], tail.d[i] = d[k][LANES + i], tail.weight[i] = weight[k][LANES + i];
    }

    void add_absolute(int block) {
        Floats sum = {};
        for (int i = REACH; i < REACH + LANES; i++) sum += magnitude(d[block % (LAG + 1)][i]);
        for (int i = 0; i < LANES; i++) absolute[i] += sum[i];
    }

    template <class In>
    INLINE void blur_and_transpose(In in, Floats* out) {
        Floats v[LANES];
        blur<LANES>(in, v);
        transpose(v);
        for (int i = 0; i < LANES; i++) out[i] = v[i];
    }

    void blur_columns(int block) {
        const Floats *s_ = s[block % (LAG + 1)], *d_ = d[block % (LAG + 1)];
        const int to = begin + BEHIND;
        blur_and_transpose([s_](int i) { return s_[i]; }, means[0] + to);
        blur_and_transpose([d_](int i) { return d_[i]; }, means[1] + to);
        blur_and_transpose([s_](int i) { return s_[i] * s_[i]; }, means[2] + to);
        blur_and_transpose([d_](int i) { return d_[i] * d_[i]; }, means[3] + to);
    }

    // Means and maps of the columns [block LANES - REACH, ...).
    void find_maps(int block) {
        const int from = begin + BEHIND - HALO, to = begin + BEHIND, rows = images.height - top;
        Floats blurred[4][LANES];
        for (int q = 0; q < 4; q++) {
            const Floats* in = means[q] + from;
            blur<LANES>([in](int i) { return in[i]; }, blurred[q]);
        }
        const Mask within = above(broadcast(float(rows)), ramp()), none = above(Floats{}, Floats{});
        Floats sum = {};
        for (int i = 0; i < LANES; i++) {
            const int x = block * LANES - REACH + i;
            const Mask inside = x >= 0 && x < images.width ? within : none;
            sum += maps_of(inside, blurred[0][i], blurred[1][i], blurred[2][i], blurred[3][i], maps[0][to + i],
                           maps[1][to + i], maps[2][to + i]);
        }
        for (int i = 0; i < LANES; i++) ssims[i] += sum[i];
    }

    void find_gradient(int block) {
        Tail& tail = tails[block];
        Floats* tails_[3] = {tail.a, tail.b, tail.c};
        Floats blurred[3][LANES];
        for (int q = 0; q < 3; q++) {
            Floats v[KEPT];
            const Floats* in = maps[q] + begin;
            for (int i = 0; i < HALO; i++) v[i] = tails_[q][i];
            blur_and_transpose([in](int i) { return in[i]; }, v + HALO);
            for (int i = 0; i < HALO; i++) tails_[q][i] = v[LANES + i];
            blur<LANES>([&v](int i) { return v[i]; }, blurred[q]);
        }
        if (!wanted) return;
        const int k = block % (LAG + 1), last = std::min(LANES, images.height - (top - REACH));
        const Floats l1 = broadcast(images.l1_factor), factor = broadcast(images.ssim_factor);
        for (int i = std::max(0, REACH - top); i < last; i++) {
            const Floats d_ = d[k][i], w = weight[k][i];
            const Floats sign = where(above(d_, Floats{}), l1) - where(above(Floats{}, d_), l1);
            const Floats sum = fma(d_, blurred[2][i], fma(s[k][i], blurred[1][i], blurred[0][i]));
            plane->write_gradient(top - REACH + i, block * LANES, w * fma(factor, sum, sign));
        }
    }

    void move_on() {
        begin += LANES;
        if (begin + BEHIND + LANES <= ROOM) return;
        for (auto& m : means) std::copy(m + begin, m + begin + BEHIND, m);
        for (auto& m : maps) std::copy(m + begin, m + begin + BEHIND, m);
        begin = 0;
    }

public:
    Strips(const LossImages& images, int first, std::vector<Tail>& tails)
        : images(images), blocks((images.width + LANES - 1) / LANES), planes{{images, 0}, {images, 1}, {images, 2}},
          all_tails(tails) {
        tails.assign(3 * blocks, Tail{});
        for (int c = 0; c < 3; c++)
            for (int block = 0; block < blocks; block++)
                for (int i = 0; i < HALO; i++) {
                    const int y = first * LANES - REACH + i;
                    Tail& tail = tails[c * blocks + block];
                    if (y >= 0) planes[c].read(y, block * LANES, tail.s[i], tail.d[i], tail.weight[i]);
                }
    }

    // Without `counts`, computes only what the next strip needs.
    LossSums work(int strip, int channel, bool counts) {
        plane = planes + channel, tails = all_tails.data() + channel * blocks;
        top = strip * LANES, begin = 0, wanted = counts;
        for (auto& m : means) std::fill(m, m + BEHIND, Floats{});
        for (auto& m : maps) std::fill(m, m + BEHIND, Floats{});
        std::fill(absolute, absolute + LANES, 0.0);
        std::fill(ssims, ssims + LANES, 0.0);
        for (int block = 0; block < blocks + LAG; block++) {
            if (block < blocks) {
                take_in(block);
                add_absolute(block);
                blur_columns(block);
            } else {
                for (auto& m : means) std::fill(m + begin + BEHIND, m + begin + BEHIND + LANES, Floats{});
            }
            find_maps(block);
            if (images.gradient && block >= LAG) find_gradient(block - LAG);
            move_on();
        }
        LossSums sums = {};
        for (int i = 0; i < LANES; i++) sums.absolute += absolute[i], sums.ssim += ssims[i];
        return sums;
    }
};

// Returns the loss. Pixels and the order of sums do not depend on the number of threads.
inline double l1_ssim(int width, int height, int threads, double ssim_lambda, const float* render,
                      const float* target, const float* weight, float* gradient) {
    const double count = 3.0 * width * height;
    const LossImages images = {width, height, render, target, weight, gradient, float((1 - ssim_lambda) / count),
                               float(-2 * ssim_lambda / count)};
    const int strips = (height + REACH + LANES - 1) / LANES;
    std::vector<LossSums> sums(3 * strips);
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int part = 0; part < threads; part++) {
        static thread_local std::vector<Tail> tails;
        const int begin = strips * part / threads, end = strips * (part + 1) / threads;
        const int before = std::max(begin - LAG, 0);
        Strips work(images, before, tails);
        for (int strip = before; strip < end; strip++)
            for (int c = 0; c < 3; c++) {
                const LossSums s = work.work(strip, c, strip >= begin);
                if (strip >= begin) sums[3 * strip + c] = s;
            }
    }
    double absolute = 0, ssim = 0;
    for (const LossSums& s : sums) absolute += s.absolute, ssim += s.ssim;
    return (1 - ssim_lambda) * absolute / count + ssim_lambda * (1 - ssim / count);
}

}  // namespace egosplat

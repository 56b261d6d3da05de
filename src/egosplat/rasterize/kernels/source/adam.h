// Adam (Kingma & Ba 2015, algorithm 1) on rows of parameters, in place.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "simd.h"

namespace egosplat {

// Rows with a larger gradient are skipped like non-finite ones: its square would overflow.
constexpr float LARGEST_GRADIENT = 1e18f;

struct AdamFactors {
    float one_minus_beta1, beta2, one_minus_beta2;
    float inverse_root2;  // 1 / sqrt(1 - beta2^step)
    float eps;
};

// A parameter: pointers to rows of `columns` values each, and to the learning rate of each column.
struct AdamRows {
    int64_t columns;
    float* param;
    const float* grad;
    float *exp_avg, *exp_avg_sq;
    const float* learning_rates;
};

// The bits of magnitudes order like the magnitudes, and those of NaN come last.
inline int32_t largest_bits(const float* values, int64_t count) {
    int32_t largest = 0;
    for (int64_t i = 0; i < count; i++) {
        int32_t bits;
        memcpy(&bits, values + i, 4);
        largest = std::max(largest, bits & 0x7fffffff);
    }
    return largest;
}

inline bool sound(const float* grad, int64_t count) {
    return largest_bits(grad, count) <= largest_bits(&LARGEST_GRADIENT, 1);
}

// `steps`: learning rate over 1 - beta1^step. Zero gradient and moments change nothing, exactly; a test for that
// would cost more in branches than it saves.
INLINE void update(const AdamFactors& f, Floats steps, float* param, const float* grad, float* exp_avg,
                   float* exp_avg_sq) {
    const Floats g = load(grad), m0 = load(exp_avg), v0 = load(exp_avg_sq);
    const Floats m = fma(g - m0, broadcast(f.one_minus_beta1), m0);
    const Floats v = fma(g * broadcast(f.one_minus_beta2), g, v0 * broadcast(f.beta2));
    const Floats denominator = fma(root(v), broadcast(f.inverse_root2), broadcast(f.eps));
    store(exp_avg, m), store(exp_avg_sq, v);
    store(param, load(param) - steps * m / denominator);
}

// Updates LANES values, or `count` if those are fewer: through a vector, too, so that results are the same.
INLINE void update_some(const AdamFactors& f, const float* steps, const AdamRows& rows, int64_t at, int64_t count) {
    float *to[3] = {rows.param + at, rows.exp_avg + at, rows.exp_avg_sq + at};
    if (count >= LANES) return update(f, load(steps), to[0], rows.grad + at, to[1], to[2]);
    float grad[LANES] = {}, values[3][LANES] = {};
    memcpy(grad, rows.grad + at, 4 * count);
    for (int k = 0; k < 3; k++) memcpy(values[k], to[k], 4 * count);
    update(f, load(steps), values[0], grad, values[1], values[2]);
    for (int k = 0; k < 3; k++) memcpy(to[k], values[k], 4 * count);
}

// `steps` repeats those of the columns LANES times: LANES rows are `columns` vectors.
inline void update_rows(const AdamFactors& f, const float* steps, const AdamRows& rows, int64_t begin, int64_t end) {
    const int64_t group = rows.columns * LANES, last = end * rows.columns;
    int64_t at = begin * rows.columns;
    for (; group && at + group <= last; at += group)
        for (int64_t i = at; i < at + group; i += LANES)
            update(f, load(steps + i - at), rows.param + i, rows.grad + i, rows.exp_avg + i, rows.exp_avg_sq + i);
    for (int64_t i = at; i < last; i += LANES) update_some(f, steps + i - at, rows, i, last - i);
}

// Updates `count` parameters of n rows. A row is skipped if any of its gradients is not sound, and rows that were never
// `used` may be: their gradients and moments are zero. Returns the number of rows skipped because of their gradients.
inline int64_t adam(int64_t n, int count, const AdamRows* all, const uint8_t* used, int threads, double beta1,
                    double beta2, double eps, int64_t step) {
    const AdamFactors f = {float(1 - beta1), float(beta2), float(1 - beta2),
                           float(1 / std::sqrt(1 - std::pow(beta2, step))), float(eps)};
    const double correction = 1 / (1 - std::pow(beta1, step));
    std::vector<std::vector<float>> steps(count);
    for (int k = 0; k < count; k++)
        for (int64_t i = 0; i < all[k].columns * LANES; i++)
            steps[k].push_back(float(all[k].learning_rates[i % all[k].columns] * correction));
    auto are_sound = [&](int64_t begin, int64_t end) {
        bool every = true;
        for (int k = 0; k < count; k++)
            every &= sound(all[k].grad + begin * all[k].columns, (end - begin) * all[k].columns);
        return every;
    };
    auto update_all = [&](int64_t begin, int64_t end) {
        for (int k = 0; k < count; k++) update_rows(f, steps[k].data(), all[k], begin, end);
    };
    // The gradients of a part stay in the cache between the check and the update. Smaller parts start too many streams.
    constexpr int64_t PART = 4096;
    int64_t left_out = 0;
#pragma omp parallel for schedule(static) num_threads(threads) reduction(+ : left_out)
    for (int64_t begin = 0; begin < n; begin += PART) {
        const int64_t end = std::min(n, begin + PART);
        if (!memchr(used + begin, 1, end - begin)) continue;
        if (are_sound(begin, end)) {
            update_all(begin, end);
            continue;
        }
        for (int64_t row = begin; row < end; row++) {
            if (are_sound(row, row + 1)) update_all(row, row + 1);
            else left_out++;
        }
    }
    return left_out;
}

}  // namespace egosplat

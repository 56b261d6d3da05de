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

// Pointers to rows of `columns` values each.
struct AdamRows {
    int columns;
    float* param;
    const float* grad;
    float *exp_avg, *exp_avg_sq;

    AdamRows from(int64_t row) const {
        const int64_t at = row * columns;
        return {columns, param + at, grad + at, exp_avg + at, exp_avg_sq + at};
    }
};

INLINE bool sound(const float* grad, int count) {
    bool all = true;
    for (int i = 0; i < count; i++) all &= std::fabs(grad[i]) <= LARGEST_GRADIENT;
    return all;
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

// Updates LANES rows at once, as `columns` vectors.
inline void update_group(const AdamFactors& f, const float* steps, const AdamRows& rows) {
    for (int i = 0; i < rows.columns * LANES; i += LANES)
        update(f, load(steps + i), rows.param + i, rows.grad + i, rows.exp_avg + i, rows.exp_avg_sq + i);
}

// Updates one row, through vectors too, so that the result does not depend on the rows next to it.
inline void update_row(const AdamFactors& f, const float* steps, const AdamRows& row) {
    for (int i = 0; i < row.columns; i += LANES) {
        const int bytes = 4 * (row.columns - i < LANES ? row.columns - i : LANES);
        float param[LANES] = {}, grad[LANES] = {}, exp_avg[LANES] = {}, exp_avg_sq[LANES] = {};
        memcpy(param, row.param + i, bytes), memcpy(grad, row.grad + i, bytes);
        memcpy(exp_avg, row.exp_avg + i, bytes), memcpy(exp_avg_sq, row.exp_avg_sq + i, bytes);
        update(f, load(steps + i), param, grad, exp_avg, exp_avg_sq);
        memcpy(row.param + i, param, bytes);
        memcpy(row.exp_avg + i, exp_avg, bytes), memcpy(row.exp_avg_sq + i, exp_avg_sq, bytes);
    }
}

// learning_rates: one per column. Returns the number of rows skipped because of their gradient.
inline int64_t adam(int64_t n, AdamRows all, int threads, const float* learning_rates, double beta1, double beta2,
                    double eps, int64_t step) {
    const AdamFactors f = {float(1 - beta1), float(beta2), float(1 - beta2),
                           float(1 / std::sqrt(1 - std::pow(beta2, step))), float(eps)};
    const double correction = 1 / (1 - std::pow(beta1, step));
    std::vector<float> steps(size_t(all.columns) * LANES);
    for (size_t i = 0; i < steps.size(); i++) steps[i] = float(learning_rates[i % all.columns] * correction);
    int64_t left_out = 0;
#pragma omp parallel for schedule(static) num_threads(threads) reduction(+ : left_out)
    for (int64_t row = 0; row < n; row += LANES) {
        const AdamRows group = all.from(row);
        if (row + LANES <= n && sound(group.grad, LANES * all.columns)) {
            update_group(f, steps.data(), group);
            continue;
        }
        for (int64_t r = row; r < std::min(n, row + LANES); r++) {
            const AdamRows one = all.from(r);
            if (sound(one.grad, all.columns)) update_row(f, steps.data(), one);
            else left_out++;
        }
    }
    return left_out;
}

}  // namespace egosplat

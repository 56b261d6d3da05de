// How fast one core multiplies and adds in float32, with nothing else to do.

typedef float Lanes __attribute__((vector_size(EGOSPLAT_VECTOR_BYTES)));

// As many independent sums as hide the latency of two pipes.
constexpr int SUMS = 12;

// Returns the floating-point operations done; `sink` keeps the compiler from leaving them out.
extern "C" double egosplat_fma(long repetitions, float *sink) {
    // Different starts: equal sums would be computed once.
    Lanes sums[SUMS];
    for (int k = 0; k < SUMS; ++k) sums[k] = Lanes{} + sink[1] * k;
    Lanes factor = Lanes{} + sink[0], addend = Lanes{} + sink[1];
    for (long i = 0; i < repetitions; ++i) {
#pragma GCC unroll 16
        for (int k = 0; k < SUMS; ++k) sums[k] = sums[k] * factor + addend;
    }
    Lanes total{};
    for (int k = 0; k < SUMS; ++k) total += sums[k];
    sink[0] = total[0];
    return 2.0 * repetitions * SUMS * (sizeof(Lanes) / sizeof(float));
}

// The C interface of the library. Arrays are float32, contiguous, row-major; the callers check sizes.
#include "adam.h"
#include "exposure.h"
#include "loss.h"
#include "own_weights.h"
#include "pixel_weights.h"
#include "project_backward.h"
#include "raster.h"
#include "sparse.h"

using namespace egosplat;

#ifndef EGOSPLAT_SOURCE_HASH
#define EGOSPLAT_SOURCE_HASH ""
#endif

static Camera camera_of(const double* numbers, int width, int height, int antialiased) {
    Camera camera;
    memcpy(camera.rotation, numbers, sizeof camera.rotation);
    memcpy(camera.translation, numbers + 9, sizeof camera.translation);
    camera.fx = numbers[12], camera.fy = numbers[13], camera.cx = numbers[14], camera.cy = numbers[15];
    camera.near_plane = numbers[16], camera.far_plane = numbers[17];
    camera.radius_clip = numbers[18], camera.eps2d = numbers[19];
    camera.width = width, camera.height = height, camera.antialiased = antialiased;
    return camera;
}

extern "C" {

int egosplat_abi(void) { return 1; }
const char* egosplat_source_hash(void) { return EGOSPLAT_SOURCE_HASH; }
int egosplat_lanes(void) { return LANES; }

// camera: world-to-camera rotation (9) and translation (3), fx, fy, cx, cy, near plane, far plane, radius clip, eps2d.
void egosplat_project_forward(int n, int stored, int coefficients, int feature_count, int depth, int width, int height,
                              int antialiased, int threads, const double* camera, const float* means,
                              const float* quats, const float* scales, const float* opacities, const float* sh,
                              const float* features, float* means2d, float* conics, float* depths, float* compensated,
                              float* channels, float* spreads, int32_t* radii) {
    project_forward(camera_of(camera, width, height, antialiased), {n, stored, coefficients, feature_count, depth != 0},
                    {means, quats, scales, opacities, sh, features}, {means2d, conics, depths, compensated, channels},
                    spreads, radii, threads);
}

// v_pose: rotation (9) and translation (3), or null. v_means, v_quats, v_scales and v_opacities are null together.
void egosplat_project_backward(int n, int stored, int coefficients, int feature_count, int depth, int width, int height,
                               int antialiased, int threads, const double* camera, const float* means,
                               const float* quats, const float* scales, const float* opacities, const float* sh,
                               const int32_t* radii, const float* channels, const float* v_means2d,
                               const float* v_conics, const float* v_depths, const float* v_compensated,
                               const float* v_channels, float* v_means, float* v_quats, float* v_scales,
                               float* v_opacities, float* v_sh, float* v_features, double* v_pose) {
    PoseGradient pose;
    project_backward(camera_of(camera, width, height, antialiased),
                     {n, stored, coefficients, feature_count, depth != 0},
                     {means, quats, scales, opacities, sh, nullptr}, radii, channels,
                     {v_means2d, v_conics, v_depths, v_compensated, v_channels},
                     {v_means, v_quats, v_scales, v_opacities, v_sh, v_features}, v_pose ? &pose : nullptr, threads);
    if (!v_pose) return;
    memcpy(v_pose, pose.rotation, sizeof pose.rotation);
    memcpy(v_pose + 9, pose.translation, sizeof pose.translation);
}

// render (channels, height, width), alpha (height, width); pass the result to raster_backward and raster_free.
void* egosplat_raster_forward(int n, int channels, int width, int height, int threads, const float* means2d,
                              const float* conics, const float* spreads, const float* opacities, const float* colors,
                              const float* depths, const int32_t* radii, const float* background, float* render,
                              float* alpha) {
    return raster_forward(n, channels, width, height, threads, means2d, conics, spreads, opacities, colors, depths,
                          radii, background, render, alpha);
}

void egosplat_raster_backward(void* raster, int threads, const float* conics, const float* render, const float* alpha,
                              const float* v_render, const float* v_alpha, float* v_means2d, float* v_conics,
                              float* v_opacities, float* v_colors) {
    raster_backward(*static_cast<Raster*>(raster), threads, conics, render, alpha, v_render, v_alpha,
                    {v_means2d, v_conics, v_opacities, v_colors});
}

// sums (n, channels) must be zero on entry; image (channels, height, width).
void egosplat_raster_sum(int n, int channels, int width, int height, int threads, const float* means2d,
                         const float* conics, const float* spreads, const float* opacities, const float* depths,
                         const int32_t* radii, const float* image, float* sums) {
    raster_sum(n, channels, width, height, threads, means2d, conics, spreads, opacities, depths, radii, image, sums);
}

// pixels (count, 2) column and row, inside the image; begin (count + 1,); ids and weights (room,).
void egosplat_pixel_weights(int n, int width, int height, int threads, const float* means2d, const float* conics,
                            const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                            int count, const int32_t* pixels, int64_t room, int64_t* begin, int64_t* ids,
                            float* weights) {
    pixel_weights(n, width, height, threads, means2d, conics, spreads, opacities, depths, radii, count, pixels, room,
                  begin, ids, weights);
}

// pixels (n, 2) column and row, outside the image for none; weights (n,) must be zero on entry.
void egosplat_own_weights(int n, int width, int height, int threads, const float* means2d, const float* conics,
                          const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                          const int32_t* pixels, float* weights) {
    own_weights(n, width, height, threads, means2d, conics, spreads, opacities, depths, radii, pixels, weights);
}

// begin (n + 1,), channel and value: rows of a sparse matrix; render (channels, height, width) must be zero on entry.
void egosplat_sparse_render(int n, int width, int height, int threads, const float* means2d, const float* conics,
                            const float* spreads, const float* opacities, const float* depths, const int32_t* radii,
                            const int64_t* begin, const int64_t* channel, const float* value, float* render) {
    sparse_render(n, width, height, threads, means2d, conics, spreads, opacities, depths, radii,
                  {begin, channel, value}, render);
}

void egosplat_raster_free(void* raster) { POOL.give(static_cast<Raster*>(raster)); }

// render and gradient (3, height, width), target (height, width, 3), weight (height, width).
// gradient and weight may be null.
double egosplat_l1_ssim(int width, int height, int threads, double ssim_lambda, const float* render,
                        const float* target, const float* weight, float* gradient) {
    return l1_ssim(width, height, threads, ssim_lambda, render, target, weight, gradient);
}

// tone: logarithms of three gains, then the compression; photograph (pixels, 3) or null; render, result (3, pixels).
void egosplat_expose(int64_t pixels, int threads, const float* tone, const float* photograph, const float* render,
                     float* result) {
    expose({pixels, tone, photograph}, threads, render, result);
}

// v_tone (4,) must be zero on entry.
void egosplat_expose_backward(int64_t pixels, int threads, const float* tone, const float* photograph,
                              const float* render, const float* v_result, float* v_render, double* v_tone) {
    expose_backward({pixels, tone, photograph}, threads, render, v_result, v_render, v_tone);
}

// parameters (count,), six 64-bit numbers each; used (rows,) bool. Returns the number of skipped rows.
int64_t egosplat_adam(int64_t rows, int count, int threads, double beta1, double beta2, double eps, int64_t step,
                      const AdamRows* parameters, const uint8_t* used) {
    return adam(rows, count, parameters, used, threads, beta1, beta2, eps, step);
}
}

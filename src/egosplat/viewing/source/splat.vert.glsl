#version 300 es
// One corner of a Gaussian's quad: EWA projection as in egosplat/rasterize/reference/projection.py.
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D geometry;  // per Gaussian: (mean, opacity), (xx, xy, xz, yy), (yz, zz, 0, 0) of the covariance
uniform sampler2D colors;   // per Gaussian: base color, and three coefficients of degree 1
uniform sampler2D paint;     // per Gaussian: color, and in alpha how to use it
uniform mat3 worldToCamera;
uniform vec3 eye;
uniform vec2 size;           // of the image [px]
uniform float focal;         // [px]
uniform float near;
uniform vec3 limits;         // margin of the frustum, blur [px^2], least alpha
uniform int bands;

in uint index;

out vec2 offset;
flat out vec3 conic;
flat out vec4 color;

vec4 entry(sampler2D data, int number) {
  int width = textureSize(data, 0).x;
  return texelFetch(data, ivec2(number % width, number / width), 0);
}

vec3 shade(int one, vec3 direction) {
  vec3 sum = entry(colors, 4 * one).rgb;
  if (bands == 3)
    sum += 0.4886025119029199 * (-direction.y * entry(colors, 4 * one + 1).rgb
      + direction.z * entry(colors, 4 * one + 2).rgb - direction.x * entry(colors, 4 * one + 3).rgb);
  return max(sum, 0.0);
}

void main() {
  int one = int(index);
  vec4 center = entry(geometry, 3 * one), first = entry(geometry, 3 * one + 1), second = entry(geometry, 3 * one + 2);
  vec4 mark = entry(paint, one);
  vec3 seen = worldToCamera * (center.xyz - eye);
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);  // outside of the image
  bool hidden = mark.a > 0.1 && mark.a < 0.4;
  if (seen.z < near || hidden) return;
  vec2 widest = 0.5 * size / focal * (1.0 + limits.x);
  vec2 slope = clamp(seen.xy / seen.z, -widest, widest);
  mat3 covariance = mat3(first.x, first.y, first.z, first.y, first.w, second.x, first.z, second.x, second.y);
  mat3 turned = worldToCamera * covariance * transpose(worldToCamera);
  vec3 u = focal / seen.z * vec3(1.0, 0.0, -slope.x), v = focal / seen.z * vec3(0.0, 1.0, -slope.y);
  float uu = dot(u, turned * u), uv = dot(u, turned * v), vv = dot(v, turned * v);
  uu += limits.y;
  vv += limits.y;
  float area = uu * vv - uv * uv, alpha = center.w;
  if (alpha < limits.z || !(area > 0.0)) return;
  // The quad along the ellipse's axes, to where alpha falls below the least.
  float reach = sqrt(2.0 * log(alpha / limits.z)), half_sum = 0.5 * (uu + vv);
  float apart = length(vec2(0.5 * (uu - vv), uv)), longer = sqrt(half_sum + apart), shorter = sqrt(max(half_sum - apart, 1e-6));
  vec2 axis = abs(uv) < 1e-9 ? (uu >= vv ? vec2(1.0, 0.0) : vec2(0.0, 1.0)) : normalize(vec2(half_sum + apart - vv, uv));
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  offset = reach * (corner.x * longer * axis + corner.y * shorter * vec2(-axis.y, axis.x));
  conic = vec3(vv, -uv, uu) / area;
  vec3 natural = shade(one, normalize(center.xyz - eye));
  float light = dot(natural, vec3(0.3, 0.59, 0.11));
  if (mark.a > 0.9) natural = mark.rgb * (0.35 + 0.75 * light);
  else if (mark.a > 0.4) natural = vec3(0.12 + 0.4 * light);
  color = vec4(natural, alpha);
  vec2 place = focal * seen.xy / seen.z + offset;
  gl_Position = vec4(2.0 * place.x / size.x, -2.0 * place.y / size.y, 0.0, 1.0);
}

#version 300 es
precision highp float;

uniform vec2 bounds;  // least and largest alpha

in vec2 offset;
flat in vec3 conic;
flat in vec4 color;

out vec4 pixel;

void main() {
  float sigma = 0.5 * (conic.x * offset.x * offset.x + conic.z * offset.y * offset.y) + conic.y * offset.x * offset.y;
  float alpha = min(color.a * exp(-sigma), bounds.y);
  if (sigma < 0.0 || alpha < bounds.x) discard;
  pixel = vec4(color.rgb * alpha, alpha);
}

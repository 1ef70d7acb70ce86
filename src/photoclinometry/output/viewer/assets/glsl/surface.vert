// The landmarks as a mesh in a pinhole camera. Values are those of the landmarks; the rasteriser interpolates them.
uniform sampler2D u_position;
uniform sampler2D u_normal;
uniform sampler2D u_values;     // per cell: sum of value times weight, and sum of weights
uniform mat3 u_cam_from_local;
uniform vec3 u_offset;          // of the local frame's origin in the camera's frame
uniform vec4 u_intrinsics;      // fx, fy, cx, cy [px of the picture]
uniform vec2 u_size;            // of the picture [px]
uniform vec2 u_depths;          // nearest depth, and farthest less that of the origin
uniform vec2 u_factors;         // value shown = x * value + y
uniform vec3 u_shade_sun;
in uint a_cell;
out vec4 v_surface;
flat out vec2 v_vertex;         // column and row, plus 1, of one of the triangle's corners

const float MISSING = -1e30;

void main() {
    int columns = textureSize(u_position, 0).x;
    ivec2 cell = ivec2(int(a_cell) % columns, int(a_cell) / columns);
    vec3 turned = u_cam_from_local * texelFetch(u_position, cell, 0).xyz;
    vec2 sums = texelFetch(u_values, cell, 0).rg;
    float value = sums.y > 0.0 ? u_factors.x * sums.x / sums.y + u_factors.y : MISSING;
    float shade = max(dot(texelFetch(u_normal, cell, 0).xyz, u_shade_sun), 0.0);
    v_surface = vec4(value, shade, vec2(cell) + 1.0);
    v_vertex = vec2(cell) + 1.0;

    float depth = u_offset.z + turned.z;
    float nearest = u_depths.x;
    float farthest_from_here = u_depths.y - turned.z;
    float range = u_depths.y + u_offset.z - nearest;
    vec2 pixel = u_intrinsics.xy * (turned.xy + u_offset.xy) + u_intrinsics.zw * depth;
    vec2 ndc = vec2(2.0, -2.0) * pixel / u_size + vec2(-depth, depth);
    gl_Position = vec4(ndc, depth - 2.0 * nearest * farthest_from_here / range, depth);
}

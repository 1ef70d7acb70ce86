// Which landmarks no ground hides from the Sun: rays over the reference camera's depths, as surface/map_rays.py follows them.
// Depths are relative to that of the local frame's origin, which keeps them exact enough in single precision.
uniform sampler2D u_position;   // per cell: x, y, z in the local frame; w is 1 where there is a landmark
uniform sampler2D u_depth;      // per cell; FAR where there is no landmark
uniform sampler2D u_around;     // depths of the surroundings; FAR where they are not known
uniform mat3 u_cam_from_local;
uniform vec3 u_offset;          // of the local frame's origin in the reference camera's frame
uniform vec3 u_towards;         // unit vector to the Sun in the reference camera's frame
uniform vec4 u_intrinsics;      // fx, fy, cx, cy [px]
uniform vec3 u_first;           // row and column of the grid's first cell [px], and its stride [px]
uniform float u_around_stride;  // [px]
uniform vec2 u_depths;          // nearest and farthest depth of all ground
uniform float u_step;           // length of a step along a ray
out vec4 lit;

const float FIRST_STEP = 1.5;
const int MOST_STEPS = 20000;

float depth_at(sampler2D depths, vec2 row_col) {
    ivec2 at = ivec2(row_col.yx);
    vec2 part = row_col - floor(row_col);
    float upper = mix(texelFetch(depths, at, 0).r, texelFetch(depths, at + ivec2(1, 0), 0).r, part.y);
    float lower = mix(texelFetch(depths, at + ivec2(0, 1), 0).r, texelFetch(depths, at + ivec2(1, 1), 0).r, part.y);
    return mix(upper, lower, part.x);
}

bool inside(vec2 row_col, ivec2 size) {
    return row_col.x >= 0.0 && row_col.y >= 0.0 && row_col.x < float(size.y - 1) && row_col.y < float(size.x - 1);
}

void main() {
    vec4 position = texelFetch(u_position, ivec2(gl_FragCoord.xy), 0);
    lit = vec4(position.w);
    if (position.w == 0.0) {
        return;
    }
    vec3 from = u_cam_from_local * position.xyz + vec3(u_offset.xy, 0.0);
    vec2 across = u_towards.xy - u_towards.z / (from.z + u_offset.z) * from.xy;
    float first = FIRST_STEP / length(across);
    for (int i = 0; i < MOST_STEPS; i++) {
        vec3 at = from + (first + float(i)) * u_step * u_towards;
        if (at.z < u_depths.x || at.z > u_depths.y) {
            return;
        }
        vec2 row_col = (u_intrinsics.yx * at.yx / (at.z + u_offset.z) + u_intrinsics.wz) - 0.5;
        vec2 cell = (row_col - u_first.xy) / u_first.z;
        vec2 around = row_col / u_around_stride;
        float surface;
        if (inside(cell, textureSize(u_depth, 0))) {
            surface = depth_at(u_depth, cell);
        } else if (inside(around, textureSize(u_around, 0))) {
            surface = depth_at(u_around, around);
        } else {
            return;
        }
        if (at.z > surface) {
            lit = vec4(0.0);
            return;
        }
    }
}

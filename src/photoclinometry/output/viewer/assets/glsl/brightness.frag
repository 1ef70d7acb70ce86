// Brightness of every landmark, albedo * rho * share in sunlight, as photometry/render.py states it.
uniform sampler2D u_position;   // per cell: x, y, z; w is 1 where there is a landmark
uniform sampler2D u_normal;     // per cell: normal, and albedo
uniform sampler2D u_lit;        // per cell: 1 where no ground hides the Sun
uniform vec3 u_sun;             // unit vector
uniform vec3 u_center;          // of the camera
uniform int u_around;           // cells on each side over which shadows are averaged; -1: no shadows are cast
out vec2 brightness;            // value and 1; both 0 where there is no landmark

float share_in_sunlight(ivec2 cell) {
    ivec2 last = textureSize(u_lit, 0) - 1;
    vec2 total = vec2(0.0);
    for (int i = -u_around; i <= u_around; i++) {
        for (int j = -u_around; j <= u_around; j++) {
            ivec2 at = cell + ivec2(j, i);
            if (all(greaterThanEqual(at, ivec2(0))) && all(lessThanEqual(at, last))) {
                float there = texelFetch(u_position, at, 0).w;
                total += there * vec2(texelFetch(u_lit, at, 0).r, 1.0);
            }
        }
    }
    return total.x / total.y;
}

void main() {
    ivec2 cell = ivec2(gl_FragCoord.xy);
    vec4 position = texelFetch(u_position, cell, 0);
    brightness = vec2(0.0);
    if (position.w == 0.0) {
        return;
    }
    vec4 normal = texelFetch(u_normal, cell, 0);
    vec3 to_camera = normalize(u_center - position.xyz);
    float phase = atan(length(cross(u_sun, to_camera)), dot(u_sun, to_camera));
    float value = normal.w * reflectance(dot(u_sun, normal.xyz), dot(to_camera, normal.xyz), phase);
    if (u_around >= 0 && value > 0.0) {
        value *= share_in_sunlight(cell);
    }
    brightness = vec2(value, 1.0);
}

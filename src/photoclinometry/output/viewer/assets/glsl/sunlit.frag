// Which vertices nothing hides from the Sun: those that are no lower than the surface that the Sun sees there.
uniform sampler2D u_position;   // per cell: x, y, z; w is 1 where there is a vertex
uniform sampler2D u_normal;     // per cell: normal, and albedo
uniform sampler2D u_heights;    // sun_heights.frag's
uniform mat3 u_sun_from_local;
uniform float u_radius;
out vec4 lit;

const float STEEPEST = 10.0;    // tangent of incidence beyond which ground is dark anyway: 84 degrees

void main() {
    ivec2 cell = ivec2(gl_FragCoord.xy);
    vec4 position = texelFetch(u_position, cell, 0);
    lit = vec4(position.w);
    if (position.w == 0.0) {
        return;
    }
    vec3 seen = u_sun_from_local * position.xyz;
    float cosine = (u_sun_from_local * texelFetch(u_normal, cell, 0).xyz).z;
    float side = float(textureSize(u_heights, 0).x);
    vec2 texel = (0.5 + 0.5 * seen.xy / u_radius) * side - 0.5;
    ivec2 first = ivec2(floor(texel));
    vec2 part = texel - floor(texel);
    // Within a texel heights differ by its size times the tangent of incidence.
    float tangent = min(sqrt(max(1.0 - cosine * cosine, 0.0)) / max(cosine, 1e-3), STEEPEST);
    float margin = 2.0 * u_radius / side * (1.0 + 1.5 * tangent);
    float sum = 0.0;
    for (int i = 0; i < 2; i++) {
        for (int j = 0; j < 2; j++) {
            float there = texelFetch(u_heights, first + ivec2(j, i), 0).r;
            float weight = (j == 0 ? 1.0 - part.x : part.x) * (i == 0 ? 1.0 - part.y : part.y);
            sum += seen.z + margin >= there ? weight : 0.0;
        }
    }
    lit = vec4(sum);
}

// The surface as seen from the Sun, by parallel rays.
uniform sampler2D u_position;
uniform mat3 u_sun_from_local;  // rows: across, across, towards the Sun
uniform float u_radius;         // of a sphere about the origin that holds the surface
in uint a_cell;
out float v_height;

void main() {
    int columns = textureSize(u_position, 0).x;
    vec3 seen = u_sun_from_local * texelFetch(u_position, ivec2(int(a_cell) % columns, int(a_cell) / columns), 0).xyz;
    v_height = seen.z;
    gl_Position = vec4(seen.xy / u_radius, -seen.z / u_radius, 1.0);
}

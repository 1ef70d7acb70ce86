// Values of the landmarks, and where there is none that of the nearest one.
uniform sampler2D u_values;   // per cell: value times weight, and weight
uniform sampler2D u_nearest;  // per cell: column and row of the nearest landmark's
out float value;

void main() {
    vec2 sums = texelFetch(u_values, ivec2(texelFetch(u_nearest, ivec2(gl_FragCoord.xy), 0).rg), 0).rg;
    value = sums.x / sums.y;
}

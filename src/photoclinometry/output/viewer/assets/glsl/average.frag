// A Gaussian along rows or columns of the grid, of value and weight: the quotient of both sums is the average.
uniform sampler2D u_values;  // per cell: value times weight, and weight
uniform ivec2 u_along;       // (1, 0) or (0, 1)
uniform float u_sigma;       // [cells]
out vec2 sums;

const float TRUNCATE = 4.0;  // of the Gaussian [standard deviations], as SciPy's

void main() {
    ivec2 cell = ivec2(gl_FragCoord.xy);
    ivec2 last = textureSize(u_values, 0) - 1;
    int radius = int(TRUNCATE * u_sigma + 0.5);
    sums = vec2(0.0);
    for (int i = -radius; i <= radius; i++) {
        ivec2 at = cell + i * u_along;
        if (all(greaterThanEqual(at, ivec2(0))) && all(lessThanEqual(at, last))) {
            sums += exp(-0.5 * float(i * i) / (u_sigma * u_sigma)) * texelFetch(u_values, at, 0).rg;
        }
    }
}

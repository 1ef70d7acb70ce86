// What the picture shows at a pixel: value, shade, column and row of the grid plus 1 (0: no ground).
uniform int u_closed;  // 1: cells are vertices of a closed surface, between which there are no columns and rows
uniform int u_smooth;  // 1: values are those of a spline, and none is negative
uniform sampler2D u_coefficients;  // of that spline (spline.frag)
uniform vec2 u_factors;            // value shown = x * value + y
in vec4 v_surface;
flat in vec2 v_vertex;
out vec4 surface;

vec4 weights(float t) {
    float s = 1.0 - t;
    return vec4(s * s * s, 4.0 - 3.0 * t * t * (1.0 + s), 4.0 - 3.0 * s * s * (1.0 + t), t * t * t) / 6.0;
}

float spline_at(vec2 place) {
    vec2 cell = max(place, vec2(0.0));  // rounding may leave the grid
    ivec2 first = ivec2(cell);
    vec4 across = weights(fract(cell.x));
    vec4 down = weights(fract(cell.y));
    vec4 rows;
    for (int i = 0; i < 4; i++) {
        vec4 row;
        for (int j = 0; j < 4; j++) {
            row[j] = texelFetch(u_coefficients, first + ivec2(j, i), 0).r;
        }
        rows[i] = dot(across, row);
    }
    return dot(down, rows);
}

void main() {
    surface = u_closed == 1 ? vec4(v_surface.xy, v_vertex) : v_surface;
    if (u_smooth == 1) {
        surface.x = u_factors.x * max(spline_at(v_surface.zw - 1.0), 0.0) + u_factors.y;
    }
}

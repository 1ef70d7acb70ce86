// What the picture shows at a pixel: value, shade, column and row of the grid plus 1 (0: no ground).
uniform int u_closed;  // 1: cells are vertices of a closed surface, between which there are no columns and rows
in vec4 v_surface;
flat in vec2 v_vertex;
out vec4 surface;

void main() {
    surface = u_closed == 1 ? vec4(v_surface.xy, v_vertex) : v_surface;
}

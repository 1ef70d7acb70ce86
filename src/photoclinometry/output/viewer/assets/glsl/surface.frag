// What the picture shows at a pixel: value, shade, column and row of the grid plus 1 (0: no ground).
in vec4 v_surface;
out vec4 surface;

void main() {
    surface = v_surface;
}

// Height towards the Sun of the surface that is nearest to it.
in float v_height;
out vec4 height;

void main() {
    height = vec4(v_height, 0.0, 0.0, 0.0);
}

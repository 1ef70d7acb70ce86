// Coefficients of the cubic spline through the values of a grid, along its rows or columns (Unser 1999,
// doi:10.1109/79.799930); beyond the edges values repeat. Along these there is one coefficient more at the beginning, and
// two at the end: a place on the last cell asks for them.
uniform sampler2D u_values;
uniform ivec2 u_along;       // (1, 0) or (0, 1)
out float coefficient;

const float POLE = -0.26794919;  // sqrt(3) - 2
const float GAIN = 1.7320508;    // sqrt(3)
const int TAPS = 7;              // POLE^7 is a ten-thousandth

void main() {
    ivec2 cell = ivec2(gl_FragCoord.xy) - u_along;
    ivec2 last = textureSize(u_values, 0) - 1;
    coefficient = 0.0;
    float weight = GAIN;
    for (int i = 0; i <= TAPS; i++) {
        for (int side = i == 0 ? 1 : -1; side <= 1; side += 2) {
            coefficient += weight * texelFetch(u_values, clamp(cell + side * i * u_along, ivec2(0), last), 0).r;
        }
        weight *= POLE;
    }
}

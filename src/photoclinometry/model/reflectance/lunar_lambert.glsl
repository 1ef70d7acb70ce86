// Lambert's and Lommel and Seeliger's laws mixed by a weight g: lunar_lambert.py has the equations.
float lunar_lambert(float mu0, float mu, float phase, float g) {
    return (1.0 - g) * mu0 + g * 2.0 * mu0 / (mu0 + mu);
}

float mcewen(float mu0, float mu, float phase) {
    return lunar_lambert(mu0, mu, phase, exp(-phase * DEG / 60.0));
}

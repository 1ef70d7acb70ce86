// Minnaert's disk function of exponent g: minnaert.py has the equation.
float minnaert(float mu0, float mu, float phase, float g) {
    return exp(g * log(mu0) + (g - 1.0) * log(mu));
}

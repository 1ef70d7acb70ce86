// Phase functions of parameters p[at], p[at + 1], ...: phase_functions.py has the equations.
float polynomial(int at, float phase) {
    float value = 0.0;
    for (int i = p_count - 1; i >= at; i--) {
        value = value * phase + p[i];
    }
    return value * phase + 1.0;
}

float magnitudes(int at, float phase) {
    return exp(-0.4 * log(10.0) * phase * (p[at] + phase * (p[at + 1] + phase * p[at + 2])));
}

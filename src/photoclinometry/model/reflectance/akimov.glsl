// Akimov's disk function with a phase weight g: akimov.py has the equation. Finite at limb and terminator.
float akimov(float mu0, float mu, float phase, float g) {
    float sine = max(sin(phase), PHASE_FLOOR);
    float k = PI / (PI - phase);
    float t = (mu0 - mu * cos(phase)) / sine;
    float across = mu * mu + t * t;
    float delta = atan(mu, t);
    float quotient = sin(k * delta) * sqrt(across) / mu;
    return cos(0.5 * phase) * quotient * exp(0.5 * g * (k - 1.0) * log(across));
}

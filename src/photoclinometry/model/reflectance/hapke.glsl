// Hapke's bidirectional reflectance over that at mu0 = mu = 1, phase = 0: hapke.py has the equations.
// p[1] to p[6]: w, theta, b, c, B0, h; p[7]: the value that all is over.
const float HAPKE_FLOOR = 1e-6;  // of cosines and sines that something is divided by, in single precision

float hapke_h(float x, float gamma) {
    return (1.0 + 2.0 * x) / (1.0 + 2.0 * gamma * x);
}

// Effective cosines mu0e, mue and the shadowing factor S (Hapke 1984).
vec3 hapke_roughness(float mu0, float mu, float phase, float theta) {
    if (theta <= 0.0) {
        return vec3(mu0, mu, 1.0);
    }
    float sin_i = sqrt(max(1.0 - mu0 * mu0, HAPKE_FLOOR * HAPKE_FLOOR));
    float sin_e = sqrt(max(1.0 - mu * mu, HAPKE_FLOOR * HAPKE_FLOOR));
    float tan_theta = tan(theta);
    float cotangent = 1.0 / tan_theta;
    float chi = inversesqrt(1.0 + PI * tan_theta * tan_theta);
    float cos_psi = clamp((cos(phase) - mu0 * mu) / (sin_i * sin_e), -1.0, 1.0);
    float psi = acos(cos_psi);
    float half2 = 0.5 * (1.0 - cos_psi);
    float cot_i = mu0 / sin_i;
    float cot_e = mu / sin_e;
    float e1_i = exp(-2.0 / PI * cotangent * cot_i);
    float e1_e = exp(-2.0 / PI * cotangent * cot_e);
    float e2_i = exp(-pow(cotangent * cot_i, 2.0) / PI);
    float e2_e = exp(-pow(cotangent * cot_e, 2.0) / PI);
    float eta_i = chi * (mu0 + sin_i * tan_theta * e2_i / (2.0 - e1_i));
    float eta_e = chi * (mu + sin_e * tan_theta * e2_e / (2.0 - e1_e));
    float f = half2 >= 1.0 ? 0.0 : exp(-2.0 * sqrt(half2 / (1.0 - half2)));
    float mu0e;
    float mue;
    float last;
    if (mu0 >= mu) {  // incidence <= emission
        float below = 2.0 - e1_e - psi / PI * e1_i;
        mu0e = chi * (mu0 + sin_i * tan_theta * (cos_psi * e2_e + half2 * e2_i) / below);
        mue = chi * (mu + sin_e * tan_theta * (e2_e - half2 * e2_i) / below);
        last = mu0 / eta_i;
    } else {
        float below = 2.0 - e1_i - psi / PI * e1_e;
        mu0e = chi * (mu0 + sin_i * tan_theta * (e2_i - half2 * e2_e) / below);
        mue = chi * (mu + sin_e * tan_theta * (cos_psi * e2_i + half2 * e2_e) / below);
        last = mu / eta_e;
    }
    float shadowing = mue / eta_e * mu0 / eta_i * chi / (1.0 - f + f * chi * last);
    return vec3(max(mu0e, HAPKE_FLOOR), max(mue, HAPKE_FLOOR), shadowing);
}

float hapke(float mu0, float mu, float phase) {
    float w = p[1];
    float b = p[3];
    float c = p[4];
    vec3 rough = hapke_roughness(mu0, mu, phase, p[2]);
    float cos_g = cos(phase);
    float backward = (1.0 - b * b) / pow(1.0 - 2.0 * b * cos_g + b * b, 1.5);
    float forward = (1.0 - b * b) / pow(1.0 + 2.0 * b * cos_g + b * b, 1.5);
    float particle = 0.5 * (1.0 + c) * backward + 0.5 * (1.0 - c) * forward;
    float surge = p[5] / (1.0 + tan(0.5 * phase) / p[6]);
    float gamma = sqrt(1.0 - w);
    float inner = (1.0 + surge) * particle + hapke_h(rough.x, gamma) * hapke_h(rough.y, gamma) - 1.0;
    return 0.25 * w * rough.x / (rough.x + rough.y) * inner * rough.z / p[7];
}

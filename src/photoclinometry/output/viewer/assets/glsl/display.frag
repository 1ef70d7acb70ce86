// The picture in colours: a layer, an image, both beside each other, or their difference.
uniform sampler2D u_surface;     // surface.frag's
uniform sampler2D u_colours;     // colour table, and below it that of differences
uniform sampler2D u_image;       // brightness of a view's pixels; MISSING where not valid
uniform sampler2D u_drawn;       // surface.frag's at the image's pixels, for differences
uniform int u_block;             // pixels of u_drawn per cell of u_image, across and down
uniform vec2 u_size;             // of the picture [px]
uniform vec4 u_image_from_screen; // cell of u_image = xy * pixel + zw
uniform vec2 u_limits;           // values at the colour table's ends
uniform vec2 u_image_limits;
uniform vec2 u_difference;       // 1 / mean brightness, and the limit of differences [-]
uniform float u_shading;         // share of the hillshade in colours
uniform float u_shade_mean;
uniform float u_contour;         // interval of contours [unit of values]; 0: none
uniform int u_compare;           // 0 map, 1 image, 2 swipe, 3 difference
uniform float u_swipe;           // [px]
out vec4 colour;

const vec3 NO_DATA = vec3(0.66, 0.71, 0.77);
const vec3 SKY = vec3(0.075, 0.09, 0.11);
const float MISSING = -1e29;     // values below are none
const int MAP = 0;
const int IMAGE = 1;
const int SWIPE = 2;
const int DIFFERENCE = 3;

vec3 from_table(float place, float row) {
    float last = float(textureSize(u_colours, 0).x - 1);
    float at = clamp(place, 0.0, 1.0) * last;
    int low = int(min(floor(at), last - 1.0));
    vec3 below = texelFetch(u_colours, ivec2(low, int(row)), 0).rgb;
    vec3 above = texelFetch(u_colours, ivec2(low + 1, int(row)), 0).rgb;
    return mix(below, above, at - float(low));
}

vec4 surface_at(ivec2 pixel) {
    return texelFetch(u_surface, clamp(pixel, ivec2(0), ivec2(u_size) - 1), 0);
}

float image_at(vec2 pixel) {
    vec2 cell = floor(u_image_from_screen.xy * pixel + u_image_from_screen.zw);
    vec2 size = vec2(textureSize(u_image, 0));
    bool outside = any(lessThan(cell, vec2(0.0))) || any(greaterThanEqual(cell, size));
    return outside ? -1e30 : texelFetch(u_image, ivec2(cell), 0).r;
}

float steps_of_contour(vec4 here, ivec2 pixel) {
    float found = 0.0;
    for (int i = 0; i < 2; i++) {
        vec4 next = surface_at(pixel + (i == 0 ? ivec2(1, 0) : ivec2(0, 1)));
        if (next.w > 0.0 && next.x > MISSING) {
            float level = max(floor(here.x / u_contour), floor(next.x / u_contour));
            bool crosses = floor(here.x / u_contour) != floor(next.x / u_contour);
            found = max(found, crosses ? (mod(level, 5.0) == 0.0 ? 1.0 : 0.55) : 0.0);
        }
    }
    return found;
}

vec3 map_colour(ivec2 pixel) {
    vec4 here = surface_at(pixel);
    if (here.w == 0.0) {
        return SKY;
    }
    if (here.x < MISSING) {
        return NO_DATA;
    }
    vec3 shown = from_table((here.x - u_limits.x) / (u_limits.y - u_limits.x), 0.0);
    float relief = clamp(0.35 + 0.65 * here.y / u_shade_mean, 0.0, 1.45);
    shown = clamp(shown * mix(1.0, relief, u_shading), 0.0, 1.0);
    return u_contour > 0.0 ? mix(shown, vec3(0.0), 0.8 * steps_of_contour(here, pixel)) : shown;
}

vec3 image_colour(float value) {
    float place = (value - u_image_limits.x) / (u_image_limits.y - u_image_limits.x);
    return value < MISSING ? SKY : vec3(clamp(place, 0.0, 1.0));
}

// At the cells of the image, where both are known. u_drawn has its rows from the bottom.
vec3 difference_colour(vec2 from_top) {
    ivec2 cell = ivec2(floor(u_image_from_screen.xy * from_top + u_image_from_screen.zw));
    ivec2 size = textureSize(u_drawn, 0);
    float value = image_at(from_top);
    if (value < MISSING || size != u_block * textureSize(u_image, 0)) {
        return SKY;
    }
    vec2 sum = vec2(0.0);
    for (int i = 0; i < u_block * u_block; i++) {
        ivec2 pixel = u_block * cell + ivec2(i % u_block, i / u_block);
        vec4 drawn = texelFetch(u_drawn, ivec2(pixel.x, size.y - 1 - pixel.y), 0);
        sum += drawn.w == 0.0 || drawn.x < MISSING ? vec2(0.0) : vec2(drawn.x, 1.0);
    }
    float off = sum.x / sum.y - value;
    return sum.y == 0.0 ? SKY : from_table(0.5 + 0.5 * off * u_difference.x / u_difference.y, 1.0);
}

void main() {
    // Rows of the picture count downwards, those of the graphics processor upwards.
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 from_top = vec2(gl_FragCoord.x, u_size.y - gl_FragCoord.y);
    bool of_image = u_compare == IMAGE || (u_compare == SWIPE && from_top.x < u_swipe);
    vec3 shown;
    if (u_compare == MAP) {
        shown = map_colour(pixel);
    } else if (u_compare == DIFFERENCE) {
        shown = difference_colour(from_top);
    } else {
        shown = of_image ? image_colour(image_at(from_top)) : map_colour(pixel);
    }
    bool on_edge = u_compare == SWIPE && abs(from_top.x - u_swipe) < 1.0;
    colour = vec4(on_edge ? vec3(1.0, 0.8, 0.2) : shown, 1.0);
}

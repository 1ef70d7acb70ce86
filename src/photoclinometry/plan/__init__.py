"""What a map would have before its images are taken: a representative map of a place, and what one more image adds."""

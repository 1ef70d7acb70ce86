"""Products of a finished shape model: meshes, SPC's and SPICE's models, maps, planes, gravity and mass properties."""

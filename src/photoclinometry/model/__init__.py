"""The data model: cameras, views, landmarks and tracks; geometry and reflectance."""

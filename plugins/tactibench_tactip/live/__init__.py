"""A model that watches the camera: loop latency, pictures."""

"""The camera: fresh frames with the time at which they were taken."""

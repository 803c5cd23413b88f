"""Collecting a data set, press by press."""

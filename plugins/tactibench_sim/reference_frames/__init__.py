"""The finite-element scenes that ship, as sensors for tests.

No frame that a model learns from is made here: the core keeps this folder out of the identity of
the other sensors' frames.
"""

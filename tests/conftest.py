"""Settings that hold for every test."""

from hypothesis import settings

# The first example of a kernel compiles it: time per example says nothing.
settings.register_profile("kernels", deadline=None)
settings.load_profile("kernels")

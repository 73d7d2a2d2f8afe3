"""Settings that hold for every test."""

from hypothesis import HealthCheck, settings

# The first example of a kernel compiles it, and the machine may be busy: the time of an example says nothing.
settings.register_profile("kernels", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("kernels")

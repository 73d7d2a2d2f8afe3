"""The package's version, read by the build as well as by results that carry it."""

__version__ = "0.32.0"

"""Compile numeric kernels, call them, and share them between threads and processes."""

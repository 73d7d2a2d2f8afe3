"""What compiles kernels, calls them and shares them between threads and processes."""

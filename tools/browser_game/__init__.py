"""Build the page that plays without a server: kernels as WebAssembly, prepared maps, and the page's own modules."""
